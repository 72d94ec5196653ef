"""The body as arrays for the kernels, and where the parts of a command begin.

A command is a row as in a target: changes of the rest lengths of the S links and of the rest angles of the J joints, or
of the rest vectors of the S links; friction of each point, forward, backward, left and right, or along each direction
of its polygon; and the load on each point, if there are any.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ...body.body import Body
from ...body.turning import measure_shape
from ...compiled import inlined, lean


class Frame(NamedTuple):
    """What a command does not change.

    Its K springs are the links, then the joints; of vector springs they are the x and the y component of each link.

    Attributes:
        vector: whether links are springs with a rest vector, which do not turn, and friction is fixed to the ground.
        position: reference positions, shape (N, 2) [m].
        links: their number.
        points: a, b, -1 of each spring of a link, a, b, c of a joint, which turns about b, int64, shape (K, 3).
        pairs: pairs of points whose forces depend on each other, int64, shape (Q, 2).
        stiffness: of links [N/m] and joints [N m/rad], shape (K,).
        rest: lengths of the links [m] and angles of the joints [rad] in the reference shape, 0 for vector springs,
            shape (K,).
        shortest: the length of the shortest link, 0 for vector springs [m].
        guide: the two points whose direction is the axis of a point's friction, int64, shape (N, 2); twice the point
            itself where the axis is fixed to the ground.
        offset: angle from that direction to the axis, shape (N,) [rad].
        along_velocity: whether friction follows the law of the snake literature.
        order: the points, neighbours close to each other, int64, shape (N,).
        grip: how stiffly the body holds each point, shape (N,) [N/m].
        heading: the two points whose direction is the yaw, int64, shape (2,).
        directions: unit vectors of friction polygons, counterclockwise, shape (m, 2); m = 0 for quarter ellipses.
        compliance: a bound on the relative displacement of two points per force between them, of vector springs [m/N].
        effort: work spent in a ramp, and its upper limit: points in evaluations of an implicit step, shape (2,); the
            only entry that kernels change.
    """

    vector: bool
    position: np.ndarray
    links: int
    points: np.ndarray
    pairs: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    shortest: float
    guide: np.ndarray
    offset: np.ndarray
    along_velocity: bool
    order: np.ndarray
    grip: np.ndarray
    heading: np.ndarray
    directions: np.ndarray
    compliance: float
    effort: np.ndarray


def build_frame(body: Body, directions: np.ndarray) -> Frame:
    """Build the arrays of a body in the plane.

    Args:
        body: the body.
        directions: unit vectors of friction polygons, shape (m, 2).

    Returns:
        The arrays.
    """
    turning, n = body.turning, body.contacts
    position = np.array(body.position, np.float64)
    ends = np.array(body.ends, np.int64).reshape(-1, 2)
    points = np.column_stack((ends, np.full(len(ends), -1)))
    grip, compliance = np.zeros(n), 0.0
    if turning is None:
        points = np.repeat(points, 2, axis=0)
        stiffness = np.repeat(np.array(body.stiffness, np.float64), 2)
        rest = np.zeros(stiffness.size)
        np.add.at(grip, ends, stiffness.reshape(-1, 2))
        guide, offset, along_velocity = np.repeat(np.arange(n)[:, None], 2, axis=1), np.zeros(n), False
        pairs, heading, compliance = ends, np.zeros(2, np.int64), float((1.0 / body.stiffness).sum())
    else:
        joints = np.array(turning.joints, np.int64).reshape(-1, 3)
        points = np.concatenate((points, joints))
        stiffness = np.concatenate((body.stiffness, turning.joint_stiffness)).astype(np.float64)
        rest = measure_shape(position, ends, joints)
        np.add.at(grip, ends, np.repeat(stiffness[: len(ends), None], 2, axis=1))
        squared = (np.diff(position[joints], axis=1) ** 2).sum(axis=2)
        for k, (a, b, c) in enumerate(joints):
            own = turning.joint_stiffness[k] * (1.0 / squared[k])
            grip[[a, b, c]] += own[0], own.sum(), own[1]
        guide, offset = np.array(turning.frame, np.int64), np.array(turning.offset, np.float64)
        along_velocity, heading = turning.along_velocity, np.array(turning.heading, np.int64)
        guided = (np.column_stack((np.arange(n), guide[:, k])) for k in range(2))
        pairs = np.concatenate((ends, joints[:, :2], joints[:, 1:], joints[:, ::2], *guided))
    shape = position, len(ends), points, np.unique(pairs, axis=0), stiffness, rest, float(rest[: len(ends)].min())
    axes = guide, offset, along_velocity
    ways = np.array(directions, np.float64).reshape(-1, 2)
    effort = np.array([0.0, np.inf])
    return Frame(turning is None, *shape, *axes, _order(pairs, n), grip, heading, ways, compliance, effort)


def friction_columns(frame: Frame) -> slice:
    """Return where friction stands in a command.

    Args:
        frame: the body.

    Returns:
        The columns, four for each point or one for each direction of its polygon.
    """
    first = frame.rest.size
    return slice(first, first + (len(frame.directions) or 4) * len(frame.position))


def _order(pairs: np.ndarray, n: int) -> np.ndarray:
    """Order points so that the two points of each pair are close to each other."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    graph = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    return reverse_cuthill_mckee(csr_array(graph + graph.T), symmetric_mode=True).astype(np.int64)


