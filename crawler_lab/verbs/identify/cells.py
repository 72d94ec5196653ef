"""Cells of CSV and Parquet tables as numbers, whichever program wrote them."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model.errors import LARGEST
from crawler_model.scene.text import decode_text

from ...identify.measurements import MeasurementError

PARQUET = ".parquet"
_DELIMITERS = ("\t", ";", ",")
"""In this order: names may contain commas where another delimiter separates them."""
MOST_NAMED = 12
"""Columns of a table that a message lists."""
_BEGINS_COMMENT = ("#", '"#')


@dataclass(frozen=True, eq=False)
class Table:
    """Cells that are not yet converted.

    Attributes:
        path: the file.
        names: of the columns in the header, shape (C,).
        cells: a pyarrow table of R rows and C columns; text, or what a Parquet file contains.
        rows: numbers of the rows, shape (R,): of their lines in a CSV file, where the first line is 1, or of the rows
            of a Parquet file, which count from 0.
        decimal_commas: whether a number may have a decimal comma, because no comma separates the columns.
    """

    path: Path
    names: tuple[str, ...]
    cells: Any
    rows: np.ndarray
    decimal_commas: bool

    @property
    def header(self) -> str:
        """The first names of the header, for messages."""
        return ",".join(self.names[:MOST_NAMED]) + (",..." if len(self.names) > MOST_NAMED else "")


def open_table(path: Path, headless: Sequence[str] = ()) -> Table:
    """Open a CSV table (delimiter `,`, `;` or tab, comments after `#`, UTF-8) or a Parquet table.

    Args:
        path: the file; a name that ends in .parquet is Parquet, any other CSV.
        headless: names of the first columns of a CSV table that may begin with numbers instead of a header.

    Returns:
        The table.

    Raises:
        MeasurementError: if the file does not exist or is no such table.
    """
    import pyarrow as pa
    from pyarrow import parquet

    if not path.is_file():
        raise MeasurementError(f"{path}: no such file")
    kind = "Parquet" if path.suffix.lower() == PARQUET else "CSV"
    try:
        if kind == "CSV":
            return _open_csv(path, headless)
        cells = parquet.read_table(path)
        names = tuple(str(name).strip() for name in cells.column_names)
        return Table(path, names, cells, np.arange(cells.num_rows), False)
    except MeasurementError:
        raise
    except (pa.ArrowException, csv.Error, ValueError, OSError) as error:
        reason = str(error).partition("\n")[0]  # pyarrow shows the row, which may contain quoted line breaks
        raise MeasurementError(f"{path}: not a {kind} table with a header ({reason})") from None


def _open_csv(path: Path, headless: Sequence[str]) -> Table:
    """Read all cells as text; the header determines the delimiter."""
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    text = io.StringIO(decode_text(path.read_bytes()), newline=None).read()  # whatever ends its lines
    lines = list(enumerate(text.split("\n"), 1))
    lines = [(k, line) for k, line in lines if line.strip() and not line.lstrip().startswith(_BEGINS_COMMENT)]
    header = lines[0][1] if lines else ""
    splits = {one: next(csv.reader([header], delimiter=one), []) for one in _DELIMITERS}
    delimiter = next((one for one in _DELIMITERS if len(splits[one]) > 1), ",")
    names = tuple(name.strip() for name in splits[delimiter])
    if headless and names and all(_is_number(name.replace(",", ".")) for name in names):
        names = (*headless, *(f"column {place}" for place in range(len(headless), len(names))))[: len(names)]
    else:
        lines = lines[1:]
    numbered = [str(place) for place in range(len(names))]  # because names may occur twice
    rows = np.array([k for k, _ in lines], np.int64)
    if not rows.size:
        return Table(path, names, pa.table({place: pa.array([], pa.string()) for place in numbered}), rows, False)
    wrong: list[Any] = []

    def note_wrong(row: Any) -> str:
        wrong.append(row)
        return "error"

    try:
        cells = arrow_csv.read_csv(
            io.BytesIO("\n".join(line for _, line in lines).encode()),
            read_options=arrow_csv.ReadOptions(column_names=numbered, use_threads=False),  # an error then has its row
            parse_options=arrow_csv.ParseOptions(delimiter=delimiter, invalid_row_handler=note_wrong),
            convert_options=arrow_csv.ConvertOptions(column_types=dict.fromkeys(numbered, pa.string())),
        )
    except pa.ArrowInvalid:
        if not wrong or wrong[0].number is None:
            raise
        raise MeasurementError(
            f"{path}: row {rows[wrong[0].number - 1]} has {wrong[0].actual_columns} cells, the header has {len(names)}"
        ) from None
    return Table(path, names, cells, rows, delimiter != ",")


def read_numbers(table: Table, names: Sequence[str]) -> np.ndarray:
    """Convert columns to numbers.

    Args:
        table: the table, with R rows.
        names: of the columns, shape (M,).

    Returns:
        Shape (R, M), in the units of the table; NaN where a cell is empty or a marker of a missing value.

    Raises:
        MeasurementError: with the column and the row of the first cell that is neither, if a column is given twice, or
            if a number is too large.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    name = table.path.name
    twice = next((one for one in names if table.names.count(one) > 1), None)
    if twice is not None:
        raise MeasurementError(f"{name}: column {twice} is given twice")
    cells = {one: _tidy(name, one, table.cells.column(table.names.index(one))) for one in names}
    texts = [column for column in cells.values() if pa.types.is_string(column.type)]
    found = {mark: sum(pc.sum(pc.match_substring(text, mark)).as_py() or 0 for text in texts) for mark in ",."}
    commas = table.decimal_commas and found[","] > found["."]  # the others are then mistakes, and named
    columns = [_convert(table, one, column, commas) for one, column in cells.items()]
    return np.column_stack(columns) if columns else np.zeros((table.cells.num_rows, 0))


