"""How the options of a command describe a table: its names of columns, and its units."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass

from crawler_model import CrawlerError

_PER_METRE = {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6}
_PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6}
_KINDS = {"length": _PER_METRE, "time": _PER_SECOND}


@dataclass(frozen=True)
class Units:
    """Units of a table.

    Attributes:
        length: of positions, elongations and commanded changes of lengths: m, cm, mm or um.
        time: s, ms or us.
    """

    length: str = "m"
    time: str = "s"

    @property
    def per_metre(self) -> float:
        """Number of units of length in a metre."""
        return _PER_METRE[self.length]

    @property
    def per_second(self) -> float:
        """Number of units of time in a second."""
        return _PER_SECOND[self.time]


SI = Units()


def parse_units(text: str) -> Units:
    """Parse the `--units` option.

    Args:
        text: a unit of length, a unit of time, or both with a comma between them.

    Returns:
        The units; m or s where none is given.

    Raises:
        CrawlerError: with one line that describes the correct form.
    """
    found: dict[str, str] = {}
    for unit in text.split(","):
        unit = unit.strip()
        kind = next((kind for kind, known in _KINDS.items() if unit in known), None)
        if kind is None:
            known = " or ".join(f"a unit of {kind} ({', '.join(units)})" for kind, units in _KINDS.items())
            raise CrawlerError(f"--units {text}: {unit!r} is not known; write {known}, or both: mm,ms")
        if kind in found:
            raise CrawlerError(f"--units {text}: {found[kind]} and {unit} are both units of {kind}; write one of them")
        found[kind] = unit
    return Units(**found)


def parse_columns(texts: Sequence[str]) -> dict[str, str]:
    """Parse the `--columns` options.

    Args:
        texts: each one or several OURS=THEIRS, with commas between them; one that contains a comma is quoted.

    Returns:
        The names in the table by our names.

    Raises:
        CrawlerError: with one line that describes the correct form, or names a column that occurs twice.
    """
    found: dict[str, str] = {}
    for text in texts:
        for pair in next(csv.reader([text], skipinitialspace=True), []):
            ours, _, theirs = (part.strip() for part in pair.partition("="))
            if not ours or not theirs:
                raise CrawlerError(f"--columns {text}: write OURS=THEIRS, for example contact_0=HeadX,time=t")
            if ours in found:
                raise CrawlerError(f"--columns: {ours} is mapped twice, to {found[ours]} and to {theirs}")
            other = next((name for name, taken in found.items() if taken == theirs), None)
            if other is not None:
                raise CrawlerError(f"--columns: {theirs} is mapped twice, to {other} and to {ours}")
            found[ours] = theirs
    return found
