"""The path of a body in the plane along its drive, with the derivatives of positions and work."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.drive import NS
from crawler_model.body.plan import Plan
from crawler_model.errors import CommandError
from crawler_model.motion.account import WORK, empty_account
from crawler_model.motion.plane.elastic import pull
from crawler_model.motion.plane.frame import Frame
from crawler_model.motion.plane.friction import measure_margins
from crawler_model.motion.plane.motion import build_plane_motion
from crawler_model.motion.plane.ramp import PATIENCE, PLACE, begin_ramp, follow_ramp, predict_first_slide
from crawler_model.motion.plane.walk import AT_ONCE
from crawler_model.run.account import tolerance_of
from crawler_model.run.screw import gain_in_frame, to_frame

from .parameters import Derivatives
from .plane_part import Course, differentiate_part
from .plane_step import Rates
from .tangent_path import Stretch, Vertices

_TOLERANCE = 1e-8
"""Tolerance of the path, relative to its largest change of length."""
_RESTS = 0.03
"""A point that moves by this part of the tolerance while a part of a ramp is followed has started at its end."""
_AT_BOUND = 4.0
"""A gap is zero if it opens by moving this many tolerances."""
_LONG = 1e-2
"""A point that rests at the boundary of its set over this part of a ramp does not just start or stop there."""
_SHORT = 1e-3
"""A part this much shorter than the one before has its velocities; in one this much shorter than the ramp a point goes
on that moves by more than this part of what its velocity suggests."""
_SHORT_OF = 1.0 - 1e-6
"""Derivatives are followed over this much of a part at whose end a force may reach a corner and be on two edges."""
_CROSSING = 1e-7
"""A part this short on the ramp only crosses an event. Its velocities mix both sides of the event, so it belongs to
the part before, and the event is passed behind it."""
_STEP = 1e-7
"""Step of the differences of gaps, relative to what changes with a parameter."""
_ROUNDING = 1e-12
"""Rounding errors of a gap, relative to the largest number of the command."""
_SAME = 1e-4
"""Derivatives that differ by no more than this part are taken to be equal when kinks are looked for."""


class _Part(NamedTuple):
    """A part of a ramp that was followed.

    Attributes:
        length: relative to the ramp [1].
        x: displacements at its start, shape (N, 2) [m].
        command: at its start, shape (C,).
        force: of links and joints at its start, shape (N, 2) [N].
        gap: from there to the edges of the polygons of friction forces, shape (N, m), or to the boundaries of the
            ellipses, shape (N, 1) [N].
        moved: displacement gained, shape (N, 2) [m].
        slides: points that slide; a point that starts at its very end does not, shape (N,).
        velocity: at its end, shape (N, 2) [m per part].
        slowing: by how much it decreases there, shape (N, 2) [m per part^2].
        rate: at which the derivatives of places change at its end, shape (N, 2, P) [per part].
    """

    length: float
    x: np.ndarray
    command: np.ndarray
    force: np.ndarray
    gap: np.ndarray
    moved: np.ndarray
    slides: np.ndarray
    velocity: np.ndarray
    slowing: np.ndarray
    rate: np.ndarray

    def continuing(self, last: _Part) -> _Part:
        """Build the same part with the velocities of the one before: what moves in a short one is a rounding error."""
        r = self.length / last.length
        velocity = r * (last.velocity - r * last.slowing)
        return self._replace(velocity=velocity, slowing=r * r * last.slowing, rate=r * last.rate)


class PlanePath:
    """A path in progress, with the derivatives of its state."""

    def __init__(self, plan: Plan, derivatives: Derivatives, coarser: float = 1.0) -> None:
        """Begin at the start of a plan.

        Args:
            plan: a body in the plane.
            derivatives: of its arrays.
            coarser: factor for the tolerance of the path.
        """
        drive = plan.drive
        motion = build_plane_motion(plan)
        self._plan = plan
        tolerance = motion.tolerance * min(1.0, _TOLERANCE / tolerance_of(plan)) * coarser
        self._motion = dataclasses.replace(motion, tolerance=tolerance)
        self._state = self._motion.start(plan.start_displacement, drive.targets[0])
        self._velocity, _ = self._motion.scratch()
        self._rates = Rates(derivatives.stiffness, derivatives.rest, derivatives.offset)
        turns = not motion.frame.vector  # the forces of vector springs do not depend on the reference positions
        self._d_position = derivatives.position if turns else np.zeros_like(derivatives.position)
        self._targets = drive.targets
        self._d_targets = derivatives.targets
        self._place = derivatives.start + self._d_position
        self._d_command = self._motion.expand(derivatives.targets[:1])[0]
        columns = len(derivatives.names)
        self.one_sided = np.zeros(columns, np.bool_)
        self.one_sided[: derivatives.jumps.size] = derivatives.jumps
        self.kinks: list[tuple[int, float, int]] = []
        self._rests = _RESTS * tolerance
        self._zero = _AT_BOUND * tolerance * motion.frame.grip
        self._rough = self._state.friction.reshape(plan.body.contacts, -1).max(axis=1) > 0.0
        self._ramps = 0

    @property
    def dx(self) -> np.ndarray:
        """Derivatives of the displacement, shape (N, 2, P)."""
        return self._place - self._d_position

    def follow_vertices(self, vertices: Vertices) -> Stretch:
        """Follow ramps to each vertex in turn.

        Args:
            vertices: their ends.

        Returns:
            Displacements and work at the vertices, with their derivatives.

        Raises:
            CommandError: if the body jumps, or a step has no solution.
        """
        count, n, columns = vertices.time_ns.size, self._plan.body.contacts, self._place.shape[2]
        x, work = np.empty((count, n, 2)), np.empty(count)
        dx, d_work = np.empty((count, n, 2, columns)), np.zeros((count, columns))
        speed = np.zeros((count, n, 2))
        for v in range(count):
            before, after, part = vertices.before[v], vertices.after[v], vertices.part[v]
            d_target = (1.0 - part) * self._d_targets[before] + part * self._d_targets[after]
            d_target += (self._targets[after] - self._targets[before])[:, None] * vertices.d_part[v]
            d_target = self._motion.expand(d_target[None])[0]
            begin = self._state.command.copy()
            target = self._motion.expand(vertices.targets[v : v + 1])[0]
            work[v] = self._follow_ramp(target, d_target, d_work[v], vertices.time_ns[v] / NS)
            x[v], dx[v] = self._state.displacement, self.dx
            if vertices.d_time[v].any():
                speed[v] = self._find_velocity(target - begin)
            self._ramps += 1
        return Stretch(x, np.zeros_like(x), work, dx, d_work, speed)

    def _follow_ramp(self, target: np.ndarray, d_target: np.ndarray, d_work: np.ndarray, until: float) -> float:
        """Follow a ramp, which ends at some time [s], part by part; return its work."""
        motion, state = self._motion, self._state
        fields = tuple(motion.frame)
        arrays = state.x, state.gained, state.command, state.turned
        progress = begin_ramp(motion.tolerance, math.inf)
        account = empty_account()
        self._velocity[:] = 0.0
        last: _Part | None = None
        while progress[PLACE] < 1.0:
            progress[PATIENCE] = 1.0
            place, x, command = progress[PLACE], state.x.copy(), state.command.copy()
            force = state.force
            gap = self._gaps(motion.frame, command, x)
            if not follow_ramp(fields, arrays, target, motion.tolerance, self._velocity, account, progress):
                if not motion.frame.vector:
                    raise CommandError(
                        f"sensitivities: before {until:g} s the body jumps, as no stable equilibrium is left; no "
                        "derivative exists from there on: choose a shorter duration"
                    )
                raise CommandError(f"sensitivities: before {until:g} s no step is accurate to the tolerance")
            length = progress[PLACE] - place
            part = 1.0 if progress[PLACE] == 1.0 else length / (1.0 - place)
            if last is not None and length < _CROSSING and part < 1.0:
                self._d_command = self._d_command + part * (d_target - self._d_command)
                continue
            moved, rate = state.x - x, np.empty_like(self._place)
            way = np.hypot(*moved.T)
            slides = way > self._rests
            if last is not None and length < _SHORT:
                expected = np.hypot(*last.velocity.T) * (length / last.length)
                slides |= (way > _SHORT * expected) & last.slides
            now = _Part(length, x, command, force, gap, moved, slides, np.empty_like(x), np.empty_like(x), rate)
            if last is not None:
                self._finish_stops(last, now)
                self._pass_event(last, now, (target - command) * (last.length / (1.0 - place)), place)
            short = _SHORT_OF if part < 1.0 and motion.frame.directions.size else 1.0
            course = Course(command, target, self._d_command, d_target, short * part)
            ways, tangent = (x, moved, now.velocity, now.slowing), (self._place, now.rate)
            solved, unique = differentiate_part(motion.frame, self._rates, course, ways, ~slides, tangent, d_work)
            if not solved:
                raise CommandError(f"sensitivities: before {until:g} s a step has no solution, and no derivative")
            self._d_command = self._d_command + part * (d_target - self._d_command)
            self._find_holds(now, progress[PLACE], bool(unique))
            if last is not None and now.length < _SHORT * last.length and (last.slides == slides).all():
                now = now.continuing(last)
            last = now
        self._d_command = d_target
        state.recentre(motion.unit)
        return float(account[WORK])

    def _finish_stops(self, last: _Part, now: _Part) -> None:
        """Carry the derivatives of points that come to rest from the end of the last part to where they do.

        There a point has no velocity, but before, its velocity depends on the parameters: over a remaining way e of
        which its displacement is of the order of e^2, its derivative changes by the order of e.
        """
        for i in np.flatnonzero(last.slides & ~now.slides):
            ahead = last.moved[i] / np.hypot(*last.moved[i])
            speed, slowing = float(ahead @ last.velocity[i]), float(ahead @ last.slowing[i])
            if 0.0 < speed**2 <= 2.0 * slowing * self._rests:
                self._place[i] += (speed / slowing) * last.rate[i]

    def _pass_event(self, last: _Part, now: _Part, change: np.ndarray, place: float) -> None:
        """Carry the derivatives to where the last part ends if a force has reached the boundary of its set there.

        All points go on as before until that happens, which depends on the parameters; then their velocities change,
        and some stop. `change` is the change of the command per part, and `place` where the last part ended on the
        ramp.
        """
        near = (now.gap <= self._zero[:, None]) & (last.slides | now.slides)[:, None]  # short parts may precede a start
        if not near[~last.slides].any() and (near.sum(axis=1) <= 1).all():
            return
        still = [np.zeros_like(part) for part in (*(rate[:, 0] for rate in self._rates), now.x)]
        closing = -self._slope((*still, change, last.velocity), now.command, now.x)
        reached = near & (closing > _SAME * np.abs(closing).max(initial=0.0))
        if not self._motion.frame.directions.size:
            reached &= ~last.slides[:, None]  # what slid already was at the boundary
        if not reached.any():
            return
        delays = np.array([self._slope(way, now.command, now.x)[reached] for way in self._ways()]) / closing[reached]
        apart = np.asarray(np.ptp(delays, axis=1) > _SAME * np.abs(delays).max(axis=1))
        if place > _SHORT_OF:  # at the end of the ramp, where displacements are asked for: whether it has moved yet
            apart |= delays.any(axis=1)
        self._note(apart, place, np.nonzero(reached)[0])
        self._place += last.velocity[:, :, None] * delays[:, 0]

    def _find_holds(self, now: _Part, place: float, unique: bool) -> None:
        """Find points that rest at the boundary of their sets, and whether only friction decides the translation.

        At the end of a ramp these are also points whose force has only just come there: they may move yet, or not.
        """
        state, zero = self._state, self._zero[:, None]
        stays = np.hypot(*(state.force - now.force).T) <= self._zero  # it may have crossed to another side of its set
        rests = (now.length >= _LONG) & (now.gap <= zero) & stays[:, None]
        comes = (place == 1.0) & (now.gap > zero)
        bound = self._gaps(self._motion.frame, state.command, state.x) <= zero
        holds = bound & (rests | comes) & (~now.slides & self._rough)[:, None]
        if holds.any():
            rates = np.array([self._slope(way, state.command, state.x)[holds] for way in self._ways()])
            self._note(np.asarray(rates.any(axis=1)), place, np.flatnonzero(holds.any(axis=1)))
        if not unique:
            affected = self._place.reshape(-1, self._place.shape[2]).any(axis=0)
            self._note(affected, place, range(state.x.shape[0]))

    def _note(self, affected: np.ndarray, place: float, points: Iterable[int]) -> None:
        if affected.any():
            self.one_sided |= affected
            self.kinks += [(self._ramps, float(place), int(point)) for point in points]

    @staticmethod
    def _gaps(frame: Frame, command: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Compute how far the force on each point is from the edges of its polygon, or from its ellipse [N]."""
        force, size, gap = np.empty_like(x), np.empty(x.shape[0]), np.empty(x.shape[0])
        pull(frame, command, x, force, size)
        if frame.directions.size:
            first, count = frame.stiffness.size, frame.directions.shape[0]
            edges = command[first : first + count * x.shape[0]].reshape(-1, count)
            return np.asarray(edges - force @ frame.directions.T)
        measure_margins(frame, command, x, force, gap)
        return gap[:, None]

    def _ways(self) -> Iterator[tuple[np.ndarray, ...]]:
        """Iterate over the derivatives of all that forces depend on, in the order of `_slope`."""
        for p in range(self._place.shape[2]):
            arrays = (*self._rates, self._d_position, self._d_command, self.dx)
            yield tuple(array[..., p] for array in arrays)

    def _slope(self, way: tuple[np.ndarray, ...], command: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Compute the slopes of the gaps along a way, by differences; 0 if rounding errors.

        The way has the changes of stiffnesses, rest lengths, axes, positions, the command and the displacements.
        """
        frame = self._motion.frame
        step = _STEP / max(max(float(np.abs(change).max(initial=0.0)) for change in way), 1e-300)
        gaps = []
        for sign in (step, -step):
            stiffness, rest, offset, position, d_command, d_x = (sign * change for change in way)
            moved = frame._replace(
                stiffness=frame.stiffness + stiffness,
                rest=frame.rest + rest,
                offset=frame.offset + offset,
                position=frame.position + position,
            )
            gaps.append(self._gaps(moved, command + d_command, x + d_x))
        apart = gaps[0] - gaps[1]
        return np.where(np.abs(apart) > _ROUNDING * command.max(), apart / (2.0 * step), 0.0)

    def _find_velocity(self, change: np.ndarray) -> np.ndarray:
        """Find the velocities with which the body would go on, shape (N, 2) [m per ramp]."""
        state, velocity = self._state, np.zeros_like(self._state.x)
        negligible, force = AT_ONCE * self._motion.tolerance, np.empty(velocity.shape)
        target = state.command + change
        predict_first_slide(self._motion.frame, state.x, state.command, target, negligible, velocity, force)
        return velocity


def differentiate_yaw(body: Body, x: np.ndarray, dx: np.ndarray, d_position: np.ndarray) -> np.ndarray:
    """Differentiate the yaw of a body in the plane.

    Args:
        body: the body.
        x: displacements, shape (T, N, 2) [m].
        dx: their derivatives, shape (T, N, 2, P).
        d_position: derivatives of the reference positions, shape (N, 2, P).

    Returns:
        Shape (T, P); 0 for a body that does not turn.
    """
    if body.turning is None:
        return np.zeros((dx.shape[0], dx.shape[-1]))
    a, b = body.turning.heading
    along = (body.position + x)[:, b] - (body.position + x)[:, a]
    moves = dx[:, b] - dx[:, a] + (d_position[b] - d_position[a])
    across = along[:, 0, None] * moves[:, 1] - along[:, 1, None] * moves[:, 0]
    return np.asarray(across / (along**2).sum(axis=1, keepdims=True))


def differentiate_gains(body: Body, x: np.ndarray, dx: np.ndarray, d_position: np.ndarray) -> np.ndarray:
    """Differentiate what a body that turns gains between some instants, as `run.screw.gain_in_frame` measures it.

    Args:
        body: the body.
        x: displacements at M instants, shape (M, N, 2) [m].
        dx: their derivatives, shape (M, N, 2, P).
        d_position: derivatives of the reference positions, shape (N, 2, P).

    Returns:
        Derivatives of dx, dy and dyaw, shape (M - 1, 3, P).
    """
    assert body.turning is not None
    d_yaw = differentiate_yaw(body, x, dx, d_position)
    heading = body.turning.heading
    gained = gain_in_frame(body, x[:-1], np.diff(x, axis=0), np.zeros(x.shape[0] - 1))
    d_gained = np.diff(dx[:, heading].mean(axis=1), axis=0)
    turned = to_frame(body, x[:-1], np.moveaxis(d_gained, 2, 1))
    d_along = turned[..., 0] + gained[:, 1, None] * d_yaw[:-1]
    d_across = turned[..., 1] - gained[:, 0, None] * d_yaw[:-1]
    return np.stack((d_along, d_across, np.diff(d_yaw, axis=0)), axis=1)
