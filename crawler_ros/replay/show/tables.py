"""A replay as tidy Parquet tables: an observation per row, a quantity per column, units in the columns' metadata."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_model.body.names import name_each, name_joints

from ...wire.states import contact_names
from ..analysis import Replay
from ..ramps import Piece
from ..slips import sliding

_AXES = ("x", "y")
_FOUND: dict[str, list[tuple[str, Any, str]]] = {
    "rests": [
        ("run", pa.int32(), "1"),
        ("since", pa.float64(), "s"),
        ("until", pa.float64(), "s"),
        ("commanded", pa.bool_(), "1"),
        ("commanded_from", pa.float64(), "s"),
        ("margin", pa.float64(), "N"),
    ],
    "refusals": [
        ("topic", pa.string(), "1"),
        ("why", pa.string(), "1"),
        ("count", pa.int64(), "1"),
        ("first", pa.float64(), "s"),
        ("last", pa.float64(), "s"),
    ],
}
"""Tables that are written only where there is something to write: name, type and unit of their columns."""


def _schema(table: str, planar: bool, turns: bool = False) -> pa.Schema:
    """Build the schema of a table; in the plane lengths and forces have a column per axis, but not links that turn."""
    at = [("run", pa.int32(), "1"), ("time", pa.float64(), "s")]

    def each(name: str, unit: str) -> list[tuple[str, Any, str]]:
        names = [f"{name}_{axis}" for axis in _AXES] if planar else [name]
        return [(n, pa.float64(), unit) for n in names]

    real, label = pa.float64(), pa.dictionary(pa.int32(), pa.string())
    lengths = [(name, real, "m") for name in ("border", "distance")]
    energies = [(name, real, "J") for name in ("work", "loads_work", "dissipation", "jump_loss", "stored")]
    interval = [("start", real, "s"), ("length", real, "s")]
    columns = {
        "ticks": [
            *at,
            *each("net_translation", "m"),
            *energies,
            ("margin", real, "N"),
            ("visited_margin", real, "1"),
            ("unique", pa.bool_(), "1"),
            *[("yaw", real, "rad")] * turns,
        ],
        "contacts": [
            *at,
            ("contact", label, "1"),
            *each("position", "m"),
            *each("gained", "m"),
            *each("ground_force", "N"),
            ("state", pa.int8(), "1"),
        ],
        "links": [
            *at,
            ("link", label, "1"),
            *([("elongation", real, "m")] if turns else each("elongation", "m")),
            *([("tension", real, "N")] if turns else each("tension", "N")),
            *((f"{which}_tension", real, "N") for which in ("least", "greatest")),
        ],
        "joints": [*at, ("joint", label, "1"), ("angle", real, "rad"), ("torque", real, "N m")],
        "slips": [
            ("run", pa.int32(), "1"),
            ("contact", label, "1"),
            ("direction", real, "rad" if planar else "1"),
            *interval,
            ("distance", real, "m"),
        ],
        "jumps": [*at, ("contact", pa.string(), "1"), *lengths, ("loss", real, "J")],
        "cycles": [
            ("run", pa.int32(), "1"),
            ("start", real, "s"),
            ("end", real, "s"),
            *each("translation", "m"),
            ("slip_forward", real, "m"),
            ("slip_backward", real, "m"),
            *energies,
            ("residual", real, "1"),
            ("least_margin", real, "N"),
            ("transient", pa.bool_(), "1"),
            ("cost_of_transport", real, "1"),
            *[("turned", real, "rad")] * turns,
        ],
        **_FOUND,
    }[table]
    return pa.schema([pa.field(name, kind, metadata={"unit": unit}) for name, kind, unit in columns])


class TableWriter:
    """Writes ticks, contacts and links piece by piece; at the end slips, cycles, and jumps, rests, refusals if any.

    The joints of a body that turns have a table of their own.
    """

    def __init__(self, folder: Path, scene: Scene | None) -> None:
        """Store the folder; files are opened with the first piece.

        Args:
            folder: the folder; it is created if it does not exist.
            scene: the scene that ran; None when it is not known.
        """
        self._folder, self._scene = folder, scene
        self._writers: dict[str, parquet.ParquetWriter] = {}
        self._planar = False
        self._turns = scene is not None and scene.body.turning is not None
        self._names: dict[str, list[str]] = {}

    def __call__(self, piece: Piece) -> None:
        """Write the ends of ticks in a piece."""
        if not self._writers:
            self._planar = piece.gained.ndim == 3
            self._open(piece.gained.shape[1], piece.tension.shape[1])
        rows = np.flatnonzero(piece.ends_tick)
        if rows.size == 0:
            return
        # the rows of a tick sum over its ramps
        before = np.append(0, rows[:-1] + 1)
        sums = (piece.work, piece.loads_work, piece.dissipation, piece.jump_loss, piece.gained)
        work, loads_work, dissipation, jump_loss, gained = (np.add.reduceat(v, before) for v in sums)
        visited, unique = np.minimum.reduceat(piece.visited, before), np.logical_and.reduceat(piece.unique, before)
        at = [piece.run[rows], piece.end_ns[rows] / NS]
        numbers = [work, loads_work, dissipation, jump_loss, piece.stored[rows], piece.margin[rows], visited, unique]
        numbers += [np.full(rows.size, np.nan) if piece.yaw is None else piece.yaw[rows]] * self._turns
        self._write("ticks", [*at, *self._axes(piece.net_translation[rows]), *numbers])
        lengths = [piece.position[rows], gained, piece.ground[rows]]
        self._write_long("contacts", at, [a for v in lengths for a in self._axes(v)] + [sliding(gained)])
        self._write_links(piece, rows, at)

    def _write_links(self, piece: Piece, rows: np.ndarray, at: list[np.ndarray]) -> None:
        """Write the links, and of a body that turns the joints, where tensions are known."""
        both = piece.elongation[rows], piece.tension[rows]
        if self._turns and piece.tension.shape[1]:
            count = piece.least.shape[1]
            self._write_long("joints", at, [values[:, count:] for values in both])
            self._write_long("links", at, [*(v[:, :count] for v in both), piece.least[rows], piece.most[rows]])
        elif piece.tension.shape[1]:
            values = [a for v in both for a in self._axes(v)]
            self._write_long("links", at, [*values, piece.least[rows], piece.most[rows]])

    def _open(self, contacts: int, joints: int) -> None:
        self._folder.mkdir(parents=True, exist_ok=True)
        if self._scene is None:
            self._names = {"contacts": name_each("contact", contacts), "links": name_each("link", joints)}
        else:
            names = contact_names(self._scene.body)[:: self._scene.dimension]
            count, both = len(self._scene.body.joints), name_joints(self._scene.body)
            self._names = {"contacts": [n.removesuffix("/x") for n in names]}
            self._names |= {"links": both[:count], "joints": both[count:]}
        for name in ("ticks", "contacts", "links", *["joints"] * self._turns):
            self._open_one(name, _schema(name, self._planar, self._turns))

    def _open_one(self, name: str, schema: pa.Schema) -> None:
        self._writers[name] = parquet.ParquetWriter(self._folder / f"{name}.parquet", schema, compression="zstd")

    def _axes(self, values: np.ndarray) -> list[np.ndarray]:
        return [values[..., 0], values[..., 1]] if self._planar else [values]

    def _write_long(self, name: str, at: list[np.ndarray], values: list[np.ndarray]) -> None:
        """Write a table with a row for each tick and contact or link."""
        rows, count = values[0].shape
        index = pa.array(np.tile(np.arange(count, dtype=np.int32), rows))
        label = pa.DictionaryArray.from_arrays(index, pa.array(self._names[name]))
        columns = [np.repeat(v, count) for v in at]
        self._write(name, [*columns, label, *(v.ravel() for v in values)])

    def _write(self, name: str, columns: list[Any]) -> None:
        self._writers[name].write_table(_table(name, self._planar, columns, self._turns))

    def finish(self, replay: Replay) -> list[str]:
        """Write slips, cycles, jumps, rests and refusals and close the files.

        Args:
            replay: the analysed recording.

        Returns:
            The names of the files.
        """
        if not self._writers:
            self._open(0, 0)
        tables = {"slips": slips_table(replay), "cycles": cycles_table(replay)}
        if self._turns or (self._scene is not None and self._scene.ground.lets_go):
            tables["jumps"] = _table_of_rows("jumps", self._planar, replay.plain_jumps())
        refusals = () if replay.incidents is None else replay.incidents.refusals
        found = {"rests": [rest.as_plain() for rest in replay.rests], "refusals": [asdict(r) for r in refusals]}
        tables |= {name: _table_of_rows(name, self._planar, rows) for name, rows in found.items() if rows}
        for name, table in tables.items():
            self._open_one(name, table.schema)
            self._writers[name].write_table(table)
        for writer in self._writers.values():
            writer.close()
        return [f"{name}.parquet" for name in self._writers]


def slips_table(replay: Replay) -> pa.Table:
    """Build the table of slips.

    Args:
        replay: the analysed recording.

    Returns:
        A row for each slip.
    """
    slips = replay.slips
    label = pa.DictionaryArray.from_arrays(pa.array(slips.contact.astype(np.int32)), pa.array(replay.stations))
    length = (slips.end_ns - slips.start_ns) / NS
    columns = [slips.run, label, slips.direction, slips.start_ns / NS, length, slips.distance]
    return _table("slips", _is_planar(replay), columns)


def cycles_table(replay: Replay) -> pa.Table:
    """Build the table of cycles.

    Args:
        replay: the analysed recording.

    Returns:
        A row for each cycle.
    """
    planar = _is_planar(replay)
    rows = [{"turned": None, **cycle.as_plain()} for cycle in replay.cycles]
    for row in rows if planar else ():
        row["translation_x"], row["translation_y"] = row["translation"]
    return _table_of_rows("cycles", planar, rows, replay.turns)


def _is_planar(replay: Replay) -> bool:
    return replay.table.net_translation.shape[1] == 2


def _table(name: str, planar: bool, columns: list[Any], turns: bool = False) -> pa.Table:
    schema = _schema(name, planar, turns)
    arrays = [
        pa.array(c if isinstance(c, list) else np.ascontiguousarray(c), field.type, from_pandas=True)
        if not isinstance(c, pa.Array)
        else c
        for c, field in zip(columns, schema, strict=True)
    ]
    return pa.Table.from_arrays(arrays, schema=schema)


def _table_of_rows(name: str, planar: bool, rows: list[dict[str, Any]], turns: bool = False) -> pa.Table:
    return _table(name, planar, [[row[field.name] for row in rows] for field in _schema(name, planar, turns)], turns)
