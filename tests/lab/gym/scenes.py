"""Scenes for the environments, one of each kind of body."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_model import Scene, load_scene

from ...instrument.model.chains import coarse

CHAIN = {
    "name": "chain",
    "body": {"contacts": [0.0, 0.1, 0.2], "links": {"stiffness": [20.0, 25.0]}, "weights": 0.3},
    "friction": {"forward": [0.2, 0.25, 0.2], "backward": 0.5},
}


def chain(contacts: int = 3, **more: Any) -> Scene:
    body = {"contacts": (0.1 * np.arange(contacts)).tolist(), "links": {"stiffness": 20.0}}
    return Scene.model_validate({"name": "chain", "body": body, "friction": {"forward": 0.2, "backward": 0.5}} | more)


def varied() -> Scene:
    return Scene.model_validate(CHAIN)


KINDS: dict[str, tuple[Any, dict[str, Any]]] = {
    "chain": (varied, {}),
    "friction": (lambda: load_scene("two_anchor_a"), {}),
    "graph": (lambda: load_scene("three_springs"), {}),
    "segment": (lambda: coarse("heterogeneous_segment"), {}),
    "slope": (lambda: load_scene("slope_climber"), {"task": "climb"}),
    "patches": (lambda: load_scene("ice"), {}),
    "profile": (lambda: chain(ground={"profile": {"at": [0.0, 0.1, 0.3], "friction": [1.0, 0.4, 3.0]}}), {}),
    "walls": (lambda: load_scene("wall_pusher"), {}),
    "plane": (lambda: load_scene("planar_three_points"), {"direction": 0.3}),
    "reach in the plane": (lambda: load_scene("planar_three_points"), {"task": "reach", "place": [0.01, 0.0]}),
}
"""A scene of each kind, and settings that it needs."""
EACH_KIND = [pytest.param(kind, marks=pytest.mark.slow) if kind == "graph" else kind for kind in KINDS]
"""Their names; the kernel of graphs compiles for a minute."""


def act(observation: np.ndarray, actions: int, step: int) -> np.ndarray:
    """Do something lively that depends on every digit of what was seen."""
    phase = 0.7 * step + np.arange(actions)
    return np.sin(phase + 50.0 * observation.sum()) * 0.8 + 0.2 * np.cos(phase)
