"""Offline runs of a scene: its drive at a fixed tick rate, with every waypoint at the end of a ramp."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.drive import NS, Drive
from ..body.plan import Plan, check_plan
from ..crawler.crawler import Crawler, Method, choose_method
from ..errors import CommandError
from ..motion.state import SPENT
from ..notebook import write_html
from ..theory.uniqueness import commanded_margin
from .account import Energy, TickEnergies, Total, average_displacement
from .arrow import Tabular, load_library
from .table import TrajectoryColumns
from .ticks import check_duration, count_ticks, rational_rate, tick_end_ns, tick_ends

_CHUNK = 4096
_MOST_SAMPLES = 100_000_000
_RETURNED = 1e-15
"""A net displacement below this part of the path length of a contact is rounding."""


@dataclass(frozen=True)
class TimedJump:
    """A jump in a run, see `Jump`.

    Attributes:
        time: simulated time [s].
        contact: the contact, counted along the body.
        border: position of the border on the track [m].
        distance: from the border to where the contact came to rest or to the next border, towards +x positive [m].
        loss: energy lost beside that lost to friction, >= 0 [J].
    """

    time: float
    contact: int
    border: float
    distance: float
    loss: float


@dataclass(frozen=True, eq=False, repr=False)
class Trajectory(Tabular):
    """The result of a run. Arrays are read-only; T counts the start and all ticks, W the start and waypoints passed.

    Attributes:
        scene: the scene.
        method: "exact" or "catch_up".
        rate: ticks per second [Hz].
        time: times of the start and of the end of each tick, shape (T,) [s].
        displacement: x, shape (T, N), in the plane (T, N, 2) [m].
        tension: shape (T, S), in the plane (T, S, 2) [N].
        net_translation: y, shape (T,), in the plane (T, 2) [m].
        contact_state: direction of each contact in the tick: 1 forward, -1 backward, 0 stuck; int8, shape (T, N).
        waypoint_time: times of the start and of each waypoint passed (with a period, of its end), shape (W,) [s].
        waypoint_displacement: x at these times of the isolated contacts, then of both ends of each segment, shape
            (W, stations), in the plane (W, N, 2) [m].
        waypoint_net_translation: y at these times, shape (W,), in the plane (W, 2) [m].
        per_period: y gained in each whole period, shape (P,), in the plane (P, 2) [m].
        energy: energy account of the whole run.
        energies: energies by tick.
        jumps: contacts that crossed a border onto ground that holds less, in order; `Step.jumps` with times.
        violation: largest amount by which a spring force exceeds its bound [N].
        unique: False if the translation was not determined on some stretch.
        uniqueness_margin: margin of the commanded friction, its minimum over the waypoints [1]; None if undecided.
        visited_margin: how close all contacts came to sliding at once [1].
        visited_margin_sampled: True if this was sampled only at the ends of ramps (in the plane, of steps), so that
            the path may have come closer in between: with catch_up, and for bodies of more than 256 contacts.
        events: number of linear pieces.
        overspent: number of ramps whose budget of work was exceeded; a catch-up step completed each of them.
        unsolved: number of ramps in which the search for the sliding contacts failed; the certificate shows the error.
        ticks: number of ticks.
        wall_s: wall-clock time of the run [s].
    """

    scene: Plan
    method: Method
    rate: float
    time: np.ndarray
    displacement: np.ndarray
    tension: np.ndarray
    net_translation: np.ndarray
    contact_state: np.ndarray
    waypoint_time: np.ndarray
    waypoint_displacement: np.ndarray
    waypoint_net_translation: np.ndarray
    per_period: np.ndarray
    energy: Energy
    energies: TickEnergies
    jumps: tuple[TimedJump, ...]
    violation: float
    unique: bool
    uniqueness_margin: float | None
    visited_margin: float
    visited_margin_sampled: bool
    events: int
    overspent: int
    unsolved: int
    ticks: int
    wall_s: float

    def __repr__(self) -> str:
        """Describe the run in one line."""
        return (
            f"Trajectory({self.scene.name}, {self.method}, {self.ticks} ticks at {self.rate:g} Hz, "
            f"net_translation {self.net_translation[0]} -> {self.net_translation[-1]} m)"
        )

    def _repr_html_(self) -> str:
        """Describe the run in a notebook."""
        energy = self.energy
        facts = {
            "method": f"{self.method}, {self.ticks} ticks at {self.rate:g} Hz, {self.wall_s:.3g} s",
            "net translation [m]": np.stack((self.net_translation[0], self.net_translation[-1])),
            "gained in each period [m]": self.per_period,
            "work, dissipation, stored [J]": f"{energy.work:.6g}, {energy.dissipation:.6g}, {energy.stored:.6g}",
            "residual of the energy [1]": energy.relative_residual,
            "unique": self.unique,
        }
        return write_html(f"Trajectory of {self.scene.name}", facts.items())

    @property
    def position(self) -> np.ndarray:
        """Reference position plus displacement of each contact, shape (T, N), in the plane (T, N, 2) [m]."""
        position = self.scene.body.position + self.displacement
        position.flags.writeable = False
        return position

    def to_table(self) -> Any:
        """Convert to a table with a row for the start and for the end of each tick.

        Returns:
            A pyarrow.Table with the columns of `TrajectoryColumns`: time, positions, commands, velocities, states,
            forces, tensions and energies, with the unit of each in the metadata of its column.

        Raises:
            CrawlerError: if pyarrow is not installed, or a segment has the name of a column.
        """
        pa = load_library("pyarrow", "to_table")
        columns = TrajectoryColumns(self.scene)
        return pa.Table.from_batches(columns.build_batches(self), columns.build_schema(self))

    def summary(self) -> dict[str, Any]:
        """Build the summary that `crawler simulate --json` prints.

        Returns:
            Plain numbers, lists and strings; schema 1.
        """
        energy = self.energy
        return {
            "schema": 1,
            "scene": self.scene.name,
            "method": self.method,
            "rate_hz": self.rate,
            "time": self.waypoint_time.tolist(),
            "displacement": self.waypoint_displacement.tolist(),
            "net_translation": self.waypoint_net_translation.tolist(),
            "per_period": self.per_period.tolist(),
            "energy": {
                "work": energy.work,
                "dissipation": energy.dissipation,
                "stored": energy.stored,
                "residual": energy.relative_residual,
            },
            "loads_work": energy.loads_work,
            "jumps": [dataclasses.asdict(jump) for jump in self.jumps],
            "jump_loss": energy.jump_loss,
            "violation": self.violation,
            "unique": self.unique,
            "uniqueness_margin": self.uniqueness_margin,
            "visited_margin": self.visited_margin,
            "visited_margin_sampled": self.visited_margin_sampled,
            "events": self.events,
            "overspent": self.overspent,
            "unsolved": self.unsolved,
            "ticks": self.ticks,
            "wall_s": self.wall_s,
        }


def default_duration(drive: Drive) -> float:
    """Compute the default duration of a run: ten periods, or up to the last waypoint.

    Args:
        drive: the drive of the scene.

    Returns:
        Duration [s]; 0 for a scene without a drive.
    """
    return float(drive.times[-1]) if drive.period is None else 10.0 * drive.period


def simulate(
    scene: Plan,
    duration: float | None = None,
    rate: float = 100.0,
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
        CommandError: if duration, rate or method is out of range, or the body reaches ground on which nothing holds it.
        SceneError: if `scene` is not a scene.
    """
    began = time.perf_counter()
    check_plan(scene, "simulate")
    method = choose_method(scene, method)
    drive = scene.drive
    seconds = default_duration(drive) if duration is None else float(duration)
    check_duration(seconds)
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
        run.follow(drive, min(tick_end_ns(first, ratio), end_ns), tick_ends(first + 1, last, ratio, end_ns), first)
        if progress is not None:
            progress(last / ticks)
    return run.finish(rate, began)


