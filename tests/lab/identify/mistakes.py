"""Robots and tables that are not what they are taken for: mistakes of persons, and robots that fail or differ."""

from __future__ import annotations

import copy
import dataclasses
import itertools
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_lab import Identification, Measurements, identify
from crawler_model import Scene, simulate

from .dynamics import step
from .laboratory import KEYS, build_robot, guess_robot, measure_robot

_RATE, _NOISE = 50.0, 2e-4
Change = Callable[[Measurements], Measurements]
Failure = Callable[[np.random.Generator, dict[str, Any], np.ndarray, np.ndarray], str]
"""Changes the document of a robot and its commands; returns a pattern of the explanation that should be the first."""


def _negate(measured: Measurements, links: slice) -> Measurements:
    commands = measured.commands.copy()
    commands[:, links] *= -1.0
    return dataclasses.replace(measured, commands=commands)


def _exchange(rows: np.ndarray) -> np.ndarray:
    return rows[:, [1, 0, *range(2, rows.shape[1])]]


def _end(measured: Measurements) -> Measurements:
    end = 2 * measured.command_time.size // 3
    return dataclasses.replace(measured, commands=measured.commands[:end], command_time=measured.command_time[:end])


def _lens(values: np.ndarray) -> np.ndarray:
    """Bend positions by 5 mm where they are farthest from the middle of a picture of 1 m."""
    place = (values - values.mean()) / 0.5
    return values + 5e-3 * place**3 / np.abs(place).max() ** 3


_TABLES: dict[str, tuple[Change, str]] = {
    "all commands negated": (
        lambda m: _negate(m, slice(None)),
        "all commands are negated|positions increase the other",
    ),
    "one command negated": (lambda m: _negate(m, slice(0, 1)), "command/link_0 is negated"),
    "two commands exchanged": (
        lambda m: dataclasses.replace(m, commands=_exchange(m.commands)),
        "command/link_0 and command/link_1 are exchanged",
    ),
    "two columns exchanged": (
        lambda m: dataclasses.replace(m, values=_exchange(m.values)),
        "contact_0 and contact_1 are exchanged",
    ),
    "positions in cm": (
        lambda m: dataclasses.replace(m, values=100.0 * m.values),
        "positions are 0.01 times|commanded lengths are 100 times",
    ),
    "clock 0.7 s late": (lambda m: dataclasses.replace(m, time=m.time + 0.7), "the clock of the positions is 0.[67]"),
    "29.97 frames read as 30": (
        lambda m: dataclasses.replace(m, time=m.time * 30.0 / 29.97),
        r"the clock of the positions runs 1\.00",
    ),
    "commands end early": (_end, "the commands end early"),
    "a lens, 5 mm": (lambda m: dataclasses.replace(m, values=_lens(m.values)), "a lens"),
}
"""Mistakes in the record of a right model, and a pattern of the explanation that should be the first."""


def _begin_late(rng: np.random.Generator, times: np.ndarray) -> int:
    """Draw the row from which on something fails."""
    return int(rng.integers(round(0.35 * times.size), round(0.8 * times.size)))


