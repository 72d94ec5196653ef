"""The life of a node, from its command line to its exit status."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

from crawler_model import CrawlerError

from ...wire.definitions import find_ament_prefix
from .exit import leave_at_once, prepare_streams
from .log_pipe import unblocked_log
from .overrides import refuse_unknown
from .shared_memory import remove_orphans

_LEAVING_S = 30.0
"""Time within which a node leaves the graph on a busy machine."""


def stay_on_loopback() -> None:
    """Restrict ROS to 127.0.0.1 unless the environment specifies otherwise; call it before rclpy is initialised.

    A discovery range determines which nodes are looked for, not which can reach this one: with LOCALHOST or OFF, Fast
    DDS still listens on every interface. A Fast DDS profile opens sockets on loopback only, but rmw adds others to them
    unless the range is SYSTEM_DEFAULT. Nodes on this machine, whatever their range and without the profile, find this
    one; with OFF none do.
    """
    asked = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS")
    given = {name: os.environ[name] for name in asked if os.environ.get(name)}
    off = given == {asked[0]: "OFF"}
    local: tuple[dict[str, str], ...] = (
        {},
        {asked[0]: "LOCALHOST"},
        {asked[1]: "1"},
        {asked[0]: "LOCALHOST", asked[1]: "1"},
    )
    if not off and given not in local:
        return
    from rclpy.utilities import get_rmw_implementation_identifier

    if not off:
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    profile = Path(str(resources.files("msgs_config") / "loopback.xml"))
    if (
        get_rmw_implementation_identifier().startswith("rmw_fastrtps")
        and not os.environ.get("FASTRTPS_DEFAULT_PROFILES_FILE")
        and profile.is_file()
    ):
        os.environ["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(profile)
        os.environ.setdefault("RMW_FASTRTPS_USE_QOS_FROM_XML", "1")
        if not off:
            os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
            os.environ.pop("ROS_LOCALHOST_ONLY", None)  # it would override the range


def run_node(
    name: str, build: Callable[[], Any], spin: Callable[[Any], None], args: list[str] | None, parameters: str
) -> int:
    """Run a node: initialise ROS, build it, spin it, shut down; errors are one line on standard error.

    Args:
        name: name of the executable.
        build: function that builds the node.
        spin: function that sets the signal handlers and runs the node to its end.
        args: command line; None for the process's own.
        parameters: names of the node's parameters, for the help text.

    Returns:
        The exit status.
    """
    prepare_streams()
    leave_at_once(name)  # until `spin` has something to clean up
    find_ament_prefix()
    stay_on_loopback()
    with unblocked_log():
        return _run(name, build, spin, sys.argv if args is None else args, parameters)


def _run(name: str, build: Callable[[], Any], spin: Callable[[Any], None], words: list[str], parameters: str) -> int:
    import rclpy
    from rclpy.exceptions import ParameterException
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args

    try:
        try:
            rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
            remove_orphans()
            stray = remove_ros_args(words)[1:]
            if "-h" in stray or "--help" in stray:
                print(f"usage: {name} --ros-args [-p PARAMETER:=VALUE ...] [-r __ns:=/NAME]\nparameters: {parameters}")
                print("network: 127.0.0.1 only; ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET admits other machines")
                return 0
            if stray:
                raise ValueError(f"unknown argument {stray[0]!r}; pass parameters as in --ros-args -p scene:=FILE")
            node = build()
            refuse_unknown(node, node._parameters)
            node.leaves_within_s = _LEAVING_S
        except (ValueError, OSError, ParameterException) as error:
            print(f"{name}: {' '.join(str(error).split())}", file=sys.stderr)
            return 1
        except Exception as error:  # rcl's errors about the command line have no common type
            if type(error).__name__ not in ("RCLError", "UnknownROSArgsError", "RCLInvalidROSArgsError"):
                raise
            text = " ".join(str(error).split())[:200]
            right = "pass parameters as in --ros-args -p scene:=FILE"
            if "remap" in text:
                right = "a name has letters of English, digits, _ and /, and begins with no digit, as in -r __ns:=/left"
            print(f"{name}: {text}; {right}", file=sys.stderr)
            return 1
        try:
            spin(node)
        except CrawlerError as error:
            print(f"{name}: {' '.join(str(error).split())}", file=sys.stderr)
            return 1
        return 0
    finally:
        rclpy.try_shutdown()
        gc.freeze()  # to look for garbage in all that is loaded once more would take the exit a tenth of a second
