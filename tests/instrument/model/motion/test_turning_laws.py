"""Laws that hold for all bodies that turn: random trees with friction and stiffness over two decades."""

from __future__ import annotations

import math
import os
from typing import Any

import numpy as np
import pytest

from crawler_model import CommandError, Crawler, Scene, load_scene, simulate

from .viscous import creep

TOLERANCE = 1e-5
BODIES = 200 if os.environ.get("HYPOTHESIS_PROFILE") == "soak" else 8
TICKS = 1_000_000 if BODIES > 8 else 2_000


def grow(rng: np.random.Generator, count: int) -> tuple[np.ndarray, list[list[int]], list[list[int]]]:
    """Grow a tree whose points are apart; every link but the first turns against an earlier one."""
    points, links, joints, parents = [np.zeros(2)], [], [], [-1]
    while len(points) < count:
        i = len(points)
        parent = int(rng.integers(max(0, i - 2), i)) if rng.random() < 0.8 else int(rng.integers(0, i))
        angle, length = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.5, 1.5)
        point = points[parent] + length * np.array([math.cos(angle), math.sin(angle)])
        if min(np.hypot(*(point - other)) for other in points) < 0.4:
            continue
        other = parents[parent] if parents[parent] >= 0 else next((b for a, b in links if a == parent), -1)
        joints += [[other, parent, i]] if other >= 0 else []
        links.append([parent, i])
        points.append(point)
        parents.append(parent)
    return np.array(points), links, joints


def tree(seed: int) -> dict[str, Any]:
    """Build the document of a tree of 4 to 30 points with five ramps."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(4, 31))
    points, links, joints = grow(rng, count)
    lengths, angles = rng.normal(size=(6, len(links))) * 0.1, rng.normal(size=(6, len(joints))) * 0.3
    actuation = np.hstack((lengths, angles))
    actuation[0] = 0.0
    sides = 10.0 ** rng.uniform(-1.5, 0.5, (4, count))
    return {
        "name": "tree",
        "dimension": 2,
        "body": {
            "points": points.tolist(),
            "springs": "length",
            "links": {"stiffness": (10.0 ** rng.uniform(1, 3, len(links))).tolist(), "between": links},
            "joints": {"stiffness": (10.0 ** rng.uniform(-0.5, 1.5, len(joints))).tolist(), "between": joints},
        },
        "friction": dict(zip(("forward", "backward", "left", "right"), sides.tolist(), strict=True)),
        "drive": {"times": list(range(6)), "actuation": actuation.tolist()},
        "tolerance": TOLERANCE,
    }


def follow(document: dict[str, Any]) -> tuple[np.ndarray, Crawler, list[Any]]:
    """Follow all ramps; return the displacement after each, the body, and the steps."""
    body = Crawler(Scene.model_validate(document))
    steps, places = [], []
    for goal in document["drive"]["actuation"][1:]:
        steps.append(body.advance(goal))
        places.append(body.displacement)
    return np.array(places), body, steps


@pytest.mark.parametrize("seed", range(BODIES))
def test_energies_balance_and_forces_stay_in_their_sets(seed):
    _, body, steps = follow(tree(seed))
    work = sum(abs(step.work) for step in steps)
    residual = sum(step.certificate.energy_residual for step in steps)
    assert abs(residual) < 1e-4 * work
    assert max(step.certificate.violation for step in steps) < 1e-8
    assert body.margins.min() > -1e-8


@pytest.mark.parametrize("seed", [3, 5])
def test_a_finer_tolerance_finds_no_more_jumps(seed):
    """Forces change quarters in most parts of the way; where none was found short enough, the body jumped in place."""
    document = tree(seed) | {"tolerance": 1e-6}
    document["drive"] = {key: value[:4] for key, value in document["drive"].items()}
    assert not any(step.jumps for step in follow(document)[2])


def turned(document: dict[str, Any], angle: float) -> dict[str, Any]:
    cos, sin = math.cos(angle), math.sin(angle)
    points = np.array(document["body"]["points"]) @ np.array([[cos, sin], [-sin, cos]])
    return {**document, "body": {**document["body"], "points": points.tolist()}}


def mirrored(document: dict[str, Any]) -> dict[str, Any]:
    points = np.array(document["body"]["points"]) * [1.0, -1.0]
    sides = {"left": document["friction"]["right"], "right": document["friction"]["left"]}
    actuation = np.array(document["drive"]["actuation"])
    actuation[:, len(document["body"]["links"]["between"]) :] *= -1.0
    return {
        **document,
        "body": {**document["body"], "points": points.tolist()},
        "friction": {**document["friction"], **sides},
        "drive": {**document["drive"], "actuation": actuation.tolist()},
    }


@pytest.mark.parametrize("seed", range(2, 2 + BODIES // 2))
def test_motion_does_not_depend_on_the_view(seed):
    document = tree(seed)
    places, _, _ = follow(document)
    cos, sin = math.cos(0.7), math.sin(0.7)
    expected = places @ np.array([[cos, sin], [-sin, cos]])
    assert follow(turned(document, 0.7))[0] == pytest.approx(expected, abs=1e-9)
    assert follow(mirrored(document))[0] == pytest.approx(places * [1.0, -1.0], abs=1e-9)


@pytest.mark.parametrize("friction", [0.2, 0.5, 1.0])
def test_ticks_do_not_change_the_motion(friction):
    """The feet of the star stop and start close to each other."""
    document = load_scene("tripedal_star").document()
    document |= {"friction": {"isotropic": [0.0, friction, friction, friction]}, "tolerance": 1e-6}
    star = Scene.model_validate(document)
    yaws = [simulate(star, 3.0, rate).yaw[-1] for rate in (5.0, 10.0, 20.0, 50.0)]
    assert np.ptp(yaws) < 2e-6


def test_a_body_that_trembles_does_not_creep():
    """It shakes down, ever slower; then contacts that return to the boundary of their sets stay to the bit."""
    document = tree(3)
    body = Crawler(Scene.model_validate(document))
    at = 0.2 * np.array(document["drive"]["actuation"][1])
    places = []
    for tick in range(TICKS):
        body.advance(at if tick % 2 == 0 else 0.999 * at)
        places += [body.displacement] if tick in (1000, TICKS - 2) else []
    assert (places[0] == places[1]).all()


def soft(seed: int) -> dict[str, Any]:
    """Build the document of a soft chain, nearly half of whose points are bare, with three long ramps."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 9))
    turns, lengths = np.cumsum(rng.normal(size=count - 1) * 0.4), rng.uniform(0.7, 1.3, count - 1)
    steps = np.column_stack((lengths * np.cos(turns), lengths * np.sin(turns)))
    sides = 10.0 ** rng.uniform(-1.0, 0.7, (4, count))
    bare = rng.random(count) < 0.45
    bare[rng.integers(0, count)] = False
    bare[1] |= not bare.any()
    sides[:, bare] = 0.0
    between = [[i, i + 1] for i in range(count - 1)]
    joints = [[i, i + 1, i + 2] for i in range(count - 2)]
    size, bend = rng.uniform(0.1, 0.4), rng.uniform(0.3, 2.0)
    goals = np.hstack((rng.normal(size=(3, count - 1)) * size, rng.normal(size=(3, count - 2)) * bend))
    goals[:, : count - 1] = np.clip(goals[:, : count - 1], -0.5, 1.0)
    body = {
        "points": np.vstack(([[0.0, 0.0]], np.cumsum(steps, axis=0))).tolist(),
        "springs": "length",
        "links": {"stiffness": (10.0 ** rng.uniform(0.5, 2.0, count - 1)).tolist(), "between": between},
        "joints": {"stiffness": (10.0 ** rng.uniform(-1.5, 0.5, count - 2)).tolist(), "between": joints},
    }
    friction = dict(zip(("forward", "backward", "left", "right"), sides.tolist(), strict=True))
    drive = {"times": [0, 1, 2, 3], "actuation": [np.zeros(goals.shape[1]).tolist(), *goals.tolist()]}
    return {"name": "soft", "dimension": 2, "body": body, "friction": friction, "drive": drive, "tolerance": 1e-4}


