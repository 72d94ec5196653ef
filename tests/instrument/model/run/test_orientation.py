"""The orientation of a shape in the plane."""

from __future__ import annotations

import numpy as np
import pytest

from crawler_model import load_scene, simulate
from crawler_model.run.orientation import shape_orientation


@pytest.mark.parametrize("angle", [-3.0, -0.4, 0.0, 1e-6, 2.5])
def test_a_turned_moved_and_scaled_shape_has_its_angle(angle):
    rest = np.random.default_rng(1).normal(size=(7, 2))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    place = 1.7 * rest @ turn.T + [3.0, -5.0]
    assert shape_orientation(rest, np.stack((place - rest, 0.0 * rest))) == pytest.approx([angle, 0.0], abs=1e-14)


def test_it_is_the_polar_part_of_the_deformation():
    scipy = pytest.importorskip("scipy.linalg")
    rng = np.random.default_rng(2)
    rest, place = rng.normal(size=(5, 2)), rng.normal(size=(5, 2))
    rest_mean, place_mean = rest - rest.mean(axis=0), place - place.mean(axis=0)
    moment = place_mean.T @ rest_mean
    if np.linalg.det(moment) < 0.0:
        place_mean[:, 0] *= -1.0
        moment = place_mean.T @ rest_mean
    rotation, _ = scipy.polar(moment)
    assert shape_orientation(rest, place_mean - rest) == pytest.approx(np.arctan2(rotation[1, 0], rotation[0, 0]))


def test_equal_friction_and_symmetric_commands_turn_nothing():
    run = simulate(load_scene("planar_rectilinear"), 2.0, 50.0)
    assert shape_orientation(run.scene.body.position, run.displacement) == pytest.approx(0.0, abs=1e-9)
