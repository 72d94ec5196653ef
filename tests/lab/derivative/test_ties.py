"""At a tie that leaves the translation open, all numbers whose derivative is one-sided are listed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from crawler_lab import sensitivities
from crawler_lab.sweep.vary import Variations
from crawler_model import Scene, simulate

STEP, APART = 1e-6, 1e-3
KEYS = ("friction.forward", "friction.backward", "body.links.stiffness", "drive.actuation")


def balanced(half: int, turned: bool, rows: list[list[float]]) -> dict[str, Any]:
    """An odd chain whose middle contact rests while both halves slide apart at their bounds, which sum up to nothing."""
    count = 2 * half + 1
    sides = [float(half)] * count, [float(half + 1)] * count
    return {
        "name": "balanced",
        "body": {"contacts": list(range(count)), "links": {"stiffness": [2.0] * (count - 1)}},
        "friction": dict(
            zip(("backward", "forward") if turned else ("forward", "backward"), map(list, sides), strict=True)
        ),
        "start": "relaxed",
        "drive": {"times": list(range(len(rows))), "actuation": [row * (count - 1) for row in rows]},
    }


def drawn(seed: int) -> dict[str, Any]:
    """A symmetric chain with small whole numbers, so that many contacts reach their bounds together."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 6))
    stiffness, forward = rng.integers(1, 3, count - 1), rng.integers(1, 3, count)
    actuation = rng.integers(-3, 4, (4, count - 1))
    actuation[0] = 0
    forward = np.maximum(forward, forward[::-1])
    return {
        "name": f"drawn_{seed}",
        "body": {
            "contacts": list(range(count)),
            "links": {"stiffness": np.maximum(stiffness, stiffness[::-1]).astype(float).tolist()},
        },
        "friction": {
            "forward": forward.astype(float).tolist(),
            "backward": (forward * float(rng.integers(1, 3))).tolist(),
        },
        "start": "relaxed",
        "drive": {"times": [0, 1, 2, 3], "actuation": np.maximum(actuation, actuation[:, ::-1]).tolist()},
    }


def list_missed(document: dict[str, Any]) -> list[str]:
    """List the numbers whose one-sided differences are apart, but which are not listed."""
    scene = Scene.model_validate(document)
    found = sensitivities(scene, KEYS, rate=1.0)
    x = simulate(scene, rate=1.0).displacement
    missed = []
    for name, value, listed in zip(found.parameters, found.values, found.one_sided, strict=True):
        varied = Variations(scene, {name: value + STEP * np.array([-1.0, 1.0])}, (2,))
        below, above = (simulate(varied[k], rate=1.0).displacement for k in range(2))
        apart = np.abs((above - x) - (x - below)).max() > APART * STEP
        if apart and not listed:
            missed.append(name)
    return missed


@pytest.mark.parametrize("rows", [[[0.0], [5.0], [5.0]], [[0.0], [-5.0], [3.0]]], ids=["out", "in and out"])
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("half", [1, 2, 3])
def test_numbers_that_end_the_choice_of_a_translation_are_listed(
    half: int, turned: bool, rows: list[list[float]]
) -> None:
    assert list_missed(balanced(half, turned, rows)) == []


@pytest.mark.parametrize("seed", range(40))
def test_numbers_at_random_ties_are_listed(seed: int) -> None:
    assert list_missed(drawn(seed)) == []
