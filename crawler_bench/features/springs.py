"""What springs and actuators as robots have them cost a tick, beside the same body with linear springs."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene

from ..cases import wave_scene

CONTACTS, QUICK = (10, 100, 1_000), (10, 100)
_TICKS, _ROUNDS = 64, 24
"""Ticks of a period, and periods of which the fastest counts."""
LINKS: dict[str, dict[str, Any]] = {
    "linear": {"stiffness": 1.0},
    "motor that never stalls": {"stiffness": 1.0, "tension": 1e3},
    "motor that stalls": {"stiffness": 1.0, "tension": 0.37},
    "motor at a balance": {"stiffness": 1.0, "tension": 0.4},
    "tendon beside a spring": {"stiffness": 1.0, "tension": {"least": 0.0}, "passive": {"stiffness": 0.25}},
    "stops": {"stiffness": 1.0, "passive": {"stops": {"shortest": -0.5, "longest": 0.5, "stiffness": 10.0}}},
    "curve of four pieces": {
        "curve": {"elongation": [-0.4, -0.2, 0.0, 0.2, 0.4], "tension": [-0.5, -0.2, 0, 0.2, 0.5]}
    },
}
"""The links of the chain. Friction of 0.1 and 0.3 N sums to 0.4 N: a balance, which leaves parts of the body free."""


def measure_springs(contacts: Sequence[int], progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure ticks of chains on which waves run, in rounds over all kinds of links, so that load affects all alike.

    Args:
        contacts: numbers of contacts N.
        progress: called with the completed part, in [0, 1].

    Returns:
        For each kind of links and N: shortest time of a tick over all rounds [us], linear pieces of a tick, time of a
        piece [us], both times relative to linear springs, and ticks whose budget was spent.
    """
    rows: list[dict[str, Any]] = []
    for done, n in enumerate(contacts, 1):
        rows += _measure(n)
        progress(done / len(contacts))
    return rows


def _measure(n: int) -> list[dict[str, Any]]:
    base = wave_scene(n, 20.0).document()
    best, pieces, overspent = dict.fromkeys(LINKS, np.inf), dict.fromkeys(LINKS, 0.0), dict.fromkeys(LINKS, 0)
    crawlers = {}
    for name, links in LINKS.items():
        body = base["body"] | {"links": links}
        crawlers[name] = Crawler(Scene.model_validate(base | {"body": body, "start": "relaxed"}))
    ends = np.arange(1, _TICKS + 1) * (1_000_000_000 // _TICKS)
    targets = np.ascontiguousarray(crawlers["linear"].scene.drive.sample(ends))
    for turn in range(_ROUNDS + 1):
        for name, crawler in crawlers.items():
            began = time.perf_counter()
            step = crawler.follow(targets)
            spent = 1e6 * (time.perf_counter() - began) / _TICKS
            pieces[name] = step.events / _TICKS  # of the last period
            overspent[name] += step.overspent
            if turn > 0:  # the first period begins at rest and loads the kernels
                best[name] = min(best[name], spent)
    return [
        {
            "case": f"waves of 20 links on {n} contacts",
            "n": n,
            "links": name,
            "us_per_tick": best[name],
            "pieces": pieces[name],
            "us_per_piece": best[name] / pieces[name],
            "to_linear": best[name] / best["linear"],
            "piece_to_linear": best[name] / pieces[name] * pieces["linear"] / best["linear"],
            "overspent": overspent[name],
        }
        for name in LINKS
    ]
