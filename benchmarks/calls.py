"""What a call costs that users make once a command: ours and MuJoCo's, in turn in one run."""

from __future__ import annotations

import contextlib
import importlib
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from crawler_lab.gym import CrawlerEnv
from crawler_model import Crawler, Scene, simulate

from .entrants.mujoco import TUNED, build_document

CALLS, QUICK = 20_000, 2_000
"""Calls of a round."""
_ROUNDS, _CONTACTS, _PERIOD = 15, (2, 10), 64
"""Rounds, of which the fastest counts; numbers of contacts; commands of a period."""
_STEPS = 1000
"""Steps a second of MuJoCo."""


def measure_calls(calls: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure calls on chains in a wave of commands.

    Returns:
        A row for each number of contacts and call: the time of one call [us], and relative to `mj_step` of the same
        chain [1], which is left out where MuJoCo is not installed.
    """
    rows = []
    for done, contacts in enumerate(_CONTACTS):
        measured = _build_calls(contacts)
        best = dict.fromkeys(measured, float("inf"))
        for k in range(_ROUNDS):
            for name, run in measured.items():
                began = time.perf_counter()
                count = run(calls)
                best[name] = min(best[name], 1e6 * (time.perf_counter() - began) / count)
            progress((done + (k + 1) / _ROUNDS) / len(_CONTACTS))
        peer = best.get("mj_step")
        for name, spent in best.items():
            ratio = {} if peer is None else {"of_mj_step": spent / peer}
            rows.append({"case": f"chain of {contacts}", "call": name, "us": spent, **ratio})
    return rows


def _build_calls(contacts: int) -> dict[str, Callable[[int], int]]:
    """Build for each name what makes so many calls, and returns how many it made."""
    phase = np.arange(_PERIOD)[:, None] / _PERIOD - np.arange(contacts - 1) / 10
    lengths = 0.05 * np.sin(2.0 * np.pi * phase)
    lengths -= lengths[0]
    period = [*lengths.tolist(), lengths[0].tolist()]
    scene = Scene.model_validate(
        {
            "name": "chain",
            "body": {"contacts": (0.1 * np.arange(contacts)).tolist(), "links": {"stiffness": 20.0}},
            "friction": {"forward": 0.1, "backward": 0.3},
            "drive": {"times": np.linspace(0.0, 1.0, _PERIOD + 1).tolist(), "period": 1.0, "actuation": period},
        }
    )
    commands = lengths.tolist()
    found = {"Crawler.advance": _advance(scene, commands), "Crawler.follow": _follow(scene, lengths)}
    gradual = {"profile": {"at": [-1.0, 0.3, 2.0], "friction": [1.0, 1.4, 0.9]}}
    uneven = Scene.model_validate(scene.document() | {"ground": gradual})
    found |= {"a tick of simulate": _simulate(scene), "a tick of simulate on a profile": _simulate(uneven)}
    found["env.step"] = _step_environment(scene)
    with contextlib.suppress(ImportError):
        found["mj_step"] = _step_mujoco(scene, lengths)
    return found


def _advance(scene: Scene, commands: list[list[float]]) -> Callable[[int], int]:
    crawler = Crawler(scene)

    def run(calls: int) -> int:
        for k in range(calls):
            crawler.advance(commands[k % _PERIOD])
        return calls

    return run


def _follow(scene: Scene, lengths: np.ndarray) -> Callable[[int], int]:
    crawler = Crawler(scene)
    targets = [crawler.target(row)[None] for row in lengths]

    def run(calls: int) -> int:
        for k in range(calls):
            crawler.follow(targets[k % _PERIOD])
        return calls

    return run


def _simulate(scene: Scene) -> Callable[[int], int]:
    def run(calls: int) -> int:
        return simulate(scene, calls / _PERIOD, _PERIOD).ticks

    return run


def _step_environment(scene: Scene) -> Callable[[int], int]:
    environment = CrawlerEnv(scene, steps=0)
    environment.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (_PERIOD, scene.body.springs))

    def run(calls: int) -> int:
        for k in range(calls):
            environment.step(actions[k % _PERIOD])
        return calls

    return run


def _step_mujoco(scene: Scene, lengths: np.ndarray) -> Callable[[int], int]:
    mujoco: Any = importlib.import_module("mujoco")
    model = mujoco.MjModel.from_xml_string(build_document(scene, _STEPS, replace(TUNED[_STEPS], noslip=0)))
    data = mujoco.MjData(model)
    apart = 1000.0  # tendons require positive lengths
    data.qpos[:] = apart * np.arange(scene.body.contacts)
    model.dof_frictionloss[:] = 0.2
    commands = np.repeat(lengths[:, :, None] + apart, 2, axis=2)

    def run(calls: int) -> int:
        for k in range(calls):
            model.tendon_lengthspring[:] = commands[k % _PERIOD]
            mujoco.mj_step(model, data)
        return calls

    return run
