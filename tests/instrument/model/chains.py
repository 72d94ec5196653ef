"""Random chains and small scenes for the tests."""

from __future__ import annotations

from importlib import resources
from typing import Any

import numpy as np
import yaml
from hypothesis import strategies as st

from crawler_model import Scene


def scene(
    contacts: int = 2,
    stiffness: Any = 1.0,
    forward: Any = 1.0,
    backward: Any = 1.0,
    drive: dict[str, Any] | None = None,
    start: Any = None,
) -> Scene:
    data: dict[str, Any] = {
        "name": "test",
        "body": {"contacts": list(range(contacts)), "links": {"stiffness": stiffness}},
        "friction": {"forward": forward, "backward": backward},
    }
    if drive is not None:
        data["drive"] = drive
    if start is not None:
        data["start"] = {"displacement": start}
    return Scene.model_validate(data)


def coarse(name: str, elements: int = 6) -> Scene:
    """A scene of the gallery whose segments have so many elements: none are counted."""
    data = yaml.safe_load((resources.files("msgs_config") / "scenes" / f"{name}.yaml").read_text(encoding="utf-8"))
    data["body"]["segments"] = [segment | {"elements": elements} for segment in data["body"]["segments"]]
    return Scene.model_validate(data)


def from_rows(stiffness: np.ndarray, actuation: np.ndarray, forward: np.ndarray, backward: np.ndarray) -> Scene:
    """A scene whose drive goes through the rows, one a second, starting at rest with L = 0."""
    rows = {"forward": forward.tolist(), "backward": backward.tolist()}
    drive = {"times": list(range(len(actuation))), "actuation": actuation.tolist(), "friction": rows}
    n = forward.shape[1]
    return scene(n, stiffness.tolist(), forward[0].tolist(), backward[0].tolist(), drive)


@st.composite
def rows(draw: st.DrawFn, most: int = 7, commanded: bool | None = None) -> tuple[np.ndarray, ...]:
    """Stiffness (N-1,), actuation (W, N-1), forward and backward friction (W, N) of a random driven chain.

    Half of them are of quarters and whole numbers: contacts reach bounds together and frictions balance.
    """
    n = draw(st.integers(2, most))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    ways = draw(st.integers(2, 6))
    stiffness = np.exp(rng.uniform(-2, 3, n - 1))
    actuation = np.vstack((np.zeros(n - 1), rng.uniform(-3, 3, (ways - 1, n - 1))))
    forward, backward = np.exp(rng.uniform(-2, 1, (2, ways, n)))
    if draw(st.booleans()):
        stiffness = np.ones(n - 1)
        actuation[1:] = rng.integers(-3, 4, (ways - 1, n - 1))
        forward, backward = rng.integers(1, 5, (2, ways, n)) / 4.0
    if draw(st.booleans()):  # no friction here and there, now and then
        forward *= rng.random((ways, n)) < 0.7
        backward *= rng.random((ways, n)) < 0.7
    if not (draw(st.booleans()) if commanded is None else commanded):
        forward[:], backward[:] = forward[0], backward[0]
    return stiffness, actuation, forward, backward
