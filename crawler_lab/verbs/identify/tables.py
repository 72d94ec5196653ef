"""Measurements from tables: which columns are measured and commanded, when, and in which units."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from crawler_model.scene.scene import Scene

from ...identify.measurements import MeasurementError, Measurements, channel_names, check_times
from .cells import MOST_NAMED, Table, open_table, read_numbers
from .options import SI, Units

_COMMAND = "command/"


def read_table(
    path: Path,
    scene: Scene,
    columns: Mapping[str, str] | None = None,
    units: Units = SI,
    commands: Path | None = None,
) -> Measurements:
    """Read a CSV or Parquet table of measurements.

    Args:
        path: the table: `time`, positions `contact_i` or elongations `link_j`, commands `command/link_j`. A notice
            lists other columns: one of them may be misspelt.
        scene: the scene that was measured.
        columns: names in the tables by these names, where they differ.
        units: of times and lengths in both tables; strains are pure numbers, forces are in N.
        commands: a table with `time` and the commands, on the same clock, which replaces those in the first table.

    Returns:
        The measurements. A value is NaN where it is missing. Rows in which no command is given are no commands: these
        are straight between the others.

    Raises:
        MeasurementError: with one line about the first problem.
    """
    tables = [open_table(one) for one in (path, commands) if one is not None]
    _check_columns(scene, tables, columns or {})
    tables = [rename_columns(table, columns or {}) for table in tables]
    first = tables[0]
    _check_time(first)
    known = channel_names(scene)
    looks = ("contact_", "link_")
    channels = [n for n in first.names if n in known or (n.startswith(looks) and "/" not in n)]
    names = _commands_of(first) if commands is None else []
    numbers = read_numbers(first, ["time", *channels, *names])
    filled = np.isfinite(numbers).any(axis=1)  # spreadsheets write rows without contents
    numbers, number_of_row = numbers[filled], first.rows[filled]
    time, values, rows = np.split(numbers, [1, 1 + len(channels)], axis=1)
    check_times(path.name, "time", time[:, 0], number_of_row)
    command_time = time
    if commands is not None:
        names, command_time, rows = _read_commands(tables[1])
        number_of_row = tables[1].rows
    command_time, rows = _given(tables[-1].path.name, names, command_time[:, 0], rows, number_of_row)
    list_unread(first, ["time", *channels, *_commands_of(first)])
    if commands is not None:
        list_unread(tables[1], ["time", *names])
    layout = scene.columns
    lengths = [_COMMAND + name for name in layout.names[: int(layout.actuation_sizes[: layout.links].sum())]]
    return Measurements(
        path.name,
        time[:, 0] / units.per_second,
        tuple(channels),
        values / units.per_metre,
        tuple(name.removeprefix(_COMMAND) for name in names),
        rows / np.array([units.per_metre if name in lengths else 1.0 for name in names]),
        command_time / units.per_second,
    )


def _check_columns(scene: Scene, tables: list[Table], columns: Mapping[str, str]) -> None:
    """Check that the scene knows each mapped column, and that the table that should contain it does."""
    known = ("time", *channel_names(scene), *(_COMMAND + name for name in scene.columns.names))
    for ours, theirs in columns.items():
        option = f"--columns {ours}={theirs}"
        if ours not in known:
            raise MeasurementError(f"{option}: {ours} does not belong to {scene.name}, which has {', '.join(known)}")
        places = tables if ours == "time" else tables[-1:] if ours.startswith(_COMMAND) else tables[:1]
        if not any(theirs in table.names for table in places):
            raise MeasurementError(
                f"{option}: {places[0].path.name} has no column {theirs}; its header is {places[0].header}"
            )


def rename_columns(table: Table, columns: Mapping[str, str]) -> Table:
    """Give the columns our names; a column of our name is not used where another takes its place.

    Args:
        table: the table.
        columns: names in the table by ours.

    Returns:
        The table with our names.
    """
    here = {theirs: ours for ours, theirs in columns.items() if theirs in table.names}
    taken = set(here.values())
    names = (here.get(name, "" if name in taken else name) for name in table.names)
    return dataclasses.replace(table, names=tuple(names))


def _check_time(table: Table) -> None:
    if "time" not in table.names:
        raise MeasurementError(
            f"{table.path}: no column `time`; the header is {table.header}, it must be like time,contact_0,..., "
            "command/link_0,..., or name the column with --columns time=..."
        )


def _commands_of(table: Table) -> list[str]:
    return [name for name in table.names if name.startswith(_COMMAND)]


def _read_commands(table: Table) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Read a table of commands: names of the columns, times, shape (K, 1), and commands, shape (K, C)."""
    _check_time(table)
    names = _commands_of(table)
    if not names:
        raise MeasurementError(
            f"{table.path}: no column `command/...`; the header is {table.header}, it must be like "
            "time,command/link_0,..., or name the columns with --columns command/link_0=..."
        )
    numbers = read_numbers(table, ["time", *names])
    return names, numbers[:, :1], numbers[:, 1:]


def list_unread(table: Table, read: Sequence[str]) -> None:
    """List the columns of a table that are not used, because one may be misspelt, on standard error.

    Args:
        table: the table.
        read: names of the columns that are used.
    """
    unread = [name for name in table.names if name and name not in read]
    if unread:
        more = f" and {len(unread) - MOST_NAMED} more" if len(unread) > MOST_NAMED else ""
        print(f"crawler: {table.path.name}: columns not used: {', '.join(unread[:MOST_NAMED])}{more}", file=sys.stderr)


def _given(
    table: str, names: list[str], time: np.ndarray, rows: np.ndarray, numbers: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Select the rows in which commands are given, with their times; all commands of a row, or none."""
    if not names:
        return np.zeros(0), np.zeros((0, 0))
    missing = np.isnan(rows)
    given = ~missing.all(axis=1)
    if not given.any():
        raise MeasurementError(f"{table}: no row has a command; fill in {names[0]}, or leave out such columns")
    partly = np.flatnonzero(given & missing.any(axis=1))
    if partly.size:
        row = int(partly[0])
        raise MeasurementError(
            f"{table}: {names[int(np.argmax(missing[row]))]} is missing in row {numbers[row]} (time {time[row]:g}), "
            "other commands are not; give all commands of a row, or none"
        )
    return time[given], rows[given]
