"""The result of a run: positions, tensions and energies by tick, and what its waypoints and periods show."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.drive import NS
from ..body.plan import Plan
from ..crawler.method import Method
from ..notebook import write_html
from .account import Energy, TickEnergies
from .arrow import Tabular, load_library
from .inertia import Inertia
from .screw import Screw, find_screw
from .table import ENERGIES, TrajectoryColumns
from .wall_pushes import WallPush

_NUMBERS, _FEWEST_ROWS = 4_000_000, 128
"""Numbers in a batch, and rows in a batch of a wide table: each batch of a file describes all columns again."""


@dataclass(frozen=True)
class TimedJump:
    """A jump in a run, see `Jump`.

    Attributes:
        time: simulated time [s].
        contact: the contact, counted along the body.
        border: position of the border on the track [m]; None for a body that loses its stability.
        distance: from the border to where the contact came to rest or to the next border, towards +x positive; for a
            body that loses its stability, how far the contact moved that moved farthest [m].
        loss: energy lost in addition to friction, >= 0 [J].
    """

    time: float
    contact: int
    border: float | None
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
        slid: whether each contact slid forward, and backward, also where it returned within a tick; in the plane
            whether it slid, twice; bool, shape (2, N).
        waypoint_time: times of the start and of each waypoint passed (with a period, of its end), shape (W,) [s].
        waypoint_displacement: x at these times of the isolated contacts, then of both ends of each segment, shape
            (W, stations), in the plane (W, N, 2) [m].
        waypoint_net_translation: y at these times, shape (W,), in the plane (W, 2) [m].
        per_period: y gained in each whole period, shape (P,), in the plane (P, 2) [m]; for a body that turns dx and dy
            [m] in its frame at the start of the period and the angle dyaw [rad] by which it turned, shape (P, 3). The
            origin of that frame lies in the middle of the heading, whose direction is its x axis.
        yaw: angle of the heading at the times of `time`, whole turns counted, shape (T,) [rad]; 0 for bodies that do
            not turn.
        waypoint_yaw: the same at the times of `waypoint_time`, shape (W,) [rad].
        energy: energy account of the whole run.
        energies: energies by tick.
        jumps: contacts that crossed a border onto ground that holds less, or where a body that turns lost its
            stability, in order; `Step.jumps` with times.
        wall_push: what contacts at walls push, at the start and at each waypoint, in order.
        stability_margin: for a body that turns, the least of `Crawler.stability_margin` along the run [1]; else None,
            and where no command changed.
        stability_time: end of the ramp on which it was least [s]; None where `stability_margin` is.
        violation: largest amount by which a spring force exceeds its bound [N].
        unique: False if the translation was not determined on some stretch.
        uniqueness_margin: margin of the commanded friction, its minimum over the waypoints [1]; None if undecided.
        visited_margin: how close all contacts came to sliding at once [1].
        visited_margin_sampled: True if this was sampled only at the ends of ramps (in the plane, of steps), so that
            the path may have come closer in between: with catch_up, and for bodies of more than 256 contacts.
        events: number of linear pieces.
        overspent: number of ramps whose budget of work was exceeded; a catch-up step completed each of them.
        unsolved: number of ramps that were not solved; the certificate shows the error.
        ticks: number of ticks.
        wall_s: wall-clock time of the run [s].
        inertia: the inertia number; None for a scene without masses and weights.
    """

    scene: Plan
    method: Method
    rate: float
    time: np.ndarray
    displacement: np.ndarray
    tension: np.ndarray
    net_translation: np.ndarray
    contact_state: np.ndarray
    slid: np.ndarray
    waypoint_time: np.ndarray
    waypoint_displacement: np.ndarray
    waypoint_net_translation: np.ndarray
    per_period: np.ndarray
    yaw: np.ndarray
    waypoint_yaw: np.ndarray
    energy: Energy
    energies: TickEnergies
    jumps: tuple[TimedJump, ...]
    wall_push: tuple[WallPush, ...]
    stability_margin: float | None
    stability_time: float | None
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
    inertia: Inertia | None = None

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

    @property
    def screws(self) -> tuple[Screw, ...]:
        """The motion of a body that turns in each period, as a rotation; empty for bodies that do not turn."""
        return tuple(find_screw(gain) for gain in self.per_period) if self.scene.body.turning is not None else ()

    def to_table(self) -> Any:
        """Convert to a table with a row for the start and for the end of each tick.

        Returns:
            A pyarrow.Table with the columns of `TrajectoryColumns`: time, positions, commands, velocities, states,
            forces, tensions and energies, with the unit of each in the metadata of its column.

        Raises:
            CrawlerError: if pyarrow is not installed, or a segment has the name of a column.
        """
        pa = load_library("pyarrow", "to_table")
        return pa.Table.from_batches(self.build_batches(), self.build_schema())

    def build_schema(self) -> Any:
        """Build the Arrow schema of the table.

        Returns:
            A pyarrow.Schema: float64, int8 for states; the unit of each column in its metadata; scene, method and rate
            as JSON under `crawler_trajectory` in the metadata of the schema.

        Raises:
            CrawlerError: if pyarrow is not installed, or a segment has the name of a column.
        """
        pa = load_library("pyarrow", "to_table")
        fields = [
            pa.field(name, pa.int8() if group.values in ("state", "yields") else pa.float64(), metadata={"unit": unit})
            for group in TrajectoryColumns(self.scene).groups
            for name, unit in zip(group.names, group.units, strict=True)
        ]
        about = {"schema": 1, "scene": self.scene.name, "method": self.method, "rate_hz": self.rate}
        return pa.schema(fields, metadata={"crawler_trajectory": json.dumps(about)})

    def build_batches(self) -> Iterator[Any]:
        """Build the table in batches of rows, so that one batch at a time is in memory.

        Yields:
            pyarrow.RecordBatch of at most four million numbers, or of 128 rows.

        Raises:
            CrawlerError: if pyarrow is not installed, or a segment has the name of a column.
        """
        pa = load_library("pyarrow", "to_table")
        columns, schema = TrajectoryColumns(self.scene), self.build_schema()
        size = max(_NUMBERS // len(schema), _FEWEST_ROWS)
        for first in range(0, self.time.size, size):
            rows = slice(first, min(first + size, self.time.size))
            values = self._read(columns, rows)
            arrays = [
                pa.array(column)
                for group in columns.groups
                for column in np.ascontiguousarray(values[group.values].reshape(rows.stop - first, -1).T)
            ]
            yield pa.RecordBatch.from_arrays(arrays, schema=schema)

    def _read(self, columns: TrajectoryColumns, rows: slice) -> dict[str, np.ndarray]:
        """Compute the values of each group in some rows, each of shape (R, ...)."""
        scene, body = self.scene, self.scene.body
        time, x, tension = self.time[rows], self.displacement[rows], self.tension[rows]
        state = self.contact_state[rows]
        commands = scene.drive.sample_rows(np.rint(time * NS).astype(np.int64))
        friction, load = self._read_ground(commands, x)
        energies = [getattr(self.energies, name)[rows] for name in ENERGIES]
        ends = [(segment.last, segment.first) for segment in body.segments]
        first = max(rows.start - 1, 0)  # the start has no velocity
        before, seconds = self.displacement[first : rows.stop], np.diff(self.time[first : rows.stop])
        moved = np.diff(before, axis=0) / seconds.reshape(-1, *(1,) * (x.ndim - 1))
        velocity = np.concatenate((np.zeros((x.shape[0] - moved.shape[0], *x.shape[1:])), moved))
        velocity[state == 0] = 0.0
        return {
            "time": time,
            "position": body.position + x,
            "elongation": np.stack([x[:, b] - x[:, a] for b, a in ends], axis=1) if ends else np.zeros((len(x), 0)),
            "commands": commands[:, columns.commanded],
            "velocity": velocity,
            "state": state.astype(np.int8),
            "ground_force": -(body.force_at(x, tension) + load),
            "friction": friction,
            "load": load if columns.loaded else np.zeros((len(x), 0)),
            "tension": tension,
            "yields": self._read_limits(commands, x),
            "net_translation": self.net_translation[rows],
            "yaw": self.yaw[rows] if body.turning is not None else np.zeros((len(x), 0)),
            "energies": np.column_stack(energies),
        }

    def _read_limits(self, commands: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Determine which actuators are slack and which are stalled, int8, shape (R, B, 2)."""
        body = self.scene.body
        if not body.limits.index.size:
            return np.zeros((len(x), 0), np.int8)
        state = body.limits.find_states(body.elongation(x), self.scene.columns.target(commands))
        return np.stack((state < 0, state > 0), axis=2).astype(np.int8)

    def _read_ground(self, commands: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Compute friction and loads of the ground under each contact, shapes (R, F) and (R, N) or (R, N, 2) [N]."""
        scene, body = self.scene, self.scene.body
        columns, track = scene.columns, scene.ground.track
        lengths, load = body.lengths, np.zeros(x.shape)
        frictions = 2 * body.contacts if columns.planar is None else columns.frictions
        target = columns.target(commands)
        if track is not None:
            forward, backward, load = track.local_bounds(target[:, lengths:], body.position, x)
            return np.hstack((forward + load, backward - load)), load
        if columns.slope_load is not None:
            load = target[:, lengths + frictions :].reshape(x.shape)
        friction = columns.spread(commands)[:, lengths : lengths + frictions]
        if body.dimension == 2:
            each = friction.reshape(*x.shape[:-1], -1)
            friction = scene.ground.scale_friction(each, body.position + x).reshape(friction.shape)
        return friction, load

    def summary(self) -> dict[str, Any]:
        """Build the summary that `crawler simulate --json` prints.

        Returns:
            Plain numbers, lists and strings; schema 1.
        """
        energy = self.energy
        turning = {
            "yaw": self.waypoint_yaw.tolist(),
            "screws": [dataclasses.asdict(screw) for screw in self.screws],
            "stability_margin": self.stability_margin,
            "stability_time": self.stability_time,
        }
        return {
            "schema": 1,
            "scene": self.scene.name,
            "method": self.method,
            "rate_hz": self.rate,
            "time": self.waypoint_time.tolist(),
            "displacement": self.waypoint_displacement.tolist(),
            "net_translation": self.waypoint_net_translation.tolist(),
            "per_period": self.per_period.tolist(),
            **(turning if self.scene.body.turning is not None else {}),
            "energy": {
                "work": energy.work,
                "dissipation": energy.dissipation,
                "stored": energy.stored,
                "residual": energy.relative_residual,
            },
            "loads_work": energy.loads_work,
            "jumps": [dataclasses.asdict(jump) for jump in self.jumps],
            "jump_loss": energy.jump_loss,
            "wall_push": [dataclasses.asdict(push) for push in self.wall_push],
            "internal_dissipation": energy.internal_dissipation,
            "violation": self.violation,
            "unique": self.unique,
            "uniqueness_margin": self.uniqueness_margin,
            "visited_margin": self.visited_margin,
            "visited_margin_sampled": self.visited_margin_sampled,
            "events": self.events,
            "overspent": self.overspent,
            "unsolved": self.unsolved,
            "inertia": None if self.inertia is None else self.inertia.summary(),
            "ticks": self.ticks,
            "wall_s": self.wall_s,
        }
