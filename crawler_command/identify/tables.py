"""Measurements from CSV and Parquet tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import Measurements
from crawler_model.errors import LARGEST
from crawler_model.identify.measurements import MeasurementError, channel_names
from crawler_model.scene.scene import Scene

_COMMAND = "command/"


def read_table(path: Path, scene: Scene) -> Measurements:
    """Read a CSV or Parquet table of measurements.

    Args:
        path: the table: `time` (s), positions `contact_i` or elongations `link_j` (m), commands `command/link_j` (m).
            Other columns are not used.
        scene: the scene that was measured.

    Returns:
        The measurements.

    Raises:
        MeasurementError: with one line about the first problem.
    """
    import pyarrow as pa
    from pyarrow import csv, parquet

    if not path.is_file():
        raise MeasurementError(f"{path}: no such file")
    try:
        table: Any = csv.read_csv(path) if path.suffix == ".csv" else parquet.read_table(path)
        names = [str(name).strip() for name in table.column_names]
    except (pa.ArrowException, UnicodeDecodeError) as error:
        kind = "CSV" if path.suffix == ".csv" else "Parquet"
        raise MeasurementError(f"{path}: not a {kind} table with a header ({error})") from None
    if "time" not in names:
        raise MeasurementError(
            f"{path}: no column `time`; the header is {','.join(names[:6])}, it must be like time,contact_0,..., "
            "command/link_0,..."
        )
    known = channel_names(scene)
    looks = ("contact_", "link_")
    channels = [n for n in names if n in known or (n.startswith(looks) and "/" not in n)]
    commands = [n for n in names if n.startswith(_COMMAND)]

    def read(wanted: list[str]) -> np.ndarray:
        columns = [_numbers(path, table.column(names.index(name)), name) for name in wanted]
        return np.column_stack(columns) if columns else np.zeros((table.num_rows, 0))

    return Measurements(
        path.name,
        read(["time"])[:, 0],
        tuple(channels),
        read(channels),
        tuple(name.removeprefix(_COMMAND) for name in commands),
        read(commands),
    )


def _numbers(path: Path, column: Any, name: str) -> np.ndarray:
    """Convert a column to float64; an empty cell becomes NaN."""
    import pyarrow as pa

    try:
        values = np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64)
        beyond = np.flatnonzero(np.abs(values) > LARGEST)
        if beyond.size:
            row = int(beyond[0])
            raise MeasurementError(
                f"{path.name}: column {name}, row {row}: {values[row]:g}; it must be at most {LARGEST:g} in size"
            )
        return values
    except pa.ArrowException:
        rows = column.to_pylist()

        def is_number(value: object) -> bool:
            try:
                float(str(value))
            except ValueError:
                return value is None
            return True

        row = next((i for i, value in enumerate(rows) if not is_number(value)), 0)
        raise MeasurementError(f"{path.name}: column {name}, row {row}: {rows[row]!r} is not a number") from None
