"""Bodies that turn, against closed forms: rods, towed contacts, columns, snakes."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, Step, simulate
from crawler_model.compiled import compiled
from crawler_model.motion.plane.elastic import pull, stiffen
from crawler_model.motion.plane.motion import build_plane_motion

FINE = 1e-7


def build(points: Any, links: Any, **more: Any) -> Scene:
    """Build a scene; `more` may replace the friction, the joints, the drive."""
    body = {"points": np.asarray(points, float).tolist(), "springs": "length", "links": links}
    if "joints" in more:
        body["joints"] = more.pop("joints")
    return Scene.model_validate({"name": "x", "dimension": 2, "body": body, "tolerance": FINE, **more})


def chain_of(count: int, stiffness: float = 10.0) -> dict[str, Any]:
    joints = [[i, i + 1, i + 2] for i in range(count - 2)]
    return {"stiffness": stiffness, "between": joints}


def rotate(points: np.ndarray, angle: float) -> np.ndarray:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.asarray(points) @ np.array([[cos, sin], [-sin, cos]])


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_straight_chain_moves_as_on_the_line(angle):
    rng = np.random.default_rng(1)
    count = 5
    forward, backward = rng.uniform(0.3, 2.0, (2, count))
    friction = {"forward": forward.tolist(), "backward": backward.tolist(), "left": 0.7, "right": 0.7}
    points = rotate(np.column_stack((np.arange(count), np.zeros(count))), angle)
    drive = {"times": [0, 1], "actuation": [[0] * 7, [0.4, -0.4, 0.4, 0.4, 0, 0, 0]]}
    body = Crawler(build(points, {"stiffness": 10.0}, joints=chain_of(count, 0.5), friction=friction, drive=drive))
    line = {"name": "line", "body": {"contacts": list(range(count)), "links": {"stiffness": 10.0}}}
    friction = {"forward": forward.tolist(), "backward": backward.tolist()}
    exact = Crawler(Scene.model_validate({**line, "friction": friction}))
    for _ in range(12):
        lengths = rng.normal(size=count - 1) * 0.4
        body.advance([*lengths, 0, 0, 0])
        exact.advance(lengths)
        x = rotate(body.displacement, -angle)
        assert x[:, 0] == pytest.approx(exact.displacement, abs=2e-8)
        assert np.abs(x[:, 1]).max() < (1e-15 if angle == 0.0 else 1e-9)


@compiled
def _stiffen(frame, command, x, block):
    part = np.empty((6, 6))
    for k in range(frame.points.shape[0]):
        stiffen(frame, command, x, k, part)
        width = 6 if frame.points[k, 2] >= 0 else 4
        for p in range(width):
            for q in range(width):
                block[frame.points[k, p // 2], p % 2, frame.points[k, q // 2], q % 2] += part[p, q]


def test_the_stiffness_of_links_and_joints_is_the_derivative_of_their_forces():
    points = np.array([[0.0, 0.0], [1.0, 0.2], [1.7, 0.9]])
    drive = {"times": [0, 1], "actuation": [[0.0] * 3, [0.2, 0.1, 0.3]]}
    scene = build(points, {"stiffness": 10.0}, joints=chain_of(3, 2.0), friction={"isotropic": 1.0}, drive=drive)
    frame, command = build_plane_motion(scene).frame, scene.drive.targets[1].copy()
    x = np.random.default_rng(0).normal(size=(3, 2)) * 0.1
    stiffness, step = np.zeros((3, 2, 3, 2)), 1e-6
    _stiffen(frame, command, x, stiffness)

    def force(moved: np.ndarray) -> np.ndarray:
        found = np.empty((3, 2))
        pull(frame, command, moved, found, np.empty(3))
        return found

    for i, c in np.ndindex(3, 2):
        away = np.zeros((3, 2))
        away[i, c] = step
        change = (force(x - away) - force(x + away)) / (2.0 * step)
        np.testing.assert_allclose(stiffness[:, :, i, c], change, atol=1e-7)


RODS = [(3, None, 1.0, 1.5), (5, None, 0.75, 7 / 3), (6, None, 0.8, 2.75), (3, (1.0, 2.5, 1.0), 0.5, 2.0)]


@pytest.mark.parametrize(("count", "weights", "centre", "force"), RODS)
def test_a_rod_that_is_pulled_sideways_turns_about_a_contact(count, weights, centre, force):
    """F = sum w |x - a| / a; a is the first contact at which sum w x is half of the whole."""
    place = np.linspace(0.0, 1.0, count)
    mu = np.ones(count) if weights is None else np.array(weights)
    points = [[x, 0.0] for x in place] + [[0.0, -30.0]]
    between = [[i, i + 1] for i in range(count - 1)] + [[0, count]]
    links = {"stiffness": [1e5] * (count - 1) + [1.0], "between": between}
    joints = {"stiffness": 1e5, "between": [[i, i + 1, i + 2] for i in range(count - 2)]}
    friction = {"isotropic": [*mu, 1e3]}
    drive = {"times": [0, 1], "actuation": [[0] * (2 * count - 2), [0] * (count - 1) + [-4.0] + [0] * (count - 2)]}
    body = Crawler(build(points, links, joints=joints, friction=friction, drive=drive))
    for shorter in np.arange(0.05, 4.0, 0.05):
        body.advance([0] * (count - 1) + [-shorter] + [0] * (count - 2))
        if abs(body.displacement[0, 1]) > 1e-2:
            break
    y = body.displacement[:count, 1]
    pivot = place[0] - y[0] * (place[1] - place[0]) / (y[1] - y[0])
    assert pivot == pytest.approx(centre, abs=1e-3)
    assert body.tension[count - 1] == pytest.approx(force, rel=0.01)
    assert force == pytest.approx(float((mu * np.abs(place - centre)).sum()) / centre)


def towed(law: str, side: float) -> tuple[Scene, float]:
    """Build a rear contact that a hand tows; the hand is held by four long links, each of half its stiffness."""
    offset, hand, far = 0.6, 200.0, 3e4
    cos, sin = math.cos(offset), math.sin(offset)
    pull = (cos**2 + sin**2 / 9.0) ** -0.5 if law == "most_dissipative" else 0.0
    points = [[0.0, -1.0], [0.0, 0.0], *(np.array([[1, 0], [-1, 0], [0, 1], [0, -1]]) * far).tolist()]
    links = {"stiffness": [50.0, *[hand / 2] * 4], "between": [[0, 1], [1, 2], [1, 3], [1, 4], [1, 5]]}
    big = 1e6
    friction = {
        "forward": [1.0, 0, *[big] * 4],
        "backward": [1.0, 0, *[big] * 4],
        "left": [3.0, 0, *[big] * 4],
        "right": [3.0, 0, *[big] * 4],
        "angle": [offset, 0, 0, 0, 0, 0],
        "law": law,
    }
    drive = {"times": [0, 1], "actuation": [[0] * 5, [0, -side, side, 0, 0]]}
    return build(points, links, friction=friction, drive=drive), pull


def test_a_towed_contact_follows_its_tractrix():
    """tan((psi + kap) / 2) decays as exp(-X / (a cos kap)), from where the contact begins to slide."""
    way, offset = 3.0, 0.6
    scene, pull = towed("most_dissipative", way)
    body = Crawler(scene)
    body.advance([0, -way, way, 0, 0])
    arm = 1.0 + pull / 40.0
    kap = offset + math.atan2(-math.sin(offset) / 9.0, math.cos(offset))
    first = math.sqrt(arm**2 - 1.0)  # the way of the hand until the contact slides
    decay = math.exp(-(way - first) / (arm * math.cos(kap)))
    psi = 2.0 * math.atan(math.tan(0.5 * (math.atan2(1.0, first) + kap)) * decay) - kap
    rear = body.displacement[0] + [0.0, -1.0]
    assert arm == pytest.approx(1.0295325238, abs=1e-7)
    assert kap == pytest.approx(0.5241307067, abs=1e-7)
    assert rear == pytest.approx([way - arm * math.cos(psi), -arm * math.sin(psi)], abs=1e-6)


@pytest.mark.parametrize(("law", "end"), [("along_velocity", (2.0019146640, 0.2525131274))])
def test_the_law_along_the_velocity_tows_otherwise(law, end):
    body = Crawler(towed(law, 3.0)[0])
    body.advance([0, -3.0, 3.0, 0, 0])
    rear = body.displacement[0] + [0.0, -1.0]
    assert rear == pytest.approx(end, abs=2e-3)  # the reference begins under tension


def column(count: int, longer: float, stiffness: float = 200.0, bending: float = 0.3) -> dict[str, Any]:
    drive = {"times": [0, 1], "actuation": [[0.0] * (2 * count - 1), [longer] * count + [0.0] * (count - 1)]}
    friction = {"isotropic": [100.0, *[0.0] * (count - 1), 100.0]}
    points = [[float(i), 0.0] for i in range(count + 1)]
    joints = chain_of(count + 1, bending)
    return {"points": points, "links": {"stiffness": stiffness}, "joints": joints, "friction": friction, "drive": drive}


@pytest.mark.parametrize("count", [2, 3, 4, 8])
def test_a_column_buckles_under_the_load_of_euler(count):
    run = simulate(build(**column(count, 0.01)), 1.0, 1.0)
    load = 4.0 * 0.3 * math.sin(0.5 * math.pi / count) ** 2
    assert 200.0 * 0.01 * run.jumps[0].time == pytest.approx(load, abs=5e-4)
    assert run.jumps[0].loss == pytest.approx(0.0, abs=1e-7)
    assert abs(run.displacement[-1, 1:-1, 1]).max() > 0.05


def test_a_column_that_begins_beyond_its_load_falls_to_one_side():
    scene = column(2, 0.1, 20.0)
    scene["drive"]["actuation"] = [[0.1, 0.1, 0.0], [0.1, 0.1, 1e-9]]
    run = simulate(build(**scene), 1.0, 1.0)
    (jump,) = run.jumps
    assert jump.loss == pytest.approx(0.1028392070, abs=1e-8)
    assert run.displacement[-1, 1, 1] == pytest.approx(0.3899754391, abs=1e-8)
    again = simulate(build(**scene, on_instability="jump"), 1.0, 1.0)
    assert again.displacement.tobytes() == run.displacement.tobytes()


SNAKES = [
    ((1.0, 1.0, 1.0, 1.0), (-0.0802105, -0.0007422, 0.0185047)),
    ((1.0, 1.0, 5.0, 5.0), (-0.5223432, 0.0890908, -0.3378685)),
    ((0.11, 0.14, 0.20, 0.20), (-0.1770053, -0.0043676, 0.0493400)),
]


def snake(mu: tuple[float, ...], stiffness: float) -> Scene:
    """Build three links with contacts at their quarters; two joints are driven, the others keep links straight."""
    points = sorted({0.0, *(j + part for j in range(3) for part in (0.25, 0.75, 1.0))})
    count = len(points)
    touching = [point % 1.0 != 0.0 for point in points]
    sides = zip(("forward", "backward", "left", "right"), mu, strict=True)
    frame = [[3 * min(max(i - 1, 0) // 3, 2) + 1, 3 * min(max(i - 1, 0) // 3, 2) + 2] for i in range(count)]
    friction: dict[str, Any] = {side: [value * on for on in touching] for side, value in sides}
    corners = [(-0.4, -0.4), (1.2, -0.4), (1.2, 1.2), (-0.4, 1.2), (-0.4, -0.4)]
    rows = np.zeros((5, 2 * count - 3))
    rows[:, [count - 1 + 2, count - 1 + 5]] = corners
    drive = {"times": [0, 1, 2, 3, 4], "period": 4.0, "actuation": rows.tolist()}
    return build(
        [[x, 0.0] for x in points],
        {"stiffness": stiffness},
        joints=chain_of(count, 0.1 * stiffness),
        friction={**friction, "frame": frame},
        drive=drive,
        heading=[4, 5],
        start="relaxed",
    )


@pytest.mark.parametrize(("mu", "gain"), SNAKES)
def test_a_snake_of_three_stiff_links_gains_what_a_rigid_one_does(mu, gain):
    run = simulate(snake(mu, 2e5 * max(mu)), 8.0, 1.0)
    assert run.per_period[-1] == pytest.approx(gain, abs=2e-3)
    assert run.energy.relative_residual == pytest.approx(0.0, abs=1e-5)


def wriggle(seed: int) -> tuple[dict[str, Any], np.ndarray]:
    """Draw a chain of 4 to 12 points, some without friction, and commands."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 13))
    turns = np.cumsum(rng.normal(size=count - 1) * 0.3)
    lengths = rng.uniform(0.7, 1.3, count - 1)
    steps = np.column_stack((lengths * np.cos(turns), lengths * np.sin(turns)))
    mu = rng.uniform(0.1, 1.0, (4, count))
    mu[:, (rng.random(count) < 0.2) & (np.arange(count) > 1)] = 0.0
    scene = {
        "points": np.vstack(([[0.0, 0.0]], np.cumsum(steps, axis=0))),
        "links": {"stiffness": float(rng.uniform(5, 50))},
        "joints": {**chain_of(count), "stiffness": rng.uniform(1, 20, count - 2).tolist()},
        "friction": dict(zip(("forward", "backward", "left", "right"), mu.tolist(), strict=True)),
    }
    goals = np.hstack((rng.normal(size=(4, count - 1)) * 0.1, rng.normal(size=(4, count - 2)) * 0.4))
    return scene, goals


