"""Random robots that an imperfect sensor sees, and their identification from a first guess that is 30 % off."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_lab import Measurements, identify
from crawler_lab.identify.identification import Identification
from crawler_model import Scene, simulate

_RATE, _PERIOD, _CYCLES, _WAYPOINTS = 50.0, 2.0, 8, 8
_SPACING, _STIFFNESS, _STROKE = 0.1, 20.0, 0.05
_FRICTION = (0.1, 0.6)
_OFF = 0.3
_WHITE, _TRACKED, _MEMORY, _PIXEL, _LAG = 2e-4, 2.3e-4, 0.9, 5e-4, 0.02
KEYS = ("friction.forward", "friction.backward")


def _white(rng: np.random.Generator, y: np.ndarray) -> np.ndarray:
    return _WHITE * rng.normal(size=y.shape)


def _tracked(rng: np.random.Generator, y: np.ndarray) -> np.ndarray:
    """Noise of a tracker's filter, AR(1), shape (T, N)."""
    found = _TRACKED * rng.normal(size=y.shape)
    for k in range(1, y.shape[0]):
        found[k] = _MEMORY * found[k - 1] + np.sqrt(1.0 - _MEMORY**2) * found[k]
    return found


def _rounded(y: np.ndarray, shift: float = 0.0) -> np.ndarray:
    return _PIXEL * np.rint((y + shift) / _PIXEL) - shift


def _drifted(rng: np.random.Generator, y: np.ndarray) -> np.ndarray:
    return y + np.linspace(-0.5, 0.5, y.shape[0])[:, None] * rng.normal(0.0, 2e-3, y.shape[1]) + _white(rng, y)


def _walked(rng: np.random.Generator, y: np.ndarray) -> np.ndarray:
    return y + (np.cumsum(rng.normal(size=y.shape), axis=0) * 1e-3 / np.sqrt(y.shape[0]) + _white(rng, y))


def _with_outliers(rng: np.random.Generator, y: np.ndarray) -> np.ndarray:
    return y + _white(rng, y) + np.where(rng.random(y.shape) < 0.01, rng.normal(0, 0.02, y.shape), 0.0)


def _with_gaps(rng: np.random.Generator, y: np.ndarray) -> np.ndarray:
    lost = np.logical_or(rng.random(y.shape) < 0.05, rng.random((y.shape[0], 1)) < 0.1)
    return np.where(lost, np.nan, y + _white(rng, y))


_SENSORS: dict[str, Callable[[np.random.Generator, np.ndarray], np.ndarray]] = {
    "white": lambda rng, y: y + _white(rng, y),
    "pixels": lambda rng, y: _rounded(y, float(rng.uniform(0.0, _PIXEL))),
    "tracker, AR(0.9)": lambda rng, y: y + _tracked(rng, y),
    "lag": lambda rng, y: y + _white(rng, y),
    "pixels, tracker, lag": lambda rng, y: _rounded(y + _tracked(rng, y)),
    "linear drift": _drifted,
    "random-walk drift": _walked,
    "1 % outliers": _with_outliers,
    "unequal noise": lambda rng, y: y + _white(rng, y) * rng.uniform(0.3, 3.0, y.shape[1]),
    "scale": lambda rng, y: y * (1.0 + rng.normal(0.0, 3e-3)) + _white(rng, y),
    "dropped frames": _with_gaps,
    "nine digits": lambda rng, y: np.round(y, 9),
}
"""What each kind of sensor measures, shape (T, N) [m], of positions of the same shape."""
KINDS = tuple(_SENSORS)
WALKED = "walked before, white noise"
"""A kind of record, for which `cut_robot` measures."""


def build_robot(seed: int) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """Draw a robot of three to five contacts and periodic commands.

    Args:
        seed: of the random numbers.

    Returns:
        The scene's document without a drive, the times of the commands, shape (K,) [s], and the commands, shape
        (K, links) [m].
    """
    rng = np.random.default_rng(seed)
    contacts = 3 + seed % 3
    document = {
        "name": f"robot_{seed}",
        "start": "relaxed",
        "body": {
            "contacts": [_SPACING * i for i in range(contacts)],
            "links": {"stiffness": rng.uniform(0.7 * _STIFFNESS, 1.3 * _STIFFNESS, contacts - 1).tolist()},
        },
        "friction": {side: rng.uniform(*_FRICTION, contacts).tolist() for side in ("forward", "backward")},
    }
    turn = 2.0 * np.pi * np.arange(_WAYPOINTS * _CYCLES + 1)[:, None] / _WAYPOINTS
    phase = rng.uniform(0.0, 2.0 * np.pi, contacts - 1)
    rows = rng.uniform(0.5, 1.0, contacts - 1) * _STROKE * (np.sin(turn + phase) - np.sin(phase))
    return document, np.arange(rows.shape[0]) * _PERIOD / _WAYPOINTS, rows


