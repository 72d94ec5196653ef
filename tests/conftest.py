"""Settings for all tests, and what parallel workers share."""

from __future__ import annotations

import functools
import os
import re
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as in the command: workers share the cores

settings.register_profile(
    "default", derandomize=True, deadline=None, max_examples=30, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("soak", deadline=None, max_examples=5000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "default"))

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # `nohup make test &`: child processes would ignore it, too
    signal.signal(signal.SIGINT, signal.default_int_handler)

ONE_PORT = ("test_behind_a_stopped_viewer", "test_every_socket_is_on_loopback", "test_the_live_viewer_is")
"""Tests that start live viewers, which all listen on one port."""


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


SLOW = Path(__file__).parent / "slow.txt"
"""Tests that take more than some four seconds of a processor, of what others test in a smaller case: one in a line."""


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Mark the tests that `make test` leaves to `make test-all`."""
    slow = set(SLOW.read_text(encoding="utf-8").splitlines())
    marked = [item for item in items if item.nodeid in slow]
    for item in marked:
        item.add_marker(pytest.mark.slow)
    unknown = slow - {item.nodeid for item in marked}
    if unknown and config.args == config.getini("testpaths"):
        raise pytest.UsageError(f"{SLOW.name} names tests that do not exist: {', '.join(sorted(unknown)[:5])}")


OF_ANY_ORDER = {"crawler_model.crawler.readout.read_records"}
"""Kernels that write into parts of larger arrays."""
ORDER = r"'[ACF]', (True|False)|readonly |(?<=\dd, )[ACF]"
"""How numba writes the order in memory of an array, and whether it can be written, by itself and within tuples."""


def compile_jumps() -> None:
    """Compile the kernels of jumps of bodies that turn."""
    import numpy as np

    from crawler_model import Crawler, load_scene
    from crawler_model.motion.account import ACCOUNT_SIZE
    from crawler_model.motion.plane.jump import jump

    state = Crawler(load_scene("scissors"))._state
    arrays = state.x, state.gained, state.command, state.turned
    jump(state.frame, arrays, state.command.copy(), 1.0, np.zeros_like(state.x), np.zeros(ACCOUNT_SIZE))


def used_kernels() -> list[Any]:
    """List the kernels that have been compiled or read from the cache in this process."""
    values = [value for name, module in [*sys.modules.items()] if "crawler" in name for value in vars(module).values()]
    kernels = {id(value): value for value in values if hasattr(value, "signatures") and hasattr(value, "py_func")}
    return [kernel for kernel in kernels.values() if kernel.signatures]


@pytest.fixture(scope="session", autouse=True)
def compiled_once() -> Iterator[None]:
    """Refuse kernels that are compiled by every worker, or twice because of the order of an array in memory."""
    early = [kernel.py_func.__name__ for kernel in used_kernels()]
    assert not early, f"used while tests are collected, by each worker at once: {', '.join(early[:10])}"
    yield
    twice = set()
    for kernel in used_kernels():
        plain = [re.sub(ORDER, "", str(types)) for types in kernel.signatures]
        if len(set(plain)) < len(plain):
            twice.add(f"{kernel.py_func.__module__}.{kernel.py_func.__name__}")
    assert not twice - OF_ANY_ORDER, f"compiled twice, as an array had another order: {', '.join(sorted(twice))}"


@pytest.fixture(scope="session", autouse=True)
def kernels() -> None:
    """Compile the kernels that `crawler warm` leaves out before the tests of parallel workers."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if not worker or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return
    compile_jumps()
