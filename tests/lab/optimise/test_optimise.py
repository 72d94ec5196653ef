"""The best gaits: known optima, limits, uncertainty, and the order in which nothing may matter."""

from __future__ import annotations

import importlib
import itertools
import json
import sys

import numpy as np
import pytest

from crawler_lab import optimise, pareto, simulate_many
from crawler_lab.optimise.goal import Goal
from crawler_lab.optimise.limit import TimeLimit
from crawler_lab.optimise.optimise import build_space
from crawler_lab.optimise.regime import find_peak
from crawler_lab.optimise.request import Request
from crawler_lab.optimise.search import _STALE_ROUNDS, Kind, _Search, search
from crawler_lab.optimise.space import Space
from crawler_lab.optimise.starts import Starts
from crawler_lab.verbs.optimum_report import describe_front, describe_optimum
from crawler_model import CrawlerError, Scene, limit_cycle, load_scene, simulate

pytest.importorskip("cma")

FORWARD, BACKWARD, STIFFNESS = 0.2, 0.6, 10.0


def chain(contacts: int, **more) -> Scene:
    body = {"contacts": (0.1 * np.arange(contacts)).tolist(), "links": {"stiffness": STIFFNESS}}
    document = {"name": "chain", "body": body, "friction": {"forward": FORWARD, "backward": BACKWARD}}
    return Scene.model_validate(document | more)


def space_of(scene: Scene, objective: str = "translation", **given) -> Space:
    return build_space(scene, Request(objective, **given))[1]


def test_four_contacts_gain_more_than_twice_their_stroke():
    found = optimise(chain(4), waypoints=6, stroke=(0.0, 0.1))
    assert found.value >= 0.22 - 1e-12
    assert found.unit == "m"
    assert limit_cycle(found.scene).gain == pytest.approx(found.value, abs=1e-9)
    assert found.transient_left < 1e-8
    assert found.cost_of_transport == pytest.approx(FORWARD / (0.5 * (FORWARD + BACKWARD)))
    assert len(found.active_bounds) == 18
    assert found.gradient_norm == 0.0
    assert found.unique
    assert found.alternatives[0].value < 0.19
    assert found.complete
    assert found.untried == ()


@pytest.mark.parametrize("stroke", [0.02, 0.05, 0.3])
def test_two_contacts_gain_the_stroke_less_the_stretch_that_friction_holds(stroke):
    found = optimise(chain(2), waypoints=2, stroke=(0.0, stroke))
    assert found.value == pytest.approx(max(0.0, stroke - 2.0 * FORWARD / STIFFNESS), abs=1e-12)


@pytest.mark.slow
def test_anchors_that_change_at_rest_lose_only_the_least_friction():
    """Friction that changes while the length does not is at least as good as that: Lmax - 2 mu_least / k."""
    found = optimise("two_anchor_a", waypoints=4, stroke=(0.0, 4.0), free={"friction": (0.5, 1.5)})
    assert found.value >= 3.0 - 1e-9
    assert simulate(found.scene, duration=20.0).per_period[-1] == pytest.approx(found.value, rel=1e-9)


def shifted(name: str, phase: float) -> Scene:
    """A strategy whose friction runs ahead of its shape by a part of a period more than in the paper."""
    scene = load_scene(name)
    drive = scene.drive
    assert drive.period is not None
    times = np.unique(np.round(np.concatenate((drive.times, (drive.times - phase) % 1.0, [1.0])), 12))
    rows = np.column_stack(
        [np.interp(times, drive.times, drive.rows[:, 0])]
        + [np.interp((times + phase) % 1.0, drive.times, drive.rows[:, i], period=1.0) for i in (1, 2)]
    )
    rows[-1] = rows[0]
    table = {"times": times.tolist(), "period": 1.0, "actuation": rows[:, :1].tolist()}
    table["friction"] = {"isotropic": rows[:, 1:].tolist()}
    document = scene.document() | {"drive": table, "start": "relaxed"}
    return Scene.model_validate(document)