def follow(scene: dict[str, Any], goals: np.ndarray, tolerance: float = 1e-5) -> tuple[Crawler, list[Step]]:
    rows = [[0.0] * goals.shape[1], *goals.tolist()]
    drive = {"times": list(range(len(rows))), "actuation": rows}
    body = Crawler(build(**{**scene, "drive": drive, "tolerance": tolerance}))
    return body, [body.advance(goal) for goal in goals]


@pytest.mark.parametrize("seed", range(12))
def test_work_is_stored_dissipated_or_lost_in_jumps(seed):
    _, steps = follow(*wriggle(seed))
    total = sum(step.work for step in steps)
    residual = sum(step.certificate.energy_residual for step in steps)
    assert abs(residual) < 1e-4 * total
    assert max(step.certificate.violation for step in steps) < 1e-9


@pytest.mark.parametrize("seed", [30, 42])
def test_energies_keep_the_tolerance(seed):
    """A bare point that moves by itself arrives at the same place in any number of steps, which shows nothing of the
    work."""
    _, steps = follow(*wriggle(seed), 1e-7)
    residual = sum(step.certificate.energy_residual for step in steps)
    assert abs(residual) < 1e-7 * sum(step.work for step in steps)


@pytest.mark.parametrize("seed", [1, 3, 7, 9, 11, 19])
def test_small_tolerances_are_kept_without_false_jumps(seed):
    """Starts, stops and changes to other quarters of the sets of friction are found as closely as needed."""
    scene, goals = wriggle(seed)
    exact, steps = follow(scene, goals, 1e-9)
    assert not any(step.jumps for step in steps)
    assert sum(step.events for step in steps) < 10_000  # else parts are shortened in vain for rounding errors
    for tolerance in (1e-7, 1e-8):
        body, _ = follow(scene, goals, tolerance)
        assert np.abs(body.displacement - exact.displacement).max() < 0.3 * tolerance * np.abs(goals).max()