@inlined
def norm(a, b):
    """Compute the Euclidean norm of a vector; `math.hypot` is slower, and differs where kernels are interpreted.

    Args:
        a: one component.
        b: the other one.

    Returns:
        The norm.
    """
    return math.sqrt(a * a + b * b)


@lean
def span(frame, x, a, b):
    """Compute the vector from one point to another.

    Args:
        a: the first point.
        b: the second point.

    Returns:
        Its components [m].
    """
    position = frame.position
    return (
        position[b, 0] - position[a, 0] + (x[b, 0] - x[a, 0]),
        position[b, 1] - position[a, 1] + (x[b, 1] - x[a, 1]),
    )


@lean
def assign(to, values):
    """Copy two components of each point; a slice that is assigned takes seconds to compile.

    Args:
        to: output, shape (N, 2).
        values: shape (N, 2).
    """
    for i in range(to.shape[0]):
        to[i, 0] = values[i, 0]
        to[i, 1] = values[i, 1]


@lean
def unwind(angle):
    """Subtract whole turns from an angle.

    Args:
        angle: the angle [rad].

    Returns:
        The angle between -pi and pi [rad].
    """
    return angle - 2.0 * math.pi * np.floor(angle / (2.0 * math.pi) + 0.5)


@lean
def yaw_of(frame, x):
    """Compute the direction of the heading.

    Returns:
        The angle, between -pi and pi [rad].
    """
    e0, e1 = span(frame, x, frame.heading[0], frame.heading[1])
    return math.atan2(e1, e0)


@lean
def columns_of(frame):
    """Return how many numbers of a command describe the friction of a point.

    Returns:
        The number of directions, or 4.
    """
    return frame.directions.shape[0] if frame.directions.shape[0] > 0 else 4


@lean
def friction_of(frame, command, i):
    """Return where the friction of a point begins in a command, and its extremes.

    Returns:
        Index of its first friction; its least and its largest friction [N].
    """
    at = frame.stiffness.shape[0] + columns_of(frame) * i
    least = command[at]
    most = command[at]
    for k in range(1, columns_of(frame)):
        least = min(least, command[at + k])
        most = max(most, command[at + k])
    return at, least, most


@lean
def load_of(frame, command, i, c):
    """Return a component of the load on a point.

    Returns:
        The load, 0 in a command without loads [N].
    """
    at = frame.stiffness.shape[0] + columns_of(frame) * frame.position.shape[0] + 2 * i + c
    return command[at] if at < command.shape[0] else 0.0