def _stick(rng: np.random.Generator, document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> str:
    link, first = int(rng.integers(rows.shape[1])), _begin_late(rng, times)
    rows[first:, link] = rows[first, link]
    return f"link_{link} does not move from|stroke of link_{link} from"


def _glue(rng: np.random.Generator, document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> str:
    first = _begin_late(rng, times)
    contact = int(rng.integers(rows.shape[1] + 1))
    factor = np.ones((times.size, rows.shape[1] + 1))
    factor[first:, contact] = 30.0
    _command_friction(document, factor)
    return f"contact_{contact} sticks from"


def _wear(rng: np.random.Generator, document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> str:
    _command_friction(document, np.linspace(1.0, 0.6, times.size)[:, None])
    return "friction changes by"


def _command_friction(document: dict[str, Any], factor: np.ndarray) -> None:
    sides = {side: (factor * np.array(document["friction"][side])).tolist() for side in ("forward", "backward")}
    document["drive"] = {"friction": sides}


def _stiffen(rng: np.random.Generator, document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> str:
    """Stiffen a link; that the other one of two is softer is the same, as only ratios to friction matter."""
    link = int(rng.integers(rows.shape[1]))
    document["body"]["links"]["stiffness"][link] *= 1.3
    return "stiffness of link_[01]( is|:)" if rows.shape[1] == 2 else f"stiffness of link_{link}( is|:)"


def _harden(rng: np.random.Generator, document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> str:
    """Let springs pull twice as much where they are stretched by 30 mm."""
    at = np.linspace(-0.06, 0.06, 25)
    part = at + at**3 / 0.03**2
    stiffness = document["body"]["links"]["stiffness"]
    document["body"]["links"] = [
        {"curve": {"elongation": at.tolist(), "tension": (k * part).tolist()}} for k in stiffness
    ]
    return "springs harden"


def _remember(rng: np.random.Generator, document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> str:
    document["body"]["links"]["hysteresis"] = [{"stiffness": 20.0, "yield": 0.1}]
    return "springs have hysteresis"


def _loosen(rng: np.random.Generator, document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> str:
    document["body"]["links"]["backlash"] = 0.01
    return "actuators have a backlash"


def _measure_way(document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> float:
    """Measure how far a robot walks [m]."""
    scene = Scene.model_validate(document | {"drive": {"times": times.tolist(), "actuation": rows.tolist()}})
    x = simulate(scene, float(times[-1]), _RATE).displacement
    return float((x[-1] - x[0]).mean())


def _build_walker(seed: int) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """Draw robots until one walks farther than a contact moves to and fro."""
    for number in itertools.count(seed, 1000):
        robot = build_robot(number)
        if abs(_measure_way(*robot)) > 0.2:
            return robot
    raise AssertionError


def _stain(rng: np.random.Generator, document: dict[str, Any], times: np.ndarray, rows: np.ndarray) -> str:
    """Lay a stain a quarter as long as the way where the front comes to after two fifths of it."""
    way = _measure_way(document, times, rows)
    front = max(document["body"]["contacts"]) if way > 0.0 else min(document["body"]["contacts"])
    low, high = sorted((front + 0.4 * way, front + 0.65 * way))
    document["ground"] = {"patches": [{"from": low, "to": high, "friction": 1.6}]}
    return "a stain"


_STAINED = "a stain of 1.6 times the friction"
_ROBOTS: dict[str, Failure] = {
    "a link sticks from some time on": _stick,
    "a contact sticks from some time on": _glue,
    "friction wears by 40 %": _wear,
    "a link 30 % stiffer": _stiffen,
    "springs that harden": _harden,
    "hysteresis of 0.1 N": _remember,
    "backlash of 10 mm": _loosen,
    _STAINED: _stain,
}
"""What differs in the robot."""
_STEPPED: dict[str, tuple[dict[str, float], str]] = {
    "masses of 60 g": ({"mass": 0.06}, "inertia"),
    "viscosity of 0.3 N s/m": ({"viscosity": 0.3}, "viscosity"),
    "friction 50 % larger at rest": ({"static": 0.5, "damping": 1.0}, "friction at rest"),
}
"""What is stepped through time, and the explanation that should be the first."""
KINDS = (*_TABLES, *_ROBOTS, *_STEPPED)


def spoil(seed: int, kind: str) -> tuple[dict[str, Any], Measurements, str]:
    """Measure a robot with a mistake, or one that differs from its scene.

    Args:
        seed: of the robot and of its noise.
        kind: one of `KINDS`.

    Returns:
        The document of the robot as a person knows it, with its true frictions; the measurements; and a pattern of the
        explanation that should be the first.
    """
    if kind in _TABLES:
        document, measured = measure_robot(seed, "white")
        return document, _TABLES[kind][0](measured), _TABLES[kind][1]
    document, times, rows = _build_walker(seed) if kind == _STAINED else build_robot(seed)
    if kind in _STEPPED:
        numbers, right = _STEPPED[kind]
        at, x = step(document, times, rows, _RATE, **numbers)
    else:
        real, true = copy.deepcopy(document), rows.copy()
        right = _ROBOTS[kind](np.random.default_rng([seed, 7]), real, times, true)
        drive = {"times": times.tolist(), "actuation": true.tolist()} | real.pop("drive", {})
        run = simulate(Scene.model_validate(real | {"drive": drive}), float(times[-1]), _RATE)
        at, x = run.time, run.displacement
    values = np.array(document["body"]["contacts"]) + x
    values = values + _NOISE * np.random.default_rng(seed).normal(size=values.shape)
    contacts, links = (
        tuple(f"{what}_{i}" for i in range(n))
        for what, n in zip(("contact", "link"), (values.shape[1], rows.shape[1]), strict=True)
    )
    return document, Measurements(f"{kind} {seed}", at, contacts, values, links, rows, times), right


def identify_mistake(seed: int, kind: str) -> tuple[Identification, bool]:
    """Identify a robot with a mistake.

    Args:
        seed: of the robot.
        kind: of the mistake, one of `KINDS`.

    Returns:
        The identification, and whether the right explanation is the first.
    """
    document, measured, right = spoil(seed, kind)
    found = identify(guess_robot(document, seed), [measured], KEYS, hold_out=0.0, seconds=1.0)
    first = found.explanations[0].what if found.explanations else ""
    return found, bool(re.match(right, first))
