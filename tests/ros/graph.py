"""Real processes in a ROS domain of their own, and a listener to them."""

from __future__ import annotations

import itertools
import os
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor

from crawler_ros import interface

_domains = (1 + (os.getpid() + n) % 100 for n in itertools.count())  # above 101 their ports meet others'


def environment(domain: int) -> dict[str, str]:
    own = {k: v for k, v in os.environ.items() if k != "ROS_LOCALHOST_ONLY"}
    return own | {
        "ROS_DOMAIN_ID": str(domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_PYTHON_CHECK_FIELDS": "1",
        "PYTHONUNBUFFERED": "1",
    }


def wait_until(condition: Callable[[], Any], seconds: float = 20.0, what: str = "it") -> Any:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        found = condition()
        if found:
            return found
        time.sleep(0.01)
    raise AssertionError(f"{what} did not happen within {seconds} s")


class Process:
    """A node started as a user would."""

    def __init__(self, module: str, domain: int, arguments: list[str], log: Path) -> None:
        self.log = log
        self._stream = log.open("w")
        command = [sys.executable, "-m", module, *(["--ros-args", *arguments] if arguments else [])]
        self.process = subprocess.Popen(
            command, env=environment(domain), stdout=self._stream, stderr=subprocess.STDOUT, start_new_session=True
        )

    @property
    def said(self) -> str:
        return self.log.read_text()

    def end(self, number: int = signal.SIGINT, seconds: float = 20.0) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        try:
            return self.process.wait(seconds)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise AssertionError(f"it does not end; it said:\n{self.said}") from None
        finally:
            self._stream.close()


class Graph:
    """One ROS domain: its processes, and a node of this one that listens and publishes."""

    def __init__(self, folder: Path) -> None:
        self.domain = next(_domains)
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

    def _spin(self) -> None:
        while not self._stop.is_set():
            self._executor.spin_once(timeout_sec=0.05)

    def start(self, module: str, *parameters: str, arguments: tuple[str, ...] = ()) -> Process:
        given = [word for p in parameters for word in ("-p", p)]
        log = self.folder / f"{module}_{len(self.processes)}.log"
        process = Process(module, self.domain, [*given, *arguments], log)
        self.processes.append(process)
        return process

    def simulator(
        self, *parameters: str, arguments: tuple[str, ...] = (), hear: tuple[str, ...] = ("joint_states",)
    ) -> Process:
        for name in hear:
            self.hear(name)
        process = self.start("crawler_ros.simulator", *parameters, arguments=arguments)
        wait_until(lambda: self.heard[hear[0]] or process.process.poll() is not None, what=f"the first of {hear[0]}")
        assert process.process.poll() is None, process.said
        return process

    def hear(self, name: str, raw: bool = False, type_name: str | None = None) -> None:
        topic = interface.topics()[type_name or name]
        kind = interface.message_class(topic.type)
        keep = self.heard[name].append
        qos = interface.qos_profile(topic)
        qos.depth = 100_000  # a stall of this process must not lose what the test is about
        self.node.create_subscription(kind, name, keep, qos, raw=raw)

    def publish(self, name: str, message: Any, table_name: str | None = None) -> None:
        if name not in self._publishers:
            topic = interface.topics()[table_name or name]
            kind = interface.message_class(topic.type)
            publisher = self.node.create_publisher(kind, name, interface.qos_profile(topic))
            self._publishers[name] = publisher
            wait_until(lambda: publisher.get_subscription_count() > 0, what=f"a subscriber of {name}")
        self._publishers[name].publish(message)

    def call(self, service: str, kind: str, **fields: Any) -> Any:
        client = self.node.create_client(interface.message_class(kind), service)
        assert client.wait_for_service(20.0), f"no service {service}"
        request = client.srv_type.Request(**fields)
        future = client.call_async(request)
        wait_until(future.done, what=f"an answer of {service}")
        return future.result()

    def close(self) -> None:
        for process in self.processes:
            process.end()
        self._stop.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@contextmanager
def graph(folder: Path) -> Iterator[Graph]:
    made = Graph(folder)
    try:
        yield made
    finally:
        made.close()


def seconds(message: Any) -> float:
    return message.header.stamp.sec + message.header.stamp.nanosec * 1e-9
