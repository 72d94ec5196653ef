"""Loads in the plane: vectors that shift the sets of friction forces, weights, coefficients, and slopes with a direction."""

from __future__ import annotations

import math

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, SceneError, simulate
from crawler_model.body.planar_loads import check_planar_equilibrium

from .cone_program import laplacian_of, solve_with_clarabel
from .planar_ramps import polygon
from .planar_reference import Reference

TRIANGLE = [[0, 1], [1, 2], [0, 2]]
QUARTERS = [0.0, 1.5707963267948966, 3.141592653589793, 4.71238898038469]


def rotation(angle):
    return np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])


def three(loads=0.0, friction=None, **more) -> Scene:
    body = {"contacts": [[0.0, 0.0], [0.2, 0.0], [0.1, 0.17]], "links": {"stiffness": 20.0, "between": TRIANGLE}}
    friction = friction or {"isotropic": [0.3, 0.25, 0.2]}
    scene = {"name": "three", "dimension": 2, "body": body | more.pop("body", {}), "friction": friction}
    return Scene.model_validate(scene | ({} if loads is None else {"loads": loads}) | more)


def pair(angle=0.0, friction=None, **more) -> Scene:
    along = np.array([math.cos(angle), math.sin(angle)])
    body = {"contacts": [[0.0, 0.0], along.tolist()], "links": {"stiffness": 1.0}} | more.pop("body", {})
    rows = [[(length * along).tolist()] for length in (0.0, 4.0, 0.0)]
    drive = {"times": [0.0, 0.5, 1.0], "period": 1.0, "actuation": rows} | more.pop("drive", {})
    scene = {"name": "pair", "dimension": 2, "body": body, "friction": friction or {"isotropic": 1.0}}
    return Scene.model_validate(scene | {"drive": drive} | more)


def gait(ramps, links=3):
    phase = 2.0 * np.pi * np.arange(ramps)[:, None] / 6 + 2.1 * np.arange(links)
    return 0.1 * np.stack((np.cos(phase), np.sin(1.3 * phase)), -1)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.3, -1.5707963267948966])
@pytest.mark.parametrize("corners", [0, 4, 6])
def test_a_line_in_the_plane_with_loads_is_the_line(angle, corners):
    """Loads along the line, constant or changing along the ramps."""
    along = np.array([math.cos(angle), math.sin(angle)])
    for seed in range(12):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 5))
        k, mu = np.exp(rng.uniform(-1.0, 1.0, n - 1)), np.exp(rng.uniform(-1.0, 1.0, n))
        links = {"links": {"stiffness": k.tolist()}}
        line = {"name": "line", "body": {"contacts": list(range(n))} | links, "friction": {"isotropic": mu.tolist()}}
        friction = {"isotropic": mu.tolist()}
        if corners:
            directions = polygon(angle, corners)
            angles = np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)
            friction = {"directions": angles.tolist(), "value": np.repeat(mu[:, None], corners, 1).tolist()}
        lengths = rng.uniform(-4.0, 4.0, (4, n - 1))
        plane = {
            "name": "plane",
            "dimension": 2,
            "body": {"contacts": (np.arange(n)[:, None] * along).tolist()} | links,
            "friction": friction,
            "drive": {"times": [0, 1, 2, 3], "actuation": (lengths[:, :, None] * along).tolist()},
            "start": "relaxed",
        }
        one = Crawler(Scene.model_validate(line | {"loads": 0.0}))
        other = Crawler(Scene.model_validate(plane | {"loads": 0.0}))
        one.advance(lengths[0])
        before, offset = one.displacement, other.displacement
        if np.abs(one.tension).max() > 0.0:  # both start without tension
            relaxed = np.concatenate(([0.0], np.cumsum(lengths[0])))
            one = one.placed(relaxed, one.target(lengths[0]))
            before = one.displacement
        for count, length in enumerate(lengths[1:], 1):
            load = rng.uniform(-0.5, 0.5, n) * mu if seed % 2 else 0.3 * mu * rng.choice([-1.0, 1.0])
            a, b = one.advance(length, loads=load), other.advance(length[:, None] * along, loads=load[:, None] * along)
            if not a.unique:
                break
            off = np.abs(other.displacement - offset - (one.displacement - before)[:, None] * along).max()
            assert off <= count * 1e-4 * np.ptp(lengths, axis=0).max()
            assert b.loads_work == pytest.approx(a.loads_work, abs=1e-3 * np.abs(a.work))


