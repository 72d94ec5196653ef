"""Random crawlers with drives, and central differences of their runs."""

from __future__ import annotations

import copy
import re
from typing import Any

import numpy as np

from crawler_model import Scene, SceneError, simulate

KEYS = (
    "drive.actuation",
    "body.links.stiffness",
    "friction.forward",
    "friction.backward",
    "loads",
    "ground.slope",
    "body.weights",
)
BENT_KEYS = ("drive.actuation", "friction.forward", "loads", "ground.slope")
SEGMENT_KEYS = ("drive.actuation", "body.segments.0.stiffness", "body.segments.0.friction.forward", "ground.slope")


def draw(seed: int) -> dict[str, Any]:
    """Draw a chain or a graph of two to five contacts with loads on a slope, and a drive with a period."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    pairs = [[i, i + 1] for i in range(n - 1)]
    if n > 2 and rng.random() < 0.4:
        pairs += [[0, n - 1]] + ([[1, 3]] if n > 3 else [])
    waypoints = int(rng.integers(3, 7))
    return {
        "name": f"drawn {seed}",
        "body": {
            "contacts": np.cumsum(rng.uniform(0.5, 1.5, n)).tolist(),
            "links": {"stiffness": rng.uniform(0.5, 3.0, len(pairs)).tolist(), "between": pairs},
            "weights": rng.uniform(0.1, 0.4, n).tolist(),
        },
        "friction": {side: rng.uniform(0.2, 1.0, n).tolist() for side in ("forward", "backward")},
        "loads": rng.uniform(-0.05, 0.05, n).tolist(),
        "ground": {"slope": float(rng.uniform(-10.0, 10.0))},
        "start": "relaxed",
        "drive": {
            "times": [0.0, *np.sort(rng.uniform(0.05, 0.95, waypoints - 1)).tolist()],
            "period": 1.0,
            "actuation": rng.uniform(-1.5, 1.5, (waypoints, len(pairs))).tolist(),
        },
    }


def _draw_bent_link(rng: np.random.Generator) -> tuple[dict[str, Any], list[str]]:
    """Draw a link of any kind, with the keys of its numbers."""
    stiffness = float(rng.uniform(0.5, 3.0))
    part: dict[str, Any] = {}
    names: list[str] = []
    kind = rng.choice(["linear", "tendon", "motor", "curve"])
    if kind == "curve":
        at, value = np.cumsum(rng.uniform(0.1, 0.8, 4)) - 1.0, np.cumsum(rng.uniform(0.0, 0.6, 4)) - 0.8
        part["curve"] = {"elongation": at.tolist(), "tension": value.tolist()}
        names += [f"curve.{column}[{i}]" for column in ("elongation", "tension") for i in range(4)]
    else:
        part["stiffness"] = stiffness
        names.append("stiffness")
    if kind in ("tendon", "motor"):
        least = 0.0 if kind == "tendon" else float(rng.uniform(-1.0, -0.2))
        part["tension"] = {"least": least, "most": float(rng.uniform(0.2, 1.5))}
        names += ["tension.least", "tension.most"]
    kind = rng.choice(["none", "spring", "stops"])
    if kind == "spring":
        part["passive"] = {"stiffness": float(rng.uniform(0.5, 3.0))}
        names.append("passive.stiffness")
    if kind == "stops":
        part["passive"] = {
            "stops": {
                "shortest": float(rng.uniform(-0.4, -0.1)),
                "longest": float(rng.uniform(0.1, 0.4)),
                "stiffness": float(rng.uniform(5.0, 20.0)),
            }
        }
        names += [f"passive.stops.{name}" for name in ("shortest", "longest", "stiffness")]
    return part, names


def draw_bent(seed: int) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Draw a crawler whose links have limits, curves, return springs and stops, with the keys of all its numbers."""
    document, rng = draw(seed), np.random.default_rng([seed, 1])
    links, names = [], []
    for i, pair in enumerate(document["body"]["links"]["between"]):
        part, own = _draw_bent_link(rng)
        links.append({**part, "between": pair})
        names += [f"body.links[{i}].{name}" for name in own]
    document["body"]["links"] = links
    return document, (*names, *BENT_KEYS)


def draw_segment(seed: int) -> dict[str, Any]:
    """Draw a segment on a slope with a foot in front of it."""
    rng = np.random.default_rng(seed)
    friction = {"forward": float(rng.uniform(0.1, 0.3)), "backward": float(rng.uniform(0.3, 0.6))}
    segment = {"name": "trunk", "from": 0.0, "to": 1.0, "stiffness": float(rng.uniform(0.5, 2.0)), "friction": friction}
    return {
        "name": f"drawn segment {seed}",
        "body": {
            "contacts": [1.5],
            "segments": [segment | {"elements": int(rng.integers(5, 12))}],
            "links": {"stiffness": float(rng.uniform(1.0, 4.0)), "between": [["trunk.to", 0]]},
            "weights": [0.2, 0.1],
        },
        "friction": {"forward": float(rng.uniform(0.05, 0.2)), "backward": float(rng.uniform(0.2, 0.4))},
        "ground": {"slope": float(rng.uniform(-5.0, 5.0))},
        "start": "relaxed",
        "drive": {
            "times": [0.0, 0.3, 0.5, 0.8],
            "period": 1.0,
            "actuation": rng.uniform(-0.5, 0.5, (4, 2)).tolist(),
        },
    }


def changed(document: dict[str, Any], name: str, step: float) -> Scene:
    """Build the scene with one number changed."""
    other = copy.deepcopy(document)
    node: Any = other
    steps = re.sub(r"\[(\d+)\]", r".\1", name).split(".")
    for key in steps[:-1]:
        node = node[int(key)] if isinstance(node, list) else node[key]
    last: Any = int(steps[-1]) if isinstance(node, list) else steps[-1]
    node[last] += step
    return Scene.model_validate(other)


def results(scene: Scene, duration: float, rate: float) -> np.ndarray:
    """Run a scene; all its displacements, gains and its work."""
    run = simulate(scene, duration, rate)
    return np.concatenate((run.displacement.ravel(), run.per_period.ravel(), [run.energy.work]))


def differences(document: dict[str, Any], name: str, duration: float, rate: float) -> np.ndarray | None:
    """Differentiate a run by central differences of fourth order; None if a kink lies too close to tell."""
    for step in (1e-4, 1e-5, 1e-6):
        try:
            rows = {k: results(changed(document, name, k * step), duration, rate) for k in (-2, -1, 0, 1, 2)}
        except SceneError:  # a start at a bound
            return None
        sides = [(rows[1] - rows[0]) / step, (rows[0] - rows[-1]) / step]
        wide = [(rows[2] - rows[1]) / step, (rows[-1] - rows[-2]) / step]
        slopes = np.array([wide[0], *sides, wide[1]])
        if np.abs(np.diff(slopes, 2, axis=0)).max() < 1e-4 * (1.0 + np.abs(slopes).max()) * step * 1e4:
            narrow = (rows[1] - rows[-1]) / (2.0 * step)
            return np.asarray((4.0 * narrow - (rows[2] - rows[-2]) / (4.0 * step)) / 3.0)
    return None
