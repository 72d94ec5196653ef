"""`python -m benchmarks`, run as a user of a checkout runs it. No test looks at a time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent.parent
KEYS = {"case": str, "n": int, "method": str, "us_per_tick": float, "error": float, "solved": bool}
PARTS = {
    "calls": {"case", "body", "call", "us", "peer", "of_peer", "exponent"},
    "growth": {"case", "method", "n", "ms", "pieces", "overspent", "to_catch_up", "exponent", "note"},
    "identify": {"case", "recording", "noise", "method", "called_determined", "worst_error", "missed", "seconds"},
    "inertia": {"case", "n", "number", "damping", "gain", "deviation", "ratio", "mujoco"},
    "many": {"case", "scene", "n", "variations", "workers", "runs_per_s", "us_per_run", "in_kernels"},
    "mistakes": {"case", "mistake", "robots", "doubtful", "first"},
    "node": {"case", "n", "recording", "subscriber", "driven", "every", "ticks_per_s", "us_per_tick", "real_time"},
    "plan": {"case", "controller", "disturbance", "error_mm", "without_mean_mm", "way_m_per_m"},
    "replay": {"case", "messages", "simulated_s", "what", "seconds", "messages_per_s", "memory_mb"},
}
"""Keys of the first row of each part."""


def measure(folder: Path, *words: str, code: str = "") -> subprocess.CompletedProcess[str]:
    main = [sys.executable, "-m", "benchmarks"] if not code else [sys.executable, "-c", code]
    return subprocess.run([*main, *words, "--out", str(folder)], capture_output=True, text=True, cwd=ROOT)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    done = measure(folder, "--quick", "--case", "strategy_a", "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout, parse_constant=lambda name: pytest.fail(f"{name} in the JSON")), folder


def test_the_json_has_every_method_with_its_error(quick):
    result, folder = quick
    assert json.loads((folder / "speed_against_error.json").read_text()) == result
    for row in result["rows"]:
        for key, kind in KEYS.items():
            stopped = row[key] is None and not row["solved"]  # on a machine that is busy with something else
            assert isinstance(row[key], kind) or stopped, (key, row)
    methods = {row["method"] for row in result["rows"]}
    assert methods >= {"exact", "catch_up", "catch_up, one call a tick", "OSQP 1e-9", "Clarabel 1e-9"}
    assert (folder / "strategy_a.png").stat().st_size > 20_000


def test_exact_is_exact_and_peers_solve_the_same_problem(quick):
    rows = [row for row in quick[0]["rows"] if row["error"] is not None]
    exact = max(row["error"] for row in rows if row["method"].startswith("exact"))
    osqp = [row["error"] for row in rows if row["method"] == "OSQP 1e-9"]
    assert exact <= 1e-12
    assert exact < min(osqp)
    assert max(osqp) < 1e-8
    assert min(row["error"] for row in rows if row["method"].startswith("smooth")) < 1e-4
    certificate = quick[0]["references"]["strategy_a"]
    assert certificate["reference"] == "rational"
    assert certificate["rational_difference"] < 1e-15
    assert certificate["closed_form_difference"] < 1e-14


@pytest.mark.slow
@pytest.mark.parametrize("part", PARTS)
def test_every_part_has_its_figures(part, tmp_path):
    if part in ("node", "replay"):
        pytest.importorskip("rclpy")
    done = measure(tmp_path, part, "--quick", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout, parse_constant=lambda name: pytest.fail(f"{name} in the JSON"))
    assert json.loads((tmp_path / f"{part}.json").read_text()) == result
    assert PARTS[part] <= result["rows"][0].keys()
    assert result["machine"]["cores"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--case", "strategie"), "benchmarks: --case: unknown case 'strategie'; the nearest is 'strategy_a'"),
        (("node", "--case", "strategy_a"), "benchmarks: --case selects cases of the methods"),
    ],
)
def test_a_mistake_is_one_line(words, said, tmp_path):
    done = measure(tmp_path / "out", *words)
    assert done.returncode == 1
    assert done.stderr.startswith(said)
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_without_peers_one_line_names_the_extra_that_brings_them(tmp_path):
    code = (
        "import sys, importlib.util as u; f = u.find_spec;"
        "u.find_spec = lambda name, *a: None if name in ('osqp', 'mujoco', 'daqp', 'piqp', 'proxsuite') else f(name, *a);"
        "from benchmarks.__main__ import main; main()"
    )
    done = measure(tmp_path, "--quick", "--case", "strategy_a", "--json", code=code)
    assert done.returncode == 0, done.stderr
    (said,) = [line for line in done.stderr.splitlines() if "compiling" not in line]
    assert "OSQP, DAQP, PIQP, ProxQP, MuJoCo not installed" in said
    assert "pip install 'crawler-ros[bench]'" in said
