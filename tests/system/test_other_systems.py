"""What needs no ROS runs without the modules, functions and files that Windows or macOS do not have."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from ..pages import ROOT

WITHOUT = """
import builtins, os, signal, sys

MODULES = ("fcntl", "grp", "posix", "pwd", "resource", "termios")
import_module = builtins.__import__


def import_elsewhere(name, globals=None, *rest, **more):
    asked_by = (globals or {}).get("__name__", "")
    if name in MODULES and asked_by.partition(".")[0].startswith(("crawler_", "msgs_")):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)
    return import_module(name, globals, *rest, **more)


def refuse(event, arguments):
    path = str(arguments[0]) if event == "open" and arguments else ""
    if path.startswith("/proc/") and "/crawler_" in (sys._getframe(1).f_code.co_filename + os.sep):
        raise FileNotFoundError(2, "No such file or directory", path)


builtins.__import__ = import_elsewhere
sys.addaudithook(refuse)
for module, names in (
    (os, "O_DIRECTORY fork getloadavg getuid killpg sched_getaffinity setsid supports_dir_fd sysconf"),
    (signal, "SIGHUP SIGKILL SIGUSR1 pthread_sigmask"),
):
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
os.supports_dir_fd = set()
"""
"""The `sitecustomize` of every process: it takes away what other systems do not have, from this project alone."""
VERBS = {
    "simulate": ["simulate", "two_anchor_a", "--duration", "2", "--json"],
    "check": ["check", "two_anchor_a", "--json"],
    "sweep": ["sweep", "two_anchor_a", "--vary", "drive.length=2,3", "--out", "s.parquet", "--workers", "2", "--json"],
    "optimise": ["optimise", "two_anchor_a", "--for", "translation", "--seconds", "1", "--json"],
}
IMPORTS = [
    "crawler_model",
    "crawler_model.compiled",
    "crawler_lab.gym",
    "crawler_lab.play.server",
    "crawler_command.app",
]
RECORD = """
import crawler_lab.gym, crawler_lab.play.session
from crawler_ros.replay import analyse
env = crawler_lab.gym.CrawlerEnv("two_anchor_a")
env.reset(seed=0)
for _ in range(3):
    env.step(env.action_space.sample())
from pathlib import Path
replay = analyse(env.unwrapped.save("episode"))
assert replay.comparison.identical
"""


def run(folder: Path, *words: str) -> str:
    """Run Python where `WITHOUT` holds, in this process and in those that it starts; return what it printed."""
    (folder / "sitecustomize.py").write_text(WITHOUT, encoding="utf-8")
    place = {"PYTHONPATH": f"{folder}{os.pathsep}{ROOT}"}
    done = subprocess.run([sys.executable, *words], cwd=folder, env=os.environ | place, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_what_is_taken_away_is_missing(tmp_path):
    (tmp_path / "crawler_probe.py").write_text("import fcntl")
    with pytest.raises(AssertionError, match="No module named 'fcntl'"):
        run(tmp_path, "-c", "import crawler_probe")
    (tmp_path / "crawler_probe.py").write_text("open('/proc/self/statm')")
    with pytest.raises(AssertionError, match="FileNotFoundError"):
        run(tmp_path, "-c", "import crawler_probe")


@pytest.mark.parametrize("module", IMPORTS)
def test_a_module_is_imported(module, tmp_path):
    if module == "crawler_lab.gym":
        pytest.importorskip("gymnasium")
    run(tmp_path, "-c", f"import {module}")


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_runs(verb, tmp_path):
    if verb == "optimise":
        pytest.importorskip("cma")
    assert json.loads(run(tmp_path, "-m", "crawler_command.app", *VERBS[verb]))


def test_kernels_are_compiled(tmp_path):
    """Where a limit of the address space is looked up."""
    code = "import crawler_model.compiled as c; assert c._check_address_space() is None"
    run(tmp_path, "-c", code)


def test_an_episode_is_recorded_and_replayed(tmp_path):
    pytest.importorskip("gymnasium")
    run(tmp_path, "-c", RECORD)