@pytest.mark.parametrize("ticks", [1, 10, 100])
def test_a_contact_that_begins_without_force_starts_where_it_is_overcome(ticks):
    """Until the weaker of two contacts slides, the link stores mu^2 / (2 k)."""
    friction = {"forward": 0.1, "backward": 1.0, "left": 0.5, "right": 0.5}
    drive = {"times": [0, 1], "actuation": [[0], [0.3]]}
    run = simulate(build([[0.0, 0.0], [1.0, 0.0]], {"stiffness": 400.0}, friction=friction, drive=drive), 1.0, ticks)
    assert run.energy.work == pytest.approx(0.1 * 0.3 - 0.1**2 / 800.0, abs=1e-9)
    assert run.energy.relative_residual == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize("seed", [0, 3, 5])
def test_a_finer_tolerance_is_kept(seed):
    scene, goals = wriggle(seed)
    fine = follow(scene, goals, 1e-7)[0].displacement
    for tolerance in (1e-3, 1e-4, 1e-5):
        assert np.abs(follow(scene, goals, tolerance)[0].displacement - fine).max() < tolerance * 0.4 * 3.0


@pytest.mark.parametrize("seed", range(6))
def test_motion_does_not_depend_on_the_view(seed):
    """Turned, mirrored, in other units of force and length: the same motion, though steps adapt to their errors."""
    scene, goals = wriggle(seed)
    joints = len(scene["joints"]["between"])
    x = follow(scene, goals)[0].displacement
    close = {"rel": 0.0, "abs": 1e-12 * np.ptp(scene["points"])}
    for angle in (0.7, -2.6):
        turned = follow({**scene, "points": rotate(scene["points"], angle)}, goals)[0].displacement
        assert turned == pytest.approx(rotate(x, angle), **close)
    sides = {**scene["friction"], "left": scene["friction"]["right"], "right": scene["friction"]["left"]}
    mirror = np.array([1.0, -1.0])
    flip = np.concatenate((np.ones(goals.shape[1] - joints), -np.ones(joints)))
    mirrored = follow({**scene, "points": scene["points"] * mirror, "friction": sides}, goals * flip)[0].displacement
    assert mirrored == pytest.approx(x * mirror, **close)

    def measured_in(metre: float, newton: float) -> np.ndarray:
        bending = np.array(scene["joints"]["stiffness"]) * (metre * newton)
        units = {
            "points": scene["points"] * metre,
            "links": {"stiffness": scene["links"]["stiffness"] * newton / metre},
            "joints": {**scene["joints"], "stiffness": bending.tolist()},
            "friction": {side: (newton * np.array(value)).tolist() for side, value in scene["friction"].items()},
        }
        lengths = np.where(np.arange(goals.shape[1]) < goals.shape[1] - joints, metre, 1.0)
        return np.asarray(follow(units, goals * lengths)[0].displacement / metre)

    assert measured_in(1.0, 7.0) == pytest.approx(x, **close)
    assert measured_in(1000.0, 1.0) == pytest.approx(x, **close)


