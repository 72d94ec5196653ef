"""Numbers by which crawlers of different sizes are compared: cost of transport, and body lengths per period."""

from __future__ import annotations

import numpy as np

from ..body.plan import Plan

_TRAVELS = 1e-12
"""A gain below this part of the body's length, or of the displacements, is rounding."""


def supporting_force(scene: Plan) -> float:
    """Compute the force by which the cost of transport is divided.

    Args:
        scene: the scene.

    Returns:
        The sum of the weights; without weights that of the friction of all contacts, the mean of both directions (in
        the plane of all directions given) and over a period of the drive, sum (mu_plus + mu_minus) / 2 [N].
    """
    weight = float(scene.ground.weight.sum())
    if weight > 0.0:
        return weight
    drive, body = scene.drive, scene.body
    if body.dimension == 1:
        friction = 0.5 * (drive.forward + drive.backward).sum(axis=1)  # the loads cancel
    else:
        each = drive.targets[:, 2 * body.springs :][:, : scene.columns.frictions]
        friction = each.reshape(each.shape[0], body.contacts, -1).mean(axis=2).sum(axis=1)
    times = drive.times
    if drive.period is not None and drive.period > times[-1]:
        times, friction = np.append(times, drive.period), np.append(friction, friction[0])
    if times.size == 1:
        return float(friction[0])
    return float(np.trapezoid(friction, times) / (times[-1] - times[0]))


def cost_of_transport(scene: Plan, work: float, gained: np.ndarray, size: float) -> float:
    """Compute the cost of transport, work / (distance * force).

    Args:
        scene: the scene; `supporting_force` is the force.
        work: of the actuators in a period [J].
        gained: y gained in it, shape (), in the plane (2,) [m].
        size: the largest displacement, in whose rounding a gain may be lost [m].

    Returns:
        The cost [1]; NaN for a body that does not travel, or that nothing presses on the ground. It is negative where
        the loads drive the actuators.
    """
    distance, force = float(np.linalg.norm(gained)), supporting_force(scene)
    if not distance > _TRAVELS * max(size, _length(scene)) or force <= 0.0:
        return np.nan
    return work / (distance * force)


def body_lengths(scene: Plan, gained: np.ndarray) -> float:
    """Compute a gain in lengths of the body.

    Args:
        scene: the scene.
        gained: y gained in a period, shape (), in the plane the distance of shape (2,) counts [m].

    Returns:
        The gain divided by the length of the body in its reference shape, on a line with its sign [1]; NaN for a body
        of a single contact.
    """
    length = _length(scene)
    if length == 0.0:
        return np.nan
    return float(np.linalg.norm(gained) if np.ndim(gained) else gained) / length


def _length(scene: Plan) -> float:
    """Length of the body in its reference shape [m]; in the plane of the box around it, from corner to corner."""
    return float(np.linalg.norm(np.ptp(scene.body.position, axis=0)))
