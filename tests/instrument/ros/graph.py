"""Real processes in a ROS domain of their own, and a listener to them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor

from crawler_ros.node.life.domains import domain_environment, reserved_domain
from crawler_ros.wire.topics import message_class, qos_profile, read_topics

from ...processes import PATIENCE_S, wait_until
from .forked import Forked

_kept = ExitStack()


def environment(domain: int | None = None) -> dict[str, str]:
    """The environment of a process in a domain; without one, in this session's own for what never comes to talk."""
    number = speechless_domain() if domain is None else domain
    return domain_environment(number) | {"ROS_PYTHON_CHECK_FIELDS": "1", "PYTHONUNBUFFERED": "1"}


@cache
def speechless_domain() -> int:
    return _kept.enter_context(reserved_domain())


def node_command(module: str, *parameters: str, arguments: tuple[str, ...] = ()) -> list[str]:
    words = [*(word for p in parameters for word in ("-p", p)), *arguments]
    return [sys.executable, "-m", module, *(["--ros-args", *words] if words else [])]


class Process:
    """A process and what it says."""

    def __init__(self, process: subprocess.Popen[bytes] | Forked, log: Path) -> None:
        self.log = log
        self._asked = False
        self.process = process

    @property
    def said(self) -> str:
        return self.log.read_text()

    def wait(self) -> int:
        """Wait for its own end."""
        return self.process.wait(PATIENCE_S)

    def ask_to_end(self, number: int = signal.SIGINT) -> None:
        if not self._asked and self.process.poll() is None:
            self.process.send_signal(number)
            self.process.send_signal(signal.SIGCONT)  # a test that failed may have left it stopped
        self._asked = True

    def end(self, number: int = signal.SIGINT, seconds: float = PATIENCE_S) -> int:
        self.ask_to_end(number)
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            raise AssertionError(f"it does not end; it said:\n{self.said}") from None


class Graph:
    """One ROS domain: its processes, and a node of this one that listens and publishes."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.domain = domain
        self.folder = folder
        self.context = rclpy.Context()
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        self.context.init(domain_id=self.domain)
        self.node = rclpy.create_node("listener", context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        self.heard: dict[str, list[Any]] = defaultdict(list)
        self.processes: list[Process] = []
        self._publishers: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}

    def _spin(self) -> None:
        while not self._stop.is_set():
            self._executor.spin_once(timeout_sec=0.05)

    def run(self, command: list[str], **more: str | None) -> Process:
        """Start a command, with more in its environment; what is None is taken out of it."""
        given = {k: v for k, v in (environment(self.domain) | more).items() if v is not None}
        log = self._new_log()
        with log.open("w") as stream:
            process = subprocess.Popen(
                command, env=given, stdout=stream, stderr=subprocess.STDOUT, start_new_session=True
            )
        self.processes.append(Process(process, log))
        return self.processes[-1]

    def start(self, module: str, *parameters: str, arguments: tuple[str, ...] = ()) -> Process:
        """Start a node, forked from a process that has imported it; `run` starts it as a user would."""
        _, _, _, *words = node_command(module, *parameters, arguments=arguments)
        return self._fork(module, words)

    def command(self, *words: str) -> Process:
        """Start the command `crawler` in the same way."""
        return self._fork("crawler_command.app", [*words])

    def _fork(self, module: str, words: list[str]) -> Process:
        log = self._new_log()
        self.processes.append(Process(Forked(module, words, environment(self.domain), log), log))
        return self.processes[-1]

    def _new_log(self) -> Path:
        return self.folder / f"process_{len(self.processes)}.log"

    def simulator(
        self, *parameters: str, arguments: tuple[str, ...] = (), hear: tuple[str, ...] = ("joint_states",)
    ) -> Process:
        for name in hear:
            self.hear(name)
        process = self.start("crawler_ros.node.simulator", *parameters, arguments=arguments)
        wait_until(lambda: self.heard[hear[0]] or process.process.poll() is not None, what=f"the first of {hear[0]}")
        assert process.process.poll() is None, process.said
        return process

    def hear(self, name: str, raw: bool = False, type_name: str | None = None) -> None:
        topic = read_topics()[type_name or name]
        kind = message_class(topic.type)
        keep = self.heard[name].append
        qos = qos_profile(topic)
        qos.depth = 100_000  # a stall of this process must not lose what the test is about
        self.node.create_subscription(kind, name, keep, qos, raw=raw)

    def publish(self, name: str, message: Any, table_name: str | None = None) -> None:
        if name not in self._publishers:
            topic = read_topics()[table_name or name]
            kind = message_class(topic.type)
            publisher = self.node.create_publisher(kind, name, qos_profile(topic))
            self._publishers[name] = publisher
            wait_until(lambda: publisher.get_subscription_count() > 0, what=f"a subscriber of {name}")
        self._publishers[name].publish(message)

    def call(self, service: str, kind: str, **fields: Any) -> Any:
        if service not in self._clients:
            self._clients[service] = self.node.create_client(message_class(kind), service)
        client = self._clients[service]
        assert client.wait_for_service(PATIENCE_S), f"no service {service}"
        request = client.srv_type.Request(**fields)
        future = client.call_async(request)
        wait_until(future.done, what=f"an answer of {service}")
        return future.result()

    def taken_up(self, name: str = "crawler") -> None:
        """Wait until all messages sent were received, then for a service that the node answers behind them.

        The first message of a topic can need a repetition, if the other side did not know the publisher yet.
        """
        for topic, publisher in self._publishers.items():
            assert publisher.wait_for_all_acked(Duration(seconds=PATIENCE_S)), f"{topic} was not received"
        self.call(f"/{name}/get_parameters", "rcl_interfaces/srv/GetParameters")

    def ticked(self, tick: int, name: str = "joint_states", rate: float = 100.0) -> None:
        """Wait for the state of a tick; the state of the start may come twice."""
        wait_until(
            lambda: self.heard[name] and seconds(self.heard[name][-1]) > (tick - 0.5) / rate,
            what=f"tick {tick} on {name}",
        )

    def walked(self, end: Any, within: float = 1e-12, pose: str = "pose") -> None:
        """Wait until the net translation reaches the end of a gait, however late its commands came."""

        def is_there() -> bool:
            if not self.heard[pose]:
                return False
            place = self.heard[pose][-1].pose.position
            return bool(np.abs(np.array([place.x, place.y])[: np.size(end)] - end).max() <= within)

        wait_until(is_there, what=f"a net translation of {end} m")

    def close(self) -> None:
        with ExitStack() as stack:  # all of it, whatever goes wrong
            stack.callback(self._print)
            stack.callback(self._leave)
            for process in self.processes:
                stack.callback(process.end)
            for process in self.processes:
                process.ask_to_end()

    def _print(self) -> None:
        """Print what pytest shows where a test fails."""
        for process in self.processes:
            print(f"{process.log.name}, status {process.process.poll()}:\n{process.said}")
        print("heard:", {name: len(messages) for name, messages in self.heard.items()})

    def _leave(self) -> None:
        self._stop.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@contextmanager
def graph(folder: Path) -> Iterator[Graph]:
    with reserved_domain() as domain:
        made = Graph(folder, domain)
        try:
            yield made
        finally:
            made.close()


def only(folder: Path) -> Path:
    (found,) = folder.iterdir()
    return found


def seconds(message: Any) -> float:
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