class Loaded:
    """Random ramps with changing loads, up to a part of what friction holds, and where they really lead."""

    def __init__(self, seed, directional, part):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 5))
        ends = [[i, i + 1] for i in range(n - 1)] + ([[0, n - 1]] if n > 2 and seed % 2 else [])
        stiffness, count = np.exp(rng.uniform(-1.0, 1.0, len(ends))), int(rng.integers(1, 4))
        directions = polygon(rng.uniform(0.0, 6.0), int(rng.integers(3, 7))) if directional else None
        points = rng.normal(size=(n, 5, 2))
        wide = (points - points.mean(1, keepdims=True)) @ (directions.T if directional else np.eye(2))
        mu = wide.max(1) if directional else np.exp(rng.uniform(-1.0, 0.5, (n, 1)))
        self.lengths = np.concatenate((np.zeros((1, len(ends), 2)), 2.0 * rng.normal(size=(count, len(ends), 2))))
        self.loads = []
        for _ in range(count):
            load = rng.normal(size=(n, 2))
            total = load.sum(0)
            ways = directions if directional else total[None] / np.hypot(*total)
            along = ways @ total
            most = (mu.sum(0) / np.where(along > 0.0, along, 1e-9)).min()
            self.loads.append(load * min(part * rng.uniform(0.3, 1.0) * most, 3.0))
        reference = Reference(ends, stiffness, mu, directions)
        steps = zip(self.lengths[1:], self.loads, strict=True)
        self.places = [reference.ramp(length, mu, load) for length, load in steps]
        friction = {"isotropic": mu[:, 0].tolist()}
        if directional:
            angles = np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)
            friction = {"directions": angles.tolist(), "value": mu.tolist()}
        body = {"contacts": rng.normal(size=(n, 2)).tolist()}
        body["links"] = {"stiffness": stiffness.tolist(), "between": ends}
        drive = {"times": list(range(count + 1)), "actuation": self.lengths.tolist()}
        self.scene = {"name": "loaded", "dimension": 2, "body": body, "friction": friction, "loads": 0, "drive": drive}

    def error(self, tolerance):
        """The largest error in tolerances."""
        crawler = Crawler(Scene.model_validate(self.scene | {"tolerance": tolerance}))
        size, worst = np.ptp(self.lengths, axis=0).max(), 0.0
        for count, place in enumerate(self.places, 1):
            step = crawler.advance(self.lengths[count], loads=self.loads[count - 1])
            assert not step.overspent
            assert step.unique
            assert abs(step.certificate.energy_residual) <= 1e2 * tolerance
            worst = max(worst, np.abs(crawler.displacement - place).max() / (count * tolerance * size))
        return worst


@pytest.mark.parametrize("directional", [False, True])
def test_random_ramps_with_loads_end_within_the_tolerance(directional):
    for seed in range(12 if directional else 6):
        ramps = Loaded(seed, directional, 0.8)
        for tolerance in (1e-2, 1e-4, 1e-6, 1e-7):
            assert ramps.error(tolerance) <= 1.0, (seed, tolerance)


def test_steps_grow_again_after_a_start_at_the_level_of_rounding():
    """All four contacts slide at once, at a tolerance near rounding: steps that stayed short would spend the budget."""
    assert Loaded(26, False, 0.8).error(1e-7) <= 1.0


