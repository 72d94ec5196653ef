"""The steepest slope and the largest tow against which a period gains, compared with their closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from crawler_lab import vary
from crawler_model import CommandError, Scene, largest_tow, load_scene, simulate, steepest_climb
from crawler_model.run.limits import RESOLUTION

STIFFNESS, STROKE = 20.0, 0.1


def climber(forward=0.2, backward=0.8, stroke=STROKE, slope=0.0, **more):
    body = {"contacts": [0.0, 0.2], "links": {"stiffness": STIFFNESS}, "weights": 1.0}
    drive = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": [[0.0], [stroke], [0.0]]}
    document = {
        "name": "climber",
        "body": body,
        "friction": {"coefficient": {"forward": forward, "backward": backward}},
    }
    return Scene.model_validate(document | {"ground": {"slope": slope}, "drive": drive, "start": "relaxed"} | more)


def gain_of(scene):
    run = simulate(scene, 6.0)
    return float(run.per_period[-1])


@pytest.mark.parametrize("slope", [0.0, 12.0, 25.0, -5.0])
def test_friction_that_balances_ends_a_climb_whatever_the_slope_of_the_scene(slope):
    """C_plus cos + sin = c_minus cos - sin, at tan(theta) = (c_minus - c_plus) / 2; there it still gained."""
    limit = steepest_climb(climber(slope=slope))
    theta = math.atan(0.3)
    assert (limit.cause, limit.direction, limit.settled) == ("gain", 1, True)
    assert limit.value <= theta <= limit.beyond <= limit.value + RESOLUTION
    gain = STROKE - 2.0 * (0.2 * math.cos(theta) + math.sin(theta)) / STIFFNESS
    assert limit.gain == pytest.approx(gain, abs=1e-9)
    assert limit.free_gain == pytest.approx(STROKE - 0.4 / STIFFNESS, abs=1e-12)


def test_a_stroke_that_is_too_short_ends_a_climb_earlier():
    """D = 2 (c_plus cos + sin) / k: the gain has faded."""
    limit = steepest_climb(climber(stroke=0.03))
    theta = math.asin(0.3 / math.hypot(1.0, 0.2)) - math.atan(0.2)
    assert limit.value <= theta <= limit.beyond <= limit.value + RESOLUTION
    assert 0.0 < limit.gain < 1e-9


@pytest.mark.parametrize("forward", [True, False])
def test_the_tow_that_ends_a_walk_and_its_mirror_image(forward):
    """Only on the last contact: mu_plus + F = mu_minus of the other; gain D - (2 mu_plus + F) / k."""
    friction = (0.2, 0.5) if forward else (0.5, 0.2)
    scene = climber(*friction)
    limit = largest_tow(scene, -1 if forward else 0)
    assert limit.direction == (1 if forward else -1)
    assert limit.value <= 0.3 <= limit.beyond <= limit.value + RESOLUTION
    assert limit.gain == pytest.approx(STROKE - (0.4 + 0.3) / STIFFNESS, abs=1e-9)
    for force, moves in ((limit.value, True), (limit.beyond + RESOLUTION, False)):
        loads = [0.0, -force] if forward else [force, 0.0]
        gain = gain_of(Scene.model_validate(scene.document() | {"loads": loads}))
        assert (limit.direction * gain > 0.0) == moves


def test_a_payload_is_a_load_that_the_tow_adds_to():
    scene = climber(slope=5.0)
    f = math.sin(math.radians(5.0))
    plus, minus = (c * math.cos(math.radians(5.0)) for c in (0.2, 0.8))
    assert largest_tow(scene).value == pytest.approx(minus - f - (plus + f), abs=2e-9)


@pytest.mark.parametrize("search", [steepest_climb, largest_tow])
def test_what_does_not_travel_has_no_limit(search):
    for scene in (climber(0.5, 0.5), climber(stroke=0.015)):
        limit = search(scene)
        assert (limit.cause, limit.value, limit.direction, limit.gain) == ("no travel", 0.0, 0, 0.0)


def test_a_walk_can_last_until_the_equilibrium_ends():
    """Anchors of 3 and 0.1 N in turn, and an instant at which both are slippery: there 0.4 N is all that holds."""
    rows = [[3.0, 0.1], [3.0, 0.1], [0.2, 0.2], [0.1, 3.0], [0.1, 3.0], [0.2, 0.2], [3.0, 0.1]]
    times = [0.0, 0.4, 0.45, 0.5, 0.9, 0.95, 1.0]
    drive = {"times": times, "period": 1.0, "actuation": [[0], [1], [1], [1], [0], [0], [0]]}
    scene = climber(drive=drive | {"friction": {"isotropic": rows}})
    limit = largest_tow(scene)
    assert (limit.cause, limit.direction) == ("equilibrium", 1)
    assert limit.value == limit.beyond == pytest.approx(0.4, abs=1e-15)
    assert limit.gain > 0.1
    assert limit.gain == pytest.approx(
        gain_of(Scene.model_validate(scene.document() | {"loads": [0, -0.4 + 2e-9]})), abs=1e-6
    )
    climb = steepest_climb(scene)
    assert climb.cause == "equilibrium"
    assert climb.value == pytest.approx(math.asin(0.4 / 2.0), abs=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_more_tow_never_carries_a_body_further(seed):
    """The bisection relies on it, on chains and on other graphs."""
    rng = np.random.default_rng(seed)
    between = {} if seed % 2 else {"between": [[0, 1], [1, 2], [2, 3], [0, 2]]}
    links = 3 if seed % 2 else 4
    body = {"contacts": [0.0, 1.0, 2.0, 3.0], "links": {"stiffness": rng.uniform(0.5, 2.0, links).tolist(), **between}}
    rows = rng.uniform(0.0, 4.0, (4, links))
    rows[0] = 0.0
    drive = {"times": [0.0, 0.25, 0.5, 0.75, 1.0], "period": 1.0, "actuation": [*rows.tolist(), rows[0].tolist()]}
    friction = {side: rng.uniform(0.1, 0.6, 4).tolist() for side in ("forward", "backward")}
    document = {"name": "r", "body": body, "friction": friction, "drive": drive, "loads": 0.0, "start": "relaxed"}
    scene = Scene.model_validate(document)
    most = 0.9 * sum(friction["backward"])
    tows = np.linspace(-0.9 * sum(friction["forward"]), most, 25)
    gains = [gain_of(Scene.model_validate(document | {"loads": [0, 0, 0, -float(tow)]})) for tow in tows]
    assert (np.diff(gains) <= 1e-12).all()
    assert np.ptp(gains) > 0.1
    limit = largest_tow(scene)
    if limit.direction:
        inside = limit.direction * tows <= limit.value
        assert ((limit.direction * np.array(gains) > 1e-11) == inside).all()


def test_a_spent_budget_leaves_a_bracket_around_the_limit():
    scene = climber()
    free, short, whole = (largest_tow(scene, budget=n) for n in (4, 60, 10_000_000))
    assert (free.cause, free.direction, free.beyond) == ("budget", 0, math.inf)
    assert short.cause == "budget"
    assert short.value <= whole.value < whole.beyond <= short.beyond
    assert short.beyond - short.value > 1e-3
    assert short.periods * 2 * 2 <= 60
    assert steepest_climb(scene, budget=100).cause == "budget"


def test_progress_is_reported_and_grows():
    seen: list[float] = []
    steepest_climb(climber(), progress=seen.append)
    assert seen == sorted(seen)
    assert 0.0 <= seen[0] < 0.1
    assert 0.95 < seen[-1] <= 1.0


def test_a_long_transient_is_waited_for():
    """The gain belongs to the periodic regime, not to a first period from a tensioned start."""
    scene = load_scene("ten_contact_wave")
    limit = largest_tow(scene)
    assert limit.free_gain == pytest.approx(simulate(scene, 40.0).per_period[-1], abs=1e-12)


REFUSED = [
    (lambda: steepest_climb(load_scene("two_contacts_anisotropic")), "steepest_climb: the scene has no body.weights"),
    (lambda: steepest_climb(climber(drive=None)), "steepest_climb: climber has no drive with a period"),
    (lambda: largest_tow(load_scene("planar_rectilinear")), "largest_tow: only for bodies on a line"),
    (lambda: largest_tow(climber(), 2), "largest_tow: contact 2; it must be between -2 and 1"),
    (lambda: steepest_climb(climber(slope=20.0, loads=0.5)), "no equilibrium on level ground"),
]


@pytest.mark.parametrize(("call", "text"), REFUSED, ids=[text for _, text in REFUSED])
def test_what_cannot_be_searched_is_one_clear_line(call, text):
    with pytest.raises(CommandError) as refused:
        call()
    assert text in str(refused.value)
    assert "\n" not in str(refused.value)


def test_the_limits_are_where_a_sweep_changes_its_sign():
    scene = climber()
    limit = math.degrees(steepest_climb(scene).value)
    slopes = np.array([limit - 1e-6, limit + 1e-6])
    below, above = (gain_of(one) for one in vary(scene, {"ground.slope": slopes}))
    assert below > 0.0 > above
