"""How the time of a ramp grows with the number of contacts, on the drives that are hardest for chains."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene

from ..cases import wave_scene

CONTACTS, QUICK = (1_000, 10_000, 100_000), (1_000, 10_000)
_TICKS = 64
_LONGEST = 20.0
"""Seconds after which no further ramp of a drive is begun."""
_RAMPS, _FIRST = 16, 2
"""Ramps that are followed, and the first of them that counts: the first ones start from rest."""


def measure_growth(contacts: tuple[int, ...], progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure ramps of `exact` and `catch_up` on long chains.

    The drives are five waves along the body (64 ticks per period), a segment that is stretched by 2 % and by 50 % and
    contracts again in one ramp each, and a load that alternates in sign, grows along the body with the power 1.5, and
    vanishes again.

    Args:
        contacts: numbers of contacts N.
        progress: called with the completed part, in [0, 1].

    Returns:
        A row for each drive, method and N: median processor time of a ramp [ms] and median number of its linear pieces,
        ramps whose budget was spent, time relative to `catch_up`, and the growth exponent of the time since the
        smallest N, None there.
    """
    rows: list[dict[str, Any]] = []
    done = 0
    for drive, build in _DRIVES.items():
        smallest: dict[str, float] = {}
        for n in contacts:
            plan, targets = build(n)
            times = {}
            for method in ("catch_up", "exact"):
                spent, pieces, overspent = _follow(Crawler(plan, method), targets)
                times[method] = spent
                first = smallest.setdefault(method, spent)
                growth = None if n == contacts[0] else float(np.log(spent / first) / np.log(n / contacts[0]))
                rows.append(
                    {
                        "case": drive,
                        "method": method,
                        "n": n,
                        "ms": 1e3 * spent,
                        "pieces": pieces,
                        "overspent": overspent,
                        "to_catch_up": spent / times["catch_up"],
                        "growth": growth,
                    }
                )
                done += 1
                progress(done / (2 * len(_DRIVES) * len(contacts)))
    return rows


def _follow(crawler: Crawler, targets: np.ndarray) -> tuple[float, float, int]:
    times, pieces, overspent = [], [], 0
    began = time.thread_time()
    for k in range(_RAMPS):
        start = time.thread_time()
        step = crawler.follow(targets[k % len(targets)][None])
        times.append(time.thread_time() - start)
        pieces.append(step.events)
        overspent += step.overspent
        if time.thread_time() - began > _LONGEST and k >= _FIRST:
            break
    return statistics.median(times[_FIRST:]), statistics.median(pieces[_FIRST:]), overspent


def _five_waves(n: int) -> tuple[Scene, np.ndarray]:
    scene = wave_scene(n, (n - 1) / 5.0, 100.0 / n)
    ends = np.arange(1, _TICKS + 1) * (1_000_000_000 // _TICKS)
    return scene, np.ascontiguousarray(scene.drive.sample(ends))


def _there_and_back(scene: Scene, change: np.ndarray) -> np.ndarray:
    targets = np.repeat(scene.drive.targets[:1], 2, axis=0)
    targets[0, : change.size] += change
    return targets


def _stretched(part: float) -> Callable[[int], tuple[Scene, np.ndarray]]:
    def build(n: int) -> tuple[Scene, np.ndarray]:
        segment: dict[str, Any] = {"name": "s", "from": 0, "to": 1, "stiffness": 1.0, "elements": n - 1}
        segment["friction"] = {"forward": 0.1, "backward": 0.3}
        scene = Scene.model_validate({"name": "stretched", "body": {"segments": [segment]}})
        return scene, _there_and_back(scene, np.full(n - 1, part / (n - 1)))

    return build


def _alternating(n: int) -> tuple[Scene, np.ndarray]:
    body = {"contacts": list(range(n)), "links": {"stiffness": 1.0}}
    friction = {"forward": 0.1, "backward": 0.3}
    scene = Scene.model_validate({"name": "alternating", "body": body, "friction": friction})
    i = np.arange(n - 1)
    return scene, _there_and_back(scene, 1e-3 * (-1.0) ** i * i**1.5)


_DRIVES: dict[str, Callable[[int], tuple[Scene, np.ndarray]]] = {
    "five waves": _five_waves,
    "stretched by 2 %": _stretched(0.02),
    "stretched by 50 %": _stretched(0.5),
    "alternating load": _alternating,
}