@pytest.mark.parametrize("directional", [False, True])
def test_turned_scenes_move_along_turned_paths(directional):
    """Turned by two sevenths of a turn, so that the directions of friction are given from another one on."""
    turn = 4.0 * math.pi / 7.0
    spin = rotation(turn)
    loads = 0.1 * np.array([[1.0, 0.3], [-0.4, 0.2], [0.5, -0.6]])
    friction, turned = None, None
    if directional:
        angles = 2.0 * np.pi * np.arange(7) / 7
        friction = {"directions": angles.tolist(), "value": 0.3}
        turned = friction
    one = Crawler(three(friction=friction))
    places = np.array([[0.0, 0.0], [0.2, 0.0], [0.1, 0.17]]) @ spin.T
    other = Crawler(three(friction=turned, body={"contacts": places.tolist()}))
    for i, lengths in enumerate(gait(8)):
        pull = loads * (1.0 + 0.2 * i) / 2.4
        one.advance(lengths, loads=pull)
        other.advance(lengths @ spin.T, loads=pull @ spin.T)
    assert np.abs(one.displacement).max() > 0.05
    assert other.displacement == pytest.approx(one.displacement @ spin.T, abs=8 * 2e-4 * 0.2)


def test_the_work_of_constant_loads_is_force_times_displacement():
    loads = np.array([[0.05, 0.1], [-0.02, 0.03], [0.1, -0.04]])
    crawler = Crawler(three(loads.tolist()))
    total = 0.0
    for lengths in gait(20):
        before, stored = crawler.displacement, (crawler.tension**2).sum() / 40.0
        step = crawler.advance(lengths)
        assert step.loads_work == pytest.approx((loads * (crawler.displacement - before)).sum(), abs=1e-14)
        gained = (crawler.tension**2).sum() / 40.0 - stored
        balance = gained + step.dissipation - step.work - step.loads_work
        assert balance == pytest.approx(step.certificate.energy_residual, abs=1e-13)
        assert abs(balance) < 1e-5
        assert step.dissipation >= 0.0
        total += abs(step.loads_work)
    assert total > 0.05


def test_the_energy_balance_follows_the_tolerance_while_loads_change():
    residuals = []
    for tolerance in (1e-2, 1e-4, 1e-6):
        crawler, residual = Crawler(three(tolerance=tolerance)), 0.0
        for i, lengths in enumerate(gait(20)):
            load = 0.1 * np.array([math.cos(i), math.sin(i)]) * np.array([[1.0], [-0.5], [1.2]])
            residual += abs(crawler.advance(lengths, loads=load).certificate.energy_residual)
        residuals.append(residual)
    assert residuals[2] < 1e-2 * residuals[0]
    assert residuals[2] < 1e-6


def test_a_load_on_all_contacts_carries_its_way():
    """Discs: the mean drifts along the load; against it only as far as a stroke."""
    for angle in (0.0, 1.1, 3.9):
        load = 0.15 * np.array([math.cos(angle), math.sin(angle)])
        drive = {"times": list(range(13)), "actuation": [*gait(12).tolist(), gait(1)[0].tolist()], "period": 12.0}
        run = simulate(three(load.tolist(), {"isotropic": 0.3}, drive=drive, start="relaxed"), 60.0, rate=1.0)
        gain = run.per_period[-1]
        along, across = gain @ load / 0.15, gain @ [-load[1], load[0]] / 0.15
        assert along > 0.05
        assert abs(across) < 0.5 * along
        assert run.energy.loads_work == pytest.approx(3 * load @ (run.net_translation[-1] - run.net_translation[0]))


@pytest.mark.parametrize("load", [0.1, -0.3, 0.9])
@pytest.mark.parametrize("angle", [0.0, 0.6])
def test_along_the_link_the_gain_is_that_of_the_line(load, angle):
    along = np.array([math.cos(angle), math.sin(angle)])
    run = simulate(pair(angle, loads=(load * along).tolist()), 4.0)
    gain = math.copysign(4.0 - 2.0 * (1.0 - abs(load)), load)
    assert run.per_period[1:] == pytest.approx(np.tile(gain * along, (3, 1)), abs=1e-3)
    assert run.summary()["loads_work"] == run.energy.loads_work