def test_a_point_that_sticks_stays_where_it_is_to_the_bit():
    scene, _ = wriggle(2)
    count = len(scene["points"])
    body = Crawler(
        build(**scene, drive={"times": [0, 1], "actuation": [[0] * (2 * count - 3), [0.1] * (2 * count - 3)]})
    )
    body.advance([0.05] * (2 * count - 3))
    before = body.displacement
    rng = np.random.default_rng(0)
    at = body.actuation
    for _ in range(500):
        body.advance(at + 1e-4 * rng.normal(size=at.size) * (scene["friction"]["forward"][0] > 0.0))
        body.advance(at)
    stuck = np.abs(body.displacement - before).max(axis=1) == 0.0
    assert stuck.sum() >= 1


def test_a_contact_that_is_pushed_is_unstable():
    """A force T along a link of length l holds its end across with T / l, as a part of its stiffness k."""
    margins = []
    for way in (0.5, -0.5):
        drive = {"times": [0, 1], "actuation": [[0], [way]]}
        friction = {"isotropic": [10.0, 1.0]}
        body = Crawler(build([[0.0, 0.0], [1.0, 0.0]], {"stiffness": 50.0}, friction=friction, drive=drive))
        body.advance([way])
        margins.append(body.stability_margin)
    length = 1.0 + 0.5 - 1.0 / 50.0, 1.0 - 0.5 + 1.0 / 50.0
    assert margins == pytest.approx([-1.0 / 50.0 / (1.0 - 1.0 / 50.0), 1.0 / 50.0 / length[1]], rel=0.5)
    assert margins[0] < 0.0 < margins[1]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
