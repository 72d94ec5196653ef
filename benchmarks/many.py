"""The rates of many runs at once: variations of a scene, and steps of the environments, without peers."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_lab import simulate_many, vary
from crawler_lab.gym import CrawlerEnv, CrawlerVectorEnv
from crawler_model import Scene, load_scene

VARIATIONS, QUICK = 20_000, 2_000
"""Variations of a body of two contacts; larger bodies get fewer. As many steps of all environments are one round."""
_ROUNDS = 5
_CASES = (
    ("two_anchor_a", "drive.length", 1),
    ("two_contacts_anisotropic", "friction.backward", 1),
    ("three_springs", "body.links.stiffness", 4),
    ("ten_contact_wave", "drive.wave.amplitude", 40),
    ("peristaltic_segment", "body.segments.trunk.stiffness", 100),
)
"""Scene, key that varies within 10 %, and divisor of the number of variations."""
_CONTACTS, _ENVIRONMENTS = (3, 10), (1, 64, 1024)


def measure_many(variations: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure `simulate_many` on one core and on two, ten periods each, then environments with random actions.

    Returns:
        A row for each scene and number of workers, then for each body and number of environments: rates per second and
        times [us], medians of the rounds.
    """
    rows = []
    for done, (name, key, divisor) in enumerate(_CASES):
        rows += _measure_scene(name, key, max(variations // divisor, 10))
        progress(0.5 * (done + 1) / len(_CASES))
    for done, contacts in enumerate(_CONTACTS):
        rows += [measure_environments(contacts, count, variations) for count in _ENVIRONMENTS]
        progress(0.5 + 0.5 * (done + 1) / len(_CONTACTS))
    return rows


def _measure_scene(name: str, key: str, variations: int) -> list[dict[str, Any]]:
    scene = load_scene(name)
    step: Any = scene.document()
    for part in key.replace("segments.trunk", "segments.0").split("."):
        step = step[int(part)] if isinstance(step, list) else step[part]
    many = vary(scene, {key: float(np.ravel(step)[0]) * np.linspace(0.9, 1.1, variations)})
    simulate_many(many[:2], workers=1)  # loads the kernels
    rows = []
    for workers in (1, 2):
        runs = [simulate_many(many, workers=workers) for _ in range(_ROUNDS)]
        wall = statistics.median(run.wall_s for run in runs)
        row = {"case": "simulate_many", "scene": name, "n": scene.body.contacts, "variations": variations}
        row |= {"workers": workers, "runs_per_s": variations / wall, "us_per_run": 1e6 * wall / variations}
        inside = statistics.median(float(run.kernel_s.sum()) / (workers * run.wall_s) for run in runs)
        rows.append(row | {"in_kernels": inside})
    return rows


def measure_environments(contacts: int, count: int, steps: int, threads: int | None = None) -> dict[str, Any]:
    """Measure one environment, or a vector of them, whose episodes do not end.

    Args:
        contacts: number of contacts of each.
        count: number of environments.
        steps: of all environments in a round.
        threads: of a vector of environments; one for each core if None.

    Returns:
        A row: steps per second of all, the median of the rounds, the least and the most; time of a step of one [us].
    """
    document: dict[str, Any] = {"name": "chain", "friction": {"forward": 0.2, "backward": 0.5}}
    document["body"] = {"contacts": (0.1 * np.arange(contacts)).tolist(), "links": {"stiffness": 20.0}}
    scene = Scene.model_validate(document)
    several = count > 1
    many: Any = CrawlerVectorEnv(count, scene, steps=0, threads=threads) if several else CrawlerEnv(scene, steps=0)
    many.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (64, *((count,) if several else ()), contacts - 1))
    for action in actions[:3]:
        many.step(action)  # loads the kernels
    times, repeats = [], max(steps // count, 3)
    for _ in range(_ROUNDS):
        began = time.perf_counter()
        for k in range(repeats):
            many.step(actions[k % len(actions)])
        times.append((time.perf_counter() - began) / repeats)
    rate = count / statistics.median(times)
    row = {"case": "environments", "n": contacts, "environments": count, "steps_per_s": rate}
    return row | {"least": count / max(times), "most": count / min(times), "us_per_step": 1e6 / rate}
