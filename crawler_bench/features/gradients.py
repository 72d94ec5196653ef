"""The cost and the error of exact derivatives beside those of differences."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from crawler_model import Scene, sensitivities, simulate, simulate_many, vary

CONTACTS, QUICK = (2, 4, 10, 30), (2, 4)
_PERIODS, _WAYPOINTS = 10.0, 8
_ROUNDS = 3
_STEP = 1e-6
"""Step of the differences [m]: their rounding and their truncation are then about equal."""


def measure_gradients(contacts: tuple[int, ...], progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure the derivatives of ten periods with respect to all waypoints of a random gait, by three methods.

    Args:
        contacts: numbers of contacts N.
        progress: called with the completed part, in [0, 1].

    Returns:
        A row for each N and method: time [ms] (median of three rounds), time relative to P + 1 runs of `simulate`, and
        the median over all parameters of the error of the derivatives of the gain, relative to the largest derivative
        [1]; the median, as the differences of a few parameters step over kinks. `exact` is `sensitivities`, compared
        with central differences of fourth order; `differences` runs P + 1 scenes by `simulate_many` on one core.
    """
    rows = []
    for done, n in enumerate(contacts):
        scene = _gait(n)
        base = scene.drive.actuation
        keys = [f"drive.actuation[{w}][{s}]" for w in range(_WAYPOINTS) for s in range(n - 1)]
        count = len(keys)
        exact = sensitivities(scene, keys, _PERIODS, 1.0)
        steps = np.vstack((np.zeros(count), _STEP * np.eye(count)))
        nearby = vary(scene, dict(zip(keys, (base.ravel() + steps).T, strict=True)), grid=False)
        simulate_many(nearby[:2], _PERIODS, workers=1)  # loads the kernels

        single = _median(lambda: simulate(scene, _PERIODS, 1.0))  # noqa: B023
        spent = {
            "exact": _median(lambda: sensitivities(scene, keys, _PERIODS, 1.0)),  # noqa: B023
            "differences": _median(lambda: simulate_many(nearby, _PERIODS, workers=1)),  # noqa: B023
        }
        gains = np.asarray(simulate_many(nearby, _PERIODS, workers=1).per_period)
        reference = _fourth_order(scene, keys)
        found = {"exact": exact.per_period[-1], "differences": (gains[1:] - gains[0]) / _STEP}
        size = float(np.abs(reference).max())
        for method, seconds in spent.items():
            rows.append(
                {
                    "case": "gradient",
                    "method": method,
                    "n": n,
                    "parameters": count,
                    "ms": 1e3 * seconds,
                    "part_of_runs": seconds / ((count + 1) * single),
                    "error": float(np.median(np.abs(found[method] - reference))) / size,
                }
            )
        progress((done + 1) / len(contacts))
    return rows


def _gait(n: int) -> Scene:
    """Build a chain whose waypoints are random, with the friction of bristles."""
    rng = np.random.default_rng(n)
    return Scene.model_validate(
        {
            "name": f"gait_{n}",
            "body": {"contacts": (0.1 * np.arange(n)).tolist(), "links": {"stiffness": 10.0}},
            "friction": {
                "forward": rng.uniform(0.15, 0.25, n).tolist(),
                "backward": rng.uniform(0.5, 0.7, n).tolist(),
            },
            "start": "relaxed",
            "drive": {
                "times": (np.arange(_WAYPOINTS) / _WAYPOINTS).tolist(),
                "period": 1.0,
                "actuation": rng.uniform(0.0, 0.1, (_WAYPOINTS, n - 1)).tolist(),
            },
        }
    )


def _median(call: Callable[[], Any]) -> float:
    times = []
    for _ in range(_ROUNDS):
        began = time.perf_counter()
        call()
        times.append(time.perf_counter() - began)
    return statistics.median(times)


def _fourth_order(scene: Scene, keys: list[str]) -> np.ndarray:
    """Differentiate the last gain by central differences of fourth order."""
    base = scene.drive.actuation.ravel()
    step = 30.0 * _STEP
    gains = {}
    for k in (-2, -1, 1, 2):
        values = base + k * step * np.eye(base.size)
        many = vary(scene, dict(zip(keys, values.T, strict=True)), grid=False)
        gains[k] = np.asarray(simulate_many(many, _PERIODS, workers=1).per_period)
    return (8.0 * (gains[1] - gains[-1]) - (gains[2] - gains[-2])) / (12.0 * step)