@pytest.mark.parametrize(
    ("isotropic", "unique"),
    [([1.0, 0.0, 1.0], False), ([1.0, 0.0, 0.0], False), ([1.0, 0.0, 1.5], True), ([1.0, 0.5, 1.0], True)],
    ids=["two slide towards each other", "one holds it but not its yaw", "one holds it", "one rests beside them"],
)
def test_what_friction_leaves_open_is_not_unique(isotropic, unique, tolerance):
    scene = build(
        [[1e6, 0.0], [1e6 + 1.0, 0.25], [1e6 + 2.0, 0.0]],
        {"stiffness": 50.0},
        joints={"stiffness": 1.0},
        friction={"isotropic": isotropic},
        drive={"times": [0.0, 1.0], "actuation": [[0.0, 0.0, 0.0], [0.2, 0.1, 0.3]]},
        tolerance=tolerance,
    )
    assert simulate(scene, 1.0, rate=1.0).unique == unique


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_two_contacts_on_isotropic_friction_are_no_more_unique_than_on_the_line(angle):
    along = [math.cos(angle), math.sin(angle)]
    scene = build([[0.0, 0.0], along], {"stiffness": 50.0}, friction={"isotropic": 1.0})
    crawler = Crawler(scene)
    assert not crawler.advance([0.2]).unique


