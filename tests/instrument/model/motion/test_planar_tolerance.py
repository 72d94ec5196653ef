"""Ramps in the plane end within the tolerance of where they lead, whatever starts, stops or turns on the way."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import numpy as np
import pytest

from crawler_model import Crawler, Scene
from crawler_model.compiled import compiled
from crawler_model.motion.account import EVENTS
from crawler_model.motion.plane.walk import _missed

from ..planar_ramps import Planar, on_a_line, random_line
from ..planar_reference import Reference
from ..planar_stage import CROSS, DISC, Rig, Step, command_of, frame_of

PAIR = np.array([[0, 1]])


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-7])
@pytest.mark.parametrize("angle", [0.0, 2.3])
@pytest.mark.parametrize("corners", [0, 4, 6])
def test_contacts_that_exchange_roles_inside_a_ramp(tolerance, angle, corners):
    assert on_a_line([2], [1, 2], [([4], [1, 0.5])], tolerance, angle, corners) <= 1.0
    constant = [1, 0.75, 1.5]
    assert on_a_line([0.5, 2], constant, [([-3, -1.75], constant)], tolerance, angle, corners) <= 1.0


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-7])
@pytest.mark.parametrize("corners", [0, 6])
def test_random_ramps_of_a_line_in_the_plane(tolerance, corners):
    for seed in range(60):
        assert random_line(seed, tolerance, corners) <= 1.0, seed


@functools.cache
def planar(directional):
    return [Planar(seed, directional) for seed in (range(8) if not directional else range(25))]


@pytest.mark.parametrize("tolerance", [1e-2, 1e-4, 1e-6, 1e-7])
@pytest.mark.parametrize("directional", [False, True])
def test_random_ramps_in_two_dimensions(tolerance, directional):
    for number, ramps in enumerate(planar(directional)):
        assert ramps.error(tolerance) <= 1.0, number


@pytest.mark.parametrize("directions", [DISC, CROSS], ids=["discs", "polygons"])
def test_the_next_event_is_foreseen(directions):
    """Two contacts with k = 1 are pushed apart by 1 N along the ramp: one starts on the way, or none."""
    each = max(len(directions), 1)
    for growth, gain, parts in ((0.0, 0.5, 2), (0.3, 0.2, 2), (0.6, 0.0, 1), (2.0, 0.0, 1)):
        body = Rig(np.repeat([[0.5], [2.0]], each, 1), directions, PAIR, [1.0])
        body.follow([[[1.0, 0.0]]], 1e-6, np.repeat([[0.5 + growth], [2.0]], each, 1))
        np.testing.assert_allclose(body.state.displacement, [[-gain, 0.0], [0.0, 0.0]], atol=1e-6)
        assert body.account[EVENTS] == parts


def test_a_force_that_leaves_its_disc_may_come_back():
    """From (0.5, 0) on a disc of 0.5 N, along (-1, 1): the chord ends at (0, 0.5), where the contact starts."""
    friction, lengths = [[0.5], [2.0]], np.array([[[-0.5, 0.0]], [[0.0, -0.5]], [[0.5, -1.0]]])
    body, reference = Rig(friction, DISC, PAIR, [1.0]), Reference(PAIR, [1.0], friction)
    places = body.follow(lengths, 1e-6)[:, :4].reshape(-1, 2, 2)
    assert not places[:2].any()
    expected = [reference.ramp(length) for length in lengths][-1]
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(places[2], expected, atol=2e-6)
    whole = Rig(friction, DISC, PAIR, [1.0])
    whole.follow(lengths[::2], 1e-6)
    np.testing.assert_allclose(whole.state.displacement, expected, atol=2e-6)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5, 1e-6, 1e-7])
def test_contacts_that_leave_their_discs_and_return_on_the_other_side_start_there(tolerance):
    """All slide at the end of the first ramp and rest at the start of the way back."""
    body = {"contacts": [[1.3249, 2.0586], [2.4422, 0.9011], [2.5980, 1.3433]]}
    body["links"] = {"stiffness": [58.034546547364315, 18.480237677679494]}
    there = np.array([[0.0853672236262776, 0.0668841457591374], [0.10018454621095575, -0.21571879436628624]])
    places = []
    for value in (tolerance, 1e-9):
        document = {"name": "back", "dimension": 2, "tolerance": value, "body": body}
        document["friction"] = {"isotropic": 0.5030643384055251}
        document["drive"] = {"times": [0, 1], "actuation": [np.zeros((2, 2)).tolist(), there.tolist()]}
        crawler = Crawler(Scene.model_validate(document))
        crawler.advance(there)
        step = crawler.advance(0.0 * there)
        places.append(crawler.displacement)
    assert abs(step.certificate.energy_residual) < 1e-10
    assert np.abs(places[0] - places[1]).max() < tolerance * np.abs(there).max()


def test_rounding_of_short_displacements_does_not_shorten_parts():
    """A million parts followed at 1e-7, where a contact seemed to start within each of them."""
    document = json.loads((Path(__file__).parents[1] / "planar_hard_cases.json").read_text())["loaded_polygons"]
    for tolerance in (1e-6, 1e-7):
        crawler = Crawler(Scene.model_validate(document | {"tolerance": tolerance}))
        assert max(crawler.follow(target[None]).events for target in crawler.scene.drive.targets[1:]) < 100


@compiled
def missed(frame, way, moved, force, negligible):
    return _missed(frame, way[0], way[1], moved, force, negligible)


@pytest.mark.parametrize("directional", [False, True])
def test_a_step_is_never_further_off_than_it_says(directional):
    """One implicit step for the whole of a first ramp, against the path: the bound on the shape is one."""
    seen = 0
    for body in planar(directional):
        n = len(body.friction)
        if not (body.frictions == body.friction).all():
            continue
        directions = DISC if body.directions is None else body.directions
        frame = frame_of(body.ends, body.stiffness, n, directions)
        way = np.zeros((n, 2)), *(command_of(directions, length, body.friction) for length in body.lengths[:2])
        push = np.zeros((n, 2))
        for (a, b), k, longer in zip(body.ends, body.stiffness, body.lengths[1], strict=True):
            push[a] -= k * longer
            push[b] += k * longer
        moved, _ = Step(np.array(body.ends), body.stiffness, push, body.friction, directions).solve()
        bound = missed(frame, way, moved, np.zeros((n, 2)), 0.0)  # at rest there is no force
        off = moved - body.places[0]
        apart = np.hypot(*(off[:, None] - off[None]).transpose(2, 0, 1)).max()
        assert apart <= bound * (1.0 + 1e-9) + 1e-9
        seen += apart > 1e-3
    assert seen > 0