def test_strategy_a_is_best_with_friction_a_fifth_of_a_period_from_that_of_the_paper():
    phases = np.arange(80) / 80
    gains = np.array([limit_cycle(shifted("two_anchor_a", phase)).gain for phase in phases])
    assert gains[0] == pytest.approx(2.0, abs=1e-9)
    assert gains.max() == pytest.approx(2.8, abs=1e-9)
    best = phases[int(gains.argmax())]
    assert min(best, 1.0 - best) == pytest.approx(0.2, abs=1e-9)


@pytest.mark.parametrize("contacts", [4, 12, 30])
def test_a_peristaltic_wave_moves_a_long_chain_where_standing_waves_do_not(contacts):
    """With the same friction in both directions, one shortened link that travels along the body carries it along."""
    links = contacts - 1
    pulse = 0.1 * (1.0 - np.eye(links))
    standing = 0.1 * np.outer(np.arange(links) % 2, np.ones(links))
    gains = []
    for rows in (pulse, standing):
        times = (np.arange(links + 1) / links).tolist()
        table = {"times": times, "period": 1.0, "actuation": np.vstack((rows, rows[:1])).tolist()}
        gains.append(limit_cycle(chain(contacts, drive=table, friction={"isotropic": 0.1}, start="relaxed")).gain)
    assert abs(gains[0]) > 0.01
    assert gains[1] == pytest.approx(0.0, abs=1e-9)


def test_the_search_finds_a_better_gait_than_a_travelling_pulse():
    found = optimise(chain(4, friction={"isotropic": 0.1}), waypoints=3, stroke=(0.0, 0.1), seconds=5.0)
    rows = 0.1 * (1.0 - np.eye(3))
    table = {"times": [0, 1 / 3, 2 / 3, 1.0], "period": 1.0, "actuation": np.vstack((rows, rows[:1])).tolist()}
    pulse = limit_cycle(chain(4, drive=table, friction={"isotropic": 0.1}, start="relaxed")).gain
    assert found.value >= abs(pulse) - 1e-9


def test_the_search_crosses_the_jump_of_a_motor_that_stalls():
    """The gain is 0 as long as the motor cannot overcome friction, and D - 2 mu / k beyond."""
    document = {
        "name": "motor",
        "body": {
            "contacts": [0.0, 1.0],
            "links": [{"stiffness": 8.0, "tension": {"least": -0.1, "most": 0.1}}],
        },
        "friction": {"forward": 0.5, "backward": 8.0},
    }
    limits = {"body.links[0].tension.most": (0.05, 2.0), "body.links[0].tension.least": (-2.0, -0.05)}
    found = optimise(Scene.model_validate(document), waypoints=2, stroke=(0.0, 1.0), free=limits, seconds=3.0)
    assert found.gain == pytest.approx(1.0 - 2.0 * 0.5 / 8.0, rel=1e-9)
    run = simulate(found.scene, 10.0 * found.scene.drive.period, 100.0)
    assert run.per_period[-1] == pytest.approx(found.gain, rel=1e-9)


def test_the_largest_tension_counts_what_a_motor_can_pull():
    """With stops in parallel the spring pulls more than the motor; the request bounds both together."""
    document = {
        "name": "stops",
        "body": {
            "contacts": [0.0, 1.0],
            "links": [
                {"stiffness": 8.0, "passive": {"stops": {"shortest": -0.25, "longest": 0.1, "stiffness": 100.0}}}
            ],
        },
        "friction": {"forward": 0.5, "backward": 8.0},
    }
    scene = Scene.model_validate(document)
    free = optimise(scene, waypoints=2, stroke=(0.0, 1.0), seconds=2.0)
    tight = optimise(scene, waypoints=2, stroke=(0.0, 1.0), tension=0.6, seconds=2.0)
    assert 0.0 < tight.gain <= free.gain
    assert np.abs(simulate(tight.scene, 5.0 * tight.scene.drive.period, 100.0).tension).max() <= 0.6 * (1.0 + 1e-9)


