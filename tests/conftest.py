"""Settings for all tests, and what parallel workers share."""

from __future__ import annotations

import fcntl
import functools
import os
import tempfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "default", derandomize=True, deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("soak", deadline=None, max_examples=5000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

KINDS = ("three_contacts_two_ways", "three_springs", "planar_rectilinear", "planar_three_points")
"""A scene for each set of kernels."""


ONE_PORT = ("test_behind_a_stopped_viewer", "test_every_socket_is_on_loopback", "test_the_live_viewer_is")
"""Tests that start live viewers, all of which listen on one port."""


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Spread tests over workers one by one, but what shares a port or the fixture of a file stays on one worker."""
    from xdist.scheduler import LoadScopeScheduling

    @functools.cache
    def shares_a_fixture(file: str) -> bool:
        return 'scope="module"' in (config.rootpath / file).read_text(encoding="utf-8")

    class Groups(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = nodeid.split("::")[0]
            if any(name in nodeid for name in ONE_PORT):
                return "one port"
            return file if shares_a_fixture(file) else nodeid

    return Groups(config, log)


@pytest.fixture(scope="session", autouse=True)
def kernels() -> None:
    """Compile the kernels before the tests of parallel workers: each set by one of them, while the others wait."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if not worker or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return
    from crawler_model import load_scene, simulate

    first = int(worker.removeprefix("gw")) % len(KINDS)
    for name in KINDS[first:] + KINDS[:first]:
        with (Path(tempfile.gettempdir()) / f"crawler_kernels_{os.getuid()}_{name}").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)
            for method in (None, "catch_up"):
                simulate(load_scene(name), method=method, duration=0.05)
