"""Tables on terminals that are narrower than they are."""

from __future__ import annotations

import io

import pytest
from rich.table import Table

from crawler_command.screen import Screen

COLUMNS = ["time [s]", "translation [m]", "work [J]", "residual"]
ROWS = [[f"{k}.123456789", f"0.{k}53456789012", f"{k}e-10", "transient" if k == 0 else ""] for k in range(7)]


def printed(width: int) -> str:
    table = Table(title="seven cycles", title_justify="left")
    for column in COLUMNS:
        table.add_column(column, justify="right")
    for row in ROWS:
        table.add_row(*row)
    stream = io.StringIO()
    Screen(file=stream, width=width).print(table)
    return stream.getvalue()


@pytest.mark.parametrize("width", [40, 50, 60, 120])
def test_no_number_is_cut(width):
    text = printed(width)
    assert "…" not in text
    assert all(len(line) <= width for line in text.splitlines())
    assert all(cell in text for row in ROWS for cell in row)
    assert text.count("seven cycles") == 1


def test_a_table_that_fits_stays_upright():
    wide, narrow = (printed(width).splitlines() for width in (120, 40))
    assert "translation [m]" in wide[2]
    assert "time [s]" in wide[2]
    assert all("time [s]" not in line for line in narrow if "translation [m]" in line)