def test_the_largest_tension_beside_stops_counts_between_the_waypoints():
    """A link pulls at most what friction holds: the backward friction of the last contact, reached within a ramp."""
    links = [{"stiffness": 8.5}, {"stiffness": 9.4}]
    links[1]["passive"] = {"stops": {"shortest": -0.01, "longest": 0.06, "stiffness": 100.0}}
    friction = {"forward": [0.26, 0.22, 0.12], "backward": [0.42, 0.44, 0.28]}
    document = {"name": "stops", "body": {"contacts": [0, 0.1, 0.25], "links": links}, "friction": friction}
    request = Request("translation", stroke=(-0.03, 0.1), waypoints=3)
    unknowns, _ = build_space(Scene.model_validate(document), request)
    values = np.array([0.05, 0.015, 0.02, 0.085, 0.0, 0.05])
    scene = Scene.model_validate(unknowns.document(values))
    at_waypoints = simulate(scene, 6.0 * scene.drive.period, 3.0 / scene.drive.period).tension[-3:]
    assert np.abs(at_waypoints).max() < 0.27
    assert find_peak(unknowns.cycle(values)) == pytest.approx(0.28, rel=1e-9)


def test_a_rate_limits_the_stroke():
    found = optimise(chain(2), waypoints=4, stroke=(0.0, 0.3), rate=0.2, period=2.0)
    assert found.value == pytest.approx(0.2 - 2.0 * FORWARD / STIFFNESS, abs=1e-9)
    rates = np.abs(np.diff(found.scene.drive.rows[:, 0])) / np.diff(found.scene.drive.times)
    assert rates.max() <= 0.2 * (1.0 + 1e-9)
    assert "rate" in [bound.name for bound in found.active_bounds]


def test_optima_beside_the_best_one_keep_the_limits(monkeypatch):
    monkeypatch.setitem(_STALE_ROUNDS, 1, 2)
    bounds = {"drive.actuation": (-0.2, 0.25)}
    found = optimise(load_scene("two_contacts_anisotropic"), free=bounds, rate=0.3)
    assert found.value == pytest.approx(0.13, abs=1e-9)
    assert all(other.value <= found.value + 1e-9 for other in found.alternatives)


def test_the_row_that_closes_a_drive_changes_with_the_first_one():
    """A stroke of 0.3 m gains 0.3 - mu/k; the first row cannot change by itself, as the last one repeats it."""
    scene = load_scene("two_contacts_anisotropic")
    found = optimise(scene, free={"drive.actuation[0][0]": (-0.2, 0.0)}, seconds=3.0)
    assert found.value == pytest.approx(0.28, abs=1e-12)
    assert found.scene.drive.rows[[0, -1], 0].tolist() == [-0.2, -0.2]
    assert optimise(scene, free={"drive.actuation": (-0.2, 0.1)}, seconds=3.0).names == (
        "drive.actuation[0][0]",
        "drive.actuation[1][0]",
    )
    for key in ("drive.actuation[2][0]", "drive.actuation[2]"):
        with pytest.raises(CrawlerError, match="the last row of the drive repeats the first one; free that one"):
            optimise(scene, free={key: (-0.2, 0.0)})


def test_a_tension_below_friction_keeps_the_body_where_it_is():
    held = optimise(chain(2), waypoints=2, stroke=(0.0, 0.1), tension=0.9 * FORWARD)
    assert held.gain == 0.0
    assert held.peak_tension <= 0.9 * FORWARD
    moved = optimise(chain(2), waypoints=2, stroke=(0.0, 0.1), tension=1.1 * FORWARD)
    assert moved.value == pytest.approx(0.1 - 2.0 * FORWARD / STIFFNESS, abs=1e-9)


def test_the_least_cost_is_that_of_sliding_forward_alone():
    found = optimise(chain(2), "cost-of-transport", waypoints=2, stroke=(0.0, 0.1))
    assert found.value == pytest.approx(FORWARD / (0.5 * (FORWARD + BACKWARD)), rel=1e-6)
    assert found.summary()["best"] == {"value": found.value, "unit": "1"}


def test_the_most_gain_for_its_travel_is_a_full_stroke():
    found = optimise(chain(2), "travel", waypoints=2, stroke=(0.0, 0.1))
    assert found.value == pytest.approx((0.1 - 2.0 * FORWARD / STIFFNESS) / 0.2, rel=1e-6)


