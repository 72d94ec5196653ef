"""Random bodies on a line, followed also by the interpreted kernels in floating-point numbers of 80 bits.

`python -m tests.instrument.model.extended` reads the arguments of `follow` as JSON from its input, and writes what that returns.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from typing import Any

import numpy as np

RECORDS = "crawler_model.motion.line.records"
WIDENED = (RECORDS, "crawler_model.motion.line.springs.records")


def follow(kind: str, seed: int, ratio: float, rounds: int, method: str) -> dict[str, Any]:
    """Follow a random body with commanded friction through its drive, several times.

    Args:
        kind: of body, see `bodies`.
        seed: of its numbers.
        ratio: by which the stiffest link becomes stiffer than it is, relative to the softest one.
        rounds: how often the drive is repeated.
        method: `exact` or `catch_up`.

    Returns:
        The displacement at the end [m]; the largest one at the end of a ramp [m]; the number of ramps whose answer is
        not unique; and the number of digits of the kernels.
    """
    from crawler_model import Crawler, Scene

    from .bodies import Drawn

    driven = Drawn(kind, seed, commanded=True).driven()
    if "links" in driven.data["body"] and ratio > 1.0:
        stiffness = driven.data["body"]["links"]["stiffness"]
        spread = np.random.default_rng(seed).permutation(ratio ** np.linspace(0.0, 1.0, len(stiffness)))
        driven.data["body"]["links"]["stiffness"] = (spread * stiffness).tolist()
    body = Crawler(Scene.model_validate(driven.data), method)
    largest, ambiguous = 0.0, 0
    for row in driven.rows * rounds:
        ambiguous += not body.advance(*row).unique
        largest = max(largest, float(np.abs(body.displacement).max()))
    digits = np.finfo(sys.modules[RECORDS].CONTACT["x"]).precision
    return {"x": body.displacement.tolist(), "largest": largest, "ambiguous": ambiguous, "digits": digits}


def follow_extended(*args: Any) -> dict[str, Any]:
    """Do the same in 80 bits, in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.instrument.model.extended"],
        input=json.dumps(args),
        capture_output=True,
        text=True,
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def _widen() -> None:
    """Declare the numbers of all records with 80 bits, before kernels are imported."""
    for name in WIDENED:
        spec = importlib.util.find_spec(name)
        assert spec is not None
        source = spec.loader.get_source(name)  # type: ignore[union-attr]
        sys.modules[name] = module = importlib.util.module_from_spec(spec)
        exec(source.replace("np.float64", "np.longdouble"), module.__dict__)
    count = np.bincount  # of what is reported; it takes no wider numbers
    np.bincount = lambda i, values, least: count(i, np.asarray(values, np.float64), least)  # type: ignore[assignment]


if __name__ == "__main__":
    _widen()
    print(json.dumps(follow(*json.load(sys.stdin))))
