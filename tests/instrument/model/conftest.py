"""What is left out where the kernels are interpreted, so that coverage can see their branches (`make coverage`)."""

from __future__ import annotations

from fnmatch import fnmatchcase

import numba
import pytest

LONG = (
    "test_bodies.py::test_a_curved_path_in_the_plane*",
    "test_bodies.py::test_a_finer_tolerance*",
    "test_bodies.py::test_the_tolerance_is_kept*",
    "test_projection.py::test_a_load_that_alternates*100000*",
    "test_closed_forms.py::test_a_segment_climbs*-0.0004]",
    "test_closed_forms.py::test_a_segment_climbs*0.0-0.004]",
    "test_closed_forms.py::test_many_periods*",
    "test_elements.py::test_a_heterogeneous_segment*",
    "test_elements.py::test_a_segment_is_as_accurate*",
    "test_elements.py::test_elements_override*",
    "test_elements.py::test_random_homogeneous*",
    "test_elements.py::test_two_segments*",
    "test_elements.py::test_very_unequal*",
    "test_elements.py::test_where_the_body_stands*",
    "test_elements.py::test_short_waves*",
    "test_elements.py::test_waves_along*",
    "test_exact_cases.py::*1000.0*",
    "test_exact_cases.py::test_catch_up_converges*",
    "test_long_blocks.py::test_runs_take*",
    "test_long_blocks.py::test_random_chains*[[]??]",
    "test_hard_cases.py::*0000 contacts*",
    "test_hard_cases.py::*0000 elements*",
    "test_hard_cases.py::*A grid*",
    "test_hard_cases.py::*A segment with friction*",
    "test_hard_cases.py::*A ladder*",
    "test_hard_cases.py::*A ring with*",
    "test_hard_cases.py::*Random ramps*",
    "test_hard_cases.py::*Random segments*",
    "test_hard_cases.py::*hybrid*",
    "test_hard_cases.py::*periods of*",
    "test_hard_cases.py::*split in 1000-*",
    "test_hard_cases.py::test_at_rest_for_a_million*",
    "test_hard_cases.py::test_long_chains*100000*",
    "test_laws.py::*hybrid*",
    "test_laws.py::*segment on patches-*",
    "test_laws.py::*plane, discs-*",
    "test_limits.py::test_a_long_transient*",
    "test_limits.py::test_more_tow_never*[1-9]?",
    "test_loads.py::test_loads_along_a_segment*",
    "test_many.py::test_a_row_is*hybrid*",
    "test_many.py::test_a_row_is*segment*",
    "test_many.py::test_a_row_of_a_segment*-101]",
    "test_many.py::test_a_variation_is*hybrid*",
    "test_many.py::test_ctrl_c_keeps*",
    "test_many.py::test_elements_stay*",
    "test_many.py::test_long_runs*",
    "test_many.py::test_the_rate_of_exact*hybrid*",
    "test_patches.py::test_a_patch_far_away*hybrid*",
    "test_planar_kernel.py::test_a_resting_body*",
    "test_planar_kernel.py::test_error_and_energy*0]",
    "test_planar_loads.py::test_a_load_on_all_contacts*",
    "test_planar_loads.py::test_random_ramps*",
    "test_planar_loads.py::test_the_energy_balance*",
    "test_planar_stiff.py::test_forces_of*",
    "test_planar_stiff.py::test_stiff_ramps*",
    "test_planar_tolerance.py::test_random_ramps*",
    "test_scene.py::test_every_gallery_scene*segment*",
    "test_scene.py::test_every_gallery_scene*hybrid*",
    "test_cycle.py::test_a_gait*continuous*",
    "test_sensitivities.py::test_random_crawlers*[[]??]",
    "test_sensitivities.py::test_random_crawlers*[[][0379]]",
    "test_scene.py::test_the_scenes_of_the_docs*trunk_and_foot*",
    "test_turning_laws.py::test_a_body_that_creeps*",
)
"""Tests that take seconds to hours with interpreted kernels; whatever only they would reach has a shorter test."""


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if not numba.config.DISABLE_JIT:
        return
    names = {item: f"{item.path.name}::{item.nodeid.partition('::')[2]}" for item in items}
    left_out = [item for item in items if any(fnmatchcase(names[item], name) for name in LONG)]
    config.hook.pytest_deselected(items=left_out)
    items[:] = [item for item in items if item not in set(left_out)]
