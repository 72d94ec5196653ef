"""Synthetic measurements: runs of a true scene, recorded with commands, noise and offsets."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from crawler_lab.identify.measurements import Measurements
from crawler_model import Scene, simulate

RATE = 50.0


def chain(contacts: int = 3, **changes: Any) -> dict[str, Any]:
    """A chain whose friction differs by contact and side and is far from balanced, relaxed at the start; no loads."""
    document = {
        "name": "measured",
        "start": "relaxed",
        "body": {
            "contacts": [0.1 * i for i in range(contacts)],
            "links": {"stiffness": [20.0 + 3.0 * j for j in range(contacts - 1)]},
        },
        "friction": {
            "forward": [0.2 + 0.03 * i for i in range(contacts)],
            "backward": [0.62 - 0.07 * (i % 2) for i in range(contacts)],
        },
    }
    return document | changes


def walk(links: int, seconds: float, seed: int, stroke: float = 0.1, every: float = 0.2) -> tuple[list[float], Any]:
    """Random rest lengths, straight between multiples of 0.2 s: the times and the rows."""
    rng = np.random.default_rng(seed)
    count = round(seconds / every) + 1
    rows = rng.uniform(-stroke, stroke, (count, links))
    rows[0] = 0.0
    return [every * i for i in range(count)], rows


def measure(
    document: dict[str, Any],
    times: list[float],
    rows: np.ndarray,
    channels: tuple[str, ...] | None = None,
    noise: float = 0.0,
    seed: int = 0,
    offset: float = 0.0,
    rate: float = RATE,
) -> Measurements:
    """Run a scene along commands and record it at every tick."""
    driven = copy.deepcopy(document) | {"drive": {"times": times, "actuation": rows.tolist()}}
    run = simulate(Scene.model_validate(driven), times[-1], rate)
    position = np.array(document["body"]["contacts"]) + run.displacement
    names = channels or tuple(f"contact_{i}" for i in range(position.shape[1]))
    columns = {f"contact_{i}": position[:, i] + offset for i in range(position.shape[1])}
    z = np.diff(run.displacement, axis=1)
    columns |= {f"link_{j}": z[:, j] for j in range(z.shape[1])}
    values = np.column_stack([columns[name] for name in names])
    values = values + noise * np.random.default_rng(seed).normal(size=values.shape)
    commanded = tuple(f"link_{j}" for j in range(rows.shape[1]))
    return Measurements(f"run {seed}", run.time, names, values, commanded, rows, np.array(times))


def scaled(document: dict[str, Any], factors: dict[str, float]) -> Scene:
    """A scene with some lists of numbers multiplied: the first guess of a fit."""
    guess = copy.deepcopy(document)
    for key, factor in factors.items():
        *path, last = key.split(".")
        node = guess
        for step in path:
            node = node[step]
        value = node[last]
        node[last] = [factor * v for v in value] if isinstance(value, list) else factor * value
    return Scene.model_validate(guess)
