"""The time limit covers all that an optimisation does, and its examination does not beat the gait that it returns."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cma")

from crawler_model import Optimum, Scene, SceneError, load_scene, optimise, pareto
from crawler_model.optimise import examine, limit, search, space
from crawler_model.optimise import optimise as whole
from crawler_model.optimise import pareto as fronts
from crawler_model.optimise.landscape import map_plane, profile
from crawler_model.optimise.polish import improves

SECONDS, PACE = 1.0, 100
"""A clock on which a candidate takes a hundredth of a second, so that nothing depends on the machine."""
CHAIN = {
    "name": "chain",
    "body": {"contacts": [0, 1, 2, 3], "links": {"stiffness": 1.0}},
    "friction": {"forward": 0.1, "backward": 0.3},
}
SLOW = CHAIN | {"name": "slow", "body": {"contacts": [0, 1, 2, 3], "links": {"stiffness": [1.0, 1e-3, 1.0]}}}
CASES: dict[str, Callable[[], Any]] = {
    "on a line": lambda: optimise(Scene.model_validate(CHAIN), stroke=(0.0, 1.0), seconds=10 * SECONDS),
    "no periodic regime": lambda: optimise(Scene.model_validate(SLOW), stroke=(0.0, 1.0), seconds=10 * SECONDS),
    "robust": lambda: optimise(
        Scene.model_validate(CHAIN),
        waypoints=3,
        stroke=(0.0, 1.0),
        robust={"friction.forward": (0.8, 1.2), "friction.backward": (0.8, 1.2)},
        seconds=10 * SECONDS,
    ),
    "turn": lambda: optimise(load_scene("scissors"), "turn", waypoints=4, seconds=SECONDS),
    "in the plane": lambda: optimise(load_scene("planar_three_points"), waypoints=3, seconds=SECONDS),
    "compromises": lambda: pareto(Scene.model_validate(CHAIN), waypoints=3, stroke=(0.0, 1.0), seconds=20 * SECONDS),
}


@pytest.fixture
def run_so_far(monkeypatch: pytest.MonkeyPatch) -> Callable[[], int]:
    """Let the clock count candidates."""
    count = 0
    regimes = space.Space.regimes

    def counted(self: space.Space, points: np.ndarray) -> Any:
        nonlocal count
        count += len(points)
        return regimes(self, points)

    monkeypatch.setattr(space.Space, "regimes", counted)
    for module in (limit, search, examine, fronts, whole, space):
        monkeypatch.setattr(module, "clock", lambda: count / PACE)
    return lambda: count


@pytest.mark.parametrize("case", CASES)
def test_nothing_begins_after_the_time_limit(case: str, run_so_far: Callable[[], int]) -> None:
    found = CASES[case]()
    seconds = {"compromises": 20.0, "turn": 1.0, "in the plane": 1.0}.get(case, 10.0) * SECONDS
    if isinstance(found, Optimum):
        profile(found)
        if found.scene.dimension == 1:
            map_plane(found)
    assert not found.complete
    assert run_so_far() <= 1.1 * seconds * PACE


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", ["scissors", "planar_three_points", "chain"])
def test_no_gait_around_the_best_one_is_better(case: str, seed: int, run_so_far: Callable[[], int]) -> None:
    scene = Scene.model_validate(CHAIN) if case == "chain" else load_scene(case)
    stroke = (0.0, 1.0) if case == "chain" else None
    objective = "turn" if case == "scissors" else "translation"
    found = optimise(scene, objective, waypoints=4, stroke=stroke, seconds=4.0, seed=seed)
    _, around = profile(found)
    best = float(np.nanmax(around)) if np.isfinite(around).any() else found.value
    assert not improves(best, found.value + found.space.goal.resolution)
    assert found.value == pytest.approx(found.space.value(found.space.regimes(found.point[None])[0]))


def test_ctrl_c_in_the_examination_keeps_the_best_gait(monkeypatch: pytest.MonkeyPatch) -> None:
    look, looked = examine._find_transient, []

    def once(*given: Any) -> float:
        looked.append(given)
        if len(looked) == 1:
            raise KeyboardInterrupt
        return look(*given)

    monkeypatch.setattr(examine, "_find_transient", once)
    found = optimise(Scene.model_validate(CHAIN), waypoints=2, stroke=(0.0, 1.0))
    assert found.interrupted
    assert found.value > 0.0


PASSIVE = CHAIN | {"body": {"contacts": [0, 1, 2], "links": [{"stiffness": 1.0}, {"passive": {"stiffness": 2.0}}]}}
DRIVE = {"times": [0, 1], "period": 2.0, "actuation": [[0.0, 0.0], [1.0, 0.0]]}


@pytest.mark.parametrize("stroke", [(0.0, 1.0), {"link_0": (0.0, 1.0)}, None], ids=["one", "by name", "of the drive"])
def test_a_passive_link_needs_no_stroke(stroke: Any) -> None:
    scene = Scene.model_validate(PASSIVE | ({"drive": DRIVE} if stroke is None else {}))
    found = optimise(scene, waypoints=2, stroke=stroke)
    assert found.names == ("drive.actuation[0][0]", "drive.actuation[1][0]")
    assert found.value > 0.0
    assert np.array(found.scene.document()["drive"]["actuation"])[:, 1].tolist() == [0.0] * 3


def test_a_stroke_of_a_passive_link_is_one_line() -> None:
    with pytest.raises(SceneError, match="stroke: 'link_1'"):
        optimise(Scene.model_validate(PASSIVE), stroke={"link_0": (0.0, 1.0), "link_1": (0.0, 1.0)})
