"""The verb `warm`: all kernels compiled at once, before the first use of each would wait for its own."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable
from enum import Enum
from functools import partial
from threading import Event, Thread
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crawler_command.jobs.cores import WorkerEndedError, run_on_cores
from crawler_command.screen import ShowProgress, progress_bar
from crawler_model import CrawlerError

if TYPE_CHECKING:
    from crawler_model import Scene

_PATCHES = {"ground": {"patches": [{"from": 0.1, "to": 0.2, "friction": 0.5}]}}
_PROFILE = {"ground": {"profile": {"at": [0.0, 1.0], "friction": [1.0, 0.5]}}}
_LOOK_EVERY_S = 0.5


def example_of(kind: Kind) -> Scene:
    """Build a scene of the kind of body and ground that kernels are compiled for.

    Args:
        kind: a key of `EXAMPLES`.

    Returns:
        The scene.
    """
    from crawler_model import Scene, load_scene

    name, more = EXAMPLES[kind]
    return Scene.model_validate(load_scene(name).document() | more)


def compile_example(kind: Kind) -> None:
    """Compile the kernels that simulate a kind of body and ground.

    Args:
        kind: a key of `EXAMPLES`.
    """
    from crawler_model import simulate

    simulate(example_of(kind), duration=0.05)


def _make_long(contacts: int, *more: tuple[int, int]) -> dict[str, Any]:
    """Make a body long: neighbours are joined by links, and so are pairs of `more`."""
    between = [*zip(range(contacts - 1), range(1, contacts), strict=True), *more]
    body = {"contacts": [*range(contacts)], "links": {"stiffness": 1.0, "between": between}}
    return {"body": body, "drive": {"times": [0.0, 1.0], "actuation": [[0.0] * len(between), [1.0] * len(between)]}}


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
    long = "long"  # long chains
    long_graphs = "long-graphs"
    springs = "springs"  # springs that bend, as tendons that go slack, or have loops
    patches = "patches"  # patches of ground, and walls
    springs_on_patches = "springs-on-patches"
    gradual = "gradual"  # ground that changes gradually
    springs_on_gradual = "springs-on-gradual"
    elongation = "elongation"  # friction that changes with elongations
    plane = "plane"  # bodies in the plane
    node = "node"
    derivatives = "derivatives"
    batches = "batches"
    environments = "environments"


EXAMPLES: dict[Kind, tuple[str, dict[str, Any]]] = {
    Kind.line: ("three_contacts_two_ways", {}),
    Kind.graphs: ("three_springs", {}),
    Kind.long: ("three_contacts_two_ways", _make_long(300)),
    Kind.long_graphs: ("three_springs", _make_long(300, (0, 2))),
    Kind.springs: ("tendon_worm", {}),
    Kind.patches: ("three_contacts_two_ways", _PATCHES),
    Kind.springs_on_patches: ("tendon_worm", _PATCHES),
    Kind.gradual: ("leaving_ice", {}),
    Kind.springs_on_gradual: ("tendon_worm", _PROFILE),
    Kind.elongation: ("worm_in_a_tube", {}),
    Kind.plane: ("planar_three_points", {}),
}
"""A scene of the gallery for each kind of body and ground, and what is changed of it. For bodies on a line kernels are
compiled for no other kinds: all else is numbers."""
BUILDS: dict[Kind, Callable[[], None]] = {
    **{kind: partial(compile_example, kind) for kind in EXAMPLES},
    Kind.node: compile_node,
    Kind.derivatives: compile_derivatives,
    Kind.batches: compile_batches,
    Kind.environments: compile_environments,
}
"""What compiles each kind."""
SECONDS = {
    Kind.line: 11,
    Kind.graphs: 9,
    Kind.long: 9,
    Kind.long_graphs: 9,
    Kind.springs: 17,
    Kind.patches: 16,
    Kind.springs_on_patches: 16,
    Kind.gradual: 22,
    Kind.springs_on_gradual: 22,
    Kind.elongation: 33,
    Kind.plane: 18,
    Kind.node: 10,
    Kind.derivatives: 16,
    Kind.batches: 4,
    Kind.environments: 6,
}
"""Processor time that it takes to compile each kind where those before it are there [s]. Times are measured on one
machine; on another one their ratios are similar."""
_FIRST = (Kind.line, Kind.springs, Kind.patches, Kind.springs_on_patches, Kind.gradual, Kind.long)
_SECOND = (Kind.plane, Kind.graphs, Kind.elongation, Kind.springs_on_gradual, Kind.long_graphs)
JOBS = ((*_FIRST, Kind.node, Kind.environments), (*_SECOND, Kind.derivatives, Kind.batches))
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
    expected = sum(SECONDS[kind] for job in jobs for kind in job)
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
            BUILDS[kind]()
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
