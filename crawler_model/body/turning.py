"""Bodies in the plane whose links have lengths and whose joints have turning angles, so that they can turn.

    E = sum_links k/2 (|p_j - p_i| - l)^2 + sum_joints c/2 wrap(theta_abc - alpha)^2

The turning angle theta_abc at point b goes from the direction a -> b to the direction b -> c: 0 where the three points
lie on a line, positive where the way turns left. A target holds the changes of l, then of alpha, then the friction of
each point against sliding forward, backward, left and right of its frame, then its load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import CrawlerError
from ..rounding import EPS

SIDES = ("forward", "backward", "left", "right")
"""The directions of sliding in which a point has a friction of its own, in the order of a target."""
TURNING_TOLERANCE = 1e-5
"""Default error of a ramp, relative to its largest change of length."""
MOST_RATIO = 1e4
"""Largest ratio of two frictions of a point: the search for sliding points fails beyond 1e6."""
_RELAXATIONS, _MOST_ITERATIONS = 8, 50
"""Parts of the actuation, and steps in each, in which a shape without tension is sought."""


@dataclass(frozen=True, eq=False)
class Turning:
    """What a body that can turn has besides points and links.

    Attributes:
        joints: the three points of each joint, the angle at the second, int64, shape (J, 3).
        joint_stiffness: c, shape (J,) [N m/rad].
        frame: for each point the two points whose direction is its forward direction, int64, shape (N, 2).
        offset: angle from this direction to the forward direction of its friction, shape (N,) [rad].
        along_velocity: False for friction that dissipates the most; True for a force along the scaled velocity.
        heading: the two points whose direction is the yaw, int64, shape (2,).
        jumps: whether a body that loses its stability jumps; False: the command is refused.
    """

    joints: np.ndarray
    joint_stiffness: np.ndarray
    frame: np.ndarray
    offset: np.ndarray
    along_velocity: bool
    heading: np.ndarray
    jumps: bool


def wrap(angle: np.ndarray) -> np.ndarray:
    """Subtract whole turns from angles.

    Args:
        angle: any shape [rad].

    Returns:
        Angles in [-pi, pi]; angles that lie there already are unchanged [rad].
    """
    return np.asarray(angle - 2.0 * np.pi * np.round(angle / (2.0 * np.pi)))


def measure_angles(place: np.ndarray, pairs: np.ndarray) -> np.ndarray:
    """Compute the angles of directions from the x axis.

    Args:
        place: positions of the points, shape (..., N, 2) [m].
        pairs: the two points of each direction, shape (K, 2).

    Returns:
        Shape (..., K), in [-pi, pi] [rad].
    """
    way = place[..., pairs[:, 1], :] - place[..., pairs[:, 0], :]
    return np.asarray(np.arctan2(way[..., 1], way[..., 0]))


def measure_shape(place: np.ndarray, ends: np.ndarray, joints: np.ndarray) -> np.ndarray:
    """Compute the lengths of links and the turning angles of joints.

    Args:
        place: positions of the points, shape (..., N, 2) [m].
        ends: the two points of each link, shape (S, 2).
        joints: the three points of each joint, shape (J, 3).

    Returns:
        Shape (..., S + J) [m, rad].
    """
    way = place[..., ends[:, 1], :] - place[..., ends[:, 0], :]
    first = place[..., joints[:, 1], :] - place[..., joints[:, 0], :]
    second = place[..., joints[:, 2], :] - place[..., joints[:, 1], :]
    across = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return np.concatenate(
        (np.hypot(way[..., 0], way[..., 1]), np.arctan2(across, (first * second).sum(axis=-1))), axis=-1
    )


def find_forces(place: np.ndarray, ends: np.ndarray, joints: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """Compute the force -dE/dp of links and joints on each point.

    Args:
        place: positions of the points, shape (..., N, 2) [m].
        ends: the two points of each link, shape (S, 2).
        joints: the three points of each joint, shape (J, 3).
        tension: tensions of links [N], then torques of joints [N m], shape (..., S + J).

    Returns:
        Shape (..., N, 2) [N].
    """
    force = np.zeros(place.shape)
    springs = ends.shape[0]

    def pull(points: np.ndarray, values: np.ndarray) -> None:
        np.add.at(np.moveaxis(force, -2, 0), points, np.moveaxis(values, -2, 0))

    way = place[..., ends[:, 1], :] - place[..., ends[:, 0], :]
    along = way * (tension[..., :springs] / np.hypot(way[..., 0], way[..., 1]))[..., None]
    pull(ends[:, 0], along)
    pull(ends[:, 1], -along)
    # d theta / dp_c = n(second) / |second|, d theta / dp_a = n(first) / |first|, with n(v) = v turned left, normalised
    turned = []
    for a, b in ((0, 1), (1, 2)):
        side = place[..., joints[:, b], :] - place[..., joints[:, a], :]
        left = np.stack((-side[..., 1], side[..., 0]), axis=-1)
        turned.append(left * (tension[..., springs:] / (side**2).sum(axis=-1))[..., None])
    pull(joints[:, 0], -turned[0])
    pull(joints[:, 1], turned[0] + turned[1])
    pull(joints[:, 2], -turned[1])
    return force


def forward_angles(turning: Turning, place: np.ndarray) -> np.ndarray:
    """Compute the angles of the forward directions of friction.

    Args:
        turning: frames of the body.
        place: positions of the points, shape (..., N, 2) [m].

    Returns:
        Shape (..., N) [rad].
    """
    return measure_angles(place, turning.frame) + turning.offset


def load_of_friction(force: np.ndarray, angle: np.ndarray, friction: np.ndarray) -> np.ndarray:
    """Compute how large forces are relative to the friction that has to hold them.

    Args:
        force: on each point, shape (..., N, 2) [N].
        angle: of its forward direction, shape (..., N) [rad].
        friction: forward, backward, left and right of each point, shape (..., N, 4) [N].

    Returns:
        Shape (..., N) [1]: at most 1 where friction holds the force, 1 where the point may slide; infinite where there
        is a force and no friction.
    """
    cos, sin = np.cos(angle), np.sin(angle)
    ahead = cos * force[..., 0] + sin * force[..., 1]
    left = cos * force[..., 1] - sin * force[..., 0]
    size = np.zeros(np.broadcast_shapes(ahead.shape, friction.shape[:-1]))
    for value, most in ((ahead, friction[..., :2]), (left, friction[..., 2:])):
        held = np.where(value >= 0.0, most[..., 0], most[..., 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            size = np.hypot(size, np.where(value == 0.0, 0.0, np.abs(value) / held))
    return size


def check_sides(friction: np.ndarray, where: str, error: type[CrawlerError]) -> None:
    """Check the friction of points.

    Args:
        friction: forward, backward, left and right of each point, shape (N, 4) [N].
        where: what to call it.
        error: the class of the error.

    Raises:
        CrawlerError: of that class, if a friction is negative, is 0 while others are not, or is far from the others.
    """
    for i, each in enumerate(friction):
        given = ", ".join(f"{name} {value:g}" for name, value in zip(SIDES, each, strict=True))
        if not (each >= 0.0).all():
            raise error(f"{where}: point {i} has {given}; friction must be >= 0")
        if (each == 0.0).any() and (each > 0.0).any():
            raise error(f"{where}: point {i} has {given}; all four must be > 0, or all four 0 for a point without any")
        if each.max() > MOST_RATIO * each.min():
            raise error(
                f"{where}: point {i} has {given}; the largest may be at most {MOST_RATIO:g} times the least, not "
                f"{each.max() / each.min():g} times"
            )


def relax_shape(
    position: np.ndarray, ends: np.ndarray, turning: Turning, stiffness: np.ndarray, actuation: np.ndarray
) -> np.ndarray:
    """Compute displacements at which links and joints store the least energy: none where they admit it.

    The first point is not displaced, and the heading stays as in the reference shape.

    Args:
        position: reference positions, shape (N, 2) [m].
        ends: the two points of each link, shape (S, 2).
        turning: joints and heading.
        stiffness: of links [N/m], then of joints [N m/rad], shape (S + J,).
        actuation: changes of rest lengths [m] and rest angles [rad], of the same shape.

    Returns:
        x, shape (N, 2) [m].
    """
    joints, springs = turning.joints, ends.shape[0]
    rest, root = measure_shape(position, ends, joints), np.sqrt(stiffness)
    place = np.array(position)
    for part in np.linspace(0.0, 1.0, _RELAXATIONS + 1)[1:] if actuation.any() else ():
        for _ in range(_MOST_ITERATIONS):
            change = measure_shape(place, ends, joints) - rest - part * actuation
            change[springs:] = wrap(change[springs:])
            each = np.broadcast_to(place, (root.size, *place.shape))
            slopes = -find_forces(each, ends, joints, np.diag(root)).reshape(root.size, -1)
            step = np.linalg.lstsq(slopes, -root * change, rcond=1e-12)[0].reshape(place.shape)
            place = place + step
            if float(np.abs(step).max()) <= 4.0 * EPS * float(np.abs(place).max()):
                break
    back = measure_angles(position, turning.heading[None]) - measure_angles(place, turning.heading[None])
    cos, sin = float(np.cos(back[0])), float(np.sin(back[0]))
    way = place - place[0]
    return np.asarray(position[0] + way @ np.array([[cos, sin], [-sin, cos]]) - position)