def _tidy(table: str, name: str, column: Any) -> Any:
    """Trim text and remove markers of missing values from it; numbers remain as they are."""
    import pyarrow as pa
    import pyarrow.compute as pc
    from pyarrow import csv

    if pa.types.is_integer(column.type) or pa.types.is_floating(column.type) or pa.types.is_decimal(column.type):
        return column
    markers = {marker.lower() for marker in (*csv.ConvertOptions().null_values, "-", "none")}
    try:
        text = pc.utf8_trim_whitespace(column.cast(pa.string()))
    except pa.ArrowException:
        raise MeasurementError(f"{table}: column {name} has the type {column.type}; it must contain numbers") from None
    return pc.if_else(pc.is_in(pc.utf8_lower(text), value_set=pa.array(sorted(markers))), None, text)


def _convert(table: Table, name: str, column: Any, commas: bool) -> np.ndarray:
    """Convert a tidy column to float64, shape (R,); text with decimal commas, or with decimal points."""
    import pyarrow as pa
    import pyarrow.compute as pc

    plain = column
    if commas and pa.types.is_string(column.type):  # a point becomes what no number contains: a table has one mark
        plain = pc.replace_substring(pc.replace_substring(column, ".", "?"), ",", ".")
    try:
        values = np.asarray(plain.cast(pa.float64(), safe=False).to_numpy(), dtype=np.float64)
    except pa.ArrowException:
        row = next((row for row, cell in enumerate(plain.to_pylist()) if not _is_number(cell)), 0)
        mark = " with a decimal comma, as most in this table" if commas else ""
        raise MeasurementError(
            f"{table.path.name}: column {name}, row {table.rows[row]}: {column[row].as_py()!r} is not a number{mark}"
        ) from None
    beyond = np.flatnonzero(np.abs(values) > LARGEST)
    if beyond.size:
        row = int(beyond[0])
        raise MeasurementError(
            f"{table.path.name}: column {name}, row {table.rows[row]}: {values[row]:g}; it must be at most {LARGEST:g} "
            "in size"
        )
    return values


def _is_number(cell: str | None) -> bool:
    try:
        float(cell or 0.0)
    except ValueError:
        return False
    return True
