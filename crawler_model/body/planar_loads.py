"""Loads on a body in the plane: where they stand in a target, and when friction can hold them.

A load shifts the set of friction forces: spring force plus load has to lie in C_i. A connected body has an equilibrium
if and only if the sum of its loads lies in the sum of all C_i, a disc of radius sum_i mu_i, or the polygon
{F : F . d_k <= sum_i mu_ik}. Springs transmit to other contacts what one contact cannot hold.
"""

from __future__ import annotations

import numpy as np

from ..errors import CrawlerError
from ..rounding import CRITICAL
from .body import Body


def split_target(body: Body, directions: np.ndarray, target: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split targets of a body in the plane into their parts.

    Args:
        body: the body.
        directions: unit vectors of the friction directions, shape (m, 2); m = 0 for isotropic friction.
        target: shape (..., 2 S + N max(m, 1)), with loads (..., 2 S + N max(m, 1) + 2 N).

    Returns:
        L, shape (..., S, 2) [m]; mu, shape (..., N, max(m, 1)) [N]; f, shape (..., N, 2) or (..., 0, 2) [N].
    """
    lengths, n = 2 * body.springs, body.contacts
    last = lengths + n * max(directions.shape[0], 1)
    rows = target.shape[:-1]
    return (
        target[..., :lengths].reshape(*rows, body.springs, 2),
        target[..., lengths:last].reshape(*rows, n, -1),
        target[..., last:].reshape(*rows, (target.shape[-1] - last) // 2, 2),
    )


def check_planar_equilibrium(
    load: np.ndarray, friction: np.ndarray, directions: np.ndarray, where: str, error: type[CrawlerError]
) -> None:
    """Check that friction can hold the loads: their sum lies in the sum of the sets of friction forces.

    With isotropic friction the sum has to lie strictly inside: on the circle all friction forces are parallel, and
    shapes that change in any other direction have no solution.

    Args:
        load: f, shape (N, 2) [N].
        friction: mu, shape (N, max(m, 1)) [N].
        directions: unit vectors, shape (m, 2); m = 0 for isotropic friction.
        where: what to call the command.
        error: the class of the error.

    Raises:
        CrawlerError: of that class, with the sum that does not fit, if nothing would stop the body.
    """
    total, held = load.sum(axis=0), friction.sum(axis=0)
    sums = f"{where}: the loads sum to [{total[0]:g}, {total[1]:g}] N, "
    away = "no equilibrium, the body would run away"
    if directions.shape[0] == 0:
        size = float(np.hypot(*total))
        if size > 0.0 and size >= float(held[0]) * (1.0 - CRITICAL):
            raise error(f"{sums}{size:g} N long; it must be less than the sum of all friction, {held[0]:g} N: {away}")
        return
    along = directions @ total
    near = CRITICAL * (float(held.max()) + float(np.abs(load).sum()))
    k = int(np.argmax(along - held))
    if along[k] > held[k] + near:
        raise error(
            f"{sums}{along[k]:g} N along direction {k}, but friction against sliding in this direction to "
            f"{held[k]:g} N: {away}"
        )