def test_one_implicit_step_with_loads_is_a_cone_program():
    """Equal friction at both ends of a short stretch: the rest position under loads agrees with Clarabel's step."""
    scene = pair(body={"contacts": [[0.0, 0.0], [1.0, 0.0]]}, friction={"isotropic": [1.0, 2.0]}, loads=0)
    crawler = Crawler(scene)
    load = np.array([[0.5, 0.0], [-1.5, 0.0]])
    crawler.advance([[4.0, 0.0]], loads=load)
    force = np.array([[-4.0, 0.0], [4.0, 0.0]]) + load
    laplacian = laplacian_of(np.array([[0, 1]]), np.ones(1), 2)
    found = solve_with_clarabel(laplacian, force, np.array([[1.0], [2.0]]), np.zeros((0, 2)))
    assert crawler.displacement == pytest.approx(found, abs=1e-6)


def test_speed_does_not_matter():
    """A ramp in one command, or in many that follow it: the same path to the tolerance."""
    ways = []
    for parts in (1, 3, 10):
        crawler = Crawler(three(tolerance=1e-6))
        length, load, work = np.zeros((3, 2)), np.zeros((3, 2)), 0.0
        for i, goal in enumerate(gait(8)):
            pull = 0.1 * np.array([math.cos(i), math.sin(i)]) * np.array([[1.0], [-0.5], [1.2]])
            for s in np.arange(1, parts + 1) / parts:
                step = crawler.advance(length + s * (goal - length), loads=load + s * (pull - load))
                work += step.loads_work
            length, load = goal, pull
        ways.append(np.append(crawler.displacement.ravel(), work))
    assert ways[1] == pytest.approx(ways[0], abs=1e-5)
    assert ways[2] == pytest.approx(ways[0], abs=1e-5)
    assert ways[0][-1] != 0.0


def test_a_slope_is_the_load_of_the_weights_downhill():
    theta, phi, weight = math.radians(8.0), 0.9, np.array([0.5, 1.0, 0.7])
    drive = {"times": [0.0, 1.0, 2.0], "actuation": gait(3).tolist()}
    sloping = three(
        None, body={"weights": weight.tolist()}, ground={"slope": 8.0, "direction": phi}, drive=drive, start="relaxed"
    )
    down = -math.sin(theta) * weight[:, None] * np.array([math.cos(phi), math.sin(phi)])
    assert Crawler(sloping).loads == pytest.approx(down, abs=1e-15)
    loaded = three(down.tolist(), drive=drive, start="relaxed")
    assert simulate(sloping).displacement == pytest.approx(simulate(loaded).displacement, abs=1e-12)
    assert not Crawler(sloping).row[-6:].any()  # the slope's share is not commanded


def test_coefficients_act_on_what_a_slope_leaves_of_the_weight():
    press = np.array([0.5, 1.0, 0.7]) * math.cos(math.radians(10.0))
    more = {"body": {"weights": [0.5, 1.0, 0.7]}, "ground": {"slope": 10.0, "direction": 2.0}}
    disc = Crawler(three(None, {"coefficient": {"isotropic": [0.4, 0.5, 0.6]}}, **more))
    assert disc.friction == pytest.approx(press * [0.4, 0.5, 0.6], abs=1e-15)
    value = [0.4, 0.5, 0.6, 0.5]
    cross = Crawler(three(None, {"coefficient": {"directions": QUARTERS, "value": value}}, **more))
    assert cross.friction.reshape(3, 4) == pytest.approx(press[:, None] * value, abs=1e-15)


def test_a_commanded_load_holds_until_the_next():
    crawler = Crawler(three())
    load = np.array([[0.1, 0.05], [0.0, -0.1], [0.02, 0.0]])
    crawler.advance(gait(1)[0], loads=load)
    crawler.advance(gait(2)[1], [0.2, 0.2, 0.2])
    assert crawler.loads.tolist() == load.tolist()
    assert crawler.row[-6:].tolist() == load.ravel().tolist()
    names = crawler.scene.columns.names
    assert names[-6:-4] == ("contact_0/load_x", "contact_0/load_y")
    assert crawler.scene.columns.aliases["contact_2/load_y"].tolist() == [len(names) - 1]
    assert crawler.copy() == crawler
    assert crawler.margins.min() > -1e-9


