"""Chains whose bounds depend on place and shape, against places in rational numbers.

`displacement` is that after each ramp, from an event-driven solution in fractions in which all directions of all
contacts are tried; `anchors` are friction that elongations add.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from crawler_model import Scene, simulate

CASES = json.loads(Path(__file__).with_name("bounds_cases.json").read_text())
QUICK = ("profile", "anchor", "steep")
"""Kinds whose kernels other tests need, too."""


def build_scene(case: dict[str, Any]) -> Scene:
    links = [{"between": [j, j + 1], "stiffness": stiffness} for j, stiffness in enumerate(case["stiffness"])]
    for link, elements in zip(links, case.get("hysteresis", []), strict=False):
        link["hysteresis"] = [{"stiffness": each["stiffness"], "yield": each["yield_"]} for each in elements]
    friction = {side: case[side] for side in ("forward", "backward")}
    friction["with_elongation"] = [
        {key: anchor[key] for key in ("link", "elongation")}
        | {"contacts": [anchor["contact"]], "added": anchor["friction"]}
        for anchor in case.get("anchors", [])
    ]
    ground: dict[str, Any] = {
        "walls": [
            {"at": wall["at"], "stops": "forward" if wall["side"] > 0 else "backward", "contacts": [wall["contact"]]}
            for wall in case.get("walls", [])
        ]
    }
    if "profile" in case:
        ground["profile"] = {"at": case["profile"]["at"], "friction": case["profile"]["factor"]}
    rows = [[0.0] * len(links), *case["actuation"]]
    data = {
        "name": "rational",
        "body": {"contacts": case["contacts"], "links": links},
        "friction": friction,
        "ground": ground,
        "drive": {"times": list(range(len(rows))), "actuation": rows},
    }
    return Scene.model_validate(data)


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, marks=[] if case["kind"] in QUICK else pytest.mark.slow, id=f"{case['kind']}-{k}")
        for k, case in enumerate(CASES)
    ],
)
def test_runs_agree_with_rational_numbers_at_every_rate(case: dict[str, Any]) -> None:
    scene = build_scene(case)
    for rate in (1.0, 7.0, 100.0):
        run = simulate(scene, rate=rate)
        assert run.waypoint_displacement[1:] == pytest.approx(np.array(case["displacement"]), abs=1e-12)
        assert run.unique == case["unique"]
        assert run.unsolved == run.overspent == 0
        assert [jump.contact for jump in run.jumps] == [jump["contact"] for jump in case["jumps"]]
        for jump, expected in zip(run.jumps, case["jumps"], strict=True):
            assert jump.distance == pytest.approx(expected["distance"], abs=1e-12)
            assert jump.loss == pytest.approx(expected["loss"], abs=1e-12)
