"""docs/phase_diagram.py: the gallery's map of the strategies, on a few cells."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from PIL import Image

SCRIPT = Path(__file__).parent.parent.parent / "docs" / "phase_diagram.py"


@pytest.fixture(scope="module")
def diagram():
    spec = importlib.util.spec_from_file_location("phase_diagram", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def gains(diagram, strategy: str, shift: list[float]) -> np.ndarray:
    amplitude = np.array([1.5, 2.5, 4.0, 6.0])
    runs = diagram.run_map(strategy, amplitude, np.array(shift))
    return runs.per_period.reshape(len(shift), amplitude.size)


def test_friction_half_a_period_late_drives_the_body_back_as_far(diagram):
    for strategy in "ABC":
        early, late = gains(diagram, strategy, [-0.3, -0.1]), gains(diagram, strategy, [0.2, 0.4])
        np.testing.assert_allclose(late, -early, atol=1e-12)
        assert np.abs(late).max() > 0.5


def test_strategy_b_is_strategy_a_a_quarter_late(diagram):
    np.testing.assert_allclose(gains(diagram, "B", [-0.1, 0.1]), gains(diagram, "A", [0.15, 0.35]), atol=1e-12)


def test_strategy_a_gains_most_a_fifth_of_a_period_late(diagram):
    earlier, best, later = gains(diagram, "A", [0.19, 0.2, 0.21])[:, 2]
    assert best == pytest.approx(2.8, abs=1e-12)
    assert best > max(earlier, later)


def test_it_draws(diagram, tmp_path):
    diagram.main(tmp_path / "map.png", cells=8)
    assert Image.open(tmp_path / "map.png").size == (1200, 780)