def test_driven_loads_replace_those_of_the_scene():
    rows = [[0.0, 0.0], [[0.1, 0.0], [0.0, 0.1], [-0.1, 0.0]], [0.05, -0.05]]
    drive = {"times": [0.0, 1.0, 2.0], "actuation": [np.zeros((3, 2)).tolist(), *gait(2).tolist()], "loads": rows}
    run, crawler = simulate(three([0.01, 0.0], drive=drive), rate=1.0), Crawler(three(drive=drive))
    crawler.advance(gait(2)[0], loads=rows[1])
    crawler.advance(gait(2)[1], loads=np.tile(rows[2], (3, 1)))
    assert run.displacement[-1] == pytest.approx(crawler.displacement, abs=1e-14)


def test_what_each_contact_cannot_hold_alone_springs_carry_to_the_others():
    friction, loads = {"isotropic": [0.1, 2.0]}, [[0.5, 0.0], [0.0, 0.0]]
    with pytest.raises(
        SceneError, match="exceeds the friction of its own contact: start where springs carry some of it"
    ):
        pair(friction=friction, loads=loads)
    run = simulate(pair(friction=friction, loads=loads, start={"displacement": [[0.45, 0.0], [0.0, 0.0]]}), 3.0)
    assert run.violation < 1e-9
    assert run.energy.relative_residual < 1e-9


def test_loads_of_zero_move_as_no_loads_do():
    one, other = Crawler(three()), Crawler(three(None))
    for lengths in gait(10):
        one.advance(lengths)
        other.advance(lengths)
    assert one.displacement == pytest.approx(other.displacement, abs=1e-4)
    assert other.loads.shape == (0, 2)


CROSS = {"directions": QUARTERS, "value": [0.2, 0.4, 0.6, 0.4]}
PAIRS = "in the plane give [x, y] for all of 3 contact(s), or one pair each"
REFUSED = [
    ({"loads": 0.1}, f"loads: 0.1; {PAIRS}"),
    ({"loads": [0.1, 0.2, 0.3]}, f"loads: 3 number(s); {PAIRS}"),
    ({"loads": [[0.1, 0.2], [0.3, 0.0]]}, f"loads: 2 entries; {PAIRS}"),
    ({"loads": [[0.1, 0.2], 0.3, [0.0, 0.0]]}, f"loads: entry 1 is 0.3; {PAIRS}"),
    ({"loads": [[0.1], [0.3], [0.0]]}, f"loads: entry 0 is [0.1]; {PAIRS}"),
    (
        {"loads": [0.3, 0.0]},
        "the loads sum to [0.9, 0] N, 0.9 N long; it must be less than the sum of all friction, 0.75 N: no equilibrium",
    ),
    ({"loads": [0.25, 0.0]}, "0.75 N long; it must be less than the sum of all friction, 0.75 N"),
    (
        {"loads": [-0.3, -0.41], "friction": CROSS},
        "sum to [-0.9, -1.23] N, 1.23 N along direction 3, but friction against sliding in this direction to 1.2 N",
    ),
    ({"ground": {"slope": 5.0}}, "body.weights: missing; a slope acts on the weight"),
    ({"ground": {"slope": 5.0, "direction": 45.0}}, "direction: 45 rad; it must be between -6.2832 and 6.2832"),
    ({"friction": {"coefficient": {"isotropic": 0.5}}}, "body.weights: missing; a coefficient of friction acts"),
    (
        {"friction": {"coefficient": {"forward": 0.5, "backward": 1.0}}, "body": {"weights": 1.0}},
        "friction: in the plane use `isotropic`, or `directions` and `value`",
    ),
    (
        {"friction": {"coefficient": {"directions": QUARTERS}}, "body": {"weights": 1.0}},
        "give `directions` (rad) and `value` together",
    ),
    (
        {"friction": {"coefficient": {"directions": QUARTERS, "value": [1, 1, -1, 1]}}, "body": {"weights": 1.0}},
        "contact 0 has -1 of its weight in direction 2; it must be >= 0",
    ),
    ({"drive": {"times": [0, 1], "actuation": [[[0, 0]] * 3] * 2, "loads": 0.1}}, f"drive.loads: 0.1; {PAIRS}"),
    ({"drive": {"times": [0, 1], "actuation": [[[0, 0]] * 3] * 2, "loads": [[0, 0]]}}, "drive.loads: 1 row(s) for 2"),
    (
        {"drive": {"times": [0, 1], "actuation": [[[0, 0]] * 3] * 2, "loads": [[0, 0], [0, 0, 0]]}},
        f"drive.loads: row 1: 3 number(s); {PAIRS}",
    ),
    (
        {"drive": {"times": [0, 1], "actuation": [[[0, 0]] * 3] * 2, "loads": [[0, 0], [1, 0]]}},
        "drive: row 1: the loads sum to [3, 0] N",
    ),
    ({"ground": {"patches": [{"from": 0.0, "to": 1.0, "friction": 0.5}]}}, "ground.patches: "),
]