@pytest.mark.parametrize("friction", [FORWARD, [FORWARD, FORWARD]])
def test_robust_counts_the_worst_corner_and_names_the_change_that_stops_the_gait(friction):
    scene = chain(2, friction={"forward": friction, "backward": BACKWARD})
    found = optimise(scene, waypoints=2, stroke=(0.0, 0.1), robust={"friction.forward": (0.8, 1.2)})
    assert found.value == pytest.approx(0.1 - 2.0 * 1.2 * FORWARD / STIFFNESS, abs=1e-9)
    assert found.gain == pytest.approx(0.1 - 2.0 * FORWARD / STIFFNESS, abs=1e-9)
    (weakness,) = found.weaknesses
    assert weakness.key == "friction.forward"
    assert weakness.below is None
    assert weakness.above == pytest.approx(STIFFNESS * 0.1 / (2.0 * FORWARD), rel=1e-5)


@pytest.mark.parametrize("kind", ["free", "robust"])
def test_a_slope_may_be_0_beside_others(kind):
    """Only a slope that is not 0 loads a scene that states no loads."""
    found = optimise("slope_climber", waypoints=2, stroke=(0.0, 0.1), **{kind: {"ground.slope": (0.0, 1.0)}})
    assert simulate(found.scene, 6.0).per_period[-1] == pytest.approx(found.gain, abs=1e-9)
    if kind == "free":  # downhill is harder for nobody: level ground is the best in this range
        assert found.values[found.names.index("ground.slope")] == pytest.approx(0.0, abs=1e-9)


CASES = {
    "waypoints": (chain(4), {"waypoints": 5, "stroke": (-0.1, 0.1)}),
    "friction too": (chain(3), {"waypoints": 4, "stroke": (0.0, 0.2), "free": {"friction": (0.1, 0.9)}}),
    "numbers too": (
        chain(3, loads=[0.0, 0.02, -0.05]),
        {"waypoints": 3, "stroke": (0.0, 0.2), "free": {"body.links.stiffness": (5.0, 20.0), "loads[1]": (-0.1, 0.1)}},
    ),
    "a wave": (
        chain(5, drive={"wave": {"amplitude": 0.05, "wavelength": 0.5, "period": 1.0, "samples": 8}}, start="relaxed"),
        {"free": {"drive.wave.amplitude": (0.0, 0.2), "drive.wave.wavelength": (0.2, 1.0)}},
    ),
}


@pytest.mark.parametrize("objective", ["translation", "cost-of-transport", "travel"])
@pytest.mark.parametrize("case", CASES)
def test_derivatives_of_scores_equal_differences(case, objective):
    scene, given = CASES[case]
    space = space_of(scene, objective, **given)
    random = np.random.default_rng(5)
    close = 0
    for _ in range(4):
        point = random.random(space.size)
        ((score, slope),) = space.slopes(point)
        assert score == pytest.approx(space.scores([point])[0], abs=1e-9)
        steps = 1e-6 * np.eye(space.size)
        up, down = (np.array(space.scores([point + sign * step for step in steps])) for sign in (1.0, -1.0))
        size = max(np.abs(slope).max(), 1e-3)
        close += bool(np.abs((up - down) / 2e-6 - slope).max() <= 1e-5 * size)
    assert close >= 3  # a kink may lie between the differences


def test_repaired_waypoints_keep_the_rate_and_those_that_keep_it_are_not_changed():
    space = space_of(chain(4), stroke=(0.0, 0.1), rate=0.3)
    most = space.steps()[0]
    random = np.random.default_rng(1)
    for _ in range(50):
        point = space.repair(random.random(space.size) * 1.4 - 0.2)
        rows = point.reshape(6, 3)
        assert rows.min() >= 0.0
        assert rows.max() <= 1.0
        assert np.abs(rows - np.roll(rows, 1, axis=0)).max() <= most * (1.0 + 1e-12)
        assert space.repair(point) == pytest.approx(point, abs=1e-15)
        matrix, bound = space.limits()
        assert (matrix @ point <= bound + 1e-12).all()


def test_nothing_depends_on_threads_or_on_numpys_own_random_numbers(monkeypatch):
    space = space_of(chain(3), stroke=(0.0, 0.1), waypoints=4)
    np.random.seed(3)  # noqa: NPY002
    before = np.random.get_state()[1].tobytes()  # noqa: NPY002
    found = []
    for cores in (1, 2):
        monkeypatch.setattr(sys.modules[Space.__module__], "available_cores", lambda cores=cores: cores)
        found.append(search(space, 7, TimeLimit(0.0, None), [], rounds=3))
    one, two = found
    assert one.point.tobytes() == two.point.tobytes()
    assert one.evaluations == two.evaluations
    assert [score for score, _ in one.optima] == [score for score, _ in two.optima]
    assert np.random.get_state()[1].tobytes() == before  # noqa: NPY002