FAMILIES = [
    *((soft, seed) for seed in (range(1200) if BODIES > 8 else (*range(24), 199))),
    *((tree, seed) for seed in range(BODIES)),
]


def stored(body: Crawler) -> float:
    stiffness = np.r_[body.body.stiffness, body.body.turning.joint_stiffness]
    return float((body.tension**2 / stiffness).sum() / 2.0)


@pytest.mark.parametrize(("family", "seed"), FAMILIES)
def test_what_is_not_stored_dissipated_or_done_by_loads_is_lost_in_a_listed_jump(family, seed):
    """The residual follows from the energies, and is small, also where a ramp spent its budget or left its
    tolerance."""
    document = family(seed)
    least = document["tolerance"] * np.max(list(document["friction"].values()))
    body = Crawler(Scene.model_validate(document), budget=100_000)
    before = stored(body)
    for goal in document["drive"]["actuation"][1:]:
        try:
            step = body.advance(goal)
        except CommandError as error:
            assert "budget" in str(error) or "%" in str(error)  # noqa: PT017
            break
        after = stored(body)
        missed = after - before + step.dissipation + step.jump_loss - step.work
        spent = abs(after - before) + step.dissipation + abs(step.work)
        assert missed == pytest.approx(step.certificate.energy_residual, abs=1e-9 * spent)
        assert abs(missed) < 5e-3 * spent + least
        assert all(jump.loss >= 0.0 for jump in step.jumps)
        before = after


@pytest.mark.parametrize("seed", [24, 76])
def test_a_body_that_creeps_up_to_a_fold_jumps_there(seed):
    """Its parts become ever shorter: unless they are given up, they spend this budget, and one step takes the rest."""
    document = soft(seed)
    body = Crawler(Scene.model_validate(document), budget=2_000_000)
    steps = [body.advance(goal) for goal in document["drive"]["actuation"][1:]]
    assert not any(step.overspent for step in steps)
    assert steps[-1].jumps
    assert all(jump.fraction < 1.0 and jump.loss > 0.0 for jump in steps[-1].jumps)


