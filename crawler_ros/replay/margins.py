"""Margins of a run: its least distances from the boundary of the stasis domain and from sliding as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model import Scene
from crawler_model.body.drive import NS

from .ramps import RampTable

_MOST_LISTED = 100
_ROUNDING = 1e-12


@dataclass(frozen=True)
class Margins:
    """Margins of a run.

    Attributes:
        least: least distance of a spring force from its bound, at the end of any tick [N]; 0, up to rounding,
            as soon as a contact slides.
        least_at: when it was first reached [s].
        least_contact: the contact that reached it.
        visited: how near all contacts came to sliding at once [1], 0 when all did; None when nothing was commanded.
        unique: whether the translation was determined throughout.
        ambiguous: the first hundred intervals in which it was not, (start, end) [s].
        stability_margin: for a body that turns, the least of `Crawler.stability_margin` [1]; None if nothing moved, and
            for other bodies.
        stability_time: end of the ramp on which it was least [s]; None where `stability_margin` is.
    """

    least: float
    least_at: float
    least_contact: str
    visited: float | None
    unique: bool
    ambiguous: tuple[tuple[float, float], ...]
    stability_margin: float | None
    stability_time: float | None

    def as_plain(self) -> dict[str, Any]:
        """Convert to plain values for JSON.

        Returns:
            The attributes by name, as plain numbers, lists and text.
        """
        return {**self.__dict__, "ambiguous": [list(pair) for pair in self.ambiguous]}


def find_margins(table: RampTable, scene: Scene) -> Margins:
    """Compute the margins of a run.

    Args:
        table: the ramps of the run.
        scene: the scene that ran.

    Returns:
        The margins.
    """
    near = _ROUNDING * (1.0 + float(np.abs(table.margin).max()))  # differences by rounding do not count
    row = int((table.margin <= max(float(table.margin.min()), 0.0) + near).argmax())
    visited = float(table.visited.min())
    least = int(np.nan_to_num(table.stability, nan=np.inf).argmin())
    known = bool(np.isfinite(table.stability[least]))
    open_ = np.concatenate(([False], ~table.unique, [False])).astype(np.int8)
    begins, ends = np.flatnonzero(np.diff(open_) > 0), np.flatnonzero(np.diff(open_) < 0) - 1
    pairs = zip(table.start_ns[begins].tolist(), table.end_ns[ends].tolist(), strict=True)
    return Margins(
        least=float(table.margin[row]),
        least_at=float(table.end_ns[row]) / NS,
        least_contact=scene.body.name_of(int(table.nearest[row])),
        visited=visited if np.isfinite(visited) else None,
        unique=bool(table.unique.all()),
        ambiguous=tuple((a / NS, b / NS) for a, b in pairs)[:_MOST_LISTED],
        stability_margin=float(table.stability[least]) if known else None,
        stability_time=float(table.end_ns[least]) / NS if known else None,
    )
