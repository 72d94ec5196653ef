"""How the options of a command describe a table, by names of columns and units, and the sensor that measured."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from typing import NamedTuple

from crawler_model import CrawlerError

from ...identify.sensor.sensor import Prior, Sensor

_UNITS = {"length": {"m": 1.0, "cm": 1e2, "mm": 1e3, "um": 1e6}, "time": {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}}
"""Units of a table, by kind, and how many of them are one SI unit."""
_SENSOR_UNITS = {
    "lag": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "scale": {"%": 1e-2, "": 1.0},
    "drift": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "gain": {"%": 1e-2, "": 1.0},
    "place": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
}
"""Units of a property of the sensors, by its name, and how much each is in SI units."""
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-z%]*)")
_FORM = "write lag=20ms, scale=0.2%, drift=1mm or gain=1% for an uncertainty, lag=43ms+-5ms, or lag=fix:43ms to hold it"


class Units(NamedTuple):
    """Units of a table: of its times, and of positions, elongations and commanded changes of lengths."""

    per_metre: float = 1.0
    """Number of units of length in a metre."""
    per_second: float = 1.0
    """Number of units of time in a second."""


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
        kind = next((kind for kind, known in _UNITS.items() if unit in known), None)
        if kind is None:
            known = " or ".join(f"a unit of {kind} ({', '.join(units)})" for kind, units in _UNITS.items())
            raise CrawlerError(f"--units {text}: {unit!r} is not known; write {known}, or both: mm,ms")
        if kind in found:
            raise CrawlerError(f"--units {text}: {found[kind]} and {unit} are both units of {kind}; write one of them")
        found[kind] = unit
    return Units(_UNITS["length"][found.get("length", "m")], _UNITS["time"][found.get("time", "s")])


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


def parse_sensor(texts: Sequence[str]) -> Sensor:
    """Parse the `--sensor` options.

    Args:
        texts: each one or several NAME=VALUE, with commas between them; `perfect` holds all at 0.

    Returns:
        The priors; wide ones for what is not named.

    Raises:
        CrawlerError: with one line that describes the correct form.
    """
    found: dict[str, Prior] = {}
    for part in (part.strip() for text in texts for part in text.split(",") if part.strip()):
        if part == "perfect":
            found = {name: Prior(0.0, 0.0) for name in _SENSOR_UNITS} | found
            continue
        name, _, value = part.partition("=")
        if name not in _SENSOR_UNITS or not value:
            raise CrawlerError(f"--sensor {part}: {_FORM}")
        if value.startswith("fix:"):
            found[name] = Prior(_parse(part, name, value.removeprefix("fix:")), 0.0)
        elif "+-" in value:
            mean, _, deviation = value.partition("+-")
            found[name] = Prior(_parse(part, name, mean), _parse(part, name, deviation))
        else:
            found[name] = Prior(0.0, _parse(part, name, value))
    return Sensor(**found)


def _parse(part: str, name: str, text: str) -> float:
    """Convert a number with its unit to SI units."""
    match = _NUMBER.fullmatch(text.strip())
    units = _SENSOR_UNITS[name]
    if match is None or match[2] not in units:
        known = ", ".join(unit or "none" for unit in units)
        raise CrawlerError(f"--sensor {part}: {text!r} is not a number with its unit ({known}); {_FORM}")
    return float(match[1]) * units[match[2]]