def test_a_body_that_cannot_be_followed_to_the_tolerance_is_not_taken_to_jump():
    """Friction a thousand times less to one side; at 2.5e-8 no part of some stretches keeps its share of the tolerance."""
    document = json.loads((Path(__file__).parents[1] / "planar_hard_cases.json").read_text())["one_sided_chain"]
    ends = []
    for tolerance in (1e-6, 2.5e-8):
        crawler = Crawler(Scene.model_validate(document | {"tolerance": tolerance, "on_instability": "refuse"}))
        step = crawler.advance(crawler.scene.drive.targets[1, :11])
        ends.append(crawler.displacement)
    assert step.overspent
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_friction_far_larger_to_one_side_takes_few_parts(tolerance):
    """The force on a point is about to change between quarters of its set whose friction is 900 and 3 000 times as large."""
    friction = {
        "forward": [0.599, 0.269, 0.865],
        "backward": [0.469, 0.000789, 0.000275],
        "left": [0.21, 0.301, 0.00014],
        "right": [0.999, 0.737, 0.193],
        "frame": [[2, 1], [1, 0], [1, 2]],
        "angle": [-2.48, -0.778, -2.29],
    }
    points = [[0.0, 0.0], [0.4559, 0.4171], [1.125, 0.7339]]
    drive = {"times": [0, 1], "actuation": [[0, 0, 0], [0.082, 0.0375, 0]]}
    body = Crawler(
        build(
            points,
            {"stiffness": 194.0},
            joints=chain_of(3, 0.898),
            friction=friction,
            drive=drive,
            tolerance=tolerance,
        )
    )
    step = body.advance([0.082, 0.0375, 0.0])
    assert step.events < 300  # it once took 18 000
    end = [[0.0, 0.0], [0.114252, -0.011403], [0.174802, -0.058245]]
    np.testing.assert_allclose(body.displacement, end, rtol=0.0, atol=0.5 * tolerance * 0.082 + 1e-6)


def test_a_body_that_rolls_along_does_not_jump():
    """Friction 900 times less to one side: two contacts roll and turn the body, by 8 m within a sixteenth of the ramp.

    Of 4 million implicit steps of equal length along the ramp none moves a contact by more than 0.2 mm or loses energy.
    Their end and the ends of 1 million and 300 000 steps extrapolate to 5.8526 m. The body once went round for ever.
    """
    friction = {
        "forward": [0.63, 0.00084, 0.58],
        "backward": [0.64, 0.00084, 0.4],
        "left": [0.58, 0.75, 0.16],
        "right": [0.00071, 0.0016, 0.51],
        "frame": [[0, 1], [0, 1], [1, 2]],
    }
    scene = {
        "points": [[0.0, 0.0], [1.4, -0.014], [2.7, 0.17]],
        "links": {"stiffness": 12.0},
        "joints": chain_of(3, 4.2),
        "friction": friction,
    }
    goals = np.array([[0.11, 0.0, -0.15], [0.26, 0.23, -0.17], [0.036, 0.21, 0.15]])
    body, steps = follow(scene, goals, 1e-3)
    assert not any(step.jumps for step in steps)
    assert [step.overspent for step in steps] == [0, 0, 1]
    assert abs(steps[-1].certificate.energy_residual) < 5e-3 * steps[-1].dissipation
    assert np.abs(body.displacement).max() == pytest.approx(5.8526, abs=0.05)
    assert max(step.certificate.violation for step in steps) < 1e-9


@pytest.mark.parametrize("middle", [0.0, 0.03])
def test_a_link_that_shrinks_to_a_point_ends_the_ramp(middle):
    """Its tension has no direction there. A mere rest length below 0 does no harm while friction keeps the ends apart."""
    friction = {"forward": 0.1, "backward": 1.0, "left": 0.5, "right": 0.5}
    points = [[0.0, 0.0], [0.1, middle], [0.2, 0.0]]
    body = Crawler(build(points, {"stiffness": 50.0}, joints=chain_of(3, 2.0), friction=friction))
    body.advance([-0.05, 0.0, 0.0])
    before = body.displacement.copy()
    with pytest.raises(CommandError, match="link_0 shrinks to a point, for want of a rest length > 0, at"):
        body.advance([-0.15, 0.0, 0.0])
    np.testing.assert_array_equal(body.displacement, before)
    body.advance([0.0, 0.0, 0.0])
