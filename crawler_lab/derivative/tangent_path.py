"""The path of a crawler along its drive, with the derivatives of positions and work."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.drive import NS, Drive
from crawler_model.body.plan import Plan
from crawler_model.crawler.budget import default_budget
from crawler_model.errors import CommandError
from crawler_model.motion.account import OVERSPENT, UNSOLVED, empty_account
from crawler_model.motion.follow import build_motion
from crawler_model.motion.line.build_records import build_curves
from crawler_model.motion.line.records import zeros
from crawler_model.motion.line.springs.records import Curves
from crawler_model.motion.pieces import FROM, HEADER, PIECES_A_RAMP, RAMP, UNTIL, follow_pieces
from crawler_model.run.repeats import determining_tension

from .elimination import build_band
from .parameters import Derivatives
from .records import CONTACT, PARAMETER, PIECE, SPRING, Commands, Course, Derivative, System
from .tangent import follow_tangent

_MOST_NUMBERS = 4_000_000
_SLIDE = 1e-9
"""A larger part of the size of displacements that no piece of the path contains is a slide at once."""
_KINKS = 4096
"""Kinks that are listed for one call; more are counted only."""


@dataclass(frozen=True)
class Vertices:
    """Ends of ramps along a drive.

    Attributes:
        time_ns: when each is reached, shape (V,) [ns].
        before: the waypoint before each, shape (V,).
        after: the waypoint after each, the same one for a waypoint, shape (V,).
        part: where between them it is, shape (V,).
        d_part: derivatives of that place at a fixed time, shape (V, P).
        d_time: derivatives of the time of a waypoint, shape (V, P); zero for other vertices [s].
        targets: shape (V, F).
    """

    time_ns: np.ndarray
    before: np.ndarray
    after: np.ndarray
    part: np.ndarray
    d_part: np.ndarray
    d_time: np.ndarray
    targets: np.ndarray


def build_vertices(drive: Drive, derivatives: Derivatives, after_ns: int, tick_ns: np.ndarray) -> Vertices:
    """Find the ends of the ramps of some ticks: the ticks' ends and the waypoints within them.

    Args:
        drive: the drive.
        derivatives: of its arrays.
        after_ns: start of the first tick [ns].
        tick_ns: ends of the ticks, shape (T,) [ns].

    Returns:
        The vertices, in order.
    """
    time_ns, targets, waypoints, _ = drive.ramps_between(after_ns, tick_ns)
    known, rows, at, to, part = drive.locate(time_ns)
    on = to == at
    on[waypoints] = True
    to, part = np.where(on, at, to), np.where(on, 0.0, part)
    gap = np.maximum(known[to] - known[at], 1)
    d_known = derivatives.times[rows]
    if drive.period is not None:
        number = np.rint((known / NS - drive.times[rows]) / drive.period)
        d_known = d_known + number[:, None] * derivatives.period
    d_gap = d_known[to] - d_known[at]
    d_part = -np.where(on[:, None], 0.0, (d_known[at] + part[:, None] * d_gap) * (NS / gap)[:, None])
    d_time = np.zeros(d_part.shape)
    d_time[waypoints] = d_known[at[waypoints]]
    return Vertices(time_ns, rows[at], rows[to], part, d_part, d_time, targets)


@dataclass(frozen=True)
class Stretch:
    """What a path did along some vertices.

    Attributes:
        x: displacement at each vertex, without the rounding rest, shape (V, N) [m].
        rest: that rest, shape (V, N) [m].
        work: work of the actuators in each ramp, shape (V,) [J].
        dx: derivatives of x, taken at the moving waypoint where there is one, shape (V, N, P).
        d_work: derivatives of `work`, shape (V, P).
        speed: velocity at the end of each ramp, shape (V, N) [m per ramp].
    """

    x: np.ndarray
    rest: np.ndarray
    work: np.ndarray
    dx: np.ndarray
    d_work: np.ndarray
    speed: np.ndarray


def _build_system(body: Body, parameters: int) -> System:
    """Build the records of a body whose motion has not begun."""
    contacts, springs = zeros(body.contacts, CONTACT), zeros(body.springs, SPRING)
    contacts["share"] = body.share
    springs["a"], springs["b"] = body.ends.T
    springs["stiffness"] = springs["command"] = springs["scale"] = body.stiffness
    springs["bend"] = -1
    springs["bend"][[bend.spring for bend in body.bends]] = np.arange(len(body.bends))
    curves = build_curves(body)
    beside = np.full((body.contacts, 2), -1)
    for side in (0, 1):
        beside[body.element_ends[:, 1 - side], side] = np.arange(body.element_ends.shape[0])
    ends = body.ends.ravel()
    return System(
        contacts,
        springs,
        zeros(parameters, PARAMETER),
        body.element_ends,
        beside,
        np.concatenate(([0], np.cumsum(np.bincount(ends, minlength=body.contacts)))),
        np.argsort(ends, kind="stable") // 2,
        build_band(body, springs),
        np.empty((body.contacts, 2)),
        np.empty((body.contacts, 2)),
        np.zeros((_KINKS, 3)),
        Curves(*curves) if curves else None,
    )


class TangentPath:
    """A path in progress, with the derivatives of its state."""

    def __init__(self, plan: Plan, derivatives: Derivatives, samples: bool = False) -> None:
        """Begin at the start of a plan.

        Args:
            plan: a body on a line, on ground that is the same everywhere.
            derivatives: of its arrays.
            samples: whether the displacement at every vertex is a result, whose kinks count even if the path goes on
                without one.
        """
        body, drive = plan.body, plan.drive
        self._plan = plan
        self._motion: Any = build_motion(plan)
        x = plan.start_displacement
        self._state = self._motion.start(x, drive.targets[0])
        self._scratch = self._motion.scratch()
        columns = len(derivatives.names)
        self._system = _build_system(body, columns)
        self._system.parameters["one_sided"][: derivatives.jumps.size] = derivatives.jumps
        self._course = (np.array(drive.targets, order="C"), np.ascontiguousarray(derivatives.targets))
        dx, shape = derivatives.start.copy(), derivatives.stiffness.shape
        memory = np.empty(dx.shape), np.empty(dx.shape)
        d_tension = np.empty(shape)
        d_pull = np.empty(shape) if body.bends else d_tension
        self._derivative = Derivative(
            derivatives.stiffness, derivatives.pieces, dx, *memory, d_tension, np.empty(shape), d_pull
        )
        start, d_start = drive.targets[0].copy(), derivatives.targets[0].copy()
        rows, d_rows = np.empty((2, *start.shape)), np.empty((2, *d_start.shape))
        self._commands = Commands(start, rows[0], rows[1], d_start, d_rows[0], d_rows[1])
        self._piece = zeros(1, PIECE)
        self.one_sided = self._system.parameters["one_sided"]
        self.kinks: list[tuple[int, float, int]] = []
        self._ramps, self._samples = 0, samples
        self.hides = False
        """Whether a segment has slid next to an end, while contacts rested, within an element: how far is not known."""
        self._friction = 0
        """Which derivatives friction has, as a number of `_find_steady`; -1 between waypoints where they change."""

    @property
    def dx(self) -> np.ndarray:
        """Derivatives of the displacement, shape (N, P)."""
        return self._derivative.dx.copy()

    @property
    def state(self) -> np.ndarray:
        """Tensions from which the motion under given commands follows, see `run.repeats`, shape (S,) [N]."""
        return determining_tension(self._plan.body, self._state)

    @property
    def between(self) -> bool:
        """Whether the point of a segment at rest has been exactly between two cells."""
        return bool(self._piece["between"][0])

    def follow_vertices(self, vertices: Vertices) -> Stretch:
        """Follow ramps to each vertex in turn.

        Args:
            vertices: their ends.

        Returns:
            Displacements and work at the vertices, with their derivatives.

        Raises:
            CommandError: if a ramp has too many events to be followed, or contacts slide at once.
        """
        n = self._plan.body.contacts
        most = max(1, _MOST_NUMBERS // (PIECES_A_RAMP * (HEADER + 2 * n)))
        most = min(most, max(1, _MOST_NUMBERS // max(self._derivative.dx.size, 1)))
        steady = self._find_steady(vertices)
        ends = np.append(np.flatnonzero(np.diff(steady)) + 1, steady.size)
        found = [
            self._follow_rows(vertices, slice(i, min(i + most, end)), bool(steady[i]))
            for begin, end in zip(np.append(0, ends[:-1]), ends, strict=True)
            for i in range(begin, end, most)
        ]
        names = ("x", "rest", "work", "dx", "d_work", "speed")
        return Stretch(*(np.concatenate([getattr(part, name) for part in found]) for name in names))

    def _find_steady(self, vertices: Vertices) -> np.ndarray:
        """Find the ramps whose events note only what they change, see `starts`, bool, shape (V,).

        The body has segments and linear springs, and friction and its derivatives do not change on these ramps.
        """
        body, count, first = self._plan.body, vertices.time_ns.size, self._plan.body.springs
        if not body.element_ends.size or body.bends:
            return np.zeros(count, np.bool_)
        friction, n = slice(first, first + 2 * body.contacts), body.contacts
        bounds = np.vstack((self._commands.start, vertices.targets))[:, friction]
        rows, d_rows = (course[:, friction] for course in self._course)
        number = np.zeros(len(d_rows), np.int64)  # the same for waypoints with the same derivatives of friction
        number[1:] = np.cumsum((d_rows[1:] != d_rows[:-1]).any(axis=(1, 2)))
        number[(d_rows == d_rows[0]).all(axis=(1, 2))] = 0
        at, to = vertices.before, vertices.after
        alike = (number[at] == number[to]) & (rows[at] == rows[to]).all(axis=1)
        reached = np.append(self._friction, np.where(alike, number[at], -1))
        self._friction = int(reached[-1])
        held = (bounds[:-1, :n] + bounds[:-1, n:] > 0.0).all(axis=1)
        same = (bounds[1:] == bounds[:-1]).all(axis=1) & (reached[1:] == reached[:-1]) & (reached[1:] >= 0)
        return np.asarray(same & held)

    def _follow_rows(self, vertices: Vertices, rows: slice, steady: bool) -> Stretch:
        n, springs = self._plan.body.contacts, self._plan.body.springs
        targets = vertices.targets[rows]
        count = targets.shape[0]
        records = np.empty((count, 2 * n + springs))
        contacts, begin_tension = self._state.contacts, np.array(self._state.tension)
        begin_x = contacts["x"] + contacts["residue"]
        pieces = self._find_pieces(targets, records, steady)
        tensions = np.vstack((begin_tension[None], records[:-1, 2 * n :]))
        elongations = self._find_elongations(np.vstack((begin_x[None], records[:, :n] + records[:, n : 2 * n])), pieces)
        columns = self._derivative.dx.shape[1]
        dx, d_work = np.empty((count, n, columns)), np.empty((count, columns))
        work, speed = np.empty(count), np.empty((count, n))
        part = (vertices.before[rows], vertices.after[rows], vertices.part[rows])
        d_part = np.ascontiguousarray(vertices.d_part[rows])
        course = Course(*self._course, *part, d_part, targets, tensions, elongations, pieces)
        self._system.kinks[0, 0] = 0.0
        output = dx, work, d_work, speed
        follow_tangent(self._system, self._derivative, self._commands, course, self._piece, output, self._samples)
        waypoint = vertices.before[rows] == vertices.after[rows]
        self.hides |= self._divides_an_end(speed[waypoint] != 0.0)
        found = self._system.kinks[1 : 1 + int(self._system.kinks[0, 0])]
        self.kinks += [(self._ramps + int(ramp), float(place), int(contact)) for ramp, place, contact in found]
        self._ramps += count
        return Stretch(records[:, :n], records[:, n : 2 * n], work, dx, d_work, speed)

    def _divides_an_end(self, moves: np.ndarray) -> bool:
        """Determine from which contacts move, shape (V, N), whether only one contact of an end of a segment does."""
        ends = self._plan.body.element_ends
        alone = ends.shape[0] == moves.shape[1] - 1  # then the point at rest is known, see `standing`
        lonely = (np.bincount(ends.ravel(), minlength=moves.shape[1]) == 1)[ends].any(axis=1)
        still = (~moves).sum(axis=1) > alone
        return bool((still[:, None] & lonely & (moves[:, ends[:, 0]] != moves[:, ends[:, 1]])).any())

    def _find_elongations(self, x: np.ndarray, pieces: np.ndarray) -> np.ndarray:
        """Find the elongations of bent springs at the start of each ramp, (V, B) [m]; they must be continuous."""
        body = self._plan.body
        bent = [bend.spring for bend in body.bends]
        if bent:
            n = body.contacts
            way = np.zeros((x.shape[0] - 1, n))
            length = (pieces[:, UNTIL] - pieces[:, FROM])[:, None]
            np.add.at(way, pieces[:, RAMP].astype(np.int64), pieces[:, HEADER : HEADER + n] * length)
            missed = np.abs(np.diff(x, axis=0) - way).max(axis=1)
            slid = np.flatnonzero(missed > _SLIDE * (np.abs(x).max() + np.abs(way).max()))
            if slid.size:
                raise CommandError(
                    f"in ramp {self._ramps + int(slid[0])} contacts that no spring holds slide at once, by "
                    f"{missed[slid[0]]:.3g} m, until a spring pulls; no derivative exists"
                )
        ends = body.ends[bent]
        return np.ascontiguousarray(x[:-1, ends[:, 1]] - x[:-1, ends[:, 0]])

    def _find_pieces(self, targets: np.ndarray, records: np.ndarray, steady: bool) -> np.ndarray:
        """Follow ramps and note their pieces, or only the changes of contacts."""
        account = empty_account()
        budget = default_budget(self._plan.body)
        pieces = follow_pieces(self._motion, self._state, self._scratch, targets, budget, account, records, steady)
        failed = int(account[OVERSPENT] + account[UNSOLVED])
        if failed:
            raise CommandError(f"{failed} ramp(s) have too many events to be followed exactly; no derivative exists")
        return pieces
