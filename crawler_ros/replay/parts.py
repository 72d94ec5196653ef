"""Slip of the parts of a body: isolated contacts, and segments as a whole, whatever their number of elements.

The number of contacts of a segment grows with the number of its elements, and so does a sum over them. Its slip forward
is the mean distance by which its material slid forward,

    (1 / l) int max(dx, 0) ds

and its slip backward is defined in the same way; both converge as the mesh is refined, and their difference, averaged
over all isolated contacts and segments, is the net translation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model.body.body import Body

from ..wire.states import station_names


@dataclass(frozen=True, eq=False)
class Parts:
    """Isolated contacts, then segments, of a body of M contacts.

    Attributes:
        stations: the isolated contacts, then both ends of each segment, shape (Q,).
        station_names: as "contact_0" or "trunk.from".
        order: the contacts, part by part, shape (M,).
        first: where each part begins in `order`, shape (P,).
        share: weight of each contact of `order` in its part, shape (M,); the weights of a part add up to 1.
    """

    stations: np.ndarray
    station_names: tuple[str, ...]
    order: np.ndarray
    first: np.ndarray
    share: np.ndarray

    def average(self, values: np.ndarray) -> np.ndarray:
        """Average over each part.

        Args:
            values: one value per contact, shape (R, M).

        Returns:
            Shape (R, P).
        """
        if self.first.size == self.order.size:  # only isolated contacts: the average of each is its value
            return np.ascontiguousarray(values[:, self.order])
        return np.add.reduceat(values[:, self.order] * self.share, self.first, axis=1)

    def slid(self, gained: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sum the distances that all parts slid forward and backward; a segment counts with the mean over its length.

        Args:
            gained: displacement of each contact, shape (R, M), in the plane (R, M, 2) [m].

        Returns:
            Distances forward and backward, each shape (R,) [m]; in the plane by the sign of the first component.
        """
        size = np.abs(gained) if gained.ndim == 2 else np.linalg.norm(gained, axis=2)
        ahead = (gained if gained.ndim == 2 else gained[..., 0]) > 0.0
        forward, backward = np.where(ahead, size, 0.0), np.where(ahead, 0.0, size)
        return self.average(forward).sum(axis=1), self.average(backward).sum(axis=1)


def parts_of(body: Body) -> Parts:
    """List the parts of a body.

    Args:
        body: the body.

    Returns:
        Its parts, over all of its contacts.
    """
    count = body.isolated.size
    groups = [np.array([contact]) for contact in body.isolated]
    groups += [np.arange(s.first, s.last + 1) for s in body.segments]
    shares = [np.ones(1)] * count + [s.cells / s.length for s in body.segments]
    return _build(body.stations, station_names(body), groups, shares)


def parts_by_name(names: tuple[str, ...], position: np.ndarray) -> Parts:
    """Infer the parts of an unknown body from the names and positions of its contacts.

    Args:
        names: names of the contacts shown, as "contact_0" or "trunk/contact_7", shape (M,).
        position: positions of the contacts, shape (M,); in the plane, where there are no segments, (M, 2) [m].

    Returns:
        Its parts, over the contacts shown. A contact of a segment counts for half the distance to each neighbour.
    """
    alone = [contact for contact, name in enumerate(names) if "/" not in name]
    segments: dict[str, list[int]] = {}
    for contact, name in enumerate(names):
        if "/" in name:
            segments.setdefault(name.partition("/")[0], []).append(contact)
    ends = [end for inside in segments.values() for end in (inside[0], inside[-1])]
    station_labels = [names[c] for c in alone] + [f"{name}.{end}" for name in segments for end in ("from", "to")]
    groups = [np.array([contact]) for contact in alone] + [np.array(inside) for inside in segments.values()]
    shares = [np.ones(1)] * len(alone) + [_cells(position[group]) for group in groups[len(alone) :]]
    return _build(np.array([*alone, *ends], np.int64), station_labels, groups, shares)


def _cells(position: np.ndarray) -> np.ndarray:
    """Weight the contacts of a segment by the length around them; the weights add up to 1."""
    gaps = np.abs(np.diff(position))
    cells = 0.5 * (np.append(gaps, 0.0) + np.append(0.0, gaps))
    return cells / cells.sum() if cells.sum() > 0.0 else np.full(cells.size, 1.0 / cells.size)


def _build(stations: np.ndarray, names: list[str], groups: list[np.ndarray], shares: list[np.ndarray]) -> Parts:
    none = np.zeros(0)
    first = np.cumsum([0, *(group.size for group in groups)])[:-1]
    order = np.concatenate([none, *groups]).astype(np.int64)
    return Parts(stations, tuple(names), order, first, np.concatenate([none, *shares]))
