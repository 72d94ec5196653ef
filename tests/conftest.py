"""Settings for all tests, and what parallel workers share."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import os
import signal
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

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # `nohup make test &`: child processes would ignore it, too
    signal.signal(signal.SIGINT, signal.default_int_handler)

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


PATCHES = {"patches": [{"from": 0.1, "to": 0.2, "friction": 0.5}]}
LONG = {"contacts": list(range(300)), "links": {"stiffness": 1.0}}


def compile_scenes(*scenes: tuple[str, dict[str, Any]]) -> None:
    """Compile the kernels of scenes of the gallery, each with changes to its document."""
    from crawler_model import Scene, load_scene, simulate

    for name, more in scenes:
        simulate(Scene.model_validate(load_scene(name).document() | more), duration=0.05)


def compile_line() -> None:
    """Compile the kernels of bodies on a line, and those of environments, if their extra is installed."""
    compile_scenes(("three_contacts_two_ways", {}))
    with contextlib.suppress(ModuleNotFoundError):
        import gymnasium

        environment = gymnasium.make("crawler_gym:Crawler-v0", scene="three_contacts_one_way")
        environment.reset(seed=0)
        environment.step(environment.action_space.sample())


def compile_patches() -> None:
    compile_scenes(("three_contacts_two_ways", {"ground": PATCHES}))


def compile_long_chains() -> None:
    from crawler_model import Crawler, Scene

    Crawler(Scene.model_validate({"name": "long", "body": LONG, "friction": {"isotropic": 0.1}})).advance([1.0] * 299)


def compile_plane() -> None:
    compile_scenes(("planar_three_points", {}))


def compile_turning() -> None:
    compile_scenes(("scissors", {}))


def compile_derivatives() -> None:
    from crawler_model import load_scene, sensitivities

    for name in ("two_contacts_anisotropic", "three_springs"):
        sensitivities(load_scene(name), ["friction.forward[0]"], 0.2, 10.0)


def compile_batches() -> None:
    from crawler_model import load_scene, simulate_many

    for name in ("two_contacts_anisotropic", "three_springs", "planar_three_points"):
        simulate_many([load_scene(name)] * 2, 0.05)


KERNELS = (
    (compile_line, compile_plane),
    (compile_patches, compile_long_chains, compile_turning),
    (compile_derivatives, compile_batches),
)
"""What compiles a set of kernels; those of the last row build on the first."""


@pytest.fixture(scope="session", autouse=True)
def kernels() -> None:
    """Compile the kernels before the tests of parallel workers: each set by one of them."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if not worker or os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return
    for sets in KERNELS:
        for how in (fcntl.LOCK_EX | fcntl.LOCK_NB, fcntl.LOCK_EX):  # first what no other worker compiles
            for build in sets:
                file = Path(tempfile.gettempdir()) / f"crawler_kernels_{os.getuid()}_{build.__name__}"
                with contextlib.suppress(BlockingIOError), file.open("w") as lock:
                    fcntl.flock(lock, how)
                    build()
