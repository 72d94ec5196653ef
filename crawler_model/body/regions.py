"""Regions of the plane with other ground: convex, without overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..rounding import EPS

_NEAR = 16.0 * EPS
"""A point within this part of its coordinates from a border stands on it."""


@dataclass(frozen=True, eq=False)
class Regions:
    """Convex regions of the plane, on which friction is multiplied; the ground between them is region -1.

    Region r is the intersection of half planes, { p | n_k . p >= c_k for all its k }.

    Attributes:
        normals: inward unit normals n_k of each region, shape (K_r, 2) each.
        offsets: c_k of each region, shape (K_r,) each [m].
        factors: of each region on friction, and 1 as the last, shape (R + 1,) [1].
    """

    normals: tuple[np.ndarray, ...]
    offsets: tuple[np.ndarray, ...]
    factors: np.ndarray

    def find(self, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Find the regions of points; a point on a border is held by the side with more friction.

        Args:
            at: positions, shape (N, 2) [m].

        Returns:
            The region of each point, and the region on the side with the least friction, which differs on a border;
            shapes (N,), int64.
        """
        near = _NEAR * np.abs(at).max(axis=1)[:, None]
        pairs = zip(self.normals, self.offsets, strict=True)
        room = np.stack([(at @ n.T - c).min(axis=1) for n, c in pairs], axis=1)
        touched = np.column_stack((room >= -near, ~(room > near).any(axis=1)))  # the last column is region -1
        most = np.where(touched, self.factors, -np.inf).argmax(axis=1)
        least = np.where(touched, self.factors, np.inf).argmin(axis=1)
        outside = len(self.normals)
        return np.where(most == outside, -1, most), np.where(least == outside, -1, least)

    def normal(self, point: np.ndarray, region: int, behind: int) -> np.ndarray:
        """Compute the unit normal of the border on which a point stands.

        Args:
            point: shape (2,) [m].
            region: on one side.
            behind: the region on the other side, towards which the normal points.

        Returns:
            Shape (2,).
        """
        of, sign = (region, -1.0) if region >= 0 else (behind, 1.0)
        nearest = np.abs(self.normals[of] @ point - self.offsets[of]).argmin()
        return np.asarray(sign * self.normals[of][nearest])

    def keep_clear(self, region: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Determine which straight ways do not come near a border.

        Args:
            region: where the ways begin, shape (N,).
            start: shape (N, 2) [m].
            end: shape (N, 2) [m].

        Returns:
            bool, shape (N,); False where `cross` has to be asked.
        """
        near = _NEAR * np.abs((start, end)).max(axis=(0, 2))[:, None]
        away, inside = np.ones(region.size, np.bool_), np.zeros(region.size, np.bool_)
        for r, (normals, offsets) in enumerate(zip(self.normals, self.offsets, strict=True)):
            before, after = start @ normals.T - offsets, end @ normals.T - offsets
            away &= (np.maximum(before, after) < -near).any(axis=1)
            inside |= (region == r) & (np.minimum(before, after) > near).all(axis=1)
        return np.where(region < 0, away, inside)

    def cross(self, region: int, start: np.ndarray, end: np.ndarray) -> tuple[float, int]:
        """Find where a straight way leaves a region.

        Args:
            region: where the way begins.
            start: shape (2,) [m].
            end: shape (2,) [m].

        Returns:
            The part of the way, infinite if it stays; and the region into which it leads.
        """
        if (start == end).all():
            return np.inf, region
        spans = [_clip(n, c, start, end) for n, c in zip(self.normals, self.offsets, strict=True)]
        if region >= 0:
            first, last = spans[region]
            leaves = last if first < last else np.inf if self._leads_in(region, start, end) else 0.0
        else:  # a way that begins within rounding of a border, in another region, leads out of that
            met = (
                first
                for r, (first, last) in enumerate(spans)
                if first < last and (first > 0.0 or self._leads_in(r, start, start + 0.5 * last * (end - start)))
            )
            leaves = min(met, default=np.inf)
        if leaves >= 1.0:
            return np.inf, region
        into = (r for r, (first, last) in enumerate(spans) if r != region and first <= leaves + _NEAR < last)
        return leaves, next(into, -1)

    def _leads_in(self, region: int, start: np.ndarray, end: np.ndarray) -> bool:
        """Determine whether the end of a way is deeper in a region than its start."""
        normals, offsets = self.normals[region], self.offsets[region]
        return bool((normals @ end - offsets).min() > (normals @ start - offsets).min())


def _clip(normals: np.ndarray, offsets: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[float, float]:
    """Clip a straight way to a region: the parts of the way, within 0 .. 1, where it enters and leaves it.

    It leaves at 1 if it ends within, and no later than it enters if it does not pass through.
    """
    first, last = 0.0, 1.0
    near = _NEAR * float(max(np.abs(start).max(), np.abs(end).max()))
    for room, after in zip((normals @ start - offsets).tolist(), (normals @ end - offsets).tolist(), strict=True):
        begin = 0.0 if abs(room) <= near else room
        stop = 0.0 if abs(after) <= near else after
        if begin < 0.0:
            first = max(first, begin / (begin - stop)) if stop > 0.0 else np.inf
        elif stop < 0.0:
            last = min(last, begin / (begin - stop))
        elif begin == stop == 0.0:
            first = np.inf  # along the border
    return first, last