def test_a_mixed_gait_takes_whole_waypoints_or_whole_links_of_two_optima():
    run = _Search(space_of(chain(4), stroke=(0.0, 0.1)), 0, TimeLimit(0.0, None), None, None)
    run.pool = [(1.0, np.ones(18)), (0.5, np.zeros(18))]
    rows = [run.mixed().reshape(6, 3) for _ in range(200)]
    by_waypoints = [np.ptp(one, axis=1).max() == 0.0 for one in rows]
    by_links = [np.ptp(one, axis=0).max() == 0.0 for one in rows]
    assert all(np.logical_or(by_waypoints, by_links))
    mixed = [np.ptp(one) > 0.0 for one in rows]
    assert np.logical_and(mixed, by_waypoints).sum() > 10
    assert np.logical_and(mixed, by_links).sum() > 10


def test_mirrored_gaits_are_their_own_images_backwards_in_time_and_from_the_other_end():
    starts = Starts(space_of(chain(4), stroke=(0.0, 0.1), waypoints=5), np.random.default_rng(0))
    for point in (starts.mirrored(np.arange(15.0)), *starts.mirrored_points()[:8]):
        rows = point.reshape(5, 3)
        images = [np.roll(rows[::-1, ::-1], k, axis=0) for k in range(5)]
        assert any(np.array_equal(rows, image) for image in images)


def test_waves_of_all_patterns_are_tried():
    """Two links and four waypoints: four patterns differ by more than their beginning, and one repeats after two."""
    starts = Starts(space_of(chain(3), stroke=(0.0, 0.1), waypoints=4), np.random.default_rng(0))
    waves = np.array(starts.on_off_waves()).reshape(-1, 4, 2)
    assert all(any(np.array_equal(np.roll(one, k), other) for k in range(4)) for one, other in waves.transpose(0, 2, 1))
    gaits = {max(np.roll(rows, k, axis=0).tobytes() for k in range(4)) for rows in waves}
    assert len(gaits) == 3 * 4 + 2


def test_a_gait_that_was_found_coarsely_is_known_near_an_optimum_unless_it_is_better():
    run = _Search(space_of(chain(4), stroke=(0.0, 0.1)), 0, TimeLimit(0.0, None), None, None)
    run.found.optima = [(1.0, np.ones(18))]
    assert run.is_known(np.full(18, 0.99), 0.98)
    assert not run.is_known(np.full(18, 0.99), 1.01)
    assert not run.is_known(np.full(18, 0.9), 0.98)


def test_ctrl_c_keeps_the_best_so_far():
    def stop(part: float) -> None:
        if part > 0.1:
            raise KeyboardInterrupt

    found = optimise(chain(2), waypoints=2, stroke=(0.0, 0.1), progress=stop)
    assert not found.complete
    assert found.value > 0.0
    assert json.loads(json.dumps(found.summary()))["complete"] is False
    assert found.untried


def test_a_time_limit_ends_the_search():
    found = optimise(chain(4), stroke=(0.0, 0.1), seconds=0.01)
    assert not found.complete
    assert found.evaluations < 500
    assert found.value >= 0.0
    assert "CMA-ES around the best" in found.summary()["untried"]
    assert f"not tried to the end: {', '.join(found.untried)}" in describe_optimum(found)[-1]
    front = pareto(chain(2), stroke=(0.0, 0.1), waypoints=2, seconds=0.01)
    assert not front.complete
    assert front.untried


@pytest.mark.slow
def test_a_compromise_is_beaten_in_neither_gain_nor_cost():
    front = pareto("two_anchor_a", waypoints=2, stroke=(0.0, 4.0), free={"friction": (0.5, 1.5)})
    for further, cheaper in itertools.pairwise(front.points):
        assert further.gain > cheaper.gain
        assert further.cost_of_transport > cheaper.cost_of_transport
    cycle = limit_cycle(front.points[0].scene)
    assert cycle.gain == pytest.approx(front.points[0].gain, rel=1e-6)
    assert front.complete
    assert front.untried == ()


