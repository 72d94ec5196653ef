"""The table of a run: a row for the start and for the end of each tick, a column for each quantity."""

from __future__ import annotations

import functools
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..body.body import Body
from ..body.columns import Columns
from ..body.drive import NS
from ..body.names import name_every_contact, name_every_spring
from ..body.plan import Plan
from ..body.turning import SIDES
from ..errors import CrawlerError
from .account import TickEnergies
from .arrow import load_library

_NUMBERS, _FEWEST_ROWS = 4_000_000, 128
"""Numbers in a batch, and rows in a batch of a wide table: each batch of a file describes all columns again."""
_ENERGIES = ("work", "dissipation", "loads_work", "jump_loss", "stored")


class Ran(Protocol):
    """The arrays of a `Trajectory` from which its table is built."""

    @property
    def scene(self) -> Plan:
        """The scene."""

    @property
    def method(self) -> str:
        """The method of integration."""

    @property
    def rate(self) -> float:
        """Ticks per second [Hz]."""

    @property
    def time(self) -> np.ndarray:
        """Times of the start and of the end of each tick, shape (T,) [s]."""

    @property
    def displacement(self) -> np.ndarray:
        """X at these times, shape (T, N), in the plane (T, N, 2) [m]."""

    @property
    def tension(self) -> np.ndarray:
        """Tensions, shape (T, S), in the plane (T, S, 2) [N]."""

    @property
    def net_translation(self) -> np.ndarray:
        """Y, shape (T,), in the plane (T, 2) [m]."""

    @property
    def yaw(self) -> np.ndarray:
        """Angles of the heading, shape (T,) [rad]."""

    @property
    def contact_state(self) -> np.ndarray:
        """Directions of the contacts, int8, shape (T, N)."""

    @property
    def energies(self) -> TickEnergies:
        """Energies by tick."""


class _Group(NamedTuple):
    """Columns that belong together: how the values are called in `_read`, names and units of the columns."""

    values: str
    names: tuple[str, ...]
    units: tuple[str, ...]


_YIELDS = ("slack", "stalled")


def _name_torques(body: Body) -> _Group:
    """Name the tensions of links and the torques of joints of a body that turns."""
    names, links, joints = name_every_spring(body), body.springs, body.lengths - body.springs
    each = [f"{name}/{'tension' if i < links else 'torque'}" for i, name in enumerate(names)]
    return _Group("tension", tuple(each), ("N",) * links + ("N m",) * joints)


def unit_of_command(columns: Columns, column: int) -> str:
    """Find the unit of a column of command rows.

    Args:
        columns: the layout of the rows.
        column: index of the column.

    Returns:
        Its unit; "1" for strain.
    """
    segment = any(columns.names[column].split("/")[0] == name for name, _, _ in columns.segments)
    if columns.kind(column) == "actuation":
        return "1" if segment else "rad" if column >= columns.links and columns.joints is not None else "m"
    return "N/m" if segment else "N"


