"""The motion of a graph of springs on a line."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...body.body import Body
from ..line_state import LineState, build_line_state
from ..pieces import NO_PIECES
from ..translation import FEW_CONTACTS
from . import active_set, many, memory, paths, ramp, ring
from .active_set import Network


@functools.lru_cache(maxsize=4)
def build_network_of(body: Body) -> Network:
    """Build the network of a body; crawlers with the same body share it.

    Args:
        body: the body.

    Returns:
        The network.
    """
    return active_set.build_network(body)


@dataclass(frozen=True, eq=False)
class GraphMotion:
    """A graph of springs followed from event to event, or by catch-up steps.

    Attributes:
        body: the body, or variations of it that differ in their stiffness, for `start` and `follow_many`.
        network: its springs as conductances.
    """

    methods: ClassVar[tuple[str, ...]] = ("exact", "catch_up")
    body: Body
    network: Network

    @property
    def samples_margin(self) -> bool:
        """Whether an exact ramp samples its visited margin only at its ends, as in large graphs."""
        return self.body.contacts > FEW_CONTACTS

    def start(self, x: np.ndarray, target: np.ndarray) -> LineState:
        """Build the state at rest, see `Motion`."""
        return build_line_state(self.body, x, target)

    def scratch(self) -> tuple[Any, ...]:
        """Allocate the working memory of a ramp, see `Motion`."""
        n = self.body.contacts
        work = (*active_set.workspace(self.network), paths.memory(n))
        return work, ring.memory(self.body.ends, n), memory.scratch(n, self.body.springs)

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
        work, around, ramp_memory = scratch
        ramp.follow(
            body.ends,
            body.stiffness,
            (tuple(self.network.layout), self.network.conductances),
            work,
            around,
            state.contacts,
            state.links,
            state.status,
            targets,
            exact,
            budget,
            body.element_ends,
            body.share,
            active_set.most_rounds(body.contacts),
            ramp_memory,
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
        work, around, ramp_memory = scratch
        many.follow_many(
            body.ends,
            body.stiffness,
            (tuple(self.network.layout), self.network.conductances),
            work,
            around,
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
            active_set.most_rounds(body.contacts),
            ramp_memory,
            accounts,
            spent,
            records,
        )