@pytest.mark.parametrize("last", [2, 3])
def test_ctrl_c_before_the_first_gait_of_a_later_search_keeps_the_earlier_ones(monkeypatch, last):
    search_on, searches = _Search.go, []

    def go(run: _Search, begin: list[np.ndarray]) -> None:
        searches.append(run)
        if len(searches) == last:
            raise KeyboardInterrupt
        search_on(run, begin)

    monkeypatch.setattr(_Search, "go", go)
    front = pareto(chain(2), stroke=(0.0, 0.1), waypoints=2, seconds=1.0)
    assert not front.complete
    assert front.summary()["untried"] == list(front.untried) == [kind.value for kind in Kind]
    assert describe_front(front)[-1].endswith(f"; not tried to the end: {', '.join(front.untried)}")
    assert front.points[0].gain == pytest.approx(0.06)
    assert front.summary()["front"][0]["unknowns"] == dict(zip(front.names, front.points[0].values, strict=True))


def test_goals_put_what_is_outside_of_limits_last():
    space = space_of(chain(2), stroke=(0.0, 0.1), waypoints=2, tension=0.1)
    still, torn = space.scores([np.full(2, 0.5), np.array([0.0, 1.0])])
    assert still == 0.0
    assert torn < -1e5
    assert Goal("translation").scores(None)[0] < torn


TWO = chain(2)
WRONG = [
    (
        {"objective": "speed"},
        "objective: 'speed'; it must be one of translation, cost-of-transport, travel, turn, screw",
    ),
    ({"objective": "turn"}, "objective: 'turn'; chain does not turn"),
    ({}, "stroke: missing; give the bounds of the rest lengths"),
    ({"stroke": (0.1, 0.0)}, "stroke: 0.1 to 0; the lower bound must be less than the upper one"),
    ({"stroke": (0.1, 0.1)}, "stroke: 0.1 to 0.1; the lower bound must be less"),
    ({"stroke": (0.0, np.inf)}, "stroke: 0 to inf; bounds must be finite"),
    ({"stroke": (0.0, 2e100)}, "stroke: 0 to 2e+100; bounds must be finite"),
    ({"stroke": (-2e100, 0.0)}, "stroke: -2e+100 to 0; bounds must be finite"),
    ({"stroke": 0.1}, "stroke: 0.1; bounds are two numbers"),
    ({"stroke": {"link_7": (0, 1)}}, "stroke: 'link_7'; the links and segments are link_0"),
    ({"stroke": (0, 0.1), "waypoints": 1}, "waypoints: 1; it must be a whole number between 2 and 2000"),
    ({"stroke": (0, 0.1), "waypoints": 2000, "free": {"friction": (0, 1)}}, "6000 unknowns; at most 2000"),
    ({"stroke": (0, 0.1), "rate": 0.0}, "rate: 0 m/s; it must be > 0"),
    ({"stroke": (0, 0.1), "tension": -1.0}, "tension: -1 N; it must be > 0"),
    ({"stroke": (0, 0.1), "seconds": -1.0}, "seconds: -1 s; it must be > 0"),
    ({"stroke": (0, 0.1), "seed": -1}, "seed: -1; it must be a whole number >= 0"),
    ({"stroke": (0, 0.1), "period": 0.0}, "period: 0 s; it must be between"),
    ({"stroke": (0, 0.1), "free": {"friction": (-1, 1)}}, "free: friction: -1 to 1; friction must be >= 0"),
    ({"stroke": (0, 0.1), "free": {"friction.forwrd": (0, 1)}}, "free: friction.forwrd: unknown key"),
    ({"stroke": (0, 0.1), "free": {"name": (0, 1)}}, "free: name: 'chain' is not a number"),
    ({"stroke": (0, 0.1), "free": {"drive.wave.amplitude": (0, 1)}}, "no effect, as the waypoints replace the drive"),
    ({"stroke": (0, 0.1), "robust": {"friction.forward": (1.2, 0.8)}}, "robust: friction.forward: 1.2 to 0.8"),
    ({"stroke": (0, 0.1), "robust": {"friction.forwrd": (0.8, 1.2)}}, "robust: friction.forwrd: unknown key"),
    (
        {"stroke": (0, 0.1), "robust": {"loads": (0.5, 2.0)}},
        "robust: loads is 0, which no factor changes; leave it out",
    ),
    ({"stroke": (0, 0.1), "robust": {"ground.slope": (0, 2)}}, "robust: ground.slope is 0, which no factor changes"),
    (
        {"stroke": (0, 0.1), "robust": {"friction.isotropic": (0.8, 1.2)}},
        "robust: friction.isotropic; the scene gives forward and backward there, name these",
    ),
    ({"stroke": (0, 0.1), "robust": {"drive.period": (0.8, 1.2)}}, "the drive is what is sought"),
    (
        {"stroke": (0, 0.1), "free": {"friction.forward": (0, 1)}, "robust": {"friction.forward": (0.8, 1.2)}},
        "robust: friction.forward is free",
    ),
]


