"""Settings for all tests, and what parallel workers share."""

from __future__ import annotations

import fcntl
import os
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile(
    "default", derandomize=True, deadline=None, max_examples=60, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("soak", deadline=None, max_examples=5000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

KINDS = ("three_contacts_two_ways", "three_springs", "planar_rectilinear", "planar_three_points")
"""A scene for each set of kernels."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep the tests of a file together whose fixture is made once for the file: one worker makes it."""
    for item in items:
        fixtures = getattr(item, "_fixtureinfo").name2fixturedefs.values()  # noqa: B009
        if any(fixture.scope == "module" for same_name in fixtures for fixture in same_name):
            item.add_marker(pytest.mark.xdist_group(Path(item.path).stem))


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
