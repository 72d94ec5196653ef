"""Chains with a posterior, and what `crawler identify --json` prints about them."""

from __future__ import annotations

from typing import Any

import numpy as np

from crawler_lab import Posterior
from crawler_model import Scene

FORWARD, BACKWARD = (0.2, 0.23, 0.26), (0.6, 0.65, 0.7)
PERIODIC: dict[str, Any] = {
    "times": [0.0, 0.25, 0.5, 0.75, 1.0],
    "period": 1.0,
    "actuation": [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1], [0.0, 0.0]],
}
NAMES = tuple(f"friction.{side}[{i}]" for side in ("forward", "backward") for i in range(3))


def robot(drive: dict[str, Any] | None = PERIODIC, **more: Any) -> Scene:
    document = {
        "name": "robot",
        "body": {"contacts": [0.0, 0.1, 0.2], "links": {"stiffness": [10.0, 10.0]}},
        "friction": {"forward": list(FORWARD), "backward": list(BACKWARD)},
        "start": "relaxed",
    }
    return Scene.model_validate(document | ({} if drive is None else {"drive": drive}) | more)


def posterior(deviation: float = 0.03, without: tuple[str, ...] = (), **more: Any) -> Posterior:
    """All frictions of `robot` with relative standard deviations; neighbours are correlated."""
    values = np.array(FORWARD + BACKWARD)
    correlation = np.eye(6) + 0.4 * (np.eye(6, k=1) + np.eye(6, k=-1))
    covariance = correlation * np.outer(deviation * values, deviation * values)
    kept = [i for i, name in enumerate(NAMES) if name not in without]
    names = tuple(NAMES[i] for i in kept)
    return Posterior(names, values[kept], covariance[np.ix_(kept, kept)], **more)


def printed(known: Posterior) -> dict[str, Any]:
    """The JSON of an identification that ended with a posterior."""

    def entry(name: str, verdict: str, value: float | None, interval: Any = (None, None)) -> dict[str, Any]:
        group = next((one for one in known.groups if name in one), ())
        partners = [other for other in group if other != name]
        return {"name": name, "verdict": verdict, "value": value, "interval": list(interval), "with": partners}

    ratios = {name for group in known.groups for name in group}
    parameters = [
        entry(name, "ratio" if name in ratios else "identified", value, (0.9 * value, 1.1 * value))
        for name, value in zip(known.names, known.values.tolist(), strict=True)
    ]
    parameters += [entry(name, "ratio", value) for name, value in known.held.items()]
    for name, (low, high) in known.bounds.items():
        parameters.append(entry(name, "bound", high if low is None else low, (low, high)))
    parameters += [entry(name, "not excited", None) for name in known.unknown]
    return {"schema": 1, "scene": "robot", "parameters": parameters, "posterior": known.as_plain()}
