"""Entry points of all executables: from the first import on, Ctrl-C and a missing package are reported in one line.

Only the standard library is loaded here; the modules of an executable are imported when it runs.
"""

from __future__ import annotations

import gc
import importlib
import os
import signal
import sys
from typing import Any

from crawler_ros.node.life.exit import STOPPED, leave_at_once, prepare_streams

_EXTRA_OF = {
    "mcap": "viz",
    "zstandard": "viz",
    "rerun": "viz",
    "rerun_cli": "viz",
    "matplotlib": "viz",
    "rosbags": "viz",
    "PIL": "viz",
    "pyarrow": "tables",
    "pandas": "tables",
    "polars": "tables",
    "distributed": "sweep",
    "dask": "sweep",
    "cma": "optimise",
    "gymnasium": "gym",
    "av": "animate",
    "osqp": "bench",
    "mujoco": "bench",
    "aiohttp": "play",
}
_REQUIRED = ("numpy", "numba", "llvmlite", "pydantic", "yaml", "typer", "rich", "scipy")


def crawler() -> int:
    """Run the command `crawler`."""
    return run("crawler", "crawler_command.app")


def replay() -> int:
    """Run `crawler replay` as an executable of its own: `ros2 run crawler_ros replay BAG`."""
    sys.argv.insert(1, "replay")
    return run("crawler", "crawler_command.app")


def simulator() -> int:
    """Run the node `simulator`."""
    return run("simulator", "crawler_ros.node.simulator")


def gait_player() -> int:
    """Run the node `gait_player`."""
    return run("gait_player", "crawler_ros.node.gait_player")


def speed_control() -> int:
    """Run the example controller `speed_control`."""
    return run("speed_control", "crawler_ros.examples.speed_control")


def phase_control() -> int:
    """Run the example controller `phase_control`."""
    return run("phase_control", "crawler_ros.examples.phase_control")


def path_control() -> int:
    """Run the example controller `path_control`."""
    return run("path_control", "crawler_ros.examples.path_control")


def describe_missing(*modules: str) -> str:
    """Name the extras that install missing packages; each package is in one extra here, even if others bring it, too.

    Args:
        *modules: names of their modules.

    Returns:
        One line.
    """
    names = list(dict.fromkeys(module.split(".")[0] for module in modules))
    text = f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} not installed"
    if not {*names}.isdisjoint(_REQUIRED):
        return f"{text}; install with: pip install crawler-ros"
    extras = dict.fromkeys(extra for name in names if (extra := _find_extra(name)))
    return f"{text}; install with: pip install 'crawler-ros[{','.join(extras)}]'" if extras else text


def _find_extra(module: str) -> str | None:
    if module.startswith(("rcl", "rmw", "ament_")) or module.endswith(("_msgs", "_interfaces")):
        return "ros"
    return _EXTRA_OF.get(module)


def run(name: str, module: str) -> int:
    """Run an executable.

    Args:
        name: its name, for messages.
        module: the module whose `main` it runs.

    Returns:
        The exit status.
    """
    prepare_streams()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # matrices are small; on busy cores, threads wait for each other
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN  # started in the background by a script
    if not ignored:
        leave_at_once(name)
    try:
        main = importlib.import_module(module).main
        if not ignored:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # a scheduler of jobs ends it as Ctrl-C does
        _end_where_interrupts_are_lost(name)
        return main() or 0
    except ModuleNotFoundError as error:
        print(f"{name}: {describe_missing(error.name or str(error))}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        print(f"{name}: stopped", file=sys.stderr)
        return STOPPED
    finally:
        gc.freeze()  # to look for garbage in all that is loaded once more would take the exit a tenth of a second
        # while the interpreter exits, a signal that is repeated ends the command silently, and no node
        is_command = name == "crawler"
        signal.signal(signal.SIGTERM, signal.SIG_DFL if is_command else signal.SIG_IGN)
        signal.signal(signal.SIGINT, signal.SIG_DFL if is_command and not ignored else signal.SIG_IGN)


def _end_where_interrupts_are_lost(name: str) -> None:
    """End the process when Ctrl-C arrives in a callback from C, which cannot propagate an exception."""
    report = sys.unraisablehook

    def hook(lost: Any) -> None:
        if lost.exc_type is not KeyboardInterrupt:
            report(lost)
            return
        os.write(2, f"{name}: stopped\n".encode())
        os._exit(STOPPED)

    sys.unraisablehook = hook
