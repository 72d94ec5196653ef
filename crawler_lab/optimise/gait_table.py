"""A gait as people read it: a table by name and time, and the names of its numbers."""

from __future__ import annotations

import csv
import io
import re
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from crawler_model import Scene

_NUMBER = re.compile(r"drive\.(actuation|friction\.isotropic)\[(\d+)\]\[(\d+)\](?:\[(\d+)\])?")
_NOUNS = {"m": "length", "rad": "angle", "1": "strain"}


def tabulate_gait(scene: Scene) -> tuple[list[str], list[list[float]]]:
    """Tabulate the drive of a scene.

    Args:
        scene: the scene that plays the gait.

    Returns:
        Heads with units: the time, each link, segment and joint, and what else changes; and a row for each waypoint.
    """
    drive, columns = scene.drive, scene.columns
    shown = [i for i in range(columns.count) if i < columns.lengths or np.ptp(drive.rows[:, i]) > 0.0]
    heads = ["time [s]", *(f"{columns.names[i]} [{_unit_of(scene, i)}]" for i in shown)]
    return heads, np.column_stack((drive.times, drive.rows[:, shown])).tolist()


def describe_gait(scene: Scene, most: int) -> list[str]:
    """Write a gait in aligned columns.

    Args:
        scene: the scene that plays the gait.
        most: the largest number of waypoints.

    Returns:
        The lines.
    """
    heads, rows = tabulate_gait(scene)
    cells = [heads, *([f"{value:.6g}" for value in row] for row in rows[:most])]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = ["  " + "  ".join(f"{cell:>{w}}" for cell, w in zip(row, widths, strict=True)) for row in cells]
    return lines + ([f"  ... and {len(rows) - most} more waypoints"] if len(rows) > most else [])


def format_gait(scene: Scene, suffix: str) -> str:
    """Write a gait as a table.

    Args:
        scene: the scene that plays the gait.
        suffix: .csv, or .md for Markdown.

    Returns:
        The text of the file.
    """
    heads, rows = tabulate_gait(scene)
    if suffix == ".csv":
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows([heads, *rows])
        return stream.getvalue()
    cells = [heads, ["---:"] * len(heads), *([f"{value:.6g}" for value in row] for row in rows)]
    return "".join(f"| {' | '.join(row)} |\n" for row in cells)


def name_number(scene: Scene, key: str) -> str:
    """Name a number of a gait by what it commands, and when.

    Args:
        scene: the scene with the gait.
        key: a dotted key.

    Returns:
        For example "strain of trunk at 0.5 s" for `drive.actuation[1][4]`; the key itself for other numbers.
    """
    found = _NUMBER.fullmatch(key)
    if found is None:
        return key
    columns, time = scene.columns, scene.drive.times[int(found[2])]
    place = int(found[3]) if found[4] is None else 2 * int(found[3]) + int(found[4])
    if found[1] != "actuation":
        return f"friction of contact_{place} at {time:.6g} s"
    return f"{_NOUNS[_unit_of(scene, place)]} of {columns.names[place]} at {time:.6g} s"


def _unit_of(scene: Scene, column: int) -> str:
    """Write the unit of a column of commands."""
    columns, part = scene.columns, scene.columns.names[column].split("/")[0]
    if column >= columns.lengths:
        return "N/m" if part in [name for name, _, _ in columns.segments] else "N"
    return "m" if part.startswith("link_") else "1" if columns.joints is None else "rad"
