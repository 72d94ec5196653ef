"""The option `--sensor`: what is known about a sensor before the fit."""

from __future__ import annotations

import re
from collections.abc import Sequence

from crawler_model import CrawlerError, Prior, Sensor

_UNITS = {
    "lag": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "scale": {"%": 1e-2, "": 1.0},
    "drift": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6},
    "gain": {"%": 1e-2, "": 1.0},
}
_NUMBER = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([a-z%]*)")
_FORM = "write lag=20ms, scale=0.2%, drift=1mm or gain=1% for an uncertainty, lag=43ms+-5ms, or lag=fix:43ms to hold it"


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
            found = {name: Prior(0.0, 0.0) for name in _UNITS} | found
            continue
        name, _, value = part.partition("=")
        if name not in _UNITS or not value:
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
    units = _UNITS[name]
    if match is None or match[2] not in units:
        known = ", ".join(unit or "none" for unit in units)
        raise CrawlerError(f"--sensor {part}: {text!r} is not a number with its unit ({known}); {_FORM}")
    return float(match[1]) * units[match[2]]
