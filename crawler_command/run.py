"""The verb `run`: a simulator and a controller in processes of their own, from the first state to the exit status."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated

import typer

from crawler_model import CrawlerError
from crawler_ros.wire.facts import LogText

from . import controller as controller_process
from .processes import Process, node_command
from .screen import SceneArgument, require, screen

_LOG = {"RCUTILS_CONSOLE_OUTPUT_FORMAT": "[{severity}] [{time}] [{name}]: {message}", "RCUTILS_COLORIZED_OUTPUT": "0"}
"""The form in which the log of the simulator is read here."""
_LIFE = re.compile(rf"\[crawler\]: ({LogText.RECORDED.value}|{LogText.STOPPED.value})|{LogText.WAITING.value}")
"""Lines of this log that are not shown, but noted."""
_LOOKS_S = 0.02
"""Time between two looks at the processes."""
_ANSWERS_S = 60.0
"""Time within which the states of a simulator that has started are heard on a busy machine."""
_LEAVES_S = 10.0
"""Time for a controller to end after each signal."""
_RECORDS_S = 120.0
"""Time for a simulator to complete its recording on a slow disk."""


class _Simulator(Process):
    """The simulator, of whose log the user sees what needs attention."""

    def __init__(self, options: dict[str, str | float | bool], environment: dict[str, str]) -> None:
        super().__init__(node_command("crawler_ros.node.simulator", **options), environment | _LOG)
        self.noted, self.is_deaf, self.stands_still = "", False, False

    def relay(self) -> None:
        """Print warnings, errors and why nothing happens yet; note what the simulator reports of its life."""
        for line in self.new_lines():
            if re.search(r"\[(WARN|ERROR|FATAL)\]|compiling", line):
                print(line, file=sys.stderr)
                self.is_deaf |= LogText.NONE_RECEIVED in line or LogText.NOTHING_PASSES in line
                self.stands_still |= LogText.STANDS_STILL in line
            elif _LIFE.search(line):
                self.noted += f"{line}\n"


def run_controller(
    scene: SceneArgument,
    controller: Annotated[Path, typer.Argument(help="A Python file, run by the interpreter of this command.")],
    arguments: Annotated[list[str] | None, typer.Argument(help="Behind `--`: arguments of the controller.")] = None,
    lock_step: Annotated[
        bool, typer.Option("--lock-step", help="Commands trigger the ticks, so that runs repeat to the bit.")
    ] = False,
    record: Annotated[Path | None, typer.Option(help="Parent folder of a recording, which `replay` takes.")] = None,
    duration: Annotated[
        float | None, typer.Option(help="Simulated time after which both end, s; by default the controller decides.")
    ] = None,
    parameters: Annotated[
        list[str] | None,
        typer.Option("-p", help="A parameter of the simulator, NAME:=VALUE, such as rate:=200.0; may be repeated."),
    ] = None,
) -> None:
    """Run a simulator and a controller; when the controller ends, the simulator completes its recording and ends.

    `crawler run two_anchor_a controller.py --lock-step --record bags` leaves a recording for `crawler replay bags`.
    Parameters of the simulator follow `-p`, as in `-p rate:=200.0 -p sensors.noise:=1e-4`; arguments of the controller
    follow `--`, as in `-- --ros-args -p target:=0.1`.

    The controller is any Python program with a ROS 2 node. It starts as soon as the simulator has published a state,
    and its output is not changed, except that a stop by this command leaves no traceback; the simulator shows only its
    warnings and errors. The command exits with the controller's exit status, or 0 when --duration has ended it. Ctrl-C
    ends the controller, then the simulator. In lock-step, where nothing moves without a command, a controller that has
    sent no other one for twenty seconds after a refused command is ended with status 1. Both run on this machine, in a
    ROS domain of their own, unless ROS_DOMAIN_ID or a discovery range is set.
    """
    require("rclpy", *(("mcap", "zstandard") if record is not None else ()))
    if not controller.is_file():
        raise CrawlerError(f"{controller}: no such file; name the Python file of a controller")
    if duration is not None and not 0.0 < duration < float("inf"):
        raise CrawlerError(f"--duration: {duration:g} s; it must be > 0")
    options: dict[str, str | float | bool] = {"scene": scene, "lock_step": lock_step, "duration": duration or 0.0}
    if record is not None:
        options["record"] = str(record)
    for text in parameters or ():
        name, sign, value = text.partition(":=")
        if not (name and sign and value):
            raise CrawlerError(f"-p {text}: write NAME:=VALUE, for example -p rate:=200.0")
        if name in options:
            raise CrawlerError(f"-p {text}: {name} is chosen by the command; use its argument or its option")
        options[name] = _read_value(value)
    status = None
    with _noted_signals() as received, _own_domain() as environment:
        simulator = _Simulator(options, environment)
        try:
            _await_first_state(simulator, received)
            if not received:
                words = [sys.executable, controller_process.__file__, str(controller), *(arguments or ())]
                status = _play(simulator, words, environment, received)
        finally:
            simulator.end(_RECORDS_S)
        last = simulator.last_line()
        simulator.relay()
    # SIGINT may find a simulator that leaves because its duration is over
    has_failed = simulator.status != 0 and not (simulator.status == 130 and LogText.STOPPED in simulator.noted)
    if has_failed and not received:
        raise CrawlerError(f"the simulator failed: {last}")
    if status is None and simulator.stands_still and not received:
        why = "it waits behind a refused command; the warnings above name the reason"
        raise CrawlerError(f"{controller} was ended: {why}")
    if status is None and duration is None and not received:
        raise CrawlerError(f"the simulator ended before the controller: {last}")
    if status == 0 and LogText.UNCOMMANDED in simulator.noted:
        hint = (
            "; let it wait until its publisher has a subscriber (get_subscription_count() > 0), and after its last "
            "command for the next state"
        )
        hint = ": the warning above names the reason" if simulator.is_deaf else hint
        raise CrawlerError(f"{controller} ended before the simulator received a command{hint}")
    how = "was ended" if status is None else f"ended with status {status}"
    stopped = re.findall(rf"\]: ({LogText.STOPPED.value}.*)", simulator.noted)
    recorded = re.findall(rf"\]: ({LogText.RECORDED.value}.*)", simulator.noted)
    screen.print("; ".join([f"{controller.name} {how}", *(f"simulator {text}" for text in stopped), *recorded]))
    raise typer.Exit(128 + received[0] if received else status or 0)


def _read_value(text: str) -> str | float | bool:
    """Read a number or a switch as ROS reads it in a command line; all else is text."""
    import yaml

    plain = yaml.safe_load(text)
    return plain if isinstance(plain, (bool, int, float)) else text


@contextlib.contextmanager
def _noted_signals() -> Iterator[list[int]]:
    """Collect the signals that ask this process to end, except those that it was started to ignore."""
    received: list[int] = []
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, lambda found, _: received.append(found))
    try:
        yield received
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _own_domain() -> Iterator[dict[str, str]]:
    """Choose a ROS domain and loopback for this process where its environment leaves them open; yield the result."""
    from crawler_ros.node.life.domains import reserved_domain

    with contextlib.ExitStack() as stack:
        if not os.environ.get("ROS_DOMAIN_ID"):
            os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(reserved_domain()))
        ranges = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS")
        if not any(os.environ.get(name) for name in ranges):
            os.environ[ranges[0]] = "LOCALHOST"
        yield dict(os.environ)


def _await_first_state(simulator: _Simulator, received: list[int]) -> None:
    """Wait until a simulator that was just started answers, or a signal has been received."""
    deadline = None
    with _first_state() as has_arrived:
        while not (has_arrived() or received or simulator.status == 0):
            if simulator.status is not None:
                refusal = simulator.last_line().removeprefix("simulator: ")
                raise CrawlerError(f"the simulator has not started: {refusal}")
            simulator.relay()
            if deadline is None and LogText.WAITING in simulator.noted:
                deadline = time.monotonic() + _ANSWERS_S
            if deadline is not None and time.monotonic() > deadline:
                raise CrawlerError(
                    f"the simulator runs, but none of its states arrived within {_ANSWERS_S:g} s; check the variables "
                    "ROS_AUTOMATIC_DISCOVERY_RANGE, ROS_STATIC_PEERS and RMW_IMPLEMENTATION"
                )


def _play(simulator: _Simulator, command: list[str], environment: dict[str, str], received: list[int]) -> int | None:
    """Run a controller until it or the simulator ends, a signal is received, or nothing will move any more.

    Returns:
        Its status, if it has ended by itself.
    """
    controller = Process(command, environment, read=False)
    try:
        while controller.status is None and simulator.status is None and not (received or simulator.stands_still):
            simulator.relay()
            time.sleep(_LOOKS_S)
        return controller.status
    finally:
        controller.end(_LEAVES_S)


@contextlib.contextmanager
def _first_state() -> Iterator[Callable[[], bool]]:
    """Listen to the states of a simulator; yield a function that tells whether one has arrived."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions
    from sensor_msgs.msg import JointState

    from crawler_ros.node.life.quiet_node import QuietNode
    from crawler_ros.node.life.run import stay_on_loopback
    from crawler_ros.wire.definitions import find_ament_prefix
    from crawler_ros.wire.topics import qos_profile, read_topics

    find_ament_prefix()
    stay_on_loopback()
    arrived: list[bytes] = []
    context = rclpy.Context()
    try:
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        raise CrawlerError(str(error)) from None
    try:
        node = QuietNode(f"crawler_run_{os.getpid()}", context=context, start_parameter_services=False)
        profile = qos_profile(read_topics()["joint_states"])
        node.create_subscription(JointState, "joint_states", arrived.append, profile, raw=True)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)

        def has_arrived() -> bool:
            executor.spin_once(timeout_sec=_LOOKS_S)
            return bool(arrived)

        yield has_arrived
        executor.shutdown()
        node.leave()
    finally:
        rclpy.shutdown(context=context)
