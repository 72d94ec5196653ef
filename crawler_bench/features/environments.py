"""Steps a second of the environments, one and many, beside those of other projects in one run."""

from __future__ import annotations

import statistics
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

import crawler_gym
from crawler_model import Scene

STEPS, QUICK = 20_000, 500
"""Steps of all environments together in each round; of peers a tenth."""
_ROUNDS = 5
_CONTACTS, _MANY = (3, 10), (64, 1024)
_PEERS = {
    "Swimmer-v5": ("mujoco", "crawler-ros[bench]"),
    "HalfCheetah-v5": ("mujoco", "crawler-ros[bench]"),
    "OctoFlat-v0": ("gym_softrobot", "gym-softrobot"),
}
"""Environments of other projects, the module that each needs, and the requirement that brings it."""


@dataclass(eq=False)
class _Entrant:
    """Environments that step together.

    Attributes:
        name: what is measured.
        contacts: contacts of the body; None for peers.
        count: number of environments.
        step: takes one step in all of them.
        actions: actions that are played again and again.
        times: of a step of all, in each round [s].
    """

    name: str
    contacts: int | None
    count: int
    step: Callable[[Any], Any]
    actions: np.ndarray
    times: list[float]


def missing_peers() -> dict[str, str]:
    """Find the environments of other projects that are not installed, or do not start with the installed versions.

    Returns:
        The requirement that brings each, by its name.
    """
    return {name: requirement for name, (_, requirement) in _PEERS.items() if _make_peer(name) is None}


def measure_environments(steps: int, progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure the environments in interleaved rounds, with random actions, and without rendering.

    Args:
        steps: steps of all environments together in a round, about; of peers a tenth.
        progress: called with the completed part, in [0, 1].

    Returns:
        A row for each environment and number of environments: steps per second and time of a step [us], medians of the
        rounds, the range of the former, and its ratio to that of MuJoCo's swimmer, if it is installed. A vector of ours
        is one compiled call on all cores; peers are single.
    """
    entrants = _ours() + _peers()
    for entrant in entrants:
        for action in entrant.actions[:3]:
            entrant.step(action)
    for number in range(_ROUNDS):
        for entrant in entrants:
            share = steps // 10 if entrant.contacts is None else steps
            _time(entrant, max(share // entrant.count, 3))
        progress((number + 1) / _ROUNDS)
    rates = {e.name: e.count / statistics.median(e.times) for e in entrants if e.contacts is None}
    rows = []
    for entrant in entrants:
        each = [entrant.count / spent for spent in entrant.times]
        rate = statistics.median(each)
        rows.append(
            {
                "case": "environments",
                "environment": entrant.name,
                "n": entrant.contacts if entrant.contacts is not None else "-",
                "environments": entrant.count,
                "steps_per_s": rate,
                "least": min(each),
                "most": max(each),
                "us_per_step": 1e6 / rate,
                "times_swimmer": rate / rates["Swimmer-v5"] if "Swimmer-v5" in rates else None,
            }
        )
    return rows


def _time(entrant: _Entrant, count: int) -> None:
    actions, step, size = entrant.actions, entrant.step, len(entrant.actions)
    began = time.perf_counter()
    for k in range(count):
        step(actions[k % size])
    entrant.times.append((time.perf_counter() - began) / count)


def _ours() -> list[_Entrant]:
    """Build our environments; their episodes do not end."""
    found = []
    for contacts in _CONTACTS:
        scene, random = _scene(contacts), np.random.default_rng(0)
        env = crawler_gym.CrawlerEnv(scene, steps=0)
        env.reset(seed=0)
        actions = random.uniform(-1.0, 1.0, (256, contacts - 1))
        found.append(_Entrant("Crawler-v0", contacts, 1, env.step, actions, []))
        for count in _MANY:
            many = crawler_gym.CrawlerVectorEnv(count, scene, steps=0)
            many.reset(seed=0)
            actions = random.uniform(-1.0, 1.0, (16, count, contacts - 1))
            found.append(_Entrant("Crawler-v0", contacts, count, many.step, actions, []))
    return found


def _scene(contacts: int) -> Scene:
    """Build a chain with bristles."""
    return Scene.model_validate(
        {
            "name": f"chain_{contacts}",
            "body": {"contacts": (0.1 * np.arange(contacts)).tolist(), "links": {"stiffness": 20.0}},
            "friction": {"forward": 0.2, "backward": 0.5},
        }
    )


def _peers() -> list[_Entrant]:
    """Build the environments of other projects that are installed; their episodes begin anew as they end."""
    found = []
    for name in _PEERS:
        env = _make_peer(name)
        if env is None:
            continue
        env.action_space.seed(0)
        actions = np.array([env.action_space.sample() for _ in range(256)])

        def step(action: np.ndarray, env: Any = env) -> None:
            *_, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()

        found.append(_Entrant(name, None, 1, step, actions, []))
    return found


def _make_peer(name: str) -> Any | None:
    """Make an environment of another project; return None if it is not installed, or does not start."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            __import__(_PEERS[name][0])
            env = gymnasium.make(name, disable_env_checker=True)
            env.reset(seed=0)
    except Exception:  # whatever fails in another project: an old one fails where it uses what NumPy has dropped
        return None
    return env
