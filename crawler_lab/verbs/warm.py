"""The verb `warm`: all kernels compiled at once, before the first use of each would wait for its own."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from enum import Enum
from functools import partial
from threading import Event, Thread
from typing import Annotated, Any

import typer

from crawler_command.jobs.cores import WorkerEndedError, run_on_cores
from crawler_command.screen import ShowProgress, progress_bar
from crawler_model import CrawlerError

PATCHES = {"patches": [{"from": 0.1, "to": 0.2, "friction": 0.5}]}
WALLS = {"walls": [{"at": 1.0, "stops": "forward"}]}
_ELEMENTS = [{"stiffness": 1.0, "yield": 0.1}]
_HYSTERETIC = {"contacts": [0.0, 1.0, 2.0], "links": {"stiffness": 1.0, "hysteresis": _ELEMENTS}}
_LONG = {"contacts": list(range(300)), "links": {"stiffness": 1.0}}
_LOOK_EVERY_S = 0.5


def compile_scene(name: str, **more: Any) -> None:
    """Compile the kernels of a scene of the gallery.

    Args:
        name: its name.
        **more: changes to its document.
    """
    from crawler_model import Scene, load_scene, simulate

    simulate(Scene.model_validate(load_scene(name).document() | more), duration=0.05)


def compile_environments() -> None:
    """Compile the kernels of environments, if their extra is installed."""
    try:
        import gymnasium
    except ModuleNotFoundError:
        return
    for scene, direction in (("three_contacts_one_way", 1.0), ("planar_three_points", 0.0)):
        environment = gymnasium.make("crawler_lab.gym:crawler_lab/Crawler-v0", scene=scene, direction=direction)
        environment.reset(seed=0)
        environment.step(environment.action_space.sample())


def compile_node() -> None:
    """Compile the kernels of the simulator's ticks, and of recordings if what reads them is installed."""
    from crawler_model import load_scene
    from crawler_ros.node.ticks import compile_ticks

    for name in ("three_contacts_two_ways", "three_springs", "tendon_worm"):
        compile_ticks(load_scene(name))
    with contextlib.suppress(ModuleNotFoundError):
        from crawler_ros.recording.mcap_reader import compile_search

        compile_search()


def compile_long() -> None:
    """Compile the kernels of long chains."""
    from crawler_model import Crawler, Scene

    Crawler(Scene.model_validate({"name": "long", "body": _LONG, "friction": {"isotropic": 0.1}})).advance([1.0] * 299)


def compile_derivatives() -> None:
    """Compile the kernels of derivatives, which `optimise` and `identify` use."""
    from crawler_model import load_scene

    from ..derivative.sensitivities import sensitivities

    for name in ("two_contacts_anisotropic", "tendon_worm"):
        sensitivities(load_scene(name), ["friction.forward[0]"], 0.2, 10.0)
    sensitivities(load_scene("planar_three_points"), ["drive.times[1]"], 0.5, 2.0)


def compile_batches() -> None:
    """Compile the kernels of many runs at once, which `sweep` and `optimise` use."""
    from crawler_model import load_scene

    from ..sweep.many_runs import simulate_many

    for name in ("two_contacts_anisotropic", "three_springs", "planar_three_points"):
        simulate_many([load_scene(name)] * 2, 0.05)


class Kind(str, Enum):
    """A kind of kernels."""

    line = "line"  # chains on a line
    graphs = "graphs"  # other bodies on a line
    node = "node"
    springs = "springs"  # springs that bend, as tendons that go slack
    hysteresis = "hysteresis"  # springs with loops
    patches = "patches"  # patches of ground
    walls = "walls"
    long = "long"
    plane = "plane"  # bodies in the plane
    derivatives = "derivatives"
    batches = "batches"
    environments = "environments"


