"""How near a run came to the boundary of its stasis domain, and to sliding as a whole."""

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
        least: least distance of a spring force from its bound, at the end of any tick [N]; 0 (but for rounding) as soon
            as something slides.
        least_at: when that was first [s].
        least_contact: which contact it was.
        visited: how near all contacts came to sliding at once [1], 0 for all of them; None when nothing was commanded.
        unique: whether the translation was determined throughout.
        ambiguous: stretches in which it was not (start, end) [s], the first hundred.
    """

    least: float
    least_at: float
    least_contact: str
    visited: float | None
    unique: bool
    ambiguous: tuple[tuple[float, float], ...]

    def as_plain(self) -> dict[str, Any]:
        """Lay it out for JSON.

        Returns:
            The attributes by name, as plain numbers, lists and text.
        """
        return {**self.__dict__, "ambiguous": [list(pair) for pair in self.ambiguous]}


def find_margins(table: RampTable, scene: Scene) -> Margins:
    """Find a run's margins.

    Args:
        table: its ramps.
        scene: what ran.

    Returns:
        The margins.
    """
    near = _ROUNDING * (1.0 + float(np.abs(table.margin).max()))
    row = int((table.margin <= max(float(table.margin.min()), 0.0) + near).argmax())  # at a bound is at a bound
    visited = float(table.visited.min())
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
    )
