"""What users call, beside what else does the same: one table, from one run."""

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

from .bench import run_bench
from .entrants.mujoco import TUNED, build_document
from .growth import QUICK as GROWTH_QUICK
from .growth import SECONDS, measure_growth
from .growth_drives import DRIVES
from .many import measure_environments

CALLS, QUICK = 20_000, 2_000
"""Calls of a round."""
_ROUNDS, _CONTACTS, _PERIOD = 15, (2, 10), 64
"""Rounds, of which the fastest counts; numbers of contacts; commands of a period."""
_ENVIRONMENTS = 1024
_WAVES = "wave_100", "wave_1000"
_GROWING = "waves of 20 links", "five waves of strain", "ring of a segment and a foot"
"""Cases in which an implicit step is compared, and drives on which the growth of the time of a ramp is measured."""
_STEPS = 1000
"""Steps a second of MuJoCo."""


def measure_calls(calls: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure what users call.

    Returns:
        A row for each body and call: the time of one call [us], processor time but for environments, OSQP and replay;
        the name of the peer and the time relative to the peer's [1]; and the exponent of the growth of the time with
        the number of contacts. What does not apply is None, and a peer that is not installed is left out.
    """
    quick = calls < CALLS
    rows = _measure_chains(calls, lambda part: progress(0.2 * part))
    for threads, name in ((1, "one core"), (2, "two")):
        environments = measure_environments(_CONTACTS[-1], _ENVIRONMENTS, calls, threads)
        body = f"{_ENVIRONMENTS:,} environments of {_CONTACTS[-1]} contacts"
        rows.append(_row(body, f"a step of one, on {name}", environments["us_per_step"]))
    rows += _compare_steps(quick, lambda part: progress(0.2 + 0.2 * part))
    rows += _measure_long_ramps(quick, lambda part: progress(0.4 + 0.4 * part))
    return rows + _compare_replay(quick)


def _row(body: str, call: str, us: float, peer: str | None = None, peer_us: float | None = None) -> dict[str, Any]:
    return {
        "case": "what users call",
        "body": body,
        "call": call,
        "us": us,
        "peer": peer,
        "of_peer": us / peer_us if peer_us else None,
        "exponent": None,
    }


def _measure_chains(calls: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure calls of chains in a wave of commands beside a step of MuJoCo's."""
    rows = []
    for done, contacts in enumerate(_CONTACTS):
        measured = _build_calls(contacts)
        best = dict.fromkeys(measured, float("inf"))
        for k in range(_ROUNDS):
            for name, run in measured.items():
                began = time.thread_time()
                count = run(calls)
                best[name] = min(best[name], 1e6 * (time.thread_time() - began) / count)
            progress((done + (k + 1) / _ROUNDS) / len(_CONTACTS))
        peer = best.get("mj_step")
        rows += [_row(f"chain of {contacts}", name, us, "mj_step" if peer else None, peer) for name, us in best.items()]
    return rows


def _compare_steps(quick: bool, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Compare an implicit step with OSQP, both called from Python once a tick."""
    ours, peer = "catch_up, one call a tick", "OSQP 1e-9"
    bench = run_bench(_WAVES[:1] if quick else _WAVES, quick, progress, (ours, peer))
    found = {
        (row["case"], row["method"]): row["us_per_tick"] for row in bench.rows if row["ticks_per_period"] == _PERIOD
    }
    return [_row(bench.titles[case], ours, found[case, ours], peer, found.get((case, peer))) for case in bench.titles]


def _measure_long_ramps(quick: bool, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure ramps of the largest bodies beside an implicit step, and how their time grows."""
    drives = {name: DRIVES[name] for name in _GROWING}
    times = {}
    for row in measure_growth(GROWTH_QUICK if quick else 0.5 * SECONDS, progress, drives):
        if row.get("ms") is not None:
            times[row["case"], row["n"], row["method"]] = row
    last = {case: row for (case, _, method), row in times.items() if method == "exact"}
    rows = []
    for case, row in last.items():
        step = times.get((case, row["n"], "catch_up"))
        peer = ("catch_up", 1e3 * step["ms"]) if step else ()
        found = _row(f"{case}, N = {row['n']:,}", "an exact ramp", 1e3 * row["ms"], *peer)
        rows.append(found | {"exponent": row["exponent"]})
    return rows


def _compare_replay(quick: bool) -> list[dict[str, Any]]:
    """Compare `crawler replay` with mcap, which only reads the recording."""
    try:
        from .node.replay import measure_replay
    except ImportError:
        return []
    found = {row["what"]: row for row in measure_replay((60,) if quick else (60, 2_700), 1)}  # the first loads kernels
    ours, peer = (1e6 / found[what]["messages_per_s"] for what in ("replay", "mcap reads"))
    body = f"recording of {found['replay']['messages']:,} messages"
    return [_row(body, "crawler replay, a message", ours, "mcap reads", peer)]


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
