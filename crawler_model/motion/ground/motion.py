"""The motion of a chain or a graph on patches of ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...body.ground import Track
from ..borders import FOLLOWED, Patches, room_for_jumps, room_for_meetings
from ..jump import Jump, read_jumps
from ..line_state import build_line_state
from .line import LineMotion
from .state import GroundState, build_ground_state
from .walk import Walk


@dataclass(frozen=True, eq=False)
class GroundMotion:
    """A chain or a graph on patches of ground, followed from event to event; borders are events.

    Attributes:
        line: the motion between borders.
        track: the ground.
    """

    methods: ClassVar[tuple[str, ...]] = ("exact",)
    line: LineMotion
    track: Track

    @property
    def samples_margin(self) -> bool:
        """Whether an exact ramp samples its visited margin only at its ends."""
        return self.line.samples_margin

    def start(self, x: np.ndarray, target: np.ndarray) -> GroundState:
        """Build the state at rest, see `Motion`; a contact within rounding of a border stands on it."""
        body = self.line.body
        place = self.track.find_places(body.position, x)
        here = np.concatenate((target[: body.springs], *self.track.bounds(target[body.springs :], place)))
        state = build_line_state(body, x, here)
        return build_ground_state(state, place, target)

    def scratch(self) -> tuple[Any, ...]:
        """Allocate the working memory of a ramp, see `Motion`."""
        n = self.line.body.contacts
        return self.line.scratch(), np.zeros(n, np.int8), room_for_meetings(n), room_for_jumps(n)

    def follow(
        self,
        state: GroundState,
        scratch: tuple[Any, ...],
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
    ) -> tuple[Jump, ...]:
        """Follow straight ramps to each of the targets in turn, see `Motion`."""
        line_scratch, reached, meetings, jumps = scratch
        body, kept = self.line.body, state.memory.copy()
        state.gained.fill(0.0)
        if state.ground is None:
            state.ground = self.track.find_ground(body.position, state.place)
        ground, stretches = state.ground, self.track.stretches
        patches = Patches(ground, reached, True, state.place, body.position, stretches, state.command, meetings, jumps)
        try:
            jumps[0] = 0.0
            found = self.line.follow_to_border(state, line_scratch, targets, budget, account, records, patches)
            if found != (targets.shape[0], 0.0, FOLLOWED):
                walk = Walk(self.line, self.track, state, line_scratch, budget, account, patches)
                return walk.follow(targets, records, found)
        except BaseException:
            state.restore(kept)
            reached.fill(0)
            raise
        if targets.shape[0]:
            state.command[:] = targets[-1]
        return read_jumps(jumps, 0, 0.0)
