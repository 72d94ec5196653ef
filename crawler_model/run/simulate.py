"""Offline runs of a scene: its drive at a fixed tick rate, with every waypoint at the end of a ramp."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from ..body.drive import NS, Drive
from ..body.plan import Plan, check_plan
from ..crawler.crawler import Crawler
from ..crawler.method import Method, choose_method
from ..crawler.step import Step
from ..errors import CommandError
from ..motion.account import SPENT
from ..theory.uniqueness import Undecided, commanded_margin
from .account import Energy, TickEnergies, Total, average_displacement
from .inertia import Inertia, start_meter
from .screw import follow_turning, gain_in_frame
from .ticks import DEFAULT_RATE, check_duration, count_ticks, rational_rate, tick_end_ns, tick_ends
from .trajectory import TimedJump, Trajectory
from .wall_pushes import find_pushes

_CHUNK = 4096
_MOST_SAMPLES = 100_000_000
_RETURNED = 1e-15
"""A net displacement below this part of the path length of a contact is rounding."""


def default_duration(drive: Drive) -> float:
    """Compute the default duration of a run: ten periods, or up to the last waypoint.

    Args:
        drive: the drive of the scene.

    Returns:
        Duration [s]; 0 for a scene without a drive.

    Raises:
        CommandError: if it is longer than any run.
    """
    seconds = float(drive.times[-1]) if drive.period is None else 10.0 * drive.period
    return check_duration(seconds)


def simulate(
    scene: Plan,
    duration: float | None = None,
    rate: float = DEFAULT_RATE,
    method: Method | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Run a scene's drive.

    A tick follows the drive linearly through the waypoints that it contains to its end, so that `exact` is exact at any
    rate.

    Args:
        scene: the scene to run.
        duration: duration [s]; None for ten periods, or up to the last waypoint.
        rate: ticks per second [Hz].
        method: "exact" or "catch_up"; None for the best one available: exact on a line.
        progress: called with the completed part, in [0, 1].

    Returns:
        The run, sampled at every tick and at every waypoint.

    Raises:
        CommandError: if duration, rate or method is out of range, or the body reaches ground on which nothing holds it,
            or loses its stability with `on_instability: refuse`.
        SceneError: if `scene` is not a scene.
    """
    began = time.perf_counter()
    check_plan(scene, "simulate")
    method = choose_method(scene, method)
    drive = scene.drive
    seconds = default_duration(drive) if duration is None else check_duration(duration)
    ratio = rational_rate(rate)
    end_ns = round(seconds * NS)
    ticks = count_ticks(end_ns, ratio)
    n = scene.body.contacts * scene.body.dimension
    for name, count in (("ticks", ticks), ("waypoints", _waypoints(drive, seconds))):
        if count * n > _MOST_SAMPLES:
            raise CommandError(
                f"{count:.0f} {name} of {n} contacts do not fit in memory; at most {_MOST_SAMPLES // n}: "
                "choose a shorter duration or a lower rate"
            )
    crawler = Crawler(scene, method)
    run = _Run(crawler, ticks)
    for first in range(0, ticks, _CHUNK):
        last = min(first + _CHUNK, ticks)
        run.run_ticks(drive, min(tick_end_ns(first, ratio), end_ns), tick_ends(first + 1, last, ratio, end_ns), first)
        if progress is not None:
            progress(last / ticks)
    return run.finish(rate, began)


def find_inertia(scene: Plan) -> Inertia | None:
    """Run the drive of a scene for its inertia number.

    Args:
        scene: the scene.

    Returns:
        The number; None for a scene without masses and weights, or without a drive.
    """
    return None if scene.ground.masses is None or scene.drive.holds else simulate(scene).inertia


def _waypoints(drive: Drive, seconds: float) -> float:
    return drive.times.size * (1.0 if drive.period is None else max(seconds / drive.period, 1.0))


