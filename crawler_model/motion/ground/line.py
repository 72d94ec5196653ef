"""What chains and graphs offer beside `Motion`: motion up to a border of the ground, and of many variations."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ...body.body import Body
from ..borders import Patches
from ..line_state import LineState


class LineMotion(Protocol):
    """The motion of a chain or a graph: resumed at every border of patches, and over many variations in sweeps."""

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
        patches: Patches,
    ) -> tuple[int, float, int]:
        """Follow straight ramps exactly, until contacts reach a border that they do not cross.

        A chain crosses borders, and jumps, where no more is involved than the contacts around the one that does.

        Args:
            state: changed in place.
            scratch: memory from `scratch`.
            targets: for ground without patches, shape (V, S + 2 N), with loads (V, S + 3 N).
            budget: upper limit of work in one ramp.
            account: entries as in `motion.state`, shape (14,), added to.
            records: output, as for `Motion.follow`.
            patches: the ground; `reached` marks the contacts that are at a border at the end.

        Returns:
            The number of targets reached; the part of the next ramp that was followed; and how it ended: FOLLOWED or
            PASSED, or 1 or -1 before a ramp at whose end the ground holds nothing, forward or backward.
        """
        ...

    def follow_many(
        self,
        state: LineState,
        scratch: tuple[Any, ...],
        targets: np.ndarray,
        rows: np.ndarray,
        legs: np.ndarray,
        budget: int,
        accounts: np.ndarray,
        spent: np.ndarray,
        records: np.ndarray,
    ) -> None:
        """Follow straight ramps exactly, for each of M variations of the body, in one compiled call.

        Args:
            state: of all variations, changed in place.
            scratch: memory from `scratch`.
            targets: targets to choose from, shape (M, W, F).
            rows: which of them end the ramps, the same for all variations, shape (V,).
            legs: the ramps at which the account is read, increasing from 0 to V, shape (L + 1,).
            budget: upper limit of work in one ramp.
            accounts: entries as in `motion.state`, shape (M, 14), added to.
            spent: output: work, and energy lost to friction, since the start of the call at the end of each leg, shape
                (M, L, 2) [J].
            records: output: displacement, its rest and tension after each ramp, shape (M, V, 2 N + S).
        """
        ...
