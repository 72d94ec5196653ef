"""The verb `warm`: all kernels compiled at once, before the first use of each would wait for its own."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from enum import Enum
from threading import Event, Thread
from typing import Annotated, Any

import typer

from crawler_model import CrawlerError

from ..screen import ShowProgress, progress_bar
from .cores import WorkerEndedError, run_on_cores

_PATCHES = {"patches": [{"from": 0.1, "to": 0.2, "friction": 0.5}]}
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


def compile_line() -> None:
    """Compile the kernels of bodies on a line."""
    compile_scene("three_contacts_two_ways")


def compile_environments() -> None:
    """Compile the kernels of environments, if their extra is installed."""
    try:
        import gymnasium
    except ModuleNotFoundError:
        return
    environment = gymnasium.make("crawler_gym:Crawler-v0", scene="three_contacts_one_way")
    environment.reset(seed=0)
    environment.step(environment.action_space.sample())


def compile_patches() -> None:
    """Compile the kernels of bodies on patches of ground."""
    compile_scene("three_contacts_two_ways", ground=_PATCHES)


def compile_long() -> None:
    """Compile the kernels of long chains."""
    from crawler_model import Crawler, Scene

    Crawler(Scene.model_validate({"name": "long", "body": _LONG, "friction": {"isotropic": 0.1}})).advance([1.0] * 299)


def compile_plane() -> None:
    """Compile the kernels of bodies in the plane."""
    compile_scene("planar_three_points")


def compile_turning() -> None:
    """Compile the kernels of bodies that turn."""
    compile_scene("scissors")


def compile_derivatives() -> None:
    """Compile the kernels of derivatives, which `optimise` and `identify` use."""
    from crawler_model import load_scene, sensitivities

    for name in ("two_contacts_anisotropic", "three_springs"):
        sensitivities(load_scene(name), ["friction.forward[0]"], 0.2, 10.0)


def compile_batches() -> None:
    """Compile the kernels of many runs at once, which `sweep` and `optimise` use."""
    from crawler_model import load_scene, simulate_many

    for name in ("two_contacts_anisotropic", "three_springs", "planar_three_points"):
        simulate_many([load_scene(name)] * 2, 0.05)


class Kind(str, Enum):
    """A kind of kernels."""

    line = "line"
    patches = "patches"
    long = "long"
    plane = "plane"
    turning = "turning"
    derivatives = "derivatives"
    batches = "batches"
    environments = "environments"


BUILDS: dict[Kind, Callable[[], None]] = {
    Kind.line: compile_line,
    Kind.patches: compile_patches,
    Kind.long: compile_long,
    Kind.plane: compile_plane,
    Kind.turning: compile_turning,
    Kind.derivatives: compile_derivatives,
    Kind.batches: compile_batches,
    Kind.environments: compile_environments,
}
JOBS = (
    (Kind.plane,),
    (Kind.line, Kind.patches, Kind.long, Kind.environments),
    (Kind.turning,),
    (Kind.derivatives, Kind.batches),
)
"""What one process compiles, in this order, the longest first; what a kind shares with one before it is loaded."""
_FUNCTIONS = 560
"""About how many functions all kinds together take, as files of the cache; half of them are shared."""


def warm(
    kinds: Annotated[
        list[Kind] | None, typer.Argument(help="What to compile: kinds of bodies and of uses; by default all.")
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Number of processes; by default one per core.", min=1)] = None,
) -> None:
    """Compile the kernels before they are needed, in as many processes as there are cores.

    Otherwise the first use of each kind compiles its own. The kernels are kept in ~/.cache/crawler until the model's
    code changes; what is there already is only loaded.
    """
    from crawler_model.compiled import folder_of_kernels
    from crawler_model.sweep.workers import available_cores

    jobs = [job for job in ([kind for kind in job if not kinds or kind in kinds] for job in JOBS) if job]
    names = ", ".join(kind.value for job in jobs for kind in job)
    processes = min(workers or available_cores(), len(jobs))
    if not sys.stderr.isatty():
        print(f"crawler: compiling {names} in {processes} process(es) ...", file=sys.stderr)
    began, before = time.monotonic(), _count_compiled()
    done = Event()
    with progress_bar(f"compiling {names}") as progress:
        if not kinds:
            Thread(target=_watch, args=(progress, done), daemon=True).start()
        try:
            for _ in run_on_cores(_compile, [(job,) for job in jobs], processes):
                pass
        except WorkerEndedError:
            raise CrawlerError(
                "a process that compiles ended; it may have run out of memory: use --workers 1"
            ) from None
        finally:
            done.set()
    new = _count_compiled() - before
    print(
        f"ready: {names}; {new} functions compiled in {time.monotonic() - began:.0f} s, kept in {folder_of_kernels()}"
    )


def _compile(kinds: list[Kind]) -> None:
    from crawler_model.compiled import announcer

    announcer.show = lambda text: None  # the bar of the command counts the functions of all processes
    for kind in kinds:
        BUILDS[kind]()


def _count_compiled() -> int:
    from crawler_model.compiled import folder_of_kernels

    return sum(1 for _ in folder_of_kernels().rglob("*.nbc"))


def _watch(progress: ShowProgress, done: Event) -> None:
    """Show how many functions are there until all are."""
    while not done.wait(_LOOK_EVERY_S):
        count = _count_compiled()
        progress(min(count / _FUNCTIONS, 0.99), f"{count} of about {_FUNCTIONS} functions")