BUILDS: dict[Kind, tuple[Callable[[], None], int]] = {
    Kind.line: (partial(compile_scene, "three_contacts_two_ways"), 11),
    Kind.graphs: (partial(compile_scene, "three_springs"), 9),
    Kind.node: (compile_node, 10),
    Kind.springs: (partial(compile_scene, "tendon_worm"), 13),
    Kind.hysteresis: (partial(compile_scene, "three_contacts_two_ways", body=_HYSTERETIC), 13),
    Kind.patches: (partial(compile_scene, "three_contacts_two_ways", ground=PATCHES), 12),
    Kind.walls: (partial(compile_scene, "three_contacts_two_ways", ground=WALLS), 12),
    Kind.long: (compile_long, 8),
    Kind.plane: (partial(compile_scene, "planar_three_points"), 18),
    Kind.derivatives: (compile_derivatives, 16),
    Kind.batches: (compile_batches, 4),
    Kind.environments: (compile_environments, 6),
}
"""What compiles each kind, and the processor time that it takes [s]. Times are measured on one machine; on another one
their ratios are similar."""
JOBS = (
    (Kind.line, Kind.springs, Kind.hysteresis, Kind.patches, Kind.long, Kind.environments),
    (Kind.plane, Kind.graphs, Kind.walls, Kind.derivatives, Kind.node, Kind.batches),
)
"""What one process compiles, in this order; what a kind shares with one before it is loaded."""
_OF_A_FUNCTION = (
    ("crawler_model.motion.plane", 0.25),
    ("crawler_lab.derivative", 0.5),
    ("crawler_lab.gym", 0.5),
    ("crawler_", 0.07),
)
"""Beginning of a module, and the processor time that a function of it takes [s]."""


def warm(
    kinds: Annotated[
        list[Kind] | None, typer.Argument(help="What to compile: kinds of bodies and of uses; by default all.")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Number of processes; by default one per core.", min=1)] = None,
) -> None:
    """Compile the kernels of common bodies and uses before they are needed, in as many processes as there are cores.

    Otherwise the first use of each kind compiles its own. The kernels are kept in ~/.cache/crawler until the model's
    code changes; what is there already is only loaded.
    """
    from crawler_model.kernel_cache import folder_of_kernels

    from ..sweep.workers import available_cores

    jobs = [job for job in ([kind for kind in job if not kinds or kind in kinds] for job in JOBS) if job]
    names = ", ".join(kind.value for job in jobs for kind in job)
    expected = sum(BUILDS[kind][1] for job in jobs for kind in job)
    processes = min(workers or available_cores(), len(jobs))
    if not sys.stderr.isatty():
        text = f"compiling {names}: up to {expected} s of processor time in {processes} process(es)"
        print(f"crawler: {text} ...", file=sys.stderr)
    began, done = time.monotonic(), Event()
    before, seconds_before = measure_compiled()
    with progress_bar(f"compiling {names}") as progress:
        watch = Thread(
            target=_watch, args=(progress, done, 0.0 if not kinds else seconds_before, expected), daemon=True
        )
        watch.start()
        try:
            for _ in run_on_cores(_compile, [(job,) for job in jobs], processes):
                pass
        except WorkerEndedError:
            raise CrawlerError("a process ended while it compiled, perhaps without memory: use --workers 1") from None
        finally:
            done.set()
            watch.join()
    new, seconds = measure_compiled()[0] - before, time.monotonic() - began
    print(f"ready: {names}; {new} functions compiled in {seconds:.0f} s, kept in {folder_of_kernels()}")


def _compile(kinds: list[Kind]) -> None:
    from crawler_model import kernel_cache
    from crawler_model.compiled import announcer

    before = announcer.show, kernel_cache.report
    announcer.show = lambda text: None  # the bar of the command counts the functions of all processes
    kernel_cache.report = _refuse
    try:
        for kind in kinds:
            build, _ = BUILDS[kind]
            build()
    finally:  # a single process is the process of the command or of a test
        announcer.show, kernel_cache.report = before


def _refuse(reason: str) -> None:
    """Stop where a compiled kernel cannot be kept: nothing would be ready."""
    raise CrawlerError(reason)


def measure_compiled() -> tuple[int, float]:
    """Measure what the cache holds.

    Returns:
        The number of functions, and the processor time that compiling them takes [s].
    """
    from crawler_model.kernel_cache import folder_of_kernels

    modules = [file.parent.name for file in folder_of_kernels().rglob("*.nbc")]
    times = [next((cost for start, cost in _OF_A_FUNCTION if module.startswith(start)), 0.0) for module in modules]
    return len(modules), sum(times)


def _watch(progress: ShowProgress, done: Event, before: float, expected: float) -> None:
    """Show which part of the processor time is spent, until all is compiled."""
    while not done.wait(_LOOK_EVERY_S):
        progress(min((measure_compiled()[1] - before) / expected, 0.99))