@pytest.mark.parametrize(("given", "message"), WRONG)
def test_a_mistake_is_one_line(given, message):
    with pytest.raises(CrawlerError) as error:
        optimise(TWO, **given)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("ten_contact_wave", {"free": {"drive.wave.samples": (4, 8)}}, "it is a whole number"),
        ("ten_contact_wave", {"free": {"drive.wave.period": (1, 2)}}, "does not depend on how fast the drive is"),
        (
            "ten_contact_wave",
            {"free": {"drive.wave.amplitude": (0, 1)}, "period": 2.0},
            "period: 2 s; without waypoints",
        ),
    ],
)
def test_a_scene_that_has_no_best_gait_is_one_line(name, given, message):
    with pytest.raises(CrawlerError, match=message):
        optimise(name, **given)


def test_gaits_that_rounding_spoils_do_not_count():
    """A force of 1e16 N/m in a body whose springs hold 0.4 N leaves no digits."""
    trunk = {"name": "trunk", "from": 0, "to": 1, "stiffness": 1.0, "elements": 20}
    trunk["friction"] = {"forward": 0.1, "backward": 1e16}
    drive = {"times": [0, 0.5, 1], "period": 1, "actuation": [[0], [0.4], [0]]}
    scene = Scene.model_validate({"name": "strong", "body": {"segments": [trunk]}, "drive": drive})
    with pytest.raises(CrawlerError, match="no gait can be followed exactly"):
        optimise(scene, "translation", free={"drive.actuation[1][0]": (0.3, 0.4)})
    with pytest.raises(CrawlerError, match="2 ramp\\(s\\) of a period were not solved"):
        limit_cycle(scene)


def test_a_transient_that_dies_out_has_no_cost_of_transport():
    links = [{"stiffness": 8.5}, {"stiffness": 9.4}]
    links[1]["passive"] = {"stops": {"shortest": -0.01, "longest": 0.06, "stiffness": 100.0}}
    friction = {"forward": [0.26, 0.22, 0.12], "backward": [0.42, 0.44, 0.28]}
    scene = {"name": "stops", "body": {"contacts": [0, 0.1, 0.25], "links": links}, "friction": friction}
    best = optimise(
        Scene.model_validate(scene), "cost-of-transport", stroke=(-0.03, 0.1), waypoints=3, seed=1, seconds=8.0
    )
    assert best.gain > 1e-3
    assert simulate_many([best.scene], 50.0).cost_of_transport[0] == pytest.approx(best.value, rel=1e-9)


def test_a_search_that_finds_better_gaits_goes_on_until_its_time_limit(monkeypatch):
    def find_better(run: _Search, number: int, _: list[np.ndarray]) -> None:
        rounds.append(number)
        run.found.score = float(number)

    time = itertools.count()
    module = importlib.import_module("crawler_lab.optimise.search")
    monkeypatch.setattr(module, "clock", lambda: float(next(time)))
    monkeypatch.setattr(_Search, "round", find_better)
    rounds: list[int] = []
    _, space = build_space(chain(2), Request("translation", stroke=(0.0, 0.1), waypoints=2))
    search(space, 0, TimeLimit(0.0, 500.0), [])
    assert rounds[-1] > 100
    assert next(time) > 500
