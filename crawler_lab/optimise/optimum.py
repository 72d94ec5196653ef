"""The result of an optimisation."""

from __future__ import annotations

import functools
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from crawler_model.notebook import write_html
from crawler_model.run.inertia import Inertia
from crawler_model.run.simulate import find_inertia
from crawler_model.scene.scene import Scene

from ..derivative.sensitivities import Kink
from .bodies import Robustness
from .goal import OBJECTIVES
from .space import Space

Plane = tuple[tuple[int, int], np.ndarray]
"""Two unknowns, and the objective over both, shape (Y, X)."""


@dataclass(frozen=True)
class ActiveBound:
    """A bound at which an unknown lies, or a limit that the gait reaches.

    Attributes:
        name: the unknown, or `rate` or `tension`.
        side: "lower" or "upper".
        value: the bound [unit of the unknown, m/s, N].
    """

    name: str
    side: str
    value: float


@dataclass(frozen=True)
class Alternative:
    """Another local optimum.

    Attributes:
        value: of the objective [m or 1].
        values: the unknowns, shape (P,).
        drive: the part `drive` of its scene.
    """

    value: float
    values: np.ndarray
    drive: dict[str, Any]


@dataclass(frozen=True)
class Weakness:
    """How much a number of the scene may change before the gait no longer moves as it should.

    Attributes:
        key: the number.
        below: the factor [1] at which that happens when it becomes smaller; None if none was found.
        above: the factor at which that happens when it becomes larger [1]; None if none was found.
    """

    key: str
    below: float | None
    above: float | None


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Optimum:
    """The best gait that was found.

    Attributes:
        objective: a key of `OBJECTIVES`.
        value: of the objective in the periodic regime: gain per period [m], cost of transport [1], gain / travel
            [1], turn per period [rad] or distance from the target [m]; with `robust` the worst one over the box, with
            `robust_to` the mean or the worst of the drawn bodies.
        scene: a scene that plays the gait.
        names: names of the unknowns, shape (P,).
        values: the unknowns, shape (P,).
        low: their lower bounds, shape (P,).
        high: their upper bounds, shape (P,).
        gain: gain per period [m].
        cost_of_transport: work / (distance * force), the distance being the gain [1]; NaN for a gait that does not
            travel.
        travel: sum of all changes of rest lengths in a period [m].
        peak_tension: largest tension in a period [N].
        transient_left: estimate of how far the gain is from the periodic regime's [m]; infinite where
            that was not found, NaN on patches.
        found_after_s: when the best gait was found [s].
        evaluations: how many candidates were run.
        gradient_norm: by how much the objective would improve to first order if all unknowns moved within their bounds
            and limits, per width of the bounds [m or 1].
        differentiable: whether the objective is differentiable at the optimum.
        kinks: when and where it is not, times in a period.
        active_bounds: bounds and limits that the gait reaches.
        alternatives: other local optima, best first.
        flat: unknowns that change nothing near the optimum; none where it has no value.
        unique: whether it has a value, no other gait that was found is as good, and no unknown is flat.
        weaknesses: with `robust`, at which change of each number the gait fails.
        space: the candidates, for the landscape around the optimum.
        point: the optimum in the unit box of the unknowns, shape (P,).
        seed: of the random numbers.
        complete: whether the search ended because nothing better was found; False after Ctrl-C or a time limit, when
            the result depends on the machine.
        wall_s: wall-clock time [s].
        motion: in the plane dx, dy per period [m], for a body that turns in its own frame and with dyaw [rad]; None on
            a line.
        periods: on patches of ground, number of first periods whose mean `gain` is; None elsewhere.
        robustness: with `robust_to`, how good the gait is on other bodies than in the search.
        interrupted: whether Ctrl-C ended the search.
        exhausted: whether the search ended after as many evaluations as it may take without a time limit.
        untried: kinds of gaits that the search did not try to their end, because it was stopped.
        around: the objective with one unknown at a time moved between its bounds, shape (P, samples), as
            `landscape.profile` shows it.
        plane: the two unknowns that the objective depends on most, and the objective over both, shape (Y, X), as
            `landscape.map_plane` shows it; None if it was not requested.
    """

    objective: str
    value: float
    scene: Scene
    names: tuple[str, ...]
    values: np.ndarray
    low: np.ndarray
    high: np.ndarray
    gain: float
    cost_of_transport: float
    travel: float
    peak_tension: float
    transient_left: float
    found_after_s: float
    evaluations: int
    gradient_norm: float
    differentiable: bool
    kinks: tuple[Kink, ...]
    active_bounds: tuple[ActiveBound, ...]
    alternatives: tuple[Alternative, ...]
    flat: tuple[str, ...]
    unique: bool
    weaknesses: tuple[Weakness, ...]
    space: Space
    point: np.ndarray
    seed: int
    complete: bool
    wall_s: float
    motion: tuple[float, ...] | None = None
    periods: int | None = None
    robustness: Robustness | None = None
    interrupted: bool = False
    exhausted: bool = False
    untried: tuple[str, ...] = ()
    around: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    plane: Plane | None = None

    @functools.cached_property
    def inertia(self) -> Inertia | None:
        """The inertia number of the gait; None for a scene without masses and weights."""
        return find_inertia(self.scene)

    @property
    def unit(self) -> str:
        """Unit of the value."""
        return OBJECTIVES[self.objective]

    def __repr__(self) -> str:
        """Describe the optimum in one line."""
        return (
            f"Optimum({self.scene.name}, {self.objective} {self.value:.6g} {self.unit}, {len(self.names)} unknowns, "
            f"{self.evaluations} evaluations)"
        )

    def _repr_html_(self) -> str:
        """Show the unknowns of the best gait in a notebook."""
        title = f"Optimum of {self.scene.name}: {self.objective} {self.value:.6g} {self.unit}"
        rows = zip(self.names, self.values.tolist(), self.low.tolist(), self.high.tolist(), strict=True)
        return write_html(title, [(name, f"{value:.6g} in {low:g} .. {high:g}") for name, value, low, high in rows])

    def summary(self) -> dict[str, Any]:
        """Build the summary that `crawler optimise --json` prints.

        Returns:
            Plain numbers, lists and strings; schema 1.
        """
        numbers = {
            name: _number(getattr(self, name))
            for name in ("gain", "cost_of_transport", "travel", "peak_tension", "transient_left", "gradient_norm")
        }
        robust_to = None
        if self.robustness is not None:
            plain = asdict(self.robustness) | {"unknown": list(self.robustness.unknown)}
            robust_to = {name: _number(v) if isinstance(v, float) else v for name, v in plain.items()}
        return {
            "schema": 1,
            "scene": self.scene.name,
            "objective": self.objective,
            "best": {"value": _number(self.value), "unit": self.unit},
            "unknowns": dict(zip(self.names, self.values.tolist(), strict=True)),
            "drive": self.scene.document()["drive"],
            **numbers,
            "motion": None if self.motion is None else list(self.motion),
            "periods": self.periods,
            "found_after_s": self.found_after_s,
            "evaluations": self.evaluations,
            "differentiable": self.differentiable,
            "kinks": [{"time": kink.time, "contacts": list(kink.contacts)} for kink in self.kinks],
            "active_bounds": [asdict(bound) for bound in self.active_bounds],
            "alternatives": [{"value": _number(one.value), "drive": one.drive} for one in self.alternatives],
            "flat": list(self.flat),
            "unique": self.unique,
            "inertia": None if self.inertia is None else self.inertia.summary(),
            "fails": [asdict(weakness) for weakness in self.weaknesses],
            "robust_to": robust_to,
            "seed": self.seed,
            "complete": self.complete,
            "interrupted": self.interrupted,
            "untried": list(self.untried),
            "wall_s": self.wall_s,
        }


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