def _waypoints(drive: Drive, seconds: float) -> float:
    return drive.times.size * (1.0 if drive.period is None else max(seconds / drive.period, 1.0))


def _directions(moved: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Compute the directions of contacts in ticks that begin with the ramps `first`; 0 for no net displacement."""
    gained = np.add.reduceat(moved, first)
    went = np.abs(gained) > _RETURNED * np.add.reduceat(np.abs(moved), first)
    return np.asarray(went.any(axis=2) if moved.ndim == 3 else np.where(went, np.sign(gained), 0.0))


class _Run:
    """The tables of a run in progress."""

    def __init__(self, crawler: Crawler, ticks: int) -> None:
        body = crawler.body
        self.crawler = crawler
        self.start = crawler.copy()
        self.ticks = ticks
        self.time_ns = np.zeros(ticks + 1, np.int64)
        self.x = np.empty((ticks + 1, *body.position.shape))
        self.tension = np.empty((ticks + 1, *crawler.tension.shape))
        self.state = np.zeros((ticks + 1, body.contacts), np.int8)
        self.x[0], self.tension[0] = crawler.displacement, crawler.tension
        self.waypoint_ns: list[int] = [0]
        self.waypoint_row: list[int] = [0]
        self.waypoint_x: list[np.ndarray] = [crawler.displacement]
        self.waypoint_rest: list[np.ndarray] = [np.zeros(body.position.shape)]
        self.last = (crawler.displacement, np.zeros(body.position.shape))
        self.total = Total(crawler.visited_margin)
        self.stored = np.zeros(ticks + 1)
        self.stored[0] = self.energy_of(crawler)
        self.peak = abs(self.stored[0])
        self.jumps: list[TimedJump] = []
        self.spent = np.zeros((ticks + 1, SPENT))
        self.jump_loss = np.zeros(ticks + 1)

    @staticmethod
    def energy_of(crawler: Crawler) -> float:
        """Compute the energy stored in the springs of a crawler [J]."""
        return float(crawler.body.energy(crawler.tension, crawler.displacement, crawler.actuation))

    def follow(self, drive: Drive, after_ns: int, tick_ns: np.ndarray, first: int) -> None:
        """Run the ticks that end at `tick_ns`; the first one, number `first`, starts at `after_ns`."""
        vertex_ns, targets, at, way_rows = drive.ramps_between(after_ns, tick_ns)
        width = self.x[0].size
        records = np.empty((vertex_ns.size, 2 * width + self.tension[0].size + SPENT))
        step = self.crawler.follow(targets, records)
        self.total.add(step.account, step.jump_loss)
        ends = np.searchsorted(vertex_ns, tick_ns)
        for jump in step.jumps:
            self.jump_loss[first + 1 + np.searchsorted(ends, jump.ramp)] += jump.loss
            begin = int(vertex_ns[jump.ramp - 1]) if jump.ramp else after_ns
            when = (begin + jump.part * (int(vertex_ns[jump.ramp]) - begin)) / NS
            self.jumps.append(TimedJump(when, jump.contact, jump.border, jump.distance, jump.loss))
        tension = records[:, 2 * width : -SPENT].reshape(-1, *self.tension.shape[1:])
        place = (vertex_ns.size, *self.x.shape[1:])
        x, rest = records[:, :width].reshape(place), records[:, width : 2 * width].reshape(place)
        stored = self.crawler.body.energy(tension, x, targets[:, : tension.shape[1]])
        self.peak = max(self.peak, float(np.abs(stored).max()))
        rows = slice(first + 1, first + 1 + tick_ns.size)
        self.stored[rows] = stored[ends]
        self.time_ns[rows] = tick_ns
        self.x[rows] = x[ends]
        self.tension[rows] = tension[ends]
        self.spent[rows] = np.diff(records[ends, -SPENT:], axis=0, prepend=0.0)
        moved = np.diff(x, axis=0, prepend=self.last[0][None]) + np.diff(rest, axis=0, prepend=self.last[1][None])
        self.state[rows] = _directions(moved, np.concatenate(([0], ends[:-1] + 1)))
        self.last = (x[-1].copy(), rest[-1].copy())
        for i, ns, row in zip(at, vertex_ns[at], way_rows, strict=True):
            if ns > 0 and (drive.period is None or row == 0):
                self.waypoint_ns.append(int(ns))
                self.waypoint_row.append(int(row))
                self.waypoint_x.append(x[i].copy())
                self.waypoint_rest.append(rest[i].copy())

    def finish(self, rate: float, began: float) -> Trajectory:
        """Complete the account and build the trajectory."""
        scene, drive = self.crawler.scene, self.crawler.scene.drive
        body = self.crawler.body
        way_x, way_rest = np.array(self.waypoint_x), np.array(self.waypoint_rest)
        per_period = np.zeros((0, *way_x.shape[2:]))
        if drive.period is not None:
            way_time = drive.period * np.arange(len(self.waypoint_ns))
            gain = np.diff(way_x, axis=0) + np.diff(way_rest, axis=0)
            per_period = average_displacement(body, gain)
        else:
            way_time = drive.times[self.waypoint_row]
        if drive.holds and self.ticks > 0:
            way_time = np.array([0.0, self.time_ns[-1] / NS])
            way_x = np.stack((way_x[0], self.x[-1]))
        start, end = self.energy_of(self.start), self.energy_of(self.crawler)
        total = self.total
        work, dissipation, loads_work = self.spent.T.copy()
        arrays = (
            self.time_ns / NS,
            self.x,
            self.tension,
            average_displacement(body, self.x),
            self.state,
            np.array(way_time, dtype=np.float64),
            way_x[:, body.stations],
            average_displacement(body, way_x),
            per_period,
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
                float(end - start),
                float(total.residual),
                self.peak,
                float(total.loads_work),
                total.jump_loss,
            ),
            energies=TickEnergies(work, dissipation, loads_work, self.jump_loss, self.stored),
            jumps=tuple(self.jumps),
            violation=float(total.violation),
            unique=bool(total.unique),
            uniqueness_margin=commanded_margin(body, drive),
            visited_margin=float(total.visited),
            visited_margin_sampled=self.crawler.visited_margin_sampled,
            events=int(total.events),
            overspent=int(total.overspent),
            unsolved=int(total.unsolved),
            ticks=self.ticks,
            wall_s=time.perf_counter() - began,
        )