@dataclass(frozen=True, eq=False)
class TrajectoryColumns:
    """The columns of `Trajectory.to_table` for a scene, in their order.

    The file `docs/tables.md` describes them.

    Attributes:
        scene: the scene.
    """

    scene: Plan

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(name for group in self._groups for name in group.names)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column; "1" for numbers without one."""
        return {n: unit for group in self._groups for n, unit in zip(group.names, group.units, strict=True)}

    def __repr__(self) -> str:
        """State how many columns there are, and the first ones."""
        return f"TrajectoryColumns({self.scene.name}, {len(self.names)} columns: {', '.join(self.names[:4])}, ...)"

    @functools.cached_property
    def commanded(self) -> np.ndarray:
        """Indices of the command columns in the table: lengths and strains, and what else the drive commands."""
        return np.flatnonzero(self.scene.commanded)

    @functools.cached_property
    def _loaded(self) -> bool:
        return self.scene.columns.slope_load is not None or self.scene.ground.track is not None

    @functools.cached_property
    def _groups(self) -> tuple[_Group, ...]:
        scene, body = self.scene, self.scene.body
        planar = body.dimension == 2
        axes = ("_x", "_y") if planar else ("",)
        contacts, springs = name_every_contact(body), name_every_spring(body)
        if planar:
            sides = [f"direction_{k}" for k in range(scene.columns.planar or 0)] or ["friction"]
            sides = sides if body.turning is None else list(SIDES)
            friction = [f"{contact}/{side}" for contact in contacts for side in sides]
        else:
            friction = [f"{contact}/{side}" for side in ("forward", "backward") for contact in contacts]

        def group(values: str, names: list[str], unit: str) -> _Group:
            return _Group(values, tuple(names), (unit,) * len(names))

        def each(items: tuple[str, ...], quantity: str) -> list[str]:
            return [f"{item}/{quantity}{axis}" for item in items for axis in axes]

        positions = [f"{contact}/{axis}" for contact in contacts for axis in "xy"] if planar else list(contacts)
        commands = tuple(f"command/{scene.columns.names[column]}" for column in self.commanded)
        found = (
            group("time", ["time"], "s"),
            group("position", positions, "m"),
            group("elongation", [segment.name for segment in body.segments], "m"),
            _Group(
                "commands", commands, tuple(unit_of_command(scene.columns, int(column)) for column in self.commanded)
            ),
            group("velocity", each(contacts, "velocity"), "m/s"),
            group("state", [f"{contact}/state" for contact in contacts], "1"),
            group("ground_force", each(contacts, "ground_force"), "N"),
            group("friction", friction, "N"),
            group("load", each(contacts, "load") if self._loaded else [], "N"),
            group("tension", each(springs, "tension"), "N") if body.turning is None else _name_torques(body),
            group("yields", [f"{springs[k]}/{word}" for k in body.limits.index for word in _YIELDS], "1"),
            group("net_translation", [f"net_translation{axis}" for axis in axes], "m"),
            group("yaw", ["yaw"] if body.turning is not None else [], "rad"),
            group("energies", list(_ENERGIES), "J"),
        )
        own = {name for part in found if part.values != "elongation" for name in part.names}
        for segment in body.segments:
            if segment.name in own:
                raise CrawlerError(
                    f"to_table: the segment {segment.name} has the name of a column of the table; rename it"
                )
        return found

    def build_schema(self, run: Ran) -> Any:
        """Build the Arrow schema of the table of a run.

        Args:
            run: the run.

        Returns:
            A pyarrow.Schema: float64, int8 for states; the unit of each column in its metadata; scene, method and rate
            as JSON under `crawler_trajectory` in the metadata of the schema.

        Raises:
            CrawlerError: if pyarrow is not installed, or a segment has the name of a column.
        """
        pa = load_library("pyarrow", "to_table")
        fields = [
            pa.field(name, pa.int8() if group.values in ("state", "yields") else pa.float64(), metadata={"unit": unit})
            for group in self._groups
            for name, unit in zip(group.names, group.units, strict=True)
        ]
        about = {"schema": 1, "scene": self.scene.name, "method": run.method, "rate_hz": run.rate}
        return pa.schema(fields, metadata={"crawler_trajectory": json.dumps(about)})

    def build_batches(self, run: Ran) -> Iterator[Any]:
        """Build the table of a run in batches of rows, so that one batch at a time is in memory.

        Args:
            run: the run.

        Yields:
            pyarrow.RecordBatch of at most four million numbers, or of 128 rows.

        Raises:
            CrawlerError: if pyarrow is not installed, or a segment has the name of a column.
        """
        pa = load_library("pyarrow", "to_table")
        schema = self.build_schema(run)
        size = max(_NUMBERS // len(schema), _FEWEST_ROWS)
        for first in range(0, run.time.size, size):
            rows = slice(first, min(first + size, run.time.size))
            values = self._read(run, rows)
            arrays = [
                pa.array(column)
                for group in self._groups
                for column in np.ascontiguousarray(values[group.values].reshape(rows.stop - first, -1).T)
            ]
            yield pa.RecordBatch.from_arrays(arrays, schema=schema)

    def _read(self, run: Ran, rows: slice) -> dict[str, np.ndarray]:
        """Compute the values of each group in some rows, each of shape (R, ...)."""
        scene, body = self.scene, self.scene.body
        time, x, tension = run.time[rows], run.displacement[rows], run.tension[rows]
        state = run.contact_state[rows]
        commands = scene.drive.sample_rows(np.rint(time * NS).astype(np.int64))
        friction, load = self._read_ground(commands, x)
        energies = [getattr(run.energies, name)[rows] for name in _ENERGIES]
        ends = [(segment.last, segment.first) for segment in body.segments]
        first = max(rows.start - 1, 0)  # the start has no velocity
        before, seconds = run.displacement[first : rows.stop], np.diff(run.time[first : rows.stop])
        moved = np.diff(before, axis=0) / seconds.reshape(-1, *(1,) * (x.ndim - 1))
        velocity = np.concatenate((np.zeros((x.shape[0] - moved.shape[0], *x.shape[1:])), moved))
        still = state == 0
        velocity[still] = 0.0
        return {
            "time": time,
            "position": body.position + x,
            "elongation": np.stack([x[:, b] - x[:, a] for b, a in ends], axis=1) if ends else np.zeros((len(x), 0)),
            "commands": commands[:, self.commanded],
            "velocity": velocity,
            "state": state.astype(np.int8),
            "ground_force": -(body.force_at(x, tension) + load),
            "friction": friction,
            "load": load if self._loaded else np.zeros((len(x), 0)),
            "tension": tension,
            "yields": self._read_limits(commands, x),
            "net_translation": run.net_translation[rows],
            "yaw": run.yaw[rows] if body.turning is not None else np.zeros((len(x), 0)),
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
            places = track.find_places(np.tile(body.position, len(x)), x.ravel()).reshape(x.shape)
            forward, backward, load = track.bounds(target[:, lengths:], places)
            return np.hstack((forward + load, backward - load)), load
        if columns.slope_load is not None:
            load = target[:, lengths + frictions :].reshape(x.shape)
        raw = np.take(commands, columns.index[lengths : lengths + frictions], axis=1)
        return raw * columns.factor[lengths : lengths + frictions], load
