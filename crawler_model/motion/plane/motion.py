"""The motion of a body in the plane."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...body.body import Body
from ...body.plan import Plan
from ...body.regions import Regions
from ...body.turning import TURNING_TOLERANCE, measure_angles
from ...errors import CommandError
from ..account import ACCOUNT_SIZE, AMBIGUOUS, DISSIPATION, LOADS_WORK, OVERSPENT, RESIDUAL, SPENT, VISITED, WORK
from ..jump import Jump
from .borders import Crossing
from .elastic import balances
from .frame import Frame, build_frame, friction_columns
from .friction import resist_all
from .jump import COLLAPSED, jump
from .ramp import LENGTH, MARGIN, PATIENCE, PLACE, begin_ramp, complete_ramp, follow_ramp
from .state import PlanarState
from .translation import is_held

_SHARE = 0.1
"""Part of the tolerance available to the parts of a ramp, as later parts may amplify errors of earlier ones."""

DEFAULT_TOLERANCE = 1e-4
"""Default error of a ramp of vector springs, relative to its change of length."""
_ROUNDING = 1e-13
"""Least tolerance, relative to the size of the body."""
_AHEAD = 1e-6
"""Part of a ramp by which commands go on where the body jumps."""
_NEARER, _CONTINUOUS = 16.0, 8.0
"""Commands that go on by a part so much shorter move a body that slides on by so much less at least; one that buckles
moves by the square root of that."""
_PRECISE = 0.01
"""Energies of a body that moves on balance to this part of the tolerance times friction, as it may do so often."""
_AHEAD_MORE = 4.0
"""Factor for that part where the body has just landed, and divisor where it jumps with more than the least part."""
_COMPASS = np.radians(np.arange(360.0))
"""Directions in which a body may run away, from the x axis [rad]."""
_HARDLY_HELD = 0.01
"""A body that no equilibrium was found for runs away if its loads are within this part of what friction holds."""
_HELP = "a larger tolerance or budget, or shorter ramps, help"
_COMPLETION = 10_000
"""Upper limit of the work of the step that completes a ramp, per point."""


@dataclass(frozen=True, eq=False)
class PlaneMotion:
    """A body in the plane, followed by extrapolated implicit steps, to a tolerance.

    Attributes:
        body: the body.
        frame: its arrays.
        tolerance: largest error of a ramp [m].
        regions: of the ground; None if it is the same everywhere.
    """

    methods: ClassVar[tuple[str, ...]] = ("catch_up",)
    samples_margin: ClassVar[bool] = True
    body: Body
    frame: Frame
    tolerance: float
    regions: Regions | None = None

    @functools.cached_property
    def unit(self) -> float:
        """The least power of 2 that is not shorter than the body [m]."""
        return float(2.0 ** np.ceil(np.log2(np.ptp(self.frame.position, axis=0).max() or 1.0)))

    def start(self, x: np.ndarray, target: np.ndarray) -> PlanarState:
        """Build the state at rest, see `Motion`."""
        x, command = np.array(x, np.float64, order="C"), self.expand(np.array(target, np.float64)[None])[0]
        turns = not self.frame.vector
        yaw = measure_angles(self.frame.position + x, self.frame.heading[None]) if turns else np.zeros(1)
        region = behind = np.full(self.body.contacts, -1)
        if self.regions is not None:
            region, behind = self.regions.find(self.frame.position + x)
        arrays = np.zeros(2), x, np.zeros_like(x), command, command[friction_columns(self.frame)].copy(), region, behind
        state = PlanarState(self.frame, *arrays, yaw, np.full(1, np.inf))
        if self.regions is not None:
            state.held[:] *= self.regions.factors[region, None]
        state.recentre(self.unit)
        return state

    def expand(self, targets: np.ndarray) -> np.ndarray:
        """Repeat the friction of each disc for its four sides: kernels know only quarter ellipses.

        Args:
            targets: rows as in `Columns.target`, or derivatives of such rows, shape (V, F, ...).

        Returns:
            The rows of `PlanarState.command`, shape (V, C, ...).
        """
        discs = self.body.contacts if self.frame.vector and self.frame.directions.size == 0 else 0
        return np.take(targets, _columns_of(targets.shape[1], self.frame.rest.size, discs), axis=1)

    def scratch(self) -> tuple[np.ndarray, tuple[Any, ...]]:
        """Allocate the velocities with which a ramp begins, and a frame that counts its own work, see `Motion`."""
        frame = self.frame._replace(effort=np.zeros(2))
        return np.zeros((self.body.contacts, 2)), tuple(frame)  # passed to kernels in half the time of the frame

    def follow(
        self,
        state: PlanarState,
        scratch: tuple[np.ndarray, tuple[Any, ...]],
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
    ) -> tuple[Jump, ...]:
        """Follow straight ramps to each of the targets in turn, see `Motion`; `exact` has no effect."""
        moving = state.copy()  # it may have nowhere to go
        moving.gained[:] = 0.0
        moving.stability[:] = np.inf
        n, parts = self.body.contacts, self.frame.rest.size
        jumps: list[Jump] = []
        for v, target in enumerate(self.expand(targets)):
            follow = functools.partial(self._follow_ramp, moving, scratch, v, budget, account)
            if self.regions is None:
                jumps += [jump for _, jump in follow(target) if jump is not None]
            else:
                touching = np.flatnonzero(self.body.share != 0.0)
                crossing = Crossing(follow, self.regions, touching, self.tolerance, moving, v, account)
                jumps += crossing.follow_ramp(target)
            moving.asked[:] = target[friction_columns(self.frame)]
            if records.shape[0]:
                x = moving.displacement
                records[v, : 2 * n] = x.ravel()
                records[v, 2 * n : 4 * n] = (moving.x - (x - moving.origin)).ravel()
                records[v, 4 * n : 4 * n + parts] = moving.tension.ravel()
                if records.shape[1] > 4 * n + parts:
                    lost = account[DISSIPATION] + account[LOADS_WORK]
                    records[v, -SPENT:] = 0.0, 0.0, account[WORK], lost, account[LOADS_WORK]
        moving.recentre(self.unit)
        vars(state).update(vars(moving))
        if account[VISITED] == np.inf:  # no command changed
            account[VISITED] = state.visited_margin(state.force)
        return tuple(jumps)

    def _follow_ramp(
        self,
        state: PlanarState,
        scratch: tuple[np.ndarray, tuple[Any, ...]],
        ramp: int,
        budget: int,
        account: np.ndarray,
        target: np.ndarray,
        parts: float = np.inf,
    ) -> Iterator[tuple[float, Jump | None]]:
        """Follow one ramp through its jumps, so many parts of it at once.

        Yields the place on the ramp after these, or at a jump or the end, 0 to 1; and the jump, if it was one.
        """
        velocity, fields = scratch
        frame, arrays = Frame(*fields), (state.x, state.gained, state.command, state.turned)
        progress = begin_ramp(self.tolerance, state.stability[0])
        frame.effort[:] = 0.0, budget
        velocity[:] = 0.0
        ahead, landed, strayed = _AHEAD, -1.0, False
        while progress[PLACE] < 1.0:
            progress[PATIENCE] = parts
            jump: Jump | None = None
            if not follow_ramp(fields, arrays, target, self.tolerance, velocity, account, progress):
                place, found = float(progress[PLACE]), None
                if self.body.turning is not None and frame.effort[0] <= frame.effort[1]:
                    ahead = _AHEAD_MORE * ahead if place <= landed else _AHEAD
                    way = ramp, place, ahead
                    ahead, found, jumps = self._move_on(state, frame, target, velocity, way, account)
                before = strayed
                if found is not None:
                    progress[PLACE] = landed = found.fraction
                    progress[LENGTH] = ahead
                    jump = found if jumps else None
                    strayed = strayed or (not jumps and found.distance > self.tolerance)
                    velocity[:] = 0.0
                elif frame.effort[0] <= frame.effort[1]:
                    raise CommandError(self._explain(state, target, place))
                else:
                    jump = self._complete(state, fields, target, velocity, ramp, account, progress)
                    progress[PLACE], strayed = 1.0, True
                account[OVERSPENT] += strayed - before
            state.stability[0] = progress[MARGIN]
            yield float(progress[PLACE]), jump

    def _move_on(
        self,
        state: PlanarState,
        frame: Frame,
        target: np.ndarray,
        velocity: np.ndarray,
        way: tuple[int, float, float],
        account: np.ndarray,
    ) -> tuple[float, Jump | None, bool]:
        """Move a body that turns on by a part of a ramp where no part of it can be followed.

        What is not stored, dissipated or done by loads is lost: the body has jumped, if that is so with the least part
        of the ramp. With longer parts it may be their error, so these are shortened.

        Args:
            way: number of the ramp, the place, and by which part of the ramp the body shall move on.

        Returns:
            The part by which it moved on; where that led, None if there is no equilibrium; whether it jumped.
        """
        ramp, place, ahead = way
        arrays = state.x, state.gained, state.command, state.turned
        before = [array.copy() for array in arrays]
        while True:
            own = np.zeros(ACCOUNT_SIZE)
            fraction = min(ahead / (1.0 - place), 1.0)
            found, contact, distance, loss = jump(frame, arrays, target, fraction, velocity, own)
            balanced = found and balances(frame, state.command, state.x, own, loss, _PRECISE * self.tolerance)
            if balanced or ahead <= _AHEAD:
                break
            ahead /= _AHEAD_MORE
            for array, value in zip(arrays, before, strict=True):
                array[:] = value
        if not found:
            return ahead, None, False
        far = distance > self.tolerance
        jumps = far and (not balanced or self._buckles(frame, before, target, fraction, velocity, distance))
        allowed = self.body.turning is not None and self.body.turning.jumps
        own[RESIDUAL] -= min(loss, 0.0) if jumps else loss
        if not jumps:
            held = not far or is_held(frame, state.command, state.x, state.x - before[0])
            account[AMBIGUOUS] = max(account[AMBIGUOUS], 0.0 if held else 1.0)
        elif not allowed:
            raise CommandError(
                f"command: at {100.0 * place:.4g} % of the ramp no stable equilibrium is left, and the scene "
                "has on_instability: refuse; jump lets the body move to another one"
            )
        account += own
        account[VISITED] = min(account[VISITED], state.visited_margin(state.force))
        end = 1.0 if fraction == 1.0 else place + ahead
        return ahead, Jump(ramp, end, int(contact), None, float(distance), float(max(loss, 0.0))), jumps

    def _buckles(
        self,
        frame: Frame,
        state: list[np.ndarray],
        target: np.ndarray,
        fraction: float,
        moved: np.ndarray,
        distance: float,
    ) -> bool:
        """Determine whether a body that moved by a distance with a part of a ramp, and lost no energy, has buckled."""
        found, _, nearer, _ = jump(frame, tuple(state), target, fraction / _NEARER, moved, np.zeros(ACCOUNT_SIZE))
        spent = frame.effort[0] > frame.effort[1]  # which decides nothing
        return not spent and (not found or distance < _CONTINUOUS * nearer)

    def _complete(
        self,
        state: PlanarState,
        fields: tuple[Any, ...],
        target: np.ndarray,
        velocity: np.ndarray,
        ramp: int,
        account: np.ndarray,
        progress: np.ndarray,
    ) -> Jump | None:
        """Complete a ramp whose budget is spent by one implicit step; a body that turns jumps to its end."""
        place = 100.0 * progress[PLACE]
        if self.body.turning is not None and not self.body.turning.jumps:
            raise CommandError(
                f"command: at {place:.4g} % of the ramp the budget of work is spent, and the scene has on_instability: "
                f"refuse, so that no long step may complete the ramp; {_HELP}"
            )
        frame, arrays = Frame(*fields), (state.x, state.gained, state.command, state.turned)
        frame.effort[:] = 0.0, _COMPLETION * self.body.contacts
        ended = None
        if self.body.turning is None:
            found = complete_ramp(fields, arrays, target, account, progress)
        else:
            found, contact, distance, loss = jump(frame, arrays, target, 1.0, velocity, account)
            account[RESIDUAL] -= min(loss, 0.0)
            account[VISITED] = min(account[VISITED], state.visited_margin(state.force))
            ended = Jump(ramp, 1.0, int(contact), None, float(distance), float(max(loss, 0.0)))
        if not found:
            raise CommandError(
                self._find_unheld_loads(state, target)
                or f"command: at {place:.4g} % of the ramp the budget of work is spent, and no equilibrium was found "
                f"at its end; {_HELP}"
            )
        return ended

    def _explain(self, state: PlanarState, target: np.ndarray, place: float) -> str:
        """Explain why a ramp to a target cannot be followed beyond a place."""
        if unheld := self._find_unheld_loads(state, target):
            return unheld
        why = "no equilibrium was found"
        if self.body.turning is None:
            why += " to the tolerance"
        else:
            lengths = self.frame.rest[: self.body.springs]
            for link in np.flatnonzero(state.shape[: self.body.springs] < (COLLAPSED - 1.0) * lengths)[:1]:
                why = f"link_{link} shrinks to a point, for want of a rest length > 0,"
        return f"command: {why} at {100.0 * place:.4g} % of the ramp"

    def _find_unheld_loads(self, state: PlanarState, target: np.ndarray) -> str:
        """Find a direction in which friction where the points stand does not hold the loads of a target.

        Returns:
            What is wrong; empty if it holds them.
        """
        if not state.loads.size:
            return ""
        total = target[friction_columns(self.frame).stop :].reshape(-1, 2).sum(axis=0)
        ways = np.stack((np.cos(_COMPASS), np.sin(_COMPASS)), axis=1)
        along = ways @ total
        held = np.array([resist_all(self.frame, target, state.x, np.tile(way, (state.x.shape[0], 1))) for way in ways])
        k = int(np.argmax(along - held))
        if along[k] <= (1.0 - _HARDLY_HELD) * held[k]:
            return ""
        return (
            f"command: the loads sum to [{total[0]:g}, {total[1]:g}] N, {along[k]:g} N at "
            f"{np.degrees(_COMPASS[k]):g} degrees, but friction where the points stand resists sliding in this "
            f"direction with {held[k]:g} N: no equilibrium, the body would run away"
        )


@functools.lru_cache
def _columns_of(width: int, first: int, discs: int) -> np.ndarray:
    """List the columns of a target, and the frictions of discs four times."""
    times = np.ones(width, np.int64)
    times[first : first + discs] = 4
    return np.repeat(np.arange(width), times)


def build_plane_motion(plan: Plan) -> PlaneMotion:
    """Build the motion of a plan; its tolerance is relative to the changes of length that its drive commands.

    Args:
        plan: the body, its drive and its tolerance.

    Returns:
        The motion.
    """
    frame = build_frame(plan.body, plan.directions)
    links, parts = frame.links, frame.rest.size
    change = np.abs(np.ptp(plan.drive.targets[:, :parts], axis=0))
    if frame.vector:
        size = float(change.max(initial=0.0)) or float(np.abs(np.ptp(frame.position, axis=0)).max())
        tolerance = _SHARE * (plan.tolerance or DEFAULT_TOLERANCE) * size
        return PlaneMotion(plan.body, frame, tolerance, plan.ground.regions)
    change[links:] *= frame.rest[:links].mean()
    size = float(change.max(initial=0.0)) or float(frame.rest[:links].max())
    least = _ROUNDING * float(np.abs(frame.position).max() + frame.rest[:links].sum())
    tolerance = max(_SHARE * (plan.tolerance or TURNING_TOLERANCE) * size, least)
    return PlaneMotion(plan.body, frame, tolerance, plan.ground.regions)
