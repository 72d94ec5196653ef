"""Robots and tables that are not what they are taken for: mistakes of persons, and robots that fail or differ."""

from __future__ import annotations

import copy
import dataclasses
import re
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_lab import Identification, Measurements, identify
from crawler_model import Scene, simulate

from .laboratory import KEYS, build_robot, guess_robot, measure_robot

_RATE, _NOISE = 50.0, 2e-4
Change = Callable[[Measurements], Measurements]
Failure = Callable[[dict[str, Any], np.ndarray], None]


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
    "a lens, 5 mm": (lambda m: dataclasses.replace(m, values=_lens(m.values)), ""),
}
"""Mistakes in the record of a right model, and the explanation that should be the first; "" if there is none."""


def _stick(document: dict[str, Any], rows: np.ndarray) -> None:
    last = rows.shape[0] * 2 // 3
    rows[last:, 1] = rows[last, 1]


def _stiffen(document: dict[str, Any], rows: np.ndarray) -> None:
    document["body"]["links"]["stiffness"][0] *= 1.3


def _remember(document: dict[str, Any], rows: np.ndarray) -> None:
    links = document["body"]["links"]
    links["hysteresis"] = [{"stiffness": 20.0, "yield": 0.1}]


_ROBOTS: dict[str, tuple[Failure, str]] = {
    "a link sticks after two thirds": (_stick, "link_1 does not move from|stroke of link_1 from"),
    "a link 30 % stiffer": (_stiffen, "stiffness of link_0( is|:)"),
    "hysteresis of 0.1 N": (_remember, ""),
}
"""What differs in the robot, and the explanation that should be the first; "" if there is none."""
KINDS = (*_TABLES, *_ROBOTS)


def spoil(seed: int, kind: str) -> tuple[dict[str, Any], Measurements]:
    """Measure a robot with a mistake, or one that differs from its scene.

    Args:
        seed: of the robot and of its noise.
        kind: one of `KINDS`.

    Returns:
        The document of the robot as a person knows it, with its true frictions, and the measurements.
    """
    if kind in _TABLES:
        document, measured = measure_robot(seed, "white")
        return document, _TABLES[kind][0](measured)
    document, times, rows = build_robot(seed)
    real, true = copy.deepcopy(document), rows.copy()
    _ROBOTS[kind][0](real, true)
    scene = Scene.model_validate(real | {"drive": {"times": times.tolist(), "actuation": true.tolist()}})
    run = simulate(scene, float(times[-1]), _RATE)
    values = scene.body.position + run.displacement
    values = values + _NOISE * np.random.default_rng(seed).normal(size=values.shape)
    contacts, links = (
        tuple(f"{what}_{i}" for i in range(n))
        for what, n in zip(("contact", "link"), (values.shape[1], rows.shape[1]), strict=True)
    )
    return document, Measurements(f"{kind} {seed}", run.time, contacts, values, links, rows, times)


def identify_mistake(seed: int, kind: str) -> tuple[Identification, bool | None]:
    """Identify a robot with a mistake.

    Args:
        seed: of the robot.
        kind: of the mistake, one of `KINDS`.

    Returns:
        The identification, and whether the right explanation is the first; None if none is known.
    """
    document, measured = spoil(seed, kind)
    found = identify(guess_robot(document, seed), [measured], KEYS, hold_out=0.0, seconds=1.0)
    right = (_TABLES | _ROBOTS)[kind][1]
    first = found.explanations[0].what if found.explanations else ""
    return found, bool(re.match(right, first)) if right else None
