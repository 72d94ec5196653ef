"""Numbers by which crawlers of different sizes are compared: cost of transport, and body lengths per period."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import join
from ..body.body import Body
from ..body.plan import Plan

_TRAVELS = 1e-12
"""A gain below this part of the body's length, or of the displacements, is rounding."""


def supporting_force(scene: Plan) -> np.ndarray:
    """Compute the force by which the cost of transport is divided.

    Args:
        scene: the scene, or variations of it.

    Returns:
        The sum of the weights; without weights the sum of the friction of all contacts, the mean of both directions (in
        the plane of all directions given) and over a period of the drive, sum (mu_plus + mu_minus) / 2, shape () or
        (M,) [N].
    """
    drive, body = scene.drive, scene.body
    weight = scene.ground.weight.sum(axis=-1)
    if (weight > 0.0).all():
        return np.asarray(weight)
    if body.dimension == 1:
        friction = 0.5 * (drive.forward + drive.backward).sum(axis=-1)  # the loads cancel
    else:
        each = drive.targets[:, body.lengths :][:, : scene.columns.frictions]
        friction = each.reshape(each.shape[0], body.contacts, -1).mean(axis=2).sum(axis=1)
    return np.where(weight > 0.0, weight, _mean_over_a_period(friction, drive.times, drive.period))


def _mean_over_a_period(values: np.ndarray, times: np.ndarray, period: Any) -> np.ndarray:
    """Average values at waypoints, shape (..., W), over a period, or over the time from the first to the last."""
    if period is not None:  # a last piece of no length adds nothing
        times = join((times, period))
        values = np.concatenate((values, values[..., :1]), axis=-1)
    if times.shape[-1] == 1:
        return values[..., 0]
    return np.asarray(np.trapezoid(values, times, axis=-1) / (times[..., -1] - times[..., 0]))


def cost_of_transport(force: np.ndarray, work: np.ndarray, distance: np.ndarray, size: np.ndarray) -> np.ndarray:
    """Compute the cost of transport, work / (distance * force), each of shape (M,).

    Args:
        force: from `supporting_force`, shape () or (M,) [N].
        work: of the actuators in a period [J].
        distance: travelled in it [m].
        size: length of the body, or the largest displacement if that is more: a gain may be lost in its rounding [m].

    Returns:
        The cost [1]; NaN for a body that does not travel, or that nothing presses on the ground. It is negative where
        the loads drive the actuators.
    """
    travels = (distance > _TRAVELS * size) & (force > 0.0)
    return np.divide(work, distance * force, out=np.full(distance.shape, np.nan), where=travels)


def body_lengths(length: np.ndarray, gained: np.ndarray) -> np.ndarray:
    """Compute gains in lengths of the body.

    Args:
        length: of the body, from `length_of`, shape (M,) [m].
        gained: y gained in a period, in the plane the distance, shape (M,) [m].

    Returns:
        The gain divided by the length of the body in its reference shape, on a line with its sign [1]; NaN for a body
        of a single contact.
    """
    return np.divide(gained, length, out=np.full(gained.shape, np.nan), where=length > 0.0)


def length_of(body: Body) -> float:
    """Compute the length of a body in its reference shape; in the plane of the box around it, from corner to corner.

    Args:
        body: the body.

    Returns:
        The length [m].
    """
    return float(np.linalg.norm(np.ptp(body.position, axis=0)))
