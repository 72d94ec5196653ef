"""The point of a segment at rest while everything else slides, and the discretisation error that it causes.

Under uniform strain one point of the continuous body is at rest, and both sides slide away from it or towards it. In
the discrete body the contact whose cell contains this point is at rest instead: all other contacts are then off by the
strain times the distance between the two. The point follows from the force on that contact, which divides its cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.drive import Drive
from .assembly import Assembly

_PERIODS = 3
"""Number of periods of a drive that are run."""
_TICKS = 32
"""Minimum number of parts of the path of a drive."""
_BLOCK = 256
"""Number of parts that are followed in one call."""
_TIE = 1e-6
"""A point within this part of an element from the border of two cells lies between them."""


@dataclass(frozen=True, eq=False)
class Standing:
    """Strains of a segment about the points at which it is at rest.

    Attributes:
        length: length of the segment [m].
        point: point at rest, measured from the start of the segment, shape (K,) [m].
        strain: strain of the segment during that time, shape (K,).
        moment: index of the first instant of comparison with this error, shape (K,).
        moments: number of instants of comparison.
        adds: whether errors accumulate from each instant to the later ones.
    """

    length: float
    point: np.ndarray
    strain: np.ndarray
    moment: np.ndarray
    moments: int
    adds: bool

    def error(self, elements: np.ndarray) -> np.ndarray:
        """Predict the error of the net translation due to standing contacts, for numbers of elements.

        Args:
            elements: numbers of elements, shape (M,).

        Returns:
            Largest error over all instants of comparison, shape (M,) [m].
        """
        if self.point.size == 0:
            return np.zeros(elements.size)
        place = self.point / self.length * elements[:, None]
        between = np.abs(place - np.floor(place) - 0.5) < _TIE  # the body is at rest midway between both contacts
        off = np.where(between, 0.0, np.clip(np.rint(place), 0, elements[:, None]) - place) / elements[:, None]
        errors = np.zeros((elements.size, self.moments))
        for moment in range(self.moments):
            errors[:, moment] = (off * self.strain)[:, self.moment == moment].sum(axis=1) * self.length
        if self.adds:
            errors = np.cumsum(errors, axis=1)
        return np.asarray(np.abs(errors).max(axis=1, initial=0.0))


def _choose_rows(drive: Drive) -> np.ndarray:
    """List the rows of a drive along some of its periods, or along all of it."""
    if drive.period is None:
        return np.arange(drive.times.size)
    return np.append(np.tile(np.flatnonzero(drive.times < drive.period), _PERIODS), 0)


def measure_gains(assembly: Assembly) -> np.ndarray:
    """Run the drive of a scene.

    Args:
        assembly: assembly of a scene with a drive.

    Returns:
        The net translation gained in each of three periods; without a period, that at each waypoint; then the least
        and the largest translation that solve the model as well, from the one chosen, as a mean over the periods, both
        0 where it is unique [m].
    """
    from ..crawler.crawler import Crawler

    body, drive = assembly.body, assembly.drive
    targets = drive.targets[_choose_rows(drive)[1:]]
    records = np.empty((targets.shape[0], 2 * body.contacts + body.springs))
    account = Crawler(assembly).follow(targets, records).account
    x = records[:, : body.contacts] + records[:, body.contacts : 2 * body.contacts]
    at = np.vstack((assembly.start_displacement, x)) @ body.share
    gained = at if drive.period is None else np.diff(at[:: targets.shape[0] // _PERIODS])
    return np.append(gained, _find_interval(account, drive))


def _find_interval(account: np.ndarray, drive: Drive) -> np.ndarray:
    """Find the interval of translations in the account of a run, as a mean over its periods, shape (2,) [m]."""
    from ..motion.account import AMBIGUOUS, GAIN_LEAST, GAIN_MOST  # with kernels, which a mere scene does not need

    interval = account[[GAIN_LEAST, GAIN_MOST]] if account[AMBIGUOUS] else np.zeros(2)
    return np.asarray(interval / (1 if drive.period is None else _PERIODS))


def find_standing(assembly: Assembly, place: int) -> tuple[np.ndarray, Standing]:
    """Run the drive of a scene and find the points at which a segment is at rest.

    No friction wave may run along the segment.

    Args:
        assembly: assembly of a scene whose drive has times.
        place: index of the segment.

    Returns:
        The results of `measure_gains`, corrected for the points at rest, which makes them accurate to second order; and
        these points.
    """
    from ..crawler.crawler import Crawler

    body, drive = assembly.body, assembly.drive
    rows = _choose_rows(drive)
    ramps = rows.size - 1
    parts = max(1, -(-_TICKS // ramps))
    count = body.contacts
    crawler = Crawler(assembly)
    last = np.concatenate((assembly.start_displacement, np.zeros(count)))
    friction = drive.targets[rows[0], body.springs :]
    gained, points, strains, ticks = [], [], [], []
    step = None
    for first in range(0, ramps * parts, _BLOCK):
        tick = np.arange(first, min(first + _BLOCK, ramps * parts))
        begin, end = drive.targets[rows[tick // parts]], drive.targets[rows[tick // parts + 1]]
        targets = begin + ((tick % parts + 1) / parts)[:, None] * (end - begin)
        records = np.empty((tick.size, 2 * count + body.springs))
        step = crawler.follow(targets, records, step)
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
        total = ramp_gained.reshape(_PERIODS, -1).sum(axis=1)
        moments, moment = _PERIODS, ramp // (ramps // _PERIODS)
    standing = Standing(
        body.segments[place].length,
        np.concatenate(points)[found],
        strain[found],
        moment[found],
        moments,
        drive.period is None,
    )
    assert step is not None
    return np.append(total, _find_interval(step.account, drive)), standing


def _stand(
    assembly: Assembly, place: int, moved: np.ndarray, tension: np.ndarray, friction: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the point at which a segment is at rest in each part of a path.

    Args:
        assembly: assembly of the scene.
        place: index of the segment.
        moved: displacement gained in each part, shape (V, N) [m].
        tension: tensions at the end of each part, shape (V, S) [N].
        friction: friction at the start and at the end of each part, shape (V + 1, 2 N) [N].

    Returns:
        The point [m], the strain about it (0 if other contacts are at rest too), and the additional displacement of the
        body if the point itself had been at rest [m], each of shape (V,).
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
    # the point moves from one contact to the next, or lies on the border of two cells
    between = np.flatnonzero(~stuck.any(axis=1))
    turns = part[between, :-1] * part[between, 1:] < 0.0
    once = turns.sum(axis=1) == 1
    at, j = between[once], turns[once].argmax(axis=1)
    strain[at] = (part[at, j + 1] - part[at, j]) / h
    point[at] = j * h - part[at, j] / strain[at]
    return point, strain, correction
