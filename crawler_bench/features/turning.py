"""Time and error of bodies that turn, beside MuJoCo on the same body and `kinematic-snake` on a continuous one."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy import integrate

from crawler_model import Crawler, Scene
from crawler_model.body.drive import NS

from ..cases import QUARTERS, Case, snake_scene
from ..entrants.mujoco_turning import MujocoTurningRun

CONTACTS, QUICK = (3, 10, 30), (3,)
_TICKS, _ROUNDS = 100, 3
"""Ticks per period of ours, and runs of two periods, of which the fastest one counts."""
_TOLERANCES, _STEPS = (1e-3, 1e-5, 1e-7), (1_000, 3_000, 10_000)
_FROUDE = (1e-1, 1e-2, 1e-3)
"""Froude numbers of `kinematic-snake`; with the smallest one its inertia changes the advance by some 1e-5."""
_SAMPLES = 300
"""Points of its body."""
_CURVATURE, _WAYPOINTS = 7.0, 128
"""Largest curvature [1/m] of a snake of 1 m, and waypoints of a period."""
_FRICTION = {"forward": 1.0, "backward": 1.5, "left": 2.0, "right": 2.0}
_PEERS = {"MuJoCo": ("mujoco", "crawler-ros[bench]"), "kinematic-snake": ("kinematic_snake", "kinematic-snake")}


def missing_peers() -> dict[str, str]:
    """Find the peers that are not installed.

    Returns:
        The requirement that brings each, by its name.
    """
    return {name: by for name, (module, by) in _PEERS.items() if importlib.util.find_spec(module) is None}


def measure_turning(contacts: Sequence[int], progress: Callable[[float], None]) -> list[dict[str, Any]]:
    """Measure snakes on isotropic friction beside MuJoCo, then continuous snakes beside `kinematic-snake`.

    Args:
        contacts: numbers of contacts N.
        progress: called with the completed part, in [0, 1].

    Returns:
        For each body, method and setting: ticks or steps per period, the shortest processor time of one [us] and of a
        period [ms], the time relative to ours with a tolerance of 1e-5, and the error. That of the first bodies is the
        largest one of a displacement at a quarter of two periods, relative to the range of the motion, beside a
        tolerance of 1e-9; that of a continuous snake is that of the advance in the second period, beside
        `kinematic-snake` with the smallest Froude number, and is None without it.
    """
    rows: list[dict[str, Any]] = []
    for done, n in enumerate(contacts, 1):
        rows += _measure_snake(n)
        progress(done / (len(contacts) + 1))
    small = len(contacts) == len(QUICK)
    rows += _measure_continuous((10,) if small else (10, 30), _FROUDE[:1] if small else _FROUDE)
    progress(1.0)
    return rows


@dataclass(frozen=True)
class _Entry:
    """A method with a setting; ticks or steps per period, None where the method chooses its steps."""

    method: str
    n: int
    setting: str
    ticks: int | None


def _measure_snake(n: int) -> list[dict[str, Any]]:
    case = Case(f"snake_{n}", f"snake of {n} contacts", snake_scene(n))
    starts: dict[_Entry, Callable[[], Any]] = {}
    for tolerance in _TOLERANCES:
        scene = Scene.model_validate(case.scene.document() | {"tolerance": tolerance})
        starts[_Entry("crawler", n, f"tolerance {tolerance:g}", _TICKS)] = partial(_OwnRun, case, scene)
    if "MuJoCo" not in missing_peers():
        for steps in _STEPS:
            starts[_Entry("MuJoCo, tuned", n, f"{steps} steps", steps)] = partial(MujocoTurningRun, case.scene, steps)
    spent, errors = dict.fromkeys(starts, np.inf), dict.fromkeys(starts, np.inf)
    for _ in range(_ROUNDS):
        for entry, start in starts.items():
            run, found, times = start(), [], []
            for number in range(QUARTERS):
                times.append(run.quarter(number))
                found.append(run.displacement)
            spent[entry] = min(spent[entry], *np.sum(np.reshape(times, (-1, 4)), axis=1).tolist())
            errors[entry] = case.reference.error(np.array(found))
    return _list_rows(case.title, spent, errors)


class _OwnRun:
    def __init__(self, case: Case, scene: Scene) -> None:
        self._case, self._crawler = case, Crawler(scene)

    @property
    def displacement(self) -> np.ndarray:
        return self._crawler.displacement

    def quarter(self, number: int) -> float:
        targets = self._case.quarters(_TICKS, True)[number % 4]
        began = time.thread_time()
        self._crawler.follow(targets)
        return time.thread_time() - began


def _list_rows(case: str, spent: dict[_Entry, float], errors: dict[_Entry, Any]) -> list[dict[str, Any]]:
    base = next(time for entry, time in spent.items() if entry.setting == "tolerance 1e-05")
    return [
        {
            "case": case,
            **vars(entry),
            "us_per_tick": 1e6 * seconds / entry.ticks if entry.ticks else None,
            "ms_per_period": 1e3 * seconds,
            "to_ours": seconds / base,
            "error": errors[entry],
        }
        for entry, seconds in spent.items()
    ]


def _measure_continuous(sizes: Sequence[int], froude: Sequence[float]) -> list[dict[str, Any]]:
    found: dict[_Entry, tuple[float, float]] = {}
    for n in sizes:
        found[_Entry("crawler", n, "tolerance 1e-05", _WAYPOINTS)] = _advance_own(n)
    exact = None
    if "kinematic-snake" not in missing_peers():
        for number in froude:
            entry = _Entry("kinematic-snake", _SAMPLES, f"Froude number {number:g}", None)
            found[entry] = _advance_peer(number)
            exact = found[entry][1]
    errors = {entry: abs(advance / exact - 1.0) if exact else None for entry, (_, advance) in found.items()}
    return _list_rows("continuous snake", {entry: spent for entry, (spent, _) in found.items()}, errors)


def build_continuous_snake(cells: int) -> Scene:
    """Build a snake of 1 m whose curvature is a wave; it is nearly rigid, and follows the law along the velocity.

    Args:
        cells: number of straight cells N, each with a contact in its middle.

    Returns:
        The scene.
    """
    times = np.arange(_WAYPOINTS + 1) / _WAYPOINTS
    ends = np.arange(1, cells) / cells
    turns = np.zeros((_WAYPOINTS + 1, 2 * cells - 1))
    turns[:, 1::2] = _CURVATURE / cells * np.cos(2.0 * np.pi * (ends + np.where(times < 1.0, times, 0.0)[:, None]))
    share = np.arange(2 * cells + 1) % 2 / cells
    return Scene.model_validate(
        {
            "name": f"continuous_snake_{cells}",
            "dimension": 2,
            "body": {
                "points": [[0.5 * i / cells, 0.0] for i in range(2 * cells + 1)],
                "springs": "length",
                "links": {"stiffness": 1e5},
                "joints": {"stiffness": 1e4},
            },
            "friction": {name: (part * share).tolist() for name, part in _FRICTION.items()} | {"law": "along_velocity"},
            "start": "relaxed",
            "drive": {
                "times": times.tolist(),
                "period": 1.0,
                "actuation": np.hstack((np.zeros((_WAYPOINTS + 1, 2 * cells)), turns)).tolist(),
            },
        }
    )


def _advance_own(cells: int) -> tuple[float, float]:
    """Follow two periods; return the shorter time [s] and the distance of the second one [m]."""
    crawler = Crawler(build_continuous_snake(cells))
    targets = crawler.scene.drive.sample(np.arange(1, _WAYPOINTS + 1) * (NS // _WAYPOINTS))
    spent, centres = [], []
    for _ in range(2):
        began = time.thread_time()
        crawler.follow(targets)
        spent.append(time.thread_time() - began)
        centres.append(crawler.displacement[1::2].mean(axis=0))
    return min(spent), float(np.hypot(*(centres[1] - centres[0])))


def _advance_peer(froude: float) -> tuple[float, float]:
    """Follow two periods by `kinematic-snake` and LSODA, as `_advance_own`."""
    # names that SciPy has dropped; the peer passes samples as a row
    integrate.simps, integrate.cumtrapz = integrate.simpson, integrate.cumulative_trapezoid
    integrate.trapz = lambda values, samples: integrate.trapezoid(values, np.ravel(samples))
    import sympy
    from kinematic_snake.kinematic_snake import KinematicSnake

    names = {"mu_f": _FRICTION["forward"], "mu_b": _FRICTION["backward"], "mu_lat": _FRICTION["left"]}
    with contextlib.redirect_stdout(io.StringIO()):
        snake = KinematicSnake(froude_number=froude, friction_coefficients=names, samples=_SAMPLES)
    snake.set_activation(lambda s, t: _CURVATURE * sympy.cos(2 * sympy.pi * (s + t)))
    state, spent = snake.state.ravel().copy(), []
    for number in range(2):
        began, before = time.thread_time(), state[:2]
        answer = integrate.solve_ivp(snake, (number, number + 1), state, method="LSODA", rtol=1e-6, atol=1e-8)
        spent.append(time.thread_time() - began)
        state = answer.y[:, -1]
    return min(spent), float(np.hypot(*(state[:2] - before)))
