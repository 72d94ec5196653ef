"""What a body holds at rest: the sums over all contacts, and the contact that gives way first."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crawler_model import Crawler, Scene, SceneError
from crawler_model.theory.holding import compute_holding


def pair(slope=0.0, loads=None, **friction):
    body = {"contacts": [0.0, 1.0], "links": {"stiffness": 2.0}, "weights": [1.0, 3.0]}
    document = {"name": "pair", "body": body, "friction": friction, "ground": {"slope": slope}, "start": "relaxed"}
    return Scene.model_validate(document | ({} if loads is None else {"loads": loads}))


def holding(scene):
    crawler = Crawler(scene)
    load = crawler.loads if crawler.loads.size else np.zeros(scene.body.contacts)
    return compute_holding(scene.body, scene.ground, crawler.tension, crawler.forward, crawler.backward, load)


COEFFICIENT = {"coefficient": {"forward": [0.2, 0.4], "backward": [0.8, 0.5]}}
FORCES = {"forward": [0.2, 1.2], "backward": [0.8, 1.5]}


@pytest.mark.parametrize("friction", [COEFFICIENT, FORCES], ids=["coefficients", "forces"])
@pytest.mark.parametrize("loads", [None, [0.1, -0.3]])
@pytest.mark.parametrize("own", [0.0, 7.0])
def test_beyond_the_steepest_slope_and_the_largest_tow_there_is_no_equilibrium(friction, loads, own):
    limits = holding(pair(own, loads, **friction))
    for sign, tilt in ((1.0, limits.uphill), (-1.0, limits.downhill)):
        angle = math.degrees(tilt.steepest)
        pair(sign * (angle - 1e-6), loads, **friction)
        with pytest.raises(SceneError, match="no equilibrium"):
            pair(sign * (angle + 1e-6), loads, **friction)
    least, most = ([0.0, 0.0] if loads is None else loads)[0], 0.0
    for tow, sign in ((limits.tow_forward, 1.0), (limits.tow_backward, -1.0)):
        most = [least + sign * tow * (1 - 1e-9), 0.0 if loads is None else loads[1]]
        pair(own, most, **friction)
        with pytest.raises(SceneError, match="no equilibrium"):
            pair(own, [least + sign * tow * (1 + 1e-9), most[1]], **friction)


def test_the_closed_form_of_coefficients():
    """W sin(theta) = sum c w cos(theta): the weighted mean of the coefficients is the tangent."""
    limits = holding(pair(**COEFFICIENT))
    assert limits.uphill.steepest == pytest.approx(math.atan((0.8 + 1.5) / 4.0), abs=1e-15)
    assert limits.downhill.steepest == pytest.approx(math.atan((0.2 + 1.2) / 4.0), abs=1e-15)
    assert (limits.uphill.contact, limits.downhill.contact) == (1, 0)
    assert limits.uphill.gives_way == pytest.approx(math.atan(0.5), abs=1e-15)
    assert limits.downhill.gives_way == pytest.approx(math.atan(0.2), abs=1e-15)


def test_only_friction_by_coefficient_becomes_less_on_a_slope():
    trunk = {"name": "t", "from": 2.0, "to": 3.0, "stiffness": 1.0, "friction": {"isotropic": 0.7}, "elements": 4}
    body = {"contacts": [0.0, 1.0], "segments": [trunk], "weights": [1.0, 1.0, 2.0]}
    body["links"] = {"stiffness": 1.0, "between": [[0, 1], [1, "t.from"]]}
    friction = {"coefficient": {"isotropic": 0.4}}
    scene = Scene.model_validate({"name": "m", "body": body, "friction": friction, "ground": {"slope": 5.0}})
    theta = holding(scene).uphill.steepest
    assert 4.0 * math.sin(theta) == pytest.approx(0.7 + 0.8 * math.cos(theta), abs=1e-14)


def test_a_drive_that_commands_friction_replaces_the_coefficients():
    rows = {"isotropic": [[0.4, 1.0], [0.4, 1.0]]}
    drive = {"times": [0.0, 1.0], "actuation": [[0.0], [0.0]], "friction": rows}
    scene = Scene.model_validate(pair(5.0, **COEFFICIENT).document() | {"drive": drive})
    assert holding(scene).uphill.steepest == pytest.approx(math.asin(1.4 / 4.0), abs=1e-14)


def test_more_friction_than_weight_holds_up_to_the_vertical():
    assert holding(pair(forward=5.0, backward=5.0)).uphill.steepest == math.pi / 2.0
    assert holding(pair(forward=5.0, backward=5.0)).uphill.gives_way == math.pi / 2.0


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1))
def test_a_tow_moves_its_contact_first_and_exactly_from_there(seed):
    rng = np.random.default_rng(seed)
    friction = {side: rng.uniform(0.2, 1.0, 3).tolist() for side in ("forward", "backward")}
    body = {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": rng.uniform(0.5, 2.0, 2).tolist()}}
    loads = rng.uniform(-0.1, 0.1, 3)
    start = {"displacement": [0.0, *rng.uniform(-0.03, 0.03, 2)]}
    document = {"name": "t", "body": body, "friction": friction, "loads": loads.tolist(), "start": start}
    scene = Scene.model_validate(document)
    limits = holding(scene)
    for contact in range(3):
        for sign, slip in ((1.0, limits.slip_forward), (-1.0, limits.slip_backward)):
            pull = np.eye(3)[contact] * sign * slip[contact]
            held, slipped = Crawler(scene), Crawler(scene)
            assert not held.advance([0.0, 0.0], loads=loads + pull * (1 - 1e-9)).velocity.any()
            moved = slipped.advance([0.0, 0.0], loads=loads + pull * (1 + 1e-6)).velocity
            assert np.flatnonzero(moved).tolist() == [contact]


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_the_contact_named_gives_way_first_when_the_track_is_tilted(way):
    document = pair(**COEFFICIENT).document() | {"start": {"displacement": [0.0, 0.05]}}
    tilt = holding(Scene.model_validate(document))
    tilt = tilt.uphill if way > 0.0 else tilt.downhill

    def slope(degrees):
        return Scene.model_validate(document | {"ground": {"slope": way * degrees}})

    slope(math.degrees(tilt.gives_way) - 1e-6)
    with pytest.raises(SceneError, match=f"start.displacement: contact {tilt.contact}"):
        slope(math.degrees(tilt.gives_way) + 1e-6)
