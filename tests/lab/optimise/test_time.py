"""The time limit covers all that an optimisation does, and no gait that it tried is better than the one it returns."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cma")

from crawler_lab import Optimum, optimise, pareto
from crawler_lab.optimise import examine, limit, search, space
from crawler_lab.optimise import optimise as whole
from crawler_lab.optimise import pareto as fronts
from crawler_lab.optimise.landscape import map_plane, profile
from crawler_lab.optimise.polish import improves
from crawler_model import Scene, load_scene

PACE = 100
"""Candidates in a second of the clock of these tests, so that nothing depends on the machine."""
CHAIN = {
    "name": "chain",
    "body": {"contacts": [0, 1, 2, 3], "links": {"stiffness": 1.0}},
    "friction": {"forward": 0.1, "backward": 0.3},
}
SLOW = CHAIN | {"name": "slow", "body": {"contacts": [0, 1, 2, 3], "links": {"stiffness": [1.0, 1e-3, 1.0]}}}
ROBUST = {"friction.forward": (0.8, 1.2), "friction.backward": (0.8, 1.2)}
CASES: dict[str, tuple[float, Callable[[float], Any]]] = {
    "on a line": (10.0, lambda s: optimise(Scene.model_validate(CHAIN), stroke=(0.0, 1.0), seconds=s)),
    "no periodic regime": (10.0, lambda s: optimise(Scene.model_validate(SLOW), stroke=(0.0, 1.0), seconds=s)),
    "robust": (
        10.0,
        lambda s: optimise(Scene.model_validate(CHAIN), waypoints=3, stroke=(0.0, 1.0), robust=ROBUST, seconds=s),
    ),
    "turn": (1.0, lambda s: optimise(load_scene("scissors"), "turn", waypoints=4, seconds=s)),
    "in the plane": (1.0, lambda s: optimise(load_scene("planar_three_points"), waypoints=3, seconds=s)),
    "compromises": (20.0, lambda s: pareto(Scene.model_validate(CHAIN), waypoints=3, stroke=(0.0, 1.0), seconds=s)),
}


@dataclass
class Tried:
    """What was tried: when, by the clock of these tests, in which space, and the points with their regimes."""

    count: int = 0
    calls: list[tuple[float, space.Space, np.ndarray, list[Any]]] = field(default_factory=list)

    @property
    def clock(self) -> float:
        return self.count / PACE


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> Tried:
    """Let the clock count candidates."""
    seen, regimes = Tried(), space.Space.regimes

    def counted(self: space.Space, points: np.ndarray) -> Any:
        when = seen.clock
        seen.count += len(points)
        found = regimes(self, points)
        seen.calls.append((when, self, points, found))
        return found

    monkeypatch.setattr(space.Space, "regimes", counted)
    monkeypatch.setattr(space, "available_cores", lambda: 1)
    for module in (limit, search, examine, fronts, whole, space):
        monkeypatch.setattr(module, "clock", lambda: seen.clock)
    return seen


@pytest.mark.parametrize("case", CASES)
def test_no_candidate_is_run_after_the_time_limit(case: str, tried: Tried) -> None:
    """Only what is returned may be run again, as it has to be described."""
    seconds, run = CASES[case]
    found = run(seconds)
    returned = [found.values] if isinstance(found, Optimum) else [point.values for point in found.points]
    if isinstance(found, Optimum):
        profile(found)
        if found.scene.dimension == 1:
            map_plane(found)
    assert not found.complete
    late = [(one, points) for when, one, points, _ in tried.calls if when >= seconds]
    for one, points in late:
        assert points.shape[0] == 1
        values = one.values(one.canonical(points[0]))
        if isinstance(
            found, Optimum
        ):  # of compromises all ends are described, and those that another one beats left out
            assert any(np.allclose(values, other, atol=1e-12) for other in returned)
    assert tried.clock >= seconds


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", ["scissors", "planar_three_points", "chain"])
def test_no_gait_that_was_tried_is_better_than_the_one_that_is_returned(case: str, seed: int, tried: Tried) -> None:
    scene = Scene.model_validate(CHAIN) if case == "chain" else load_scene(case)
    stroke = (0.0, 1.0) if case == "chain" else None
    objective = "turn" if case == "scissors" else "translation"
    found = optimise(scene, objective, waypoints=4, stroke=stroke, seconds=2.0, seed=seed)
    own = found.space.regimes(found.point[None])[0]
    scores = [found.space.score(one) for _, other, _, all_ in tried.calls if other is found.space for one in all_]
    assert len(scores) > 150
    assert not improves(max(scores), found.space.score(own))
    assert found.value == pytest.approx(found.space.value(own))