def measure_robot(seed: int, kind: str) -> tuple[dict[str, Any], Measurements]:
    """Simulate a robot and measure it.

    Args:
        seed: of the robot and of its noise.
        kind: of the sensor, one of `KINDS`.

    Returns:
        The true scene's document, and the measurements.
    """
    document, times, rows = build_robot(seed)
    scene = Scene.model_validate(document | {"drive": {"times": times.tolist(), "actuation": rows.tolist()}})
    run = simulate(scene, float(times[-1]), _RATE)
    x, rng = scene.body.position + run.displacement, np.random.default_rng([seed, KINDS.index(kind)])
    values = _SENSORS[kind](rng, x + rng.uniform(-0.01, 0.01, x.shape[1]))
    names = tuple(f"contact_{i}" for i in range(x.shape[1]))
    commanded = tuple(f"link_{j}" for j in range(rows.shape[1]))
    shown = run.time + (_LAG if "lag" in kind else 0.0)
    return document, Measurements(f"{kind} {seed}", shown, names, values, commanded, rows, times)


def cut_robot(seed: int) -> tuple[dict[str, Any], Measurements]:
    """Measure a robot that walked before its record began, with white noise and unknown offsets.

    Args:
        seed: of the robot and of its noise.

    Returns:
        The true scene's document without a start, and the measurements.
    """
    document, measured = measure_robot(seed, "white")
    first = int(np.searchsorted(measured.command_time, _PERIOD)) + 1 + seed % _WAYPOINTS
    begin = measured.command_time[first]
    kept = measured.time >= begin - 1e-9
    cut = dataclasses.replace(
        measured,
        time=measured.time[kept] - begin,
        values=measured.values[kept],
        commands=measured.commands[first:],
        command_time=measured.command_time[first:] - begin,
    )
    del document["start"]
    return document, cut


def count_inside(document: dict[str, Any], found: Identification) -> tuple[int, int]:
    """Count the intervals of frictions, and of their sums once, and how many of them contain the truth.

    Args:
        document: the true scene's document.
        found: the identification.

    Returns:
        How many contain it, and how many there are; a lower bound counts as an interval.
    """
    seen: dict[frozenset[str], bool] = {}
    for p in found.parameters:
        low, high = p.interval
        names = frozenset((p.name, *p.partners))
        if low is not None:
            true = sum(_friction(document, name) for name in names)
            seen[names] = low <= true * (1.0 + 1e-9) and (high is None or true <= high)
    return sum(seen.values()), len(seen)


def _friction(document: dict[str, Any], name: str) -> float:
    side, index = name.removeprefix("friction.").removesuffix("]").split("[")
    return float(document["friction"][side][int(index)])


def guess_robot(document: dict[str, Any], seed: int) -> Scene:
    """Build a first guess: friction up to 30 % off.

    Args:
        document: the true scene's document.
        seed: of the random numbers.

    Returns:
        The scene.
    """
    rng = np.random.default_rng([seed, 99])
    friction = {
        side: (np.array(true) * rng.uniform(1.0 - _OFF, 1.0 + _OFF, len(true))).tolist()
        for side, true in document["friction"].items()
    }
    return Scene.model_validate(document | {"friction": friction})


def identify_robot(seed: int, kind: str, seconds: float = 10.0) -> dict[str, Any]:
    """Identify one robot.

    Args:
        seed: of the robot.
        kind: of the sensor, or `WALKED`.
        seconds: as for `identify` [s].

    Returns:
        Kind, number of intervals (of a sum once), how many contain the truth, their half widths relative to the values [1], the largest
        misfit in units of noise, whether the residuals are called noise, and the time [s].
    """
    document, measured = cut_robot(seed) if kind == WALKED else measure_robot(seed, kind)
    begin = time.perf_counter()
    found = identify(guess_robot(document, seed), [measured], KEYS, hold_out=0.0, seconds=seconds)
    spent = time.perf_counter() - begin
    inside, widths, seen = 0, [], set()
    for p in found.parameters:
        low, high = p.interval
        names = frozenset((p.name, *p.partners))
        if p.verdict not in ("identified", "sum") or low is None or high is None or names in seen:
            continue
        seen.add(names)
        true = sum(_friction(document, name) for name in names)
        inside += low <= true <= high
        widths.append(0.5 * (high - low) / true)
    return {
        "kind": kind,
        "intervals": len(widths),
        "inside": inside,
        "half_widths": widths,
        "ratio": max(m.ratio for m in found.misfits),
        "fits": found.model_fits,
        "seconds": spent,
    }
