"""Ramps on patches of ground: from border to border with the event loops of chains and graphs, and jumps.

At a border the forward bound of a contact is that of the ground ahead, the backward bound that of the ground behind. A
contact that reaches a border forward with the spring force g, which is its forward bound,

* stands there, free, if the ground ahead holds more than g;
* goes on if it holds the same;
* else jumps: its bound falls from g to what the ground ahead holds, along a ramp in no time at fixed commands. That
  ramp is followed like any other, with the part of the bound that the ground does not give as an extra load, whose work
  is the energy lost. Further borders on the way are further events.

Lowering a forward bound moves contacts forward only, as the forces of springs on a contact grow with the displacements
of the others; so the end of a jump is the least displacement at which all bounds hold. Where no equilibrium is left,
all contacts are at their forward bounds, and the body slides as a whole to the next border of one of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...body.ground import Track
from ...errors import CommandError
from ...rounding import CRITICAL, EPS, SHORTEST_STRETCH
from ..borders import move_all
from ..jump import Jump
from ..state import (
    ACTUATION,
    AMBIGUOUS,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    DISSIPATION,
    FORWARD,
    GAIN_LEAST,
    GAIN_MOST,
    GAINED,
    LOAD,
    LOAD_WORK,
    LOADS_WORK,
    OVERSPENT,
    RESIDUAL,
    UNSOLVED,
    VISITED,
    X_REST,
    X,
)
from .line import LineMotion
from .state import GroundState

_BLOCK = 64
"""Ramps that are followed in one call. After a border the bounds of those that are left are computed again."""
_SAME = 16.0 * EPS
"""Bounds closer than this, relative to their size, are equal."""
_MOST_STOPS = 1000
"""Borders met by each contact in one ramp, on average, beyond which the rest of the ramp passes over them."""
_DOUBTS = [AMBIGUOUS, GAIN_LEAST, GAIN_MOST]


@dataclass
class _Fall:
    """A jump in progress: direction, border, displacement there, energy lost so far."""

    way: int
    border: float
    x: float
    loss: float = 0.0


class Walk:
    """Ramps in progress."""

    def __init__(
        self,
        line: LineMotion,
        track: Track,
        state: GroundState,
        scratch: tuple[Any, ...],
        budget: int,
        account: np.ndarray,
    ) -> None:
        """Begin at a state.

        Args:
            line: the motion between borders.
            track: the ground.
            state: changed in place.
            scratch: memory of `line`.
            budget: upper limit of work between two borders.
            account: shape (14,), added to.
        """
        self._line, self._track, self._state, self._scratch = line, track, state, scratch
        self._budget, self._account = budget, account
        self._springs, self._n = state.links.shape[1], state.status.size
        self._reached = np.zeros(self._n, np.int8)
        self._falls: dict[int, _Fall] = {}
        self._jumps: list[Jump] = []
        self._no_records = np.empty((0, 2 * self._n + self._springs))
        self._slid = 0.0
        self._at = (0, 0.0)
        self._stops = 0

    def follow(self, targets: np.ndarray, records: np.ndarray) -> tuple[Jump, ...]:
        """Follow ramps to each of the targets in turn.

        Args:
            targets: for ground without patches, shape (V, S + 2 N), with loads (V, S + 3 N).
            records: output, as for `Motion.follow`.

        Returns:
            The jumps.

        Raises:
            CommandError: if the body reaches ground on which no equilibrium is left; the state has to be restored.
        """
        state, account = self._state, self._account
        state.contacts[GAINED] = 0.0
        begin = state.command.copy()
        ramp, done = 0, 0.0
        while ramp < targets.shape[0]:
            rows = targets[ramp : ramp + (_BLOCK if done == 0.0 else 1)]
            doubts = account[_DOUBTS]
            count, part = self._advance(self._here(rows), records[ramp : ramp + len(rows)])
            if 1.0 - done <= SHORTEST_STRETCH:  # what is left of a ramp is an instant
                account[_DOUBTS] = doubts
            if count:
                ramp, done, self._stops = ramp + count, 0.0, 0
                begin = targets[ramp - 1].copy()
            done += part * (1.0 - done)
            state.command[:] = begin
            if done > 0.0:
                state.command[:] = targets[ramp] if done == 1.0 else begin + done * (targets[ramp] - begin)
            self._at = (min(ramp, targets.shape[0] - 1), done if ramp < targets.shape[0] else 1.0)
            self._meet_borders()
            if self._falls:
                self._jump()
        if account[VISITED] == np.inf:
            self._follow(self._here(state.command[None])[:0], self._no_records)
        return tuple(self._jumps)

    def _here(self, targets: np.ndarray) -> np.ndarray:
        """Turn targets for ground without patches into those for the places of the contacts."""
        bounds = self._track.bounds(targets[:, self._springs :], self._state.place)
        return np.hstack((targets[:, : self._springs], *bounds))

    def _advance(self, targets: np.ndarray, records: np.ndarray) -> tuple[int, float]:
        """Follow ramps to the first border, which `_reached` then marks, or to where no equilibrium is left."""
        state, springs, n = self._state, self._springs, self._n
        self._slid = 0.0
        forward = targets[:, springs : springs + n]
        backward = targets[:, springs + n : springs + 2 * n]
        least = -1e-12 * (np.abs(forward) + np.abs(backward)).sum(axis=1)
        lost = np.flatnonzero((forward.sum(axis=1) < least) | (backward.sum(axis=1) < least))
        if not lost.size:
            return self._follow(targets, records)
        if lost[0] > 0:
            return self._follow(targets[: lost[0]], records[: lost[0]])
        way = 1 if forward[0].sum() < least[0] else -1
        goal = float((forward if way > 0 else backward)[0].sum())
        now = max(float(state.contacts[FORWARD if way > 0 else BACKWARD].sum()), 0.0)
        share = now / (now - goal)
        begin = np.concatenate((state.links[ACTUATION], *state.contacts[[FORWARD, BACKWARD, LOAD]]))
        _, part = self._follow((begin + share * (targets[0] - begin))[None], self._no_records)
        if self._reached.any():
            return 0, share * part
        self._slide(way, targets[0])
        return 0, share

    def _follow(self, targets: np.ndarray, records: np.ndarray) -> tuple[int, float]:
        """Follow ramps to the first border."""
        state, account = self._state, self._account
        self._reached[:] = 0
        state.contacts[LOAD_WORK] = 0.0
        limits = self._track.find_limits(self._line.body.position, state.place)
        self._stops += 1
        failed = account[OVERSPENT] + account[UNSOLVED]
        if self._stops > _MOST_STOPS * (self._n + 1):
            limits = np.array([[np.inf], [-np.inf], [0.0]]) + np.zeros(self._n)
            targets = targets[:1]
            account[OVERSPENT] += 1
        count, part = self._line.follow_to_border(
            state, self._scratch, targets, self._budget, account, records, limits, self._reached
        )
        if account[OVERSPENT] + account[UNSOLVED] > failed:
            self._place_anew()
        return count, part

    def _slide(self, way: int, target: np.ndarray) -> None:
        """Slide the whole body, with all contacts at their bounds, to the next border of one of them."""
        state, account = self._state, self._account
        limits = self._track.find_limits(self._line.body.position, state.place)
        x = state.contacts[X]
        gaps = (limits[0] - x if way > 0 else x - limits[1]) - way * state.contacts[X_REST]
        distance = float(gaps.min())
        if distance == np.inf:
            raise CommandError(self._runaway(way, target))
        distance = way * max(distance, 0.0)
        total = float(state.contacts[FORWARD if way > 0 else BACKWARD].sum()) * abs(distance)
        account[DISSIPATION] += total
        account[RESIDUAL] += total
        account[LOADS_WORK] += float(state.contacts[LOAD].sum()) * distance
        worked = state.contacts[LOAD_WORK].copy()
        move_all(state.contacts, distance)
        state.contacts[LOAD_WORK] = worked
        self._slid = distance
        none = state.contacts[FORWARD] + state.contacts[BACKWARD] == 0.0
        state.status[:] = np.where(none, AT_FORWARD | AT_BACKWARD, AT_FORWARD if way > 0 else AT_BACKWARD)
        near = limits[2] + 16.0 * EPS * np.abs(x)
        self._reached[:] = np.where(gaps <= abs(distance) + near, way, 0)
        if not self._falls and distance != 0.0:
            first = int(np.flatnonzero(self._reached)[0])
            border = self._track.borders[(state.place[first] + way) // 2 - (way < 0)]
            self._jumps.append(Jump(*self._at, first, float(border), distance, 0.0))

    def _runaway(self, way: int, target: np.ndarray) -> str:
        """Say which sums do not fit on the ground where the body would end."""
        n = self._n
        forward, backward, load = target[self._springs :].reshape(3, n)
        if self._falls:  # the row of loads holds the extra loads of the jump
            load = self._track.bounds(self._state.command[self._springs :], self._state.place)[2]
        total = float(load.sum())
        friction = float(forward.sum()) + total if way > 0 else float(backward.sum()) - total
        side = "forward" if way > 0 else "backward"
        return (
            f"ground.patches: on the ground that the contacts reach, the loads sum to {way * total:g} N {side}, but "
            f"friction against sliding {side} to {friction:g} N: no equilibrium, the body would run away"
        )

    # -- borders ----------------------------------------------------------------------------------------------------

    def _meet_borders(self) -> None:
        """Let every contact that has reached a border stand on it, go on or jump."""
        for contact in np.flatnonzero(self._reached):
            self._meet_border(int(contact), int(self._reached[contact]))
        self._reached[:] = 0

    def _meet_border(self, i: int, way: int) -> None:
        """Let contact i, sliding in direction `way`, stand, go on or jump at the border that it has reached."""
        state = self._state
        x = state.contacts[X, i]
        row, bit = (FORWARD, AT_FORWARD) if way > 0 else (BACKWARD, AT_BACKWARD)
        if state.place[i] % 2 == 1:
            self._enter(i, state.place[i] + way, bit if self._is_at_bound(i, way) else 0)
            return
        fall = self._falls.pop(i, None)
        if fall is not None:
            self._close(i, fall)
        now = state.contacts[row, i]
        bounds = self._bounds_of(i, state.place[i] + 2 * way)
        new = bounds[0 if way > 0 else 1]
        near = _SAME * (abs(state.contacts[FORWARD, i]) + abs(state.contacts[BACKWARD, i]) + abs(new))
        if new > now + near or not self._is_at_bound(i, way):
            self._enter(i, state.place[i] + way, 0)
            state.status[i] &= ~bit
            return
        border = self._track.borders[(state.place[i] + way) // 2]
        self._enter(i, state.place[i] + 2 * way, bit)
        if new < now - near:
            state.contacts[row, i] = now
            state.status[i] = bit
            self._falls[i] = _Fall(way, float(border), float(x))

    def _is_at_bound(self, i: int, way: int) -> bool:
        """Check that contact i is at the bound of its motion; else its motion is rounding.

        Where all contacts are at their bounds within rounding, those that have yet to arrive slide, too.
        """
        state = self._state
        if state.status[i] & (AT_FORWARD if way > 0 else AT_BACKWARD):
            return True
        forward, backward = state.contacts[[FORWARD, BACKWARD], i]
        force = float(self._line.body.spring_force(state.tension)[i])
        distance = forward - force if way > 0 else backward + force
        return bool(abs(distance) <= 100.0 * CRITICAL * (abs(forward) + abs(backward)))

    def _bounds_of(self, i: int, place: int) -> tuple[float, float, float]:
        """Compute the bounds and the load of contact i at a place."""
        found = self._track.bounds(self._state.command[self._springs :], np.array([place]), np.array([i]))
        return float(found[0][0]), float(found[1][0]), float(found[2][0])

    def _enter(self, i: int, place: int, bit: int) -> None:
        """Put contact i onto a place, at the bound of its motion unless `bit` is 0."""
        state = self._state
        state.place[i] = place
        forward, backward, load = self._bounds_of(i, place)
        state.contacts[FORWARD, i], state.contacts[BACKWARD, i], state.contacts[LOAD, i] = forward, backward, load
        if bit:
            state.status[i] = AT_FORWARD | AT_BACKWARD if forward + backward == 0.0 else bit

    def _place_anew(self) -> None:
        """Find the places of contacts again after a step that passed over borders; those that are not held jump."""
        state, body = self._state, self._line.body
        x = state.contacts[X]
        limits = self._track.find_limits(body.position, state.place)
        near = 2.0 * limits[2] + 16.0 * EPS * np.abs(x)
        beyond = np.flatnonzero((x > limits[0] + near) | (x < limits[1] - near))
        places = self._track.find_places(body.position, x)
        force = body.spring_force(state.tension)
        for i in beyond.tolist():
            way = 1 if x[i] > limits[0, i] else -1
            self._falls.pop(i, None)
            self._enter(i, int(places[i]), 0)
            row, bit = (FORWARD, AT_FORWARD) if way > 0 else (BACKWARD, AT_BACKWARD)
            state.status[i] = 0
            if way * force[i] > state.contacts[row, i]:
                state.contacts[row, i] = way * force[i]
                state.status[i] = bit
                border = limits[0 if way > 0 else 1, i] + body.position[i]
                self._falls[i] = _Fall(way, float(border), float(x[i]))
        if beyond.size:
            self._reached[:] = 0

    # -- jumps ------------------------------------------------------------------------------------------------------

    def _jump(self) -> None:
        """Follow the falling bounds of all jumps in progress, at fixed commands, to their end."""
        state, account = self._state, self._account
        before = account[[*_DOUBTS, VISITED]]
        while self._falls:
            target = self._falling()
            loads = self._here(state.command[None])[0, -self._n :]
            x, rest = state.contacts[X].copy(), state.contacts[X_REST].copy()
            worked = account[LOADS_WORK]
            falls = dict(self._falls)
            count, _ = self._advance(target[None], self._no_records)
            work = state.contacts[LOAD_WORK] + state.contacts[LOAD] * self._slid
            for i, fall in falls.items():
                loss = max(-float(work[i]), 0.0)
                fall.loss += loss
                account[DISSIPATION] -= loss
            moved = (state.contacts[X] - x) + (state.contacts[X_REST] - rest)
            account[LOADS_WORK] = worked + float(loads @ moved)
            self._meet_borders()
            for i, fall in falls.items() if count else ():
                if self._falls.get(i) is fall:
                    self._close(i, self._falls.pop(i))
        self._settle(before)

    def _falling(self) -> np.ndarray:
        """Set the extra loads of the jumps in progress, what the ground does not give of their bounds; end at 0."""
        state, springs, n = self._state, self._springs, self._n
        target = self._here(state.command[None])[0]
        target[:springs] = state.links[ACTUATION]
        target[-n:] = 0.0
        state.contacts[LOAD] = 0.0
        for i, fall in self._falls.items():
            row, first = (FORWARD, springs) if fall.way > 0 else (BACKWARD, springs + n)
            state.contacts[LOAD, i] = -fall.way * max(float(state.contacts[row, i] - target[first + i]), 0.0)
        return target

    def _close(self, i: int, fall: _Fall) -> None:
        """Enter a jump in the results."""
        distance = float(self._state.contacts[X, i]) - fall.x
        self._jumps.append(Jump(*self._at, i, fall.border, distance, fall.loss))

    def _settle(self, before: np.ndarray) -> None:
        """Put the bounds and loads of the ground into force after a jump; on its way nothing counts as undetermined."""
        state, account = self._state, self._account
        here = self._track.bounds(state.command[self._springs :], state.place)
        state.contacts[FORWARD], state.contacts[BACKWARD], state.contacts[LOAD] = here
        none = (here[0] + here[1] == 0.0) & (state.status != 0)
        state.status[none] = AT_FORWARD | AT_BACKWARD
        account[[*_DOUBTS, VISITED]] = before
        margin = state.visited_margin(self._line.body.spring_force(state.tension))
        account[VISITED] = min(before[-1], margin)
