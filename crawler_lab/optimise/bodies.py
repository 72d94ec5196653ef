"""Gaits for a body that is known up to the uncertainty of an identification."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np

from crawler_model.errors import CommandError, SceneError
from crawler_model.scene.scene import Scene

from ..sweep.vary import Variations
from .limit import TimeLimit
from .regime import Regime
from .space import Space
from .unknowns import Unknowns, with_numbers

Over = Literal["expected", "worst"]
_DRAWN, _SEED = 8, 20_230
"""Bodies that a gait is judged on, and the seed with which they are drawn."""
_OTHERS, _OTHER_SEED = 64, 20_231
"""Bodies on which the best gait is verified."""
_UNKNOWN = (1.0 / 3.0, 3.0)
"""Factors by which an unknown number is moved to see whether the objective depends on it."""
_SAME = 1e-6
_NO_BODY = ("drive", "start")
"""Parts of a scene on which the periodic regime of another drive does not depend."""


class Uncertain(Protocol):
    """What is known about the numbers of a scene, for example a `Posterior`."""

    @property
    def unknown(self) -> tuple[str, ...]:
        """Numbers about which nothing is known, by dotted keys."""

    def apply(self, scene: Scene) -> Scene:
        """Put the best values into a scene.

        Returns:
            The scene with the values.
        """

    def draw_bodies(self, rng: np.random.Generator, count: int) -> Mapping[str, np.ndarray]:
        """Draw values of the numbers.

        Args:
            rng: source of random numbers.
            count: number of draws K.

        Returns:
            Values by dotted key, shape (K,).
        """


@dataclass(frozen=True)
class Robustness:
    """How good a gait is on bodies on which it was not sought.

    Attributes:
        over: "expected" or "worst": for which of both it was sought.
        mean: of the objective over the bodies [m or 1].
        worst: least good value of the objective among them [m or 1].
        best_fit: the objective on the body with the best values [m or 1].
        drawn: number of bodies on which it was sought.
        verified: number of bodies of `mean` and `worst`.
        unknown: numbers about which nothing is known, which keep their values in the scene, and on which the objective
            depends if they change by a factor of three.
    """

    over: Over
    mean: float
    worst: float
    best_fit: float
    drawn: int
    verified: int
    unknown: tuple[str, ...]


def check_uncertain(over: Over, objective: str, robust: Mapping[str, Any] | None) -> None:
    """Check what uncertainty is combined with.

    Args:
        robust: factors of numbers.

    Raises:
        CommandError: if it cannot be combined.
    """
    if over not in ("expected", "worst"):
        raise CommandError(f"robust_of: {over!r}; it must be expected or worst")
    if robust:
        raise CommandError(f"robust_to: {next(iter(robust))} has bounds in robust, too; give one or the other")
    if over == "expected" and objective == "cost-of-transport":
        raise CommandError(
            "robust_to: the expected cost of transport has no bound, as a body that stays where it is has an infinite "
            "one; take robust_of worst, or another objective"
        )


def spread_over(space: Space, unknowns: Unknowns, uncertain: Uncertain, over: Over) -> Space:
    """Judge candidates on bodies that are drawn, always the same ones.

    Args:
        unknowns: of the scene with the best values.

    Returns:
        The same candidates, judged on the drawn bodies.

    Raises:
        SceneError: if a number that is uncertain is unknown, too, or a body that is drawn is not valid.
    """
    scenes = tuple(_draw(unknowns, uncertain, _SEED, _DRAWN))
    return dataclasses.replace(space, scenes=scenes, mean=over == "expected")


def count_bodies(uncertain: Uncertain) -> int:
    """Count the bodies on which the best gait is verified.

    Returns:
        Their number, with the bodies that show whether an unknown number matters.
    """
    return 1 + len(uncertain.unknown) * len(_UNKNOWN) + _OTHERS


def verify(
    space: Space, point: np.ndarray, unknowns: Unknowns, uncertain: Uncertain, over: Over, limit: TimeLimit
) -> Robustness:
    """Compute the objective of a gait on bodies on which it was not sought, after the time limit on a few.

    Args:
        point: the gait in the unit box, shape (P,).
        unknowns: of the scene with the best values.
        limit: the time limit.

    Returns:
        The values.
    """
    best_fit = dataclasses.replace(space, scenes=(unknowns,), mean=False)
    at_fit = best_fit.value(best_fit.regimes(point[None])[0])
    unknown = tuple(
        name
        for name in uncertain.unknown
        if not name.startswith(_NO_BODY) and _matters(best_fit, point, unknowns, name, at_fit)
    )
    regimes = list[Regime | None]()
    for other in _draw(unknowns, uncertain, _OTHER_SEED, _OTHERS):
        if len(regimes) >= _DRAWN and limit.over():
            break
        regimes += dataclasses.replace(best_fit, scenes=(other,)).regimes(point[None])[0]
    mean, worst = (dataclasses.replace(best_fit, mean=mean).value(regimes) for mean in (True, False))
    return Robustness(over, mean, worst, at_fit, len(space.scenes), len(regimes), unknown)


def _matters(space: Space, point: np.ndarray, unknowns: Unknowns, name: str, value: float) -> bool:
    """Determine whether the objective of a gait depends on a number."""
    for factor in _UNKNOWN:
        try:
            other = dataclasses.replace(space, scenes=(with_numbers(unknowns, {name: factor}),))
        except SceneError:
            continue
        if not abs(other.value(other.regimes(point[None])[0]) - value) <= _SAME * abs(value):
            return True
    return False


def _draw(unknowns: Unknowns, uncertain: Uncertain, seed: int, count: int) -> Iterator[Unknowns]:
    """Build the same unknowns for bodies that are drawn, one after the other."""
    drawn = uncertain.draw_bodies(np.random.default_rng(seed), count)
    values = {name: column for name, column in drawn.items() if not name.startswith(_NO_BODY)}
    table = unknowns.table
    for name in values:
        if any(name == key or name.startswith((f"{key}[", f"{key}.")) for key in unknowns.keys):
            raise SceneError(f"robust_to: {name} is free; it cannot be uncertain, too")
        if table is not None and table.friction and "friction" in name:
            raise SceneError(f"robust_to: {name}: the waypoints command friction; it cannot be uncertain, too")
    if not values:
        raise SceneError("robust_to: no number of the body is uncertain; optimise without it")
    varied = Variations(unknowns.base, values, (count,))
    try:
        for k in range(count):
            yield dataclasses.replace(unknowns, base=varied[k])
    except SceneError as error:
        raise SceneError(f"robust_to: a body that was drawn is not valid: {error}") from None
