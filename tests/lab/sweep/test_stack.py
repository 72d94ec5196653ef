"""Variations assembled together: to the bit the scenes assembled one by one, with the same message for each invalid
one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_lab import vary
from crawler_lab.sweep import stack as stacks
from crawler_lab.sweep.stack import Stack, stack
from crawler_model import Scene, SceneError, load_scene
from crawler_model.scene.assemble import assemble_together
from tests.scenes import NOT_TURNING

ON_PATCHES = ("friction_step", "hill_top", "ice")
BENT = ("peristaltic_stops", "rubber_worm", "silicone_chain", "stalling_inchworm", "tendon_worm")
ALONE = (*ON_PATCHES, *BENT, "leaving_ice", "wall_pusher", "worm_in_a_tube")
LINES = [name for name in NOT_TURNING if not name.startswith("planar") and name not in ALONE]
KEYS = (
    "body.links.stiffness",
    "body.links.stiffness[0]",
    "body.weights",
    "body.weights[0]",
    "body.segments.0.stiffness",
    "body.segments.0.friction.forward",
    "body.segments.0.friction.coefficient.backward",
    "friction.isotropic",
    "friction.forward",
    "friction.backward[0]",
    "friction.coefficient.isotropic",
    "friction.coefficient.forward[1]",
    "loads",
    "loads[0]",
    "ground.slope",
    "start.displacement.0",
    "start.displacement.1",
    "drive.length",
    "drive.friction",
    "drive.friction.isotropic.1.0",
    "drive.period",
    "drive.times[1]",
    "drive.actuation[1]",
    "drive.actuation[1][0]",
    "drive.wave.amplitude",
    "drive.wave.mean",
    "drive.wave.wavelength",
    "drive.friction_wave.amplitude",
    "drive.friction_wave.mean",
    "drive.friction_wave.wavelength",
)
OTHERS = {"drive.wave.period": "peristaltic_segment", "drive.wave.samples": "ten_contact_wave"}


def prepared(name: str, relaxed: bool) -> Scene:
    """A scene of the gallery with weights, and with few elements."""
    document: dict[str, Any] = load_scene(name).document()
    for segment in document["body"].get("segments", ()):
        segment["elements"] = 13
    document["body"].setdefault("weights", 0.01)
    return Scene.model_validate(document | ({"start": "relaxed"} if relaxed else {}))


def number(scene: Scene, key: str) -> float:
    node: Any = scene.document()
    for step in stacks_path(scene, key):
        try:
            node = node[step]
        except (KeyError, TypeError, IndexError):
            return 0.1
    while isinstance(node, list):
        node = node[0]
    return float(node)


def stacks_path(scene: Scene, key: str) -> tuple[Any, ...]:
    return vary(scene, {key: [1.0]}).paths[0]


def check(together: Stack, variations: Any) -> int:
    """Compare each variation with its scene; return how many are valid."""
    valid = 0
    for i in range(len(variations)):
        if i in together.reasons:
            with pytest.raises(SceneError) as error:
                variations[i]
            assert together.reasons[i] == str(error.value)
            continue
        one = variations[i]
        valid += 1
        own = one.drive.targets.shape[1]
        np.testing.assert_array_equal(together.stiffness[i], one.body.stiffness)
        np.testing.assert_array_equal(together.targets[i, :, :own], one.drive.targets)
        assert not together.targets[i, :, own:].any()  # loads of a slope that this one does not have
        np.testing.assert_array_equal(together.times[i], one.drive.times)
        np.testing.assert_array_equal(together.start[i], one.start_displacement)
        np.testing.assert_array_equal(together.assembly.ground.weight[i], one.ground.weight)
        assert together.length[i] == np.ptp(one.body.position)
        assert (together.period is None) == (one.drive.period is None)
        if together.period is not None:
            assert together.period[i] == one.drive.period
    return valid


@pytest.mark.parametrize("relaxed", [False, True])
@pytest.mark.parametrize("name", LINES)
def test_a_stack_is_its_scenes_to_the_bit(name, relaxed):
    base = prepared(name, relaxed)
    rng = np.random.default_rng(5)
    met = 0
    for key in KEYS:
        try:
            now = number(base, key)
        except SceneError:  # this scene has no such key
            continue
        values = [now, 0.0, -1.0, *(now + 0.02 * (abs(now) or 1.0) * rng.normal(size=4))]
        variations = vary(base, {key: values})
        assert stacks.shares_mesh(variations.base, variations.paths)
        met += check(stack(variations), variations)
    assert met > 30


@pytest.mark.parametrize("name", ALONE)
def test_bent_springs_patches_and_walls_are_assembled_scene_by_scene(name):
    variations = vary(load_scene(name), {"body.weights": [0.1, 0.2]})
    assert not stacks.shares_mesh(variations.base, variations.paths)


def test_several_keys_vary_together():
    base = prepared("segment_climber", True)
    keys = {"body.segments.0.stiffness": [1.0, 2.0], "ground.slope": [0.0, 2.0, 95.0], "body.weights": [0.02, -0.1]}
    variations = vary(base, keys)
    assert check(stack(variations), variations) == 4
    part = stack(variations).select(np.array([0, 3, 5]))
    assert len(part) == 3
    np.testing.assert_array_equal(part.targets, stack(variations).targets[[0, 3, 5]])
    assert part.reasons == {1: stack(variations).reasons[3], 2: stack(variations).reasons[5]}


def test_loads_that_springs_must_hold_at_the_start():
    base = prepared("slope_climber", True)
    variations = vary(base, {"loads[0]": np.linspace(-2.0, 2.0, 41)})
    assert 5 < check(stack(variations), variations) < 41


@pytest.mark.parametrize("key", OTHERS)
def test_keys_that_no_array_follows_are_assembled_one_by_one(key):
    base = prepared(OTHERS[key], False)
    now = number(base, key) if key.endswith("period") else 16.0
    variations = vary(base, {key: [now, -1.0, now]})
    assert not stacks.shares_mesh(variations.base, variations.paths)
    together = stack(variations)
    assert list(together.reasons) == [1]
    assert check(together, variations) == len(variations) - 1


def test_contacts_may_move_but_not_be_joined_otherwise():
    base = load_scene("three_springs")
    moved = vary(base, {"body.contacts[2]": [0.3, 0.4]})
    assert check(stack(moved), moved) == 2
    with pytest.raises(SceneError, match="variations 0 and 1 differ in their contacts, springs or columns"):
        stack([base, load_scene("two_anchor_a")])
    with pytest.raises(SceneError, match="differ"):
        stack([load_scene("planar_rectilinear")] * 2 + [load_scene("planar_three_points")])
    with pytest.raises(SceneError, match="no variation is valid; the reason of the first: body"):
        stack(vary(base, {"body.contacts[2]": [-1.0]}))


def test_numbers_outside_of_their_bounds_are_assembled_on_request():
    base = prepared("two_contacts_anisotropic", False)
    h = 1e-3
    for key, column in (("friction.forward[0]", 1), ("loads[1]", -1)):
        together = stack(vary(base, {key: [-1.0 - h, -1.0 + h]}), check=False)
        assert not together.reasons
        slope = (together.targets[1] - together.targets[0]) / (2.0 * h)
        assert slope[:, column] == pytest.approx(1.0, rel=1e-12)


def test_what_may_be_invalid_is_a_superset_of_what_is():
    base = prepared("two_contacts_anisotropic", False)
    parts = base.parts.model_copy(update={"loads": np.array([[0.0], [np.inf], [0.0]])})
    _, doubts = assemble_together(parts, base, 3)
    assert doubts.tolist() == [False, True, False]


def test_the_period_of_one_variation_is_a_number():
    whole = stack(vary(load_scene("three_contacts_one_way"), {"drive.period": [1.0, 2.0]}))
    periods = [whole.assembly.variation(i).drive.period for i in range(2)]
    assert periods == [1.0, 2.0]
    assert all(type(period) is float for period in periods)
