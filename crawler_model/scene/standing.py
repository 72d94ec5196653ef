"""Where a segment stands while everything else slides, and what a body of equal elements costs there.

Under an even strain one point of the body stands, and both sides slide away from it. A body lets a contact stand in
its place, the one in whose cell the point lies: all other contacts are then off by the strain times the distance
between the two. The point itself follows from the force on that contact, which divides its cell in two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..crawler.crawler import Crawler
from .assembly import Assembly

_TICKS = 32
"""Parts of a drive's path, at least."""
_BLOCK = 256
"""Parts that are followed in one call."""
_TIE = 1e-6
"""Nearer than this part of an element to the border of two cells, a point lies between them."""


@dataclass(frozen=True, eq=False)
class Standing:
    """How much a segment is strained about which of its points.

    Attributes:
        length: of the segment [m].
        point: where the body stands, from the segment's start, shape (K,) [m].
        strain: by which the segment lengthens meanwhile, shape (K,).
        moment: after which the translation is off by it: 1 or more, shape (K,).
        moments: how many there are.
        adds: whether what is off at a moment stays off at all later ones.
    """

    length: float
    point: np.ndarray
    strain: np.ndarray
    moment: np.ndarray
    moments: int
    adds: bool

    def error(self, elements: np.ndarray) -> np.ndarray:
        """Predict the error of the net translation in bodyes, as far as it comes from contacts that stand.

        Args:
            elements: numbers of elements, shape (M,).

        Returns:
            The largest over all moments, shape (M,) [m].
        """
        if self.point.size == 0:
            return np.zeros(elements.size)
        place = self.point / self.length * elements[:, None]
        between = np.abs(place - np.floor(place) - 0.5) < _TIE  # the body takes the middle of both contacts
        off = np.where(between, 0.0, np.clip(np.rint(place), 0, elements[:, None]) - place) / elements[:, None]
        errors = np.zeros((elements.size, self.moments))
        for moment in range(self.moments):
            errors[:, moment] = (off * self.strain)[:, self.moment == moment].sum(axis=1) * self.length
        if self.adds:
            errors = np.cumsum(errors, axis=1)
        return np.asarray(np.abs(errors).max(axis=1, initial=0.0))


def find_standing(assembly: Assembly, place: int) -> tuple[np.ndarray, Standing]:
    """Run a scene's drive and find where a segment stands.

    The friction of the segment must not vary in time along it.

    Args:
        assembly: of a scene whose drive has times.
        place: which segment.

    Returns:
        The net translation gained in each period after the first (without a period: at each waypoint), as if the body
        stood on points instead of contacts, which is right to second order; and where it stands.
    """
    body, drive = assembly.body, assembly.drive
    rows = np.arange(drive.times.size)
    if drive.period is not None:
        rows = np.append(np.tile(np.flatnonzero(drive.times < drive.period), 3), 0)
    ramps = rows.size - 1
    parts = max(1, -(-_TICKS // ramps))
    count = body.contacts
    crawler = Crawler(assembly)
    last = np.concatenate((assembly.start_displacement, np.zeros(count)))
    friction = drive.targets[rows[0], body.springs :]
    gained, points, strains, ticks = [], [], [], []
    for first in range(0, ramps * parts, _BLOCK):
        tick = np.arange(first, min(first + _BLOCK, ramps * parts))
        begin, end = drive.targets[rows[tick // parts]], drive.targets[rows[tick // parts + 1]]
        targets = begin + ((tick % parts + 1) / parts)[:, None] * (end - begin)
        records = np.empty((tick.size, 2 * count + body.springs))
        crawler.follow(targets, records)
        x = np.vstack((last, records[:, : 2 * count]))
        moved = np.diff(x[:, :count], axis=0) + np.diff(x[:, count:], axis=0)
        held = np.vstack((friction, targets[:, body.springs :]))
        point, strain, correction = _stand(assembly, place, moved, records[:, 2 * count :], held)
        gained.append(moved @ body.share + correction)
        points.append(point)
        strains.append(strain)
        ticks.append(tick)
        last, friction = x[-1], held[-1]
    ramp_gained = np.concatenate(gained).reshape(ramps, parts).sum(axis=1)
    ramp = np.concatenate(ticks) // parts
    strain = np.concatenate(strains)
    found = strain != 0.0
    if drive.period is None:
        total = body.share @ assembly.start_displacement + np.concatenate(([0.0], np.cumsum(ramp_gained)))
        moments, moment = ramps, ramp
    else:
        total = ramp_gained.reshape(3, -1).sum(axis=1)[1:]
        moments, moment = 2, ramp // (ramps // 3) - 1  # the first period is not compared
        found &= moment >= 0
    standing = Standing(
        body.segments[place].length,
        np.concatenate(points)[found],
        strain[found],
        moment[found],
        moments,
        drive.period is None,
    )
    return total, standing


def _stand(
    assembly: Assembly, place: int, moved: np.ndarray, tension: np.ndarray, friction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find where a segment stood in each part of a path.

    Args:
        assembly: of the scene.
        place: which segment.
        moved: displacement gained in each part, shape (V, N) [m].
        tension: at each part's end, shape (V, S) [N].
        friction: at the start and at each part's end, shape (V + 1, 2 N) [N].

    Returns:
        The point [m], the strain about it (0 where the segment does not stand alone), and by how much the body would
        have moved farther if it had stood on the point [m], each of shape (V,).
    """
    body = assembly.body
    segment = body.segments[place]
    n, h = segment.elements, segment.element
    part = moved[:, segment.contacts]
    point, strain, correction = np.zeros((3, moved.shape[0]))
    stuck = moved == 0.0
    alone = (stuck.sum(axis=1) == 1) & stuck[:, segment.contacts].any(axis=1)
    at = np.flatnonzero(alone & (friction[1:] == friction[:-1]).all(axis=1))
    j = stuck[at][:, segment.contacts].argmax(axis=1)
    left, right = np.maximum(j - 1, 0), np.minimum(j + 1, n)
    opposite = part[at, left] * part[at, right] <= 0.0
    at, j, left, right = at[opposite], j[opposite], left[opposite], right[opposite]
    strain[at] = (part[at, right] - part[at, left]) / ((right - left) * h)
    force = body.spring_force(tension[at])[np.arange(at.size), segment.first + j]
    forward = friction[at + 1, segment.first + j]
    backward = friction[at + 1, body.contacts + segment.first + j]
    ahead = np.where(strain[at] > 0.0, forward - force, force + backward)
    share = np.clip(ahead / (forward + backward), 0.0, 1.0)
    cell_start, cell_end = np.maximum(j - 0.5, 0.0) * h, np.minimum(j + 0.5, n) * h
    point[at] = cell_start + share * (cell_end - cell_start)
    correction[at] = strain[at] * (j * h - point[at])
    between = np.flatnonzero(~stuck.any(axis=1))  # from one contact to another, or on the border of two cells
    turns = part[between, :-1] * part[between, 1:] < 0.0
    once = turns.sum(axis=1) == 1
    at, j = between[once], turns[once].argmax(axis=1)
    strain[at] = (part[at, j + 1] - part[at, j]) / h
    point[at] = j * h - part[at, j] / strain[at]
    return point, strain, correction
