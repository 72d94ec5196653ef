"""The start of every executable: stopped, or with a package missing, it ends with one line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from crawler_command import executables

from ..pages import ROOT

BIN = Path(sys.executable).parent
NODES = ["simulator", "gait_player", "speed_control", "phase_control", "path_control", "policy", "plan"]
HOOK = """
import os, signal, sys

class Hook:
    def find_spec(self, name, path=None, target=None):
        if name == os.environ.get("INTERRUPTED_AT"):
            os.kill(os.getpid(), signal.SIGINT)
        if name.split(".")[0] in os.environ.get("NOT_INSTALLED", "").split():
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hook())
"""
"""Runs in the started process: interrupts it while a module is imported, or lets a package be missing."""


def start(folder: Path, name: str, *words: str, **more: str) -> subprocess.Popen[str]:
    (folder / "sitecustomize.py").write_text(HOOK)
    executable = "crawler" if name == "crawler" else f"crawler-{name.replace('_', '-')}"
    return subprocess.Popen(
        [str(BIN / executable), *words],
        env=os.environ
        | {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        | more,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=folder,
        start_new_session=True,
    )


def end(process: subprocess.Popen[str]) -> tuple[int, list[str]]:
    try:
        _, said = process.communicate(timeout=200)
    finally:
        process.kill()
    return process.returncode, [line for line in said.splitlines() if "compiling" not in line]


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("crawler", "crawler_command.app"),
        ("crawler", "numpy.linalg"),
        ("crawler", "numba.core.typing"),
        ("crawler", "pydantic"),
        ("replay", "typer"),
        *[(name, "rclpy.node") for name in NODES],
        *[(name, "rclpy.clock") for name in NODES],
        ("simulator", "numba"),
        ("simulator", "crawler_model"),
        ("gait_player", "rcl_interfaces.msg"),
    ],
)
def test_ctrl_c_during_imports_is_one_line(name, module, tmp_path):
    if name in NODES:
        pytest.importorskip("rclpy")
    words = ("simulate", "two_anchor_a") if name == "crawler" else ()
    status, said = end(start(tmp_path, name, *words, INTERRUPTED_AT=module))
    assert said == [f"{'crawler' if name == 'replay' else name}: stopped"]
    assert status == 130


@pytest.mark.parametrize(("name", "words"), [("crawler", ["check", "two_anchor_a"]), ("simulator", [])])
def test_ctrl_c_while_compiling_is_one_line(name, words, tmp_path):
    if name in NODES:
        pytest.importorskip("rclpy")
    process = start(tmp_path, name, *words, XDG_CACHE_HOME=str(tmp_path), NUMBA_CACHE_DIR="", ROS_DOMAIN_ID="99")
    while not any(tmp_path.rglob("*.nbc")) and process.poll() is None:  # the first kernel of many
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    status, said = end(process)
    assert said == [f"{name}: stopped"]
    assert status == 130


@pytest.mark.parametrize(
    ("name", "words", "missing", "extra"),
    [
        *[(name, [], "rclpy", "ros") for name in NODES],
        ("simulator", [], "std_msgs sensor_msgs rcl_interfaces trajectory_msgs", "ros"),
        ("crawler", ["demo"], "rclpy", "ros"),
        ("crawler", ["view", "x.rrd", "--png", "x.png"], "rerun rerun_cli", "viz"),
        ("crawler", ["check", "two_anchor_a", "--png", "x.png"], "matplotlib", "viz"),
    ],
)
def test_a_missing_package_names_the_extra_that_brings_it(name, words, missing, extra, tmp_path):
    (tmp_path / "x.rrd").write_bytes(b"RRF2")
    status, said = end(start(tmp_path, name, *words, NOT_INSTALLED=missing))
    (line,) = said
    assert line.startswith(f"{name}: ")
    assert line.endswith(f" is not installed; install with: pip install 'crawler-ros[{extra}]'")
    assert status == 1


@pytest.mark.parametrize("package", ["numba", "yaml", "typer"])
def test_a_missing_requirement_is_named(package, tmp_path):
    status, said = end(start(tmp_path, "crawler", "simulate", "two_anchor_a", NOT_INSTALLED=package))
    assert said == [f"crawler: {package} is not installed; install with: pip install crawler-ros"]
    assert status == 1


def test_a_recording_goes_to_the_home_folder(tmp_path):
    pytest.importorskip("rclpy")
    words = ["--ros-args", "-p", "record:=~/bags"]
    process = start(
        tmp_path,
        "simulator",
        *words,
        HOME=str(tmp_path),
        ROS_DOMAIN_ID="98",
        XDG_CACHE_HOME=os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache")),
    )
    while not list((tmp_path / "bags").glob("*/*.mcap")) and process.poll() is None:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    end(process)
    assert list((tmp_path / "bags").glob("*/*.mcap"))
    assert not (tmp_path / "~").exists()


@pytest.mark.parametrize("ignored", [False, True])
def test_interrupts_that_a_script_ignores_stay_ignored(ignored, monkeypatch):
    """A program that was started in the background inherits this, and Ctrl-C is meant for another one."""
    seen: list[object] = []

    def load(_: str) -> SimpleNamespace:
        seen.append(signal.getsignal(signal.SIGINT))
        return SimpleNamespace(main=lambda: seen.append(signal.getsignal(signal.SIGINT)))

    for name in ("prepare_streams", "_end_where_interrupts_are_lost"):
        monkeypatch.setattr(executables, name, lambda *_: None)
    monkeypatch.setattr(executables.importlib, "import_module", load)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN if ignored else signal.default_int_handler)
    try:
        assert executables.run("crawler", "somewhere") == 0
    finally:
        signal.signal(signal.SIGINT, before)
    assert [handler is signal.SIG_IGN for handler in seen] == [ignored] * 2
    assert [handler is signal.default_int_handler for handler in seen] == [False, not ignored]


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="counts threads in /proc")
def test_linear_algebra_takes_one_thread_unless_asked_otherwise(tmp_path):
    (tmp_path / "counted.py").write_text(
        "import os, numpy\ndef main():\n    numpy.ones((200, 200)) @ numpy.ones((200, 200))\n"
        "    print(len(os.listdir('/proc/self/task')))\n"
    )
    words = [sys.executable, "-c", "from crawler_command.executables import run; run('crawler', 'counted')"]
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    counts = []
    for more in ({}, {"OPENBLAS_NUM_THREADS": "2"}):
        done = subprocess.run(words, cwd=tmp_path, env=environment | more, capture_output=True, text=True, check=True)
        counts.append(int(done.stdout))
    assert counts[0] == 1
    assert counts[1] >= counts[0]