def arch(seed: int) -> dict[str, Any]:
    """Build the document of two links between heavy feet, whose joint is bent to the other side and back."""
    rng = np.random.default_rng(seed)
    points = [[0.0, 0.0], [rng.uniform(0.28, 0.32), rng.uniform(0.05, 0.15)], [0.6, 0.0]]
    bent = [*rng.uniform(-0.01, 0.03, 2), rng.uniform(1.0, 2.5)]
    back = [*rng.uniform(-0.01, 0.03, 2), rng.uniform(-1.0, 1.0)]
    return {
        "name": "arch",
        "dimension": 2,
        "body": {
            "points": points,
            "springs": "length",
            "links": {"stiffness": rng.uniform(30, 200, 2).tolist(), "between": [[0, 1], [1, 2]]},
            "joints": {"stiffness": [rng.uniform(0.02, 0.3)], "between": [[0, 1, 2]]},
        },
        "friction": {"isotropic": [2.5, rng.uniform(0.01, 0.1), 2.5]},
        "drive": {"times": [0, 1, 2, 3], "period": 3.0, "actuation": [[0, 0, 0], bent, back, [0, 0, 0]]},
        "tolerance": TOLERANCE,
    }


def thin(seed: int, loaded: bool) -> dict[str, Any]:
    """Build the document of a tree of three to five points with isotropic friction and three ramps."""
    rng = np.random.default_rng(seed)
    points, links, joints = grow(rng, int(rng.integers(3, 6)))
    friction = 10.0 ** rng.uniform(-1.0, 0.3, len(points))
    sizes = [0.15] * len(links) + [0.5] * len(joints)
    drive = {"times": [0, 1, 2, 3], "actuation": (rng.normal(size=(4, len(sizes))) * sizes).tolist()}
    drive["actuation"][0] = [0.0] * len(sizes)
    if loaded:
        angle = rng.uniform(0.0, 2.0 * np.pi, len(points))
        size = 0.6 * friction * rng.random(len(points))
        drive["loads"] = [np.column_stack((size * np.cos(angle), size * np.sin(angle))).tolist()] * 4
    return {
        "name": "thin",
        "dimension": 2,
        "body": {
            "points": points.tolist(),
            "springs": "length",
            "links": {"stiffness": (10.0 ** rng.uniform(1, 2, len(links))).tolist(), "between": links},
            "joints": {"stiffness": (10.0 ** rng.uniform(-0.3, 1, len(joints))).tolist(), "between": joints},
        },
        "friction": {"isotropic": friction.tolist()},
        "drive": drive,
        "tolerance": TOLERANCE,
    }


@pytest.mark.parametrize("seed", range(BODIES))
def test_where_a_jump_ends_does_not_depend_on_the_rate_of_ticks(seed):
    """Its path is followed in steps so short that their number does not matter."""
    scene = Scene.model_validate(arch(seed))
    whole, *divided = (simulate(scene, 3.0, rate) for rate in (1.0 / 3.0, 7.0 / 3.0, 34.0))
    for run in divided:
        assert len(run.jumps) == len(whole.jumps)
        assert [jump.loss for jump in run.jumps] == pytest.approx([jump.loss for jump in whole.jumps], rel=5e-4)
        assert run.position[-1] == pytest.approx(whole.position[-1], abs=2e-5)


@pytest.mark.parametrize("seed", [1, 3, 15])
def test_a_jump_ends_where_points_in_a_viscous_liquid_come_to_rest(seed):
    document = arch(seed)
    scene, drive = Scene.model_validate(document), document["drive"]
    jump = simulate(scene, 3.0, 1.0 / 3.0).jumps[0]
    assert jump.time < 1.0
    crawler, places = Crawler(scene), []
    for time in (jump.time * (1.0 - 1e-3), jump.time * (1.0 + 1e-4)):
        command = [np.interp(time, drive["times"], column) for column in np.transpose(drive["actuation"])]
        crawler.advance(command)
        places.append(scene.body.position + crawler.displacement)
    held = document | {"drive": {"times": [0, 1], "actuation": [command, command]}}
    assert np.abs(places[1] - places[0]).max() > 0.1
    assert places[1] == pytest.approx(creep(held, places[0], [0.0, 1.0], 1e5), abs=1e-4)


@pytest.mark.parametrize("loaded", [False, True])
@pytest.mark.parametrize("seed", range(BODIES))
def test_bodies_go_where_points_in_a_thin_liquid_go(seed, loaded):
    """The liquid delays all motion by a time that becomes a tenth where commands take ten times as long."""
    document = thin(seed, loaded)
    run = simulate(Scene.model_validate(document), 3.0, 1.0)
    start = np.array(document["body"]["points"])
    quick, slow = (creep(document, start, document["drive"]["times"], seconds) for seconds in (1e3, 1e4))
    delay = np.abs(quick - slow).max()
    assert delay < 1.0
    assert run.position[-1] == pytest.approx(slow, abs=0.4 * delay + 2e-4)
