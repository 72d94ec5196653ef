"""Processes of modules that are forked from one that has imported them: a node imports half a second of libraries."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import signal
import subprocess
import sys
from functools import cache
from multiprocessing.context import ForkServerContext
from pathlib import Path

import pytest

from ...processes import PATIENCE_S

NODES = (
    "crawler_ros.node.simulator",
    "crawler_ros.node.gait_player",
    "crawler_command.app",
    "crawler_lab.play.console",
)
MESSAGES = ("diagnostic_msgs", "geometry_msgs", "nav_msgs", "rosgraph_msgs", "sensor_msgs", "trajectory_msgs")
LIBRARIES = ("numba.np.arraymath", "numpy.ma", "rcl_interfaces.srv", "rosidl_generator_py", "std_srvs.srv")
IMPORTED = (*NODES, *(f"{name}.msg" for name in MESSAGES), *LIBRARIES)
"""What they share; kernels are loaded by each process, as where a user starts it."""


@cache
def _server() -> ForkServerContext:
    """Start the process that they are forked from."""
    from multiprocessing import forkserver

    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([*IMPORTED, __name__])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")  # read where messages are imported
        forkserver.ensure_running()
    return context


def _run(module: str, arguments: list[str], environment: dict[str, str], log: Path, folder: Path) -> None:
    """Run the `main` of a module in a session of its own, as `python -m` does; runs in the new process."""
    os.setsid()
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:0] = [path for path in environment.get("PYTHONPATH", "").split(os.pathsep) if path]
    out = os.open(log, os.O_WRONLY | os.O_APPEND)
    os.dup2(out, 1)
    os.dup2(out, 2)
    os.close(out)
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(write_through=True)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = ["", *arguments]
    sys.exit(importlib.import_module(module).main())


class Forked:
    """A process with the methods of `subprocess.Popen` that tests use."""

    def __init__(
        self, module: str, arguments: list[str], environment: dict[str, str], log: Path, folder: Path | None = None
    ) -> None:
        log.touch()
        place = folder or Path.cwd()
        words = (module, arguments, environment, log, place)
        self._process = _server().Process(target=_run, args=words, daemon=True)  # the end of the tests does not wait
        self._process.start()
        assert self._process.pid is not None
        self.pid = self._process.pid

    @property
    def returncode(self) -> int | None:
        return self._process.exitcode

    def poll(self) -> int | None:
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        self._process.join(timeout)
        if self._process.exitcode is None:
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout or 0.0)
        return self._process.exitcode

    def send_signal(self, number: int) -> None:
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        self.send_signal(signal.SIGKILL)


def finish(folder: Path, module: str, *arguments: str, environment: dict[str, str]) -> tuple[int, str]:
    """Run a module in a folder to its own end; return its status and what it said."""
    log = folder / "forked.log"
    process = Forked(module, [*arguments], environment, log, folder)
    try:
        return process.wait(PATIENCE_S), log.read_text()
    finally:
        process.kill()