@pytest.mark.parametrize(("change", "text"), REFUSED)
def test_what_does_not_fit_is_one_clear_line(change, text):
    with pytest.raises(SceneError) as refused:
        three(**{"loads": None} | change)
    assert text in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"loads": [[0.1, 0.0], [0.0, 0.0]]}, "loads: pairs; on a line each load is a number (or dimension: 2)"),
        ({"ground": {"direction": 1.0}}, "ground.direction: only in the plane"),
        (
            {"body": {"contacts": [0, 1], "links": {"stiffness": 1}, "weights": 1}}
            | {"friction": {"coefficient": {"directions": QUARTERS, "value": 1}}},
            "friction.directions: only for planar scenes",
        ),
    ],
)
def test_what_belongs_to_the_plane_is_refused_on_a_line(change, text):
    body = {"contacts": [0.0, 1.0], "links": {"stiffness": 1.0}}
    with pytest.raises(SceneError) as refused:
        Scene.model_validate({"name": "line", "body": body, "friction": {"isotropic": 1.0}} | change)
    assert text in str(refused.value)


def test_commands_that_no_equilibrium_holds_change_nothing():
    crawler = Crawler(three())
    before = crawler.copy()
    with pytest.raises(CommandError, match=r"command: the loads sum to \[0, 3\] N, 3 N long"):
        crawler.advance(gait(1)[0], loads=[[0.0, 1.0]] * 3)
    with pytest.raises(CommandError, match=r"loads: shape \(3,\); it must be \(3, 2\)"):
        crawler.advance(gait(1)[0], loads=[0.1, 0.1, 0.1])
    assert crawler == before
    with pytest.raises(CommandError, match="the scene has no loads; add `loads: 0`"):
        Crawler(three(None)).advance(gait(1)[0], loads=np.zeros((3, 2)))


def test_polygons_hold_a_sum_on_their_edge():
    directions = polygon(0.0, 4)
    friction = np.array([[0.2, 0.4, 0.6, 0.4], [0.1, 0.3, 0.5, 0.2]])
    check_planar_equilibrium(np.array([[0.3, 0.1], [0.0, 0.2]]), friction, directions, "here", SceneError)
    with pytest.raises(
        SceneError, match=r"0.31 N along direction 0, but friction against sliding in this direction to 0.3 N"
    ):
        check_planar_equilibrium(np.array([[0.31, 0.1], [0.0, 0.2]]), friction, directions, "here", SceneError)
    crawler = Crawler(three(friction={"directions": QUARTERS, "value": 0.2}))
    for lengths in gait(6):
        step = crawler.advance(lengths, loads=[[0.2, 0.0], [0.2, 0.05], [0.2, 0.0]])
        assert not step.overspent
        assert abs(step.certificate.energy_residual) < 1e-9
    assert np.abs(crawler.displacement).max() < 10.0
