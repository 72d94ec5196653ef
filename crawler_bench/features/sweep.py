"""The rate of runs of many variations, and the part of the time spent in compiled kernels."""

from __future__ import annotations

import statistics
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_model import load_scene, simulate_many, vary

VARIATIONS, QUICK = 20_000, 2_000
"""Variations of a body of two contacts; larger bodies get fewer."""
_ROUNDS = 3
_CASES = (
    ("two_anchor_a", "drive.length", 1),
    ("two_contacts_anisotropic", "friction.backward", 1),
    ("three_springs", "body.links.stiffness", 4),
    ("ten_contact_wave", "drive.wave.amplitude", 40),
    ("peristaltic_segment", "body.segments.trunk.stiffness", 100),
)
"""Scene, key that varies within 10 %, and divisor of the number of variations."""


def measure_sweep(variations: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure `simulate_many` on one core and on two, ten periods each.

    Args:
        variations: number of variations of a body of two contacts.
        progress: called with the fraction done, in [0, 1].

    Returns:
        A row for each scene and number of workers: runs per second, time of a run [us] (medians of three rounds), and
        the part of the time of all workers spent in kernels.
    """
    rows = []
    for done, (name, key, divisor) in enumerate(_CASES):
        scene = load_scene(name)
        step: Any = scene.document()
        for part in key.replace("segments.trunk", "segments.0").split("."):
            step = step[int(part)] if isinstance(step, list) else step[part]
        base = float(np.ravel(step)[0])
        values = base * np.linspace(0.9, 1.1, max(variations // divisor, 10))
        many = vary(scene, {key: values})
        simulate_many(many[:2], workers=1)  # loads the kernels
        for workers in (1, 2):
            times, inside = [], []
            for _ in range(_ROUNDS):
                runs = simulate_many(many, workers=workers)
                times.append(runs.wall_s)
                inside.append(float(runs.kernel_s.sum()) / (workers * runs.wall_s))
            wall = statistics.median(times)
            rows.append(
                {
                    "case": "simulate_many",
                    "scene": name,
                    "n": scene.body.contacts,
                    "variations": values.size,
                    "workers": workers,
                    "runs_per_s": values.size / wall,
                    "us_per_run": 1e6 * wall / values.size,
                    "in_kernels": statistics.median(inside),
                }
            )
        progress((done + 1) / len(_CASES))
    return rows