def _directions(moved: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Compute the directions of contacts in ticks that begin with the ramps `first`; 0 for no net displacement."""
    gained, way = moved, np.abs(moved)
    if first.size < moved.shape[0]:  # some ticks have several ramps
        gained, way = np.add.reduceat(moved, first), np.add.reduceat(way, first)
    went = np.abs(gained) > _RETURNED * way
    return np.asarray(went.any(axis=2) if moved.ndim == 3 else np.where(went, np.sign(gained), 0.0))


class _Run:
    """The tables of a run in progress."""

    def __init__(self, crawler: Crawler, ticks: int) -> None:
        body = crawler.body
        self.crawler = crawler
        self.ticks = ticks
        self.time_ns = np.zeros(ticks + 1, np.int64)
        self.x = np.empty((ticks + 1, *body.position.shape))
        self.tension = np.empty((ticks + 1, *crawler.tension.shape))
        self.state = np.zeros((ticks + 1, body.contacts), np.int8)
        self.slid = np.zeros((2, body.contacts), np.bool_)
        self.x[0], self.tension[0] = crawler.displacement, crawler.tension
        self.waypoint_row: list[int] = [0]
        self.waypoint_x: list[np.ndarray] = [crawler.displacement]
        self.waypoint_rest: list[np.ndarray] = [np.zeros(body.position.shape)]
        self.last = (crawler.displacement, np.zeros(body.position.shape))
        self.total = Total(crawler.visited_margin)
        self.stored = np.zeros(ticks + 1)
        self.stored[0] = self.energy_of(crawler)
        self.peak = abs(self.stored[0])
        self.jumps: list[TimedJump] = []
        start = crawler.scene.drive.targets[:1]
        self.wall_push = find_pushes(crawler.scene, np.zeros(1), self.x[:1], self.tension[:1], start)
        self.spent = np.zeros((ticks + 1, SPENT - 1))
        self.jump_loss = np.zeros(ticks + 1)
        self.yaw = np.full(ticks + 1, crawler.yaw)
        self.waypoint_yaw: list[float] = [crawler.yaw]
        self.stability: tuple[float, float] | None = None
        self.inertia = start_meter(crawler.scene)

    @staticmethod
    def energy_of(crawler: Crawler) -> float:
        """Compute the energy stored in the springs of a crawler [J]."""
        return crawler.stored

    def run_ticks(self, drive: Drive, after_ns: int, tick_ns: np.ndarray, first: int) -> None:
        """Run the ticks that end at `tick_ns`; the first one, number `first`, starts at `after_ns`."""
        vertex_ns, targets, at, way_rows = drive.ramps_between(after_ns, tick_ns)
        width = self.x[0].size
        records = np.empty((vertex_ns.size, 2 * width + self.tension[0].size + SPENT))
        lengths = self.crawler.lengths_at(targets)
        step, yaw = self._follow_ramps(targets, records, vertex_ns)
        self.total.add_account(step.account, step.jump_loss)
        if self.inertia is not None:
            x = records[:, :width].reshape(-1, *self.x.shape[1:])
            self.inertia.add_ramps(targets, after_ns, vertex_ns, x, [jump.ramp for jump in step.jumps])
        ends = np.searchsorted(vertex_ns, tick_ns)
        for jump in step.jumps:
            self.jump_loss[first + 1 + np.searchsorted(ends, jump.ramp)] += jump.loss
            begin = int(vertex_ns[jump.ramp - 1]) if jump.ramp else after_ns
            when = (begin + jump.fraction * (int(vertex_ns[jump.ramp]) - begin)) / NS
            self.jumps.append(TimedJump(when, jump.contact, jump.border, jump.distance, jump.loss))
        tension = records[:, 2 * width : -SPENT].reshape(-1, *self.tension.shape[1:])
        place = (vertex_ns.size, *self.x.shape[1:])
        x, rest = records[:, :width].reshape(place), records[:, width : 2 * width].reshape(place)
        stored = self.crawler.body.energy(tension, x, lengths) + records[:, -SPENT]
        self.peak = max(self.peak, float(np.abs(stored).max()))
        rows = slice(first + 1, first + 1 + tick_ns.size)
        self.stored[rows] = stored[ends]
        self.time_ns[rows] = tick_ns
        self.x[rows] = x[ends]
        self.yaw[rows] = yaw[ends]
        self.tension[rows] = tension[ends]
        self.spent[rows] = np.diff(records[ends, 1 - SPENT :], axis=0, prepend=0.0)
        way = at[vertex_ns[at] > 0]
        self.wall_push += find_pushes(self.crawler.scene, vertex_ns[way] / NS, x[way], tension[way], targets[way])
        moved = np.diff(x, axis=0, prepend=self.last[0][None]) + np.diff(rest, axis=0, prepend=self.last[1][None])
        self.state[rows] = _directions(moved, np.concatenate(([0], ends[:-1] + 1)))
        plane = moved.ndim == 3
        self.slid |= [((moved != 0.0).any(axis=2) if plane else side * moved > 0.0).any(axis=0) for side in (1, -1)]
        self.last = (x[-1].copy(), rest[-1].copy())
        counts = (vertex_ns[at] > 0) & ((way_rows == 0) | (drive.period is None))
        self.waypoint_row += way_rows[counts].tolist()
        self.waypoint_x += list(x[at[counts]])
        self.waypoint_rest += list(rest[at[counts]])
        self.waypoint_yaw += yaw[at[counts]].tolist()

    def _follow_ramps(self, targets: np.ndarray, records: np.ndarray, ends_ns: np.ndarray) -> tuple[Step, np.ndarray]:
        """Follow ramps; return their account, and the yaw at the end of each [rad]."""
        if self.crawler.body.turning is None:
            return self.crawler.follow(targets, records), np.zeros(ends_ns.size)
        step, yaw, margin = follow_turning(self.crawler, targets, records, ends_ns / NS)
        least = int(np.argmin(margin))
        if np.isfinite(margin[least]) and (self.stability is None or margin[least] < self.stability[0]):
            self.stability = float(margin[least]), float(ends_ns[least]) / NS
        return step, yaw

    def _gains(self, x: np.ndarray) -> np.ndarray:
        """Compute the gain in each period from displacements at its ends, shape (W, ...)."""
        body = self.crawler.body
        if self.crawler.scene.drive.period is None:
            return np.zeros((0, *x.shape[2:]))
        moved = np.diff(x, axis=0) + np.diff(np.array(self.waypoint_rest), axis=0)
        if body.turning is not None:
            return gain_in_frame(body, x[:-1], moved, np.diff(self.waypoint_yaw))
        return average_displacement(body, moved)

    def finish(self, rate: float, began: float) -> Trajectory:
        """Complete the account and build the trajectory."""
        scene, drive = self.crawler.scene, self.crawler.scene.drive
        body = self.crawler.body
        way_x = np.array(self.waypoint_x)
        per_period = self._gains(way_x)
        way_time = drive.times[self.waypoint_row]
        if drive.period is not None:
            way_time = drive.period * np.arange(len(self.waypoint_row))
        if drive.holds and self.ticks > 0:
            way_time = np.array([0.0, self.time_ns[-1] / NS])
            way_x = np.stack((way_x[0], self.x[-1]))
            self.waypoint_yaw.append(float(self.yaw[-1]))
        if self.inertia is not None and drive.period is None and self.time_ns[-1] >= drive.times[-1] * NS:
            self.inertia.stop(int(self.time_ns[-1]))
        total = self.total
        uniqueness = commanded_margin(body, drive)
        margin, when = self.stability or (None, None)
        internal, work, dissipation, loads_work = self.spent.T.copy()
        arrays = (
            self.time_ns / NS,
            self.x,
            self.tension,
            average_displacement(body, self.x),
            self.state,
            self.slid,
            np.array(way_time, dtype=np.float64),
            way_x[:, body.stations],
            average_displacement(body, way_x),
            per_period,
            self.yaw,
            np.array(self.waypoint_yaw),
        )
        for array in arrays:
            array.flags.writeable = False
        return Trajectory(
            scene,
            self.crawler.method,
            rate,
            *arrays,
            energy=Energy(
                float(total.work),
                float(total.dissipation),
                self.energy_of(self.crawler) - float(self.stored[0]),
                float(total.residual),
                self.peak,
                float(total.loads_work),
                total.jump_loss,
                float(total.internal_dissipation),
            ),
            energies=TickEnergies(work, dissipation, loads_work, self.jump_loss, self.stored, internal),
            jumps=tuple(self.jumps),
            wall_push=tuple(self.wall_push),
            stability_margin=margin,
            stability_time=when,
            violation=float(total.violation),
            unique=bool(total.unique),
            uniqueness_margin=None if isinstance(uniqueness, Undecided) else uniqueness,
            visited_margin=float(total.visited),
            visited_margin_sampled=self.crawler.visited_margin_sampled,
            events=int(total.events),
            overspent=int(total.overspent),
            unsolved=int(total.unsolved),
            ticks=self.ticks,
            wall_s=time.perf_counter() - began,
            inertia=None if self.inertia is None else self.inertia.result(),
        )
