"""Build a body that can turn from its points, links, joints and frames, and check them against each other."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import frozen, spread
from ..errors import SceneError
from .body import Body
from .build import check_connected
from .turning import Turning

_COINCIDE = 1e-6
"""Points nearer to each other than this part of the size of the body coincide."""


def build_links(points: np.ndarray, between: Sequence[Sequence[int]] | None, field: str) -> np.ndarray:
    """Check the links of a body that can turn.

    Args:
        points: reference positions, shape (N, 2) [m].
        between: the pair of points that each link joins; None joins each point to the next.
        field: key of the points, for error messages.

    Returns:
        Shape (S, 2), int64.

    Raises:
        SceneError: if there are too few points, or a link joins none of them, itself or two at the same place.
    """
    count = points.shape[0]
    if count < 2:
        raise SceneError(f"{field}: {count} point(s); a body needs at least 2")
    pairs = list(itertools.pairwise(range(count))) if between is None else between
    for i, pair in enumerate(pairs):
        _check_points(f"body.links.between: link {i}", pair, points, "a link needs a length > 0")
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def build_turning_body(
    points: np.ndarray, ends: np.ndarray, stiffness: ArrayLike, turning: Turning, bare: np.ndarray
) -> Body:
    """Build a body that can turn.

    Args:
        points: reference positions, shape (N, 2) [m].
        ends: the two points of each link, from `build_links`, shape (S, 2).
        stiffness: of the links, one number or one each, > 0 [N/m].
        turning: joints, frames and heading, checked.
        bare: whether a point has no friction, so that it does not count in the net translation, shape (N,).

    Returns:
        The body, its arrays read-only.

    Raises:
        SceneError: if a stiffness is not positive, or the links do not connect all points.
    """
    k = spread(stiffness, ends.shape[0], "body.links.stiffness", "link")
    for link in np.flatnonzero(~(k > 0.0)):
        raise SceneError(f"body.links.stiffness: link {link} has {k[link]:g} N/m; it must be > 0")
    count = points.shape[0]
    touching = (~bare).astype(np.float64)
    body = Body(
        position=frozen(points),
        ends=frozen(ends, np.int64),
        stiffness=frozen(k),
        share=frozen(touching / touching.sum()),
        ground=frozen(np.ones(count)),
        isolated=frozen(np.arange(count), np.int64),
        link_springs=frozen(np.arange(k.size), np.int64),
        segments=(),
        turning=turning,
    )
    check_connected(body, range(count), np.arange(count), "point")
    return body


def build_joints(
    points: np.ndarray, between: Sequence[Sequence[int]] | None, stiffness: ArrayLike
) -> tuple[np.ndarray, np.ndarray]:
    """Check the joints of a body that can turn.

    Args:
        points: reference positions, shape (N, 2) [m].
        between: the three points of each joint; None for all that follow each other.
        stiffness: one number or one each, > 0 [N m/rad].

    Returns:
        The points, int64, shape (J, 3), and the stiffness, shape (J,) [N m/rad].

    Raises:
        SceneError: if a joint has no such points, the same one twice or two at the same place, or no stiffness.
    """
    triples = [(i, i + 1, i + 2) for i in range(points.shape[0] - 2)] if between is None else between
    for i, triple in enumerate(triples):
        _check_points(f"body.joints.between: joint {i}", triple, points, "an angle needs three places")
    c = spread(stiffness, len(triples), "body.joints.stiffness", "joint")
    for joint in np.flatnonzero(~(c > 0.0)):
        raise SceneError(f"body.joints.stiffness: joint {joint} has {c[joint]:g} N m/rad; it must be > 0")
    return frozen(np.array(triples, dtype=np.int64).reshape(-1, 3), np.int64), frozen(c)


def build_frames(points: np.ndarray, ends: np.ndarray, given: Sequence[Sequence[int]] | None) -> np.ndarray:
    """Check the frames of points.

    Args:
        points: reference positions, shape (N, 2) [m].
        ends: the two points of each link, shape (S, 2).
        given: for each point the two points whose direction is its forward direction; None for its first link.

    Returns:
        Shape (N, 2), int64.

    Raises:
        SceneError: if the frame of a point is missing, or no link joins its two points.
    """
    count = points.shape[0]
    if given is None:
        rows = [np.flatnonzero((ends == i).any(axis=1)) for i in range(count)]
        return frozen([ends[row[0]] if row.size else (0, 0) for row in rows], np.int64)
    if len(given) != count:
        raise SceneError(f"friction.frame: {len(given)} pair(s) for {count} points; give one each")
    linked = {tuple(pair) for pair in np.concatenate((ends, ends[:, ::-1])).tolist()}
    for i, pair in enumerate(given):
        _check_points(f"friction.frame: point {i}", pair, points, "a direction needs two places")
        if tuple(pair) not in linked:
            raise SceneError(
                f"friction.frame: point {i} has {list(pair)}, which no link joins; its direction must be that of a link"
            )
    return frozen(np.array(given, dtype=np.int64), np.int64)


def build_heading(points: np.ndarray, given: Sequence[int] | None) -> np.ndarray:
    """Check the heading.

    Args:
        points: reference positions, shape (N, 2) [m].
        given: the two points whose direction is the yaw; None for the first and the last one.

    Returns:
        Shape (2,), int64.

    Raises:
        SceneError: if there are no such points, or they are at the same place.
    """
    pair = (0, points.shape[0] - 1) if given is None else given
    hint = "" if given is not None else "; give two other points"
    _check_points("heading: it", pair, points, f"a direction needs two places{hint}")
    return frozen(np.array(pair, dtype=np.int64), np.int64)


def _check_points(where: str, numbers: Sequence[int], points: np.ndarray, needs: str) -> None:
    """Check that points exist, differ and do not coincide."""
    count, shown = points.shape[0], list(numbers)
    for number in numbers:
        if not 0 <= number < count:
            raise SceneError(f"{where} has {shown}, but there are points 0 .. {count - 1}")
    near = _COINCIDE * float(np.linalg.norm(np.ptp(points, axis=0)))
    for one, other in itertools.combinations(numbers, 2):
        if one == other:
            raise SceneError(f"{where} has {shown}, point {one} twice; {needs}")
        if float(np.linalg.norm(points[one] - points[other])) <= near:
            at = ", ".join(f"{v:g}" for v in points[one])
            raise SceneError(f"{where} has {shown}, but points {one} and {other} are both at [{at}] m; {needs}")
