"""How far bent springs stay from the knots of their curves: from their limits, their stops and the knots between."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.curves import BEGIN, END
from crawler_model.body.drive import NS
from crawler_model.body.names import name_every_spring
from crawler_model.scene.scene import Scene

from ...derivative.parameters import Derivatives


class Reached(NamedTuple):
    """Where a distance would vanish first if a parameter changed."""

    value: float
    """Of the parameter, in the unit of the scene's key."""
    row: int
    """The instant."""
    column: int
    """The distance."""


def describe(body: Body) -> list[str]:
    """Describe what did not happen where each distance is positive.

    Returns:
        One for each distance, shape (4 B,).
    """
    names = name_every_spring(body)
    return [f"{names[bend.spring]} was {how} no further" for bend in body.bends for how in ("pressed", "pulled") * 2]


def find_distances(
    scene: Scene, derivatives: Derivatives, time: np.ndarray, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Compute how far bent springs are from the next knots of their curves.

    Returns:
        The distances, infinite where there is no knot, shape (T, 4 B) [m]; their derivatives with respect to the
        parameters at fixed lengths, shape (T, 4 B, P).
    """
    body, d_pieces = scene.body, derivatives.pieces
    targets = scene.drive.sample(np.rint(np.maximum(time, 0.0) * NS).astype(np.int64))
    elongation, length = body.elongation(x), targets[:, : body.springs]
    distance = np.empty((time.size, 4 * len(body.bends)))
    derivative = np.zeros((*distance.shape, d_pieces.shape[-1]))
    first = column = 0
    for bend in body.bends:
        z = elongation[:, bend.spring]
        for curve, at in ((bend.actuator, z - length[:, bend.spring]), (bend.passive, z)):
            piece = np.searchsorted(curve.pieces[:-1, END], at)
            distance[:, column] = at - curve.pieces[piece, BEGIN]
            derivative[:, column] = -d_pieces[first + piece, BEGIN]
            distance[:, column + 1] = curve.pieces[piece, END] - at
            derivative[:, column + 1] = d_pieces[first + piece, END]
            first += len(curve.pieces)
            column += 2
    return distance, derivative


def find_limits(values: np.ndarray, distance: np.ndarray, derivative: np.ndarray) -> dict[tuple[int, bool], Reached]:
    """Find the values of parameters at which distances, which are positive now, would vanish.

    Args:
        distance: shape (V, C).
        derivative: of the distances with respect to the parameters, shape (V, C, P).

    Returns:
        By parameter and whether it is a lower limit.
    """
    found = {}
    for p, value in enumerate(values):
        slope = derivative[:, :, p]
        for at_least in (True, False):
            which = slope > 0.0 if at_least else slope < 0.0
            if which.any():
                with np.errstate(divide="ignore", invalid="ignore"):
                    limit = np.where(which, value - distance / slope, -np.inf if at_least else np.inf)
                row, column = np.unravel_index(int(limit.argmax() if at_least else limit.argmin()), limit.shape)
                found[p, at_least] = Reached(float(limit[row, column]), int(row), int(column))
    return found
