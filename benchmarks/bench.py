"""The comparison of methods: entrants of each case, description of the machine, and methods left out with reasons."""

from __future__ import annotations

import difflib
import importlib.util
import os
import platform
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from crawler_model import CrawlerError, prepare
from crawler_ros.recording.attachments import installed_version

from .cases import CASES, LONG, Case, describe
from .entrants import mujoco as mujoco_peer
from .entrants import ode as ode_peer
from .entrants import ours
from .entrants import planar as planar_peer
from .entrants import qp as qp_peers
from .entrants.entrant import Entrant
from .measure import Effort, measure
from .result import BenchResult

PEERS = {
    "osqp": "OSQP",
    "clarabel": "Clarabel",
    "daqp": "DAQP",
    "piqp": "PIQP",
    "proxsuite": "ProxQP",
    "mujoco": "MuJoCo",
}
"""Module and name of each peer; scipy's LSODA is always installed."""
_LEAST_SMOOTHING = {
    "strategy_a": (1e-6, 1e-6),
    "peristaltic": (1e-5, 1e-4),
    "wave_100": (1e-4, 1e-2),
    "wave_1000": (1e-2, 1e-2),
}
"""The finest eps of smooth friction that a full run and a quick run try; finer ones take seconds a period."""
_QUADRATIC = ("OSQP", "DAQP", "PIQP", "ProxQP")
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def missing_peers() -> list[str]:
    """List the peers that are not installed.

    Returns:
        Their names.
    """
    return [name for module, name in PEERS.items() if importlib.util.find_spec(module) is None]


def choose_cases(names: Sequence[str], quick: bool) -> list[str]:
    """Check the names of cases.

    Returns:
        The names, in the order of the list of cases.
    """
    for name in names:
        if name not in CASES:
            near = difflib.get_close_matches(name, CASES, n=1, cutoff=0.0)[0]
            raise CrawlerError(f"--case: unknown case {name!r}; the nearest is {near!r}, of {', '.join(CASES)}")
    return [name for name in CASES if name in names or (not names and not (quick and name in LONG))]


def run_bench(
    names: Sequence[str], quick: bool, progress: Callable[[float], None], methods: Sequence[str] = ()
) -> BenchResult:
    """Measure the methods on some cases.

    Args:
        names: of the cases.
        quick: whether to measure less.
        progress: told the part that is done.
        methods: names of those to measure; all if there are none.

    Returns:
        The results.
    """
    for name in THREADS:  # for libraries loaded from here on
        os.environ.setdefault(name, "1")
    bench = BenchResult(describe_machine(quick))
    for done, name in enumerate(names):
        case = CASES[name]()
        prepare(case.scene)
        entrants = [e for e in _entrants(case, quick, bench.left_out) if not methods or e.method in methods]
        effort = _effort(case, quick)
        parts, total = 0, len(entrants) * (1 + effort.rounds)

        def step(done: int = done, total: int = total) -> None:
            nonlocal parts
            parts += 1
            progress((done + parts / total) / len(names))

        with _silence():
            bench.rows += measure(case, entrants, effort, step)
        bench.references[name] = describe(case.reference)
        bench.titles[name] = case.title
    bench.machine["load_average_end"] = [round(x, 2) for x in os.getloadavg()]
    return bench


@contextmanager
def _silence() -> Iterator[None]:
    """Discard standard output of compiled libraries: OSQP reports on polishing even when not verbose."""
    import ctypes

    sys.stdout.flush()
    saved = os.dup(1)
    with open(os.devnull, "w", encoding="utf-8") as nothing:
        os.dup2(nothing.fileno(), 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        ctypes.CDLL(None).fflush(None)
        os.dup2(saved, 1)
        os.close(saved)


def _effort(case: Case, quick: bool) -> Effort:
    if quick:
        return Effort(3, 0.5 if case.contacts < 1_000 else 1.6)
    return Effort(7, 3.0) if case.contacts < 10_000 else Effort(5, 10.0)


def _entrants(case: Case, quick: bool, left_out: list[dict[str, str]]) -> list[Entrant]:
    n, absent = case.contacts, missing_peers()
    reason = mujoco_peer.why_not(case)
    if reason is not None:
        left_out.append({"case": case.name, "method": "MuJoCo", "reason": reason})
    if case.scene.dimension == 2:
        reason = "friction in the plane is a disc, which a quadratic program cannot represent"
        left_out += [{"case": case.name, "method": m, "reason": reason} for m in _QUADRATIC]
        entrants = ours.build_planar(case, (1e-2, 1e-4, 1e-6) if quick else (1e-2, 1e-3, 1e-4, 1e-5, 1e-6))
        return entrants + planar_peer.build_cone_peers(case, (4, 64) if quick else (4, 16, 64, 256, 1024))
    exact: tuple[int, ...]
    catch_up: tuple[int, ...]
    each: tuple[int, ...]
    ticks: tuple[int, ...]
    if n < 100:
        exact, catch_up, each = (4, 64, 1024), (4, 16, 64, 256, 1024, 4096), (4, 64, 1024)
        ticks = (4, 64, 256) if quick else (4, 16, 64, 256, 1024)
    elif n <= 1_000:
        exact, catch_up, each = (4, 64, 1024), (16, 64, 256, 1024, 4096), (64,)
        ticks = (64,) if quick else (16, 64, 256) if n > 100 else (16, 64, 256, 1024)
    else:
        exact, catch_up, each = (64,), (16, 64, 256) if n <= 10_000 else (16, 64), (64,)
        ticks = (64,)
    entrants = ours.build_ours(case, exact, catch_up, each)
    for entrant in qp_peers.build_qp_peers(case, ticks):
        if entrant.method.split()[0] not in absent:
            entrants.append(entrant)
    if case.name in _LEAST_SMOOTHING:
        least = _LEAST_SMOOTHING[case.name][quick]
        entrants += ode_peer.build_ode_peers(case, tuple(eps for eps in ode_peer.SMOOTHINGS if eps >= 0.99 * least))
    if reason is None and "MuJoCo" not in absent:
        entrants += mujoco_peer.build_mujoco_peers(case, scan=not quick)
    return entrants


def describe_machine(quick: bool) -> dict[str, Any]:
    """Describe the machine.

    Returns:
        Its processor, versions and load.
    """
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {
        "cpu": models[0] if models else platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
        **{name: installed_version(name) for name in ("crawler-ros", "numpy", "numba", "scipy", *PEERS)},
        "threads": "one, set for each library by " + ", ".join(THREADS),
        "load_average": [round(x, 2) for x in os.getloadavg()],
        "quick": quick,
    }
