"""The time limit covers all that an optimisation does, the gait that it returns is examined, and none it tried is better."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("cma")

from crawler_lab import Optimum, Posterior, optimise, pareto
from crawler_lab.optimise import examine, limit, search, space
from crawler_lab.optimise import optimise as whole
from crawler_lab.optimise import pareto as fronts
from crawler_lab.optimise.landscape import map_plane
from crawler_lab.optimise.optimise import build_space
from crawler_lab.optimise.polish import improves
from crawler_lab.optimise.request import Request
from crawler_lab.verbs.optimum_report import describe_optimum
from crawler_model import Scene, load_scene

PACE = 100
"""Bodies that are followed in a second of the clock of these tests, so that nothing depends on the machine."""
CHAIN = {
    "name": "chain",
    "body": {"contacts": [0, 1, 2, 3], "links": {"stiffness": 1.0}},
    "friction": {"forward": 0.1, "backward": 0.3},
}
SLOW = CHAIN | {"name": "slow", "body": {"contacts": [0, 1, 2, 3], "links": {"stiffness": [1.0, 1e-3, 1.0]}}}
KNOWN = Posterior(
    ("friction.forward",), np.array([0.1]), np.array([[1e-4]]), unknown=("body.links.stiffness", "friction.backward")
)
ROBUST = {"friction.forward": (0.8, 1.2), "friction.backward": (0.8, 1.2)}
CASES: dict[str, tuple[float, Callable[[float], Any]]] = {
    "on a line": (10.0, lambda s: optimise(Scene.model_validate(CHAIN), stroke=(0.0, 1.0), seconds=s)),
    "for a picture": (30.0, lambda s: optimise(Scene.model_validate(CHAIN), stroke=(0.0, 1.0), seconds=s, mapped=True)),
    "drawn bodies": (
        40.0,
        lambda s: optimise(
            Scene.model_validate(CHAIN), waypoints=3, stroke=(0.0, 1.0), robust_to=KNOWN, robust_of="worst", seconds=s
        ),
    ),
    "no periodic regime": (10.0, lambda s: optimise(Scene.model_validate(SLOW), stroke=(0.0, 1.0), seconds=s)),
    "robust": (
        40.0,
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
        seen.count += len(points) * len(self.scenes)
        found = regimes(self, points)
        seen.calls.append((when, self, points, found))
        return found

    monkeypatch.setattr(space.Space, "regimes", counted)
    monkeypatch.setattr(space, "available_cores", lambda: 1)
    for module in (limit, search, examine, fronts, whole, space):
        monkeypatch.setattr(module, "clock", lambda: seen.clock)
    return seen


def check_examination(found: Optimum, robust: bool) -> None:
    """Check that what the search left of the time was enough to examine the gait."""
    assert found.summary()["peak_tension"] > 0.0
    assert not np.isnan(found.transient_left)
    assert np.isfinite(found.gradient_norm) == found.scene.has_exact_derivatives
    assert (found.robustness is not None) == robust
    if found.robustness is not None:
        assert found.robustness.verified == 64
        assert found.robustness.unknown == KNOWN.unknown


@pytest.mark.parametrize("case", CASES)
def test_no_candidate_is_run_after_the_time_limit(case: str, tried: Tried) -> None:
    """Only what is returned may be run again, as it has to be examined, and that takes a tenth of the time at most."""
    seconds, run = CASES[case]
    found = run(seconds)
    returned = [found.values] if isinstance(found, Optimum) else [point.values for point in found.points]
    assert not found.complete
    late = [(one, points) for when, one, points, _ in tried.calls if when >= seconds]
    for one, points in late:
        assert points.shape[0] == 1
        values = one.values(one.canonical(points[0]))
        if isinstance(
            found, Optimum
        ):  # of compromises all ends are described, and those that another one beats left out
            assert any(np.allclose(values, other, atol=1e-12) for other in returned)
    assert 0.6 * seconds <= tried.clock <= 1.1 * seconds
    if isinstance(found, Optimum):
        check_examination(found, case == "drawn bodies")


def test_a_gait_has_a_peak_even_if_its_time_ends_before_the_examination(tried: Tried) -> None:
    found = optimise(Scene.model_validate(CHAIN), waypoints=2, stroke=(0.0, 1.0), seconds=0.01)
    assert found.summary()["peak_tension"] >= 0.0  # in JSON nan would be null


def test_a_gait_that_only_the_map_shows_is_returned() -> None:
    """Of two contacts at rest, no single waypoint within the stroke overcomes friction, D/2 < 2 mu/k; both do."""
    document = CHAIN | {"body": {"contacts": [0, 1], "links": {"stiffness": 5.0}}}
    _, box = build_space(Scene.model_validate(document), Request("translation", waypoints=2, stroke=(0.0, 0.06)))
    for mapped, gain in ((False, 0.0), (True, 0.06 - 2.0 * 0.1 / 5.0)):
        found = search.Found(np.full(2, 0.5), 0.0)
        around = examine.confirm_best(box, found, limit.TimeLimit(0.0, None), mapped)
        assert found.score == pytest.approx(gain, abs=1e-12)
        assert (around.plane is None) != mapped


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("case", ["scissors", "planar_three_points", "chain"])
def test_no_gait_that_was_tried_is_better_than_the_one_that_is_returned(case: str, seed: int, tried: Tried) -> None:
    scene = Scene.model_validate(CHAIN) if case == "chain" else load_scene(case)
    stroke = (0.0, 1.0) if case == "chain" else None
    objective = "turn" if case == "scissors" else "translation"
    seconds = 50.0 if case == "chain" else 2.0
    found = optimise(scene, objective, waypoints=4, stroke=stroke, seconds=seconds, seed=seed, mapped=True)
    own = found.space.regimes(found.point[None])[0]
    scores = [found.space.score(one) for _, other, _, all_ in tried.calls if other is found.space for one in all_]
    assert len(scores) > 150
    assert not improves(max(scores), found.space.score(own))
    assert found.value == pytest.approx(found.space.value(own))
    if case == "chain":
        assert np.nanmax(map_plane(found)[-1]) <= found.value * (1.0 + 1e-9)


def test_a_time_limit_does_not_prolong_a_search() -> None:
    """A search that ends by itself gives the same result with a limit that it does not reach."""
    scene = load_scene("two_contacts_anisotropic")
    free, limited = (optimise(scene, stroke=(0.0, 0.1), waypoints=2, seconds=seconds) for seconds in (None, 600.0))
    assert limited.complete
    assert (limited.evaluations, limited.values.tolist()) == (free.evaluations, free.values.tolist())
    assert "nothing better" in describe_optimum(replace(limited, evaluations=40_000))[-1]  # --seconds allows so many
    assert "--seconds allows more" in describe_optimum(replace(free, exhausted=True))[-1]
