"""Ramps on patches of ground: from border to border with the event loops of chains and graphs, and jumps.

At a border the forward bound of a contact is that of the ground ahead, the backward bound that of the ground behind. A
contact that reaches a border forward with the spring force g, which is its forward bound,

* stands there, free, if the ground ahead holds more than g;
* goes on if it holds the same;
* otherwise jumps: at fixed commands and without duration, its bound falls from g to what the ground ahead holds. The
  fall is followed like any other ramp; the part of the bound that the ground does not provide is an extra load, whose
  work is the energy lost. Borders that are met during the fall are further events.

The event loop of a chain does all this itself (`motion.chain.patches.crossing`), except for the cases that it leaves to
this file.

Lowering a forward bound moves contacts forward only, as the forces of springs on a contact grow with the displacements
of the others; so the end of a jump is the least displacement at which all bounds hold. Where no equilibrium is left,
all contacts are at their forward bounds, and the body slides as a whole to the next border of one of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...body.ground import Track
from ...body.places import AHEAD, BEHIND, ROUNDING_OF_PLACE, keep_borders, put_on_ground, survey
from ...errors import CommandError
from ...rounding import CRITICAL, EPS, SHORTEST_STRETCH
from ..borders import COUNT, FOLLOWED, PASSED, SAME, Patches, move_all
from ..jump import Jump, read_jumps
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
    LOAD,
    LOAD_WORK,
    LOADS_WORK,
    OVERSPENT,
    RESIDUAL,
    VISITED,
    X_REST,
    X,
)
from .line import LineMotion
from .state import GroundState

_MOST_STOPS = 1000
"""Average number of borders per contact in one ramp beyond which the rest of the ramp passes over borders."""
_UNDETERMINED = [AMBIGUOUS, GAIN_LEAST, GAIN_MOST]


@dataclass
class _Fall:
    """A jump in progress: direction, border, displacement there, energy lost so far."""

    direction: int
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
        patches: Patches,
    ) -> None:
        """Begin where ramps have been followed to a first stop at a border.

        Args:
            line: the motion between borders.
            track: the ground.
            state: changed in place.
            scratch: memory of `line`.
            budget: upper limit of work between two stops at borders.
            account: shape (14,), added to.
            patches: the ground, with the contacts that are at that border.
        """
        self._line, self._track, self._state, self._scratch = line, track, state, scratch
        self._budget, self._account = budget, account
        self._springs, self._n = state.links.shape[1], state.status.size
        self._patches, self._reached = patches, patches.reached
        self._falls: dict[int, _Fall] = {}
        self._jumps: list[Jump] = []
        self._no_records = np.empty((0, 2 * self._n + self._springs))
        self._slid = 0.0
        self._at = (0, 0.0)
        self._stops = 0
        self._read_jumps(0, 0.0)

    def follow(self, targets: np.ndarray, records: np.ndarray, found: tuple[int, float, int]) -> tuple[Jump, ...]:
        """Follow ramps to each of the targets in turn.

        Args:
            targets: for ground without patches, shape (V, S + 2 N), with loads (V, S + 3 N).
            records: output, as for `Motion.follow`.
            found: how far they have been followed, as returned by `LineMotion.follow_to_border`.

        Returns:
            The jumps.

        Raises:
            CommandError: if the body reaches ground on which no equilibrium is left; the state has to be restored.
        """
        state, account = self._state, self._account
        begin, undetermined = state.command.copy(), account[_UNDETERMINED]
        ramp, done = 0, 0.0
        rows = targets
        while True:
            count, part = self._settle_end(rows[0], self._ground, found)
            if 1.0 - done <= SHORTEST_STRETCH:  # what is left of a ramp is an instant
                account[_UNDETERMINED] = undetermined
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
            if ramp == targets.shape[0]:
                return tuple(self._jumps)
            rows = targets[ramp:] if done == 0.0 else targets[ramp : ramp + 1]
            undetermined = account[_UNDETERMINED]
            self._patches.jumps[0] = 0.0
            found = self._follow(rows, records[ramp:][: len(rows)], self._ground, True)
            self._read_jumps(ramp, done)

    def _read_jumps(self, ramp: int, done: float) -> None:
        """Read the jumps of a chain within a ramp, those that have ended and those that have not."""
        rows = self._patches.jumps
        self._jumps += read_jumps(rows, ramp, done)
        for _, _, contact, border, x, loss, direction in rows[1 : 1 + int(rows[0, COUNT])].tolist():
            if direction:
                self._falls[int(contact)] = _Fall(int(direction), border, x, loss)

    @property
    def _ground(self) -> np.ndarray:
        """The ground at the places of the contacts."""
        return self._patches.ground

    def _here(self, target: np.ndarray) -> np.ndarray:
        """Turn a target for ground without patches into that for the places of the contacts."""
        here = np.empty(self._springs + 3 * self._n)
        put_on_ground(target, self._springs, self._ground, here)
        return here

    def _settle_end(self, target: np.ndarray, ground: np.ndarray, found: tuple[int, float, int]) -> tuple[int, float]:
        """Complete what the compiled loops leave: places after a step, and ramps to where nothing holds the body.

        Args:
            target: the target of the first of the ramps that were followed.
            ground: on which they were.
            found: how far they were.

        Returns:
            The number of targets reached, and the part of the next ramp that was followed.
        """
        count, part, ending = found
        self._slid = 0.0
        if ending == PASSED:
            self._place_anew()
        if ending in (FOLLOWED, PASSED) or count > 0:
            return count, part
        return 0, self._follow_while_held(target, ground, ending)

    def _follow_while_held(self, target: np.ndarray, ground: np.ndarray, direction: int) -> float:
        """Follow a ramp to where nothing holds the body in a direction, and slide on; return the part followed."""
        state, springs, n = self._state, self._springs, self._n
        end = np.empty(springs + 3 * n)
        put_on_ground(target, springs, ground, end)
        row, first = (FORWARD, springs) if direction > 0 else (BACKWARD, springs + n)
        goal = float(end[first : first + n].sum())
        now = max(float(state.contacts[row].sum()), 0.0)
        share = now / (now - goal)
        begin = np.concatenate((state.links[ACTUATION], *state.contacts[[FORWARD, BACKWARD, LOAD]]))
        _, part, _ = self._follow((begin + share * (end - begin))[None], self._no_records, keep_borders(ground), False)
        if self._reached.any():
            return share * part
        self._slide(direction, end)
        return share

    def _follow(
        self, targets: np.ndarray, records: np.ndarray, ground: np.ndarray, crosses: bool
    ) -> tuple[int, float, int]:
        """Follow ramps to the first border, or to the first one that contacts do not cross."""
        state, account = self._state, self._account
        self._reached[:] = 0
        state.contacts[LOAD_WORK] = 0.0
        self._stops += 1
        spent = self._stops > _MOST_STOPS * (self._n + 1)
        if spent:
            ground = ground.copy()
            ground[AHEAD], ground[BEHIND], ground[ROUNDING_OF_PLACE] = np.inf, -np.inf, 0.0
            targets = targets[:1]
            account[OVERSPENT] += 1
        patches = self._patches._replace(ground=ground, crosses=crosses and not spent)
        count, part, ending = self._line.follow_to_border(
            state, self._scratch, targets, self._budget, account, records, patches
        )
        return count, part, PASSED if spent and ending == FOLLOWED else ending

    def _slide(self, direction: int, target: np.ndarray) -> None:
        """Slide the whole body, with all contacts at their bounds, to the next border of one of them."""
        state, account = self._state, self._account
        ground = self._ground
        x = state.contacts[X]
        gaps = (ground[AHEAD] - x if direction > 0 else x - ground[BEHIND]) - direction * state.contacts[X_REST]
        distance = float(gaps.min())
        if distance == np.inf:
            raise CommandError(self._runaway(direction, target))
        distance = direction * max(distance, 0.0)
        total = float(state.contacts[FORWARD if direction > 0 else BACKWARD].sum()) * abs(distance)
        account[DISSIPATION] += total
        account[RESIDUAL] += total
        account[LOADS_WORK] += float(state.contacts[LOAD].sum()) * distance
        worked = state.contacts[LOAD_WORK].copy()
        move_all(state.contacts, distance)
        state.contacts[LOAD_WORK] = worked
        self._slid = distance
        none = state.contacts[FORWARD] + state.contacts[BACKWARD] == 0.0
        state.status[:] = np.where(none, AT_FORWARD | AT_BACKWARD, AT_FORWARD if direction > 0 else AT_BACKWARD)
        near = ground[ROUNDING_OF_PLACE] + 16.0 * EPS * np.abs(x)
        self._reached[:] = np.where(gaps <= abs(distance) + near, direction, 0)
        if not self._falls and distance != 0.0:
            first = int(np.flatnonzero(self._reached)[0])
            border = self._track.borders[(state.place[first] + direction) // 2 - (direction < 0)]
            self._jumps.append(Jump(*self._at, first, float(border), distance, 0.0))

    def _runaway(self, direction: int, target: np.ndarray) -> str:
        """Build the message with the sums that do not fit on the ground where the body would end."""
        n = self._n
        forward, backward, load = target[self._springs :].reshape(3, n)
        if self._falls:  # the row of loads holds the extra loads of the jump
            load = self._track.bounds(self._state.command[self._springs :], self._state.place)[2]
        total = float(load.sum())
        friction = float(forward.sum()) + total if direction > 0 else float(backward.sum()) - total
        side = "forward" if direction > 0 else "backward"
        return (
            f"ground.patches: on the ground that the contacts reach, the loads sum to {direction * total:g} N {side}, "
            f"but friction against sliding {side} to {friction:g} N: no equilibrium, the body would run away"
        )

    # -- borders ----------------------------------------------------------------------------------------------------

    def _meet_borders(self) -> None:
        """Let every contact that has reached a border stand on it, go on or jump."""
        for contact in np.flatnonzero(self._reached):
            self._meet_border(int(contact), int(self._reached[contact]))
        self._reached[:] = 0

    def _meet_border(self, i: int, direction: int) -> None:
        """Let contact i, sliding in `direction`, stand, go on or jump at the border that it has reached."""
        state = self._state
        x = state.contacts[X, i]
        row, bit = (FORWARD, AT_FORWARD) if direction > 0 else (BACKWARD, AT_BACKWARD)
        if state.place[i] % 2 == 1:
            self._enter(i, state.place[i] + direction, bit if self._is_at_bound(i, direction) else 0)
            return
        fall = self._falls.pop(i, None)
        if fall is not None:
            self._close(i, fall)
        now = state.contacts[row, i]
        bounds = self._bounds_of(i, state.place[i] + 2 * direction)
        new = bounds[0 if direction > 0 else 1]
        near = SAME * (abs(state.contacts[FORWARD, i]) + abs(state.contacts[BACKWARD, i]) + abs(new))
        if new > now + near or not self._is_at_bound(i, direction):
            self._enter(i, state.place[i] + direction, 0)
            state.status[i] &= ~bit
            return
        border = self._track.borders[(state.place[i] + direction) // 2]
        self._enter(i, state.place[i] + 2 * direction, bit)
        if new < now - near:
            state.contacts[row, i] = now
            state.status[i] = bit
            self._falls[i] = _Fall(direction, float(border), float(x))

    def _is_at_bound(self, i: int, direction: int) -> bool:
        """Check that contact i is at the bound of its motion; else its motion is rounding.

        Where all contacts are at their bounds within rounding, those that have yet to arrive slide, too.
        """
        state = self._state
        if state.status[i] & (AT_FORWARD if direction > 0 else AT_BACKWARD):
            return True
        forward, backward = state.contacts[[FORWARD, BACKWARD], i]
        force = float(self._line.body.spring_force(state.tension)[i])
        distance = forward - force if direction > 0 else backward + force
        return bool(abs(distance) <= 100.0 * CRITICAL * (abs(forward) + abs(backward)))

    def _bounds_of(self, i: int, place: int) -> tuple[float, float, float]:
        """Compute the bounds and the load of contact i at a place."""
        return self._track.bounds_at(i, self._state.command[self._springs :], place)

    def _enter(self, i: int, place: int, bit: int) -> None:
        """Put contact i onto a place, at the bound of its motion unless `bit` is 0."""
        state = self._state
        state.place[i] = place
        survey(self._track.stretches, self._line.body.position[i], place, i, self._ground, i)
        forward, backward, load = self._bounds_of(i, place)
        state.contacts[FORWARD, i], state.contacts[BACKWARD, i], state.contacts[LOAD, i] = forward, backward, load
        if bit:
            state.status[i] = AT_FORWARD | AT_BACKWARD if forward + backward == 0.0 else bit

    def _place_anew(self) -> None:
        """Find the places of contacts again after a step that passed over borders; those that are not held jump."""
        state, body = self._state, self._line.body
        x = state.contacts[X]
        ground = self._ground.copy()
        near = 2.0 * ground[ROUNDING_OF_PLACE] + 16.0 * EPS * np.abs(x)
        beyond = np.flatnonzero((x > ground[AHEAD] + near) | (x < ground[BEHIND] - near))
        places = self._track.find_places(body.position, x)
        force = body.spring_force(state.tension)
        for i in beyond.tolist():
            direction = 1 if x[i] > ground[AHEAD, i] else -1
            self._falls.pop(i, None)
            self._enter(i, int(places[i]), 0)
            row, bit = (FORWARD, AT_FORWARD) if direction > 0 else (BACKWARD, AT_BACKWARD)
            state.status[i] = 0
            if direction * force[i] > state.contacts[row, i]:
                state.contacts[row, i] = direction * force[i]
                state.status[i] = bit
                border = ground[AHEAD if direction > 0 else BEHIND, i] + body.position[i]
                self._falls[i] = _Fall(direction, float(border), float(x[i]))
        if beyond.size:
            self._reached[:] = 0

    # -- jumps ------------------------------------------------------------------------------------------------------

    def _jump(self) -> None:
        """Follow the falling bounds of all jumps in progress, at fixed commands, to their end."""
        state, account = self._state, self._account
        before = account[[*_UNDETERMINED, VISITED]]
        while self._falls:
            target = self._falling()
            loads = self._here(state.command)[-self._n :]
            x, rest = state.contacts[X].copy(), state.contacts[X_REST].copy()
            worked = account[LOADS_WORK]
            falls = dict(self._falls)
            ground = keep_borders(self._ground)
            count, _ = self._settle_end(target, ground, self._follow(target[None], self._no_records, ground, False))
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
        """Set the extra loads of jumps: the parts of bounds that the ground does not provide; return their end."""
        state, springs, n = self._state, self._springs, self._n
        target = self._here(state.command)
        target[:springs] = state.links[ACTUATION]
        target[-n:] = 0.0
        state.contacts[LOAD] = 0.0
        for i, fall in self._falls.items():
            row, first = (FORWARD, springs) if fall.direction > 0 else (BACKWARD, springs + n)
            state.contacts[LOAD, i] = -fall.direction * max(float(state.contacts[row, i] - target[first + i]), 0.0)
        return target

    def _close(self, i: int, fall: _Fall) -> None:
        """Append a jump to the results."""
        distance = float(self._state.contacts[X, i]) - fall.x
        self._jumps.append(Jump(*self._at, i, fall.border, distance, fall.loss))

    def _settle(self, before: np.ndarray) -> None:
        """Set the bounds and loads of the ground after a jump, during which nothing counts as undetermined."""
        state, account = self._state, self._account
        here = self._track.bounds(state.command[self._springs :], state.place)
        state.contacts[FORWARD], state.contacts[BACKWARD], state.contacts[LOAD] = here
        none = (here[0] + here[1] == 0.0) & (state.status != 0)
        state.status[none] = AT_FORWARD | AT_BACKWARD
        account[[*_UNDETERMINED, VISITED]] = before
        margin = state.visited_margin(self._line.body.spring_force(state.tension))
        account[VISITED] = min(before[-1], margin)
