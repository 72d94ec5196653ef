"""The motion of a body that turns: its yaw along ramps, its gain in its own frame, and the rotation that it repeats."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from ..body.body import Body
from ..body.turning import measure_angles
from ..crawler.crawler import Crawler
from ..crawler.step import Step
from ..errors import CommandError

_STRAIGHT = 1e-9
"""A body that turns by less in a period goes straight [rad]."""


@dataclass(frozen=True)
class Screw:
    """A rigid motion in the plane: a rotation about a centre. A body that repeats it walks on a circle.

    Attributes:
        centre: in the frame of the body before the motion [m]; None for a motion that does not turn the body.
        radius: distance of the origin of this frame from the centre [m]; None where `centre` is.
    """

    centre: tuple[float, float] | None
    radius: float | None


def find_screw(gain: np.ndarray) -> Screw:
    """Find the centre about which a body turned, the point c = R(dyaw) c + (dx, dy) that stayed in place.

    Args:
        gain: dx, dy in the frame of the body before the motion [m], and dyaw [rad], shape (3,).

    Returns:
        The rotation.
    """
    x, y, turned = (float(value) for value in gain)
    if abs(turned) <= _STRAIGHT:
        return Screw(None, None)
    half = 0.5 / math.tan(0.5 * turned) if math.cos(0.5 * turned) else 0.0
    centre = 0.5 * x - half * y, 0.5 * y + half * x
    return Screw(centre, math.hypot(*centre))


def gain_in_frame(body: Body, x: np.ndarray, moved: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """Compute gains in the frame of the body before each of them: its origin lies between the points of the heading.

    Args:
        body: a body that turns.
        x: displacements before, shape (P, N, 2) [m].
        moved: displacement gained, shape (P, N, 2) [m].
        turned: change of the yaw, shape (P,) [rad].

    Returns:
        dx, dy along and across the heading [m], and dyaw [rad], shape (P, 3).
    """
    assert body.turning is not None
    gained = moved[:, body.turning.heading].mean(axis=1)
    along, across = to_frame(body, x, gained[:, None])[:, 0].T
    return np.column_stack((along, across, turned))


def largest_distance(body: Body) -> float:
    """Find the largest distance of two points of a body, its size whichever way it lies.

    Args:
        body: the body.

    Returns:
        The distance in the reference shape [m].
    """
    if body.dimension == 1:
        return float(np.ptp(body.position))
    return float(np.linalg.norm(body.position[:, None] - body.position, axis=2).max())


def to_frame(body: Body, x: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Compute the components of vectors along and across the heading.

    Args:
        body: a body that turns.
        x: its displacement, shape (..., N, 2) [m].
        vectors: shape (..., K, 2) [any unit].

    Returns:
        Shape (..., K, 2) [the same unit].
    """
    assert body.turning is not None
    yaw = measure_angles(body.position + x, body.turning.heading[None])
    cos, sin = np.cos(yaw), np.sin(yaw)
    across = cos * vectors[..., 1] - sin * vectors[..., 0]
    return np.stack((cos * vectors[..., 0] + sin * vectors[..., 1], across), axis=-1)


def places_in_frame(crawler: Crawler) -> np.ndarray:
    """Compute the positions of the points in the frame of a body that turns; under loads only about its origin.

    Args:
        crawler: one whose body turns.

    Returns:
        Shape (N, 2) [m].
    """
    body, x = crawler.body, crawler.displacement
    place = body.position + x
    place = place - body.share @ place
    return place if crawler.loads.size else to_frame(body, x, place)


def follow_turning(
    crawler: Crawler, targets: np.ndarray, records: np.ndarray, ends: np.ndarray
) -> tuple[Step, np.ndarray, np.ndarray]:
    """Follow ramps one after another: only the state after each tells how often the body turned round.

    Args:
        crawler: one whose body turns.
        targets: rows as for `Crawler.follow`, at least one, shape (V, F).
        records: output, as for `Crawler.follow`.
        ends: times at which the ramps end, shape (V,) [s].

    Returns:
        The account of all ramps; the yaw at the end of each [rad], and the stability margin of each [1], shape (V,).

    Raises:
        CommandError: if the body loses its stability and must not jump; the message contains the time.
    """
    yaw, margin = np.empty(targets.shape[0]), np.empty(targets.shape[0])
    step, jumps = None, []
    for i in range(targets.shape[0]):
        try:
            step = crawler.follow(targets[i : i + 1], records[i : i + 1], step)
        except CommandError as error:
            raise CommandError(f"{error} (the ramp ends at {ends[i]:g} s)") from None
        yaw[i], margin[i] = crawler.yaw, crawler.stability_margin
        jumps += [dataclasses.replace(jump, ramp=i) for jump in step.jumps]
    assert step is not None
    return Step(step.velocity, step.account, crawler.body.share, tuple(jumps)), yaw, margin
