"""Borders of regions of the ground: a ramp is followed from one border to the next.

Where a point comes to ground with less friction, it slides at once: its friction falls from one value to the other at
fixed commands, and the others follow in equilibrium. What this releases beyond the friction of the new ground is lost.
Where it comes to ground with more friction, it stands on the border: forces that point ahead must overcome the friction
ahead, forces that point back the friction behind, as on a line. A point that would slide along the border, neither
ahead nor back, is held by the friction ahead, and the motion counts as not unique.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...body.regions import Regions
from ...errors import CommandError
from ..account import AMBIGUOUS, DISSIPATION
from ..jump import Jump
from .frame import friction_columns
from .friction import find_slip, resist_all
from .state import PlanarState

_BEYOND = 0.01
"""A point has come to a border if it is beyond by at most this part of the tolerance."""
_SHORTEST = 1e-13
"""A part of a way within which a body crosses a border by a jump."""
_MOST = 100
"""Upper limit of borders that a body crosses in a ramp, per point."""
_MOST_TRIALS = 200
"""Upper limit of parts of a ramp that are tried to come to a border."""


@dataclass
class Crossing:
    """A body that crosses borders in a ramp.

    Attributes:
        follow: follows a straight ramp to a command, a number of parts at a time; yields the place after these, and a
            jump.
        regions: of the ground.
        touching: the points that touch the ground, shape (M,).
        tolerance: largest error of a ramp [m].
        state: changed in place.
        ramp: number of the ramp.
        account: shape (15,), added to.
    """

    follow: Callable[..., Iterator[tuple[float, Jump | None]]]
    regions: Regions
    touching: np.ndarray
    tolerance: float
    state: PlanarState
    ramp: int
    account: np.ndarray

    def __post_init__(self) -> None:
        """Begin before the first border."""
        self._jumps: list[Jump] = []
        self._left: dict[int, np.ndarray] = {}  # where points came to ground with less friction in this ramp

    def follow_ramp(self, target: np.ndarray) -> list[Jump]:
        """Follow the ramp from border to border, and the falls behind each.

        Args:
            target: the commands at the end of the ramp, as `PlanarState.command` outside all regions.

        Returns:
            The jumps.

        Raises:
            CommandError: where the body cannot follow, or crosses too many borders.
        """
        state, friction = self.state, friction_columns(self.state.frame)
        begin = state.command.copy()
        begin[friction] = state.asked
        place = 0.0
        for _ in range(_MOST * len(self.touching)):
            goal = target.copy()
            goal[friction] *= self._factors()
            crossed, fraction, jumps = self._follow_to_border(goal)
            rest = 1.0 - place
            self._jumps += [dataclasses.replace(jump, fraction=place + jump.fraction * rest) for jump in jumps]
            place = 1.0 if fraction == 1.0 else place + fraction * rest
            self._change_ground(crossed, (begin + place * (target - begin))[friction], place)
            if place == 1.0:
                return self._jumps
        raise CommandError(
            f"command: on the way, points cross more than {_MOST} borders of ground.regions each; shorter ramps help"
        )

    def _factors(self) -> np.ndarray:
        """Return the factor on each column of friction."""
        return np.repeat(self.regions.factors[self.state.region], self.state.held.shape[1])

    def _change_ground(self, crossed: dict[int, int], asked: np.ndarray, place: float) -> None:
        """Give points the friction of the ground that they have come to, and let them fall where it is less.

        Args:
            crossed: the regions that points have come to.
            asked: the friction commanded.
            place: the place on the ramp.
        """
        state = self.state
        x, changed, fallers, lost = state.x.copy(), set[int](), list[int](), 0.0
        while crossed:
            self._enter(crossed)
            changed |= crossed.keys()
            after, points = state.copy(), sorted(changed)
            after.held[points] = (asked * self._factors()).reshape(state.held.shape)[points]
            falls = [i for i in points if (after.held[i] < state.held[i]).any()]
            fallers = fallers or falls
            if len(falls) > 1:
                self.account[AMBIGUOUS] = 1.0
            if not falls:
                state.command[:] = after.command
                break
            crossed, loss = self._fall(after.command, place)
            lost += loss
        moved = np.hypot(*(state.x - x).T)
        first = max(fallers, key=moved.__getitem__, default=0)
        if fallers and moved[first] > self.tolerance:
            self._jumps.append(Jump(self.ramp, float(place), first, None, float(moved[first]), lost))

    def _enter(self, crossed: dict[int, int]) -> None:
        """Note the regions that points have come to, and those that they stand on the borders of."""
        state, factors, tolerance = self.state, self.regions.factors, self.tolerance
        for i, region in crossed.items():
            behind, at = int(state.region[i]), state.displacement[i]
            state.region[i] = state.behind[i] = region
            if factors[behind] >= factors[region]:
                self._left[i] = at
            elif i in self._left and np.hypot(*(at - self._left[i])) <= tolerance:
                self.account[AMBIGUOUS] = 1.0  # it slides along the border
            else:
                state.behind[i] = behind

    def _fall(self, goal: np.ndarray, place: float) -> tuple[dict[int, int], float]:
        """Let friction fall at fixed commands; return the points that come to further borders, and the energy lost."""
        state, x, stored = self.state, self.state.x.copy(), _stored(self.state)
        crossed, _, jumps = self._follow_to_border(goal)
        self._jumps += [dataclasses.replace(jump, fraction=float(place)) for jump in jumps]
        moved = state.x - x
        released = stored - _stored(state) + (float((state.loads * moved).sum()) if state.loads.size else 0.0)
        kept = resist_all(state.frame, goal, state.x, moved) + sum(jump.loss for jump in jumps)
        loss = max(released - kept, 0.0)
        self.account[DISSIPATION] -= loss
        return crossed, loss

    def _follow_to_border(self, goal: np.ndarray) -> tuple[dict[int, int], float, list[Jump]]:
        """Follow a ramp until points come to borders; return their new regions, the part of the ramp, and jumps."""
        begin = self.state.command.copy()
        jumps: list[Jump] = []
        before, low = self._save(), 0.0
        for place, jump in self.follow(goal, 1.0):
            found = [] if jump is None else [jump]
            crossed, _, _ = self._compare(before[0])
            if crossed:
                break
            self._leave_borders(before[0])
            before, low = self._save(), place
            jumps += found
        else:
            return {}, 1.0, jumps
        after, high = self._save(), place
        for k in range(_MOST_TRIALS):
            crossed, first, beyond = self._compare(before[0])
            if beyond <= _BEYOND * self.tolerance or high - low <= _SHORTEST:
                break
            fraction = low + (0.5 if k % 3 == 2 else first) * (high - low)
            self._restore(before)
            row = begin + fraction * (goal - begin)
            trial = [j for _, j in self.follow(row) if j is not None]
            if self._compare(before[0])[0]:
                after, high, found = self._save(), fraction, trial
            else:
                self._leave_borders(before[0])
                before, low = self._save(), fraction
                jumps += trial
            self._restore(after)
        share = [dataclasses.replace(jump, fraction=high) for jump in (*jumps, *found)]
        return crossed, high, share

    def _compare(self, before: PlanarState) -> tuple[dict[int, int], float, float]:
        """Find the points that have crossed borders since a state, on straight ways, or leave a border backwards.

        Returns:
            Their new regions; an estimate of the part after which the first one does, and a little beyond; how far they
            are beyond at most [m].
        """
        state, regions, allowed = self.state, self.regions, _BEYOND * self.tolerance
        start, end = (self.state.frame.position + s.displacement for s in (before, state))
        crossed, first, farthest = {}, 1.0, 0.0
        clear = regions.keep_clear(before.region, start, end)
        for i in self.touching[~clear[self.touching]].tolist():
            fraction, region = regions.cross(int(before.region[i]), start[i], end[i])
            if fraction < 1.0:
                length = float(np.hypot(*(end[i] - start[i])))
                crossed[i] = region
                first = min(first, fraction + 0.5 * allowed / length)
                farthest = max(farthest, (1.0 - fraction) * length)
        for i in np.flatnonzero(state.behind != state.region).tolist():
            if i in crossed or np.hypot(*(end[i] - start[i])) > allowed:
                continue
            excess = self._excess_behind(state, i)
            if excess > 0.0:
                crossed[i] = int(state.behind[i])
                lacked = max(-self._excess_behind(before, i), 0.0)
                first = min(first, (lacked + 0.5 * allowed) / (lacked + excess))
                farthest = max(farthest, excess)
        return crossed, first, farthest

    def _leave_borders(self, before: PlanarState) -> None:
        """Let points that have slid on from their borders since a state stand on them no longer."""
        slid = np.hypot(*(self.state.x - before.x).T) > _BEYOND * self.tolerance
        self.state.behind[slid] = self.state.region[slid]

    def _excess_behind(self, state: PlanarState, i: int) -> float:
        """Compute by how much the force on a point exceeds the friction behind a border, as a length [m].

        Of an excess, the part across the border counts: it is negative where the point would slide along it, or ahead.
        """
        frame, regions, region, behind = state.frame, self.regions, int(state.region[i]), int(state.behind[i])
        with_less, slip = state.copy(), np.empty_like(state.x)
        with_less.held[i] *= regions.factors[behind] / regions.factors[region]
        force = state.force
        balanced = force + state.loads if state.loads.size else force
        without = not with_less.held[i].any()
        excess = np.hypot(*balanced[i]) if without else -with_less.margins(force)[i]
        if excess > 0.0:
            find_slip(frame, with_less.command, state.x, balanced, slip)
            across = slip[i] @ regions.normal(frame.position[i] + state.displacement[i], region, behind)
            excess *= across / np.hypot(*slip[i])
        return float(excess / frame.grip[i])

    def _save(self) -> tuple[PlanarState, np.ndarray]:
        return self.state.copy(), self.account.copy()

    def _restore(self, saved: tuple[PlanarState, np.ndarray]) -> None:
        vars(self.state).update(vars(saved[0].copy()))
        self.account[:] = saved[1]


def _stored(state: PlanarState) -> float:
    """Compute the energy of links and joints [J]."""
    return float((0.5 * state.tension.ravel() ** 2 / state.frame.stiffness).sum())
