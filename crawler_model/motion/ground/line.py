"""The motion of a chain or a graph between two borders."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ...body.body import Body
from ..line_state import LineState


class LineMotion(Protocol):
    """The motion of a chain or a graph, resumed at every border."""

    @property
    def body(self) -> Body:
        """The body."""
        ...

    @property
    def samples_margin(self) -> bool:
        """Whether a ramp samples its visited margin only at its ends."""
        ...

    def scratch(self) -> tuple[Any, ...]:
        """Allocate the working memory of a ramp, see `Motion`."""
        ...

    def follow_to_border(
        self,
        state: LineState,
        scratch: tuple[Any, ...],
        targets: np.ndarray,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
        ground: np.ndarray,
        reached: np.ndarray,
    ) -> tuple[int, float, int]:
        """Follow straight ramps exactly, until a contact reaches a border.

        Args:
            state: changed in place.
            scratch: memory from `scratch`.
            targets: for ground without patches, shape (V, S + 2 N), with loads (V, S + 3 N).
            budget: upper limit of work in one ramp.
            account: entries as in `motion.state`, shape (14,), added to.
            records: output, as for `Motion.follow`.
            ground: from `Track.find_ground`, shape (8, N).
            reached: output: 1 for a border reached forward, -1 backward, else 0; int8, shape (N,), zero before.

        Returns:
            The number of targets reached; the part of the next ramp that was followed; and how it ended: FOLLOWED or
            PASSED, or 1 or -1 before a ramp at whose end the ground holds nothing, forward or backward.
        """
        ...
