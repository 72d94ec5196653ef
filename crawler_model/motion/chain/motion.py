"""The motion of a chain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...body.body import Body
from ..line_state import LineState, build_line_state
from ..pieces import NO_PIECES
from ..translation import FEW_CONTACTS
from . import many, memory, ramp


@dataclass(frozen=True, eq=False)
class ChainMotion:
    """A chain followed from event to event, or by catch-up steps.

    Attributes:
        body: the chain, or variations of it that differ in their stiffness, for `start` and `follow_many`.
    """

    methods: ClassVar[tuple[str, ...]] = ("exact", "catch_up")
    body: Body

    @property
    def samples_margin(self) -> bool:
        """Whether an exact ramp samples its visited margin only at its ends, as in long chains."""
        return self.body.contacts > FEW_CONTACTS

    def start(self, x: np.ndarray, target: np.ndarray) -> LineState:
        """Build the state at rest, see `Motion`."""
        return build_line_state(self.body, x, target)

    def scratch(self) -> tuple[Any, ...]:
        """Allocate the working memory of a ramp, see `Motion`."""
        return tuple(memory.scratch(self.body.contacts))

    def follow(
        self,
        state: LineState,
        scratch: tuple[Any, ...],
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
        pieces: np.ndarray = NO_PIECES,
    ) -> None:
        """Follow straight ramps to each of the targets in turn, see `Motion`."""
        body = self.body
        ramp.follow(
            body.elasticity,
            state.contacts,
            state.links,
            state.status,
            targets,
            exact,
            budget,
            body.element_ends,
            body.share,
            *scratch,
            account,
            records,
            pieces,
        )

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
        """Follow straight ramps exactly, for each variation of the body, see `Motion` and `LineMotion`."""
        body = self.body
        many.follow_many(
            body.elasticity,
            state.contacts,
            state.links,
            state.status,
            targets,
            rows,
            legs,
            True,
            budget,
            body.element_ends,
            body.share,
            *scratch,
            accounts,
            spent,
            records,
        )
