"""A ROS domain on loopback for measurements, with real processes in it: simulators and listeners."""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from crawler_ros.node.life.domains import domain_environment, reserved_domain
from crawler_ros.wire.definitions import find_ament_prefix
from crawler_ros.wire.topics import message_class, qos_profile, read_topics
from tests.processes import PATIENCE_S, cpu_seconds, wait_until

NS = 10**9
TICK_HZ = 1000.0


class Domain:
    """A ROS domain with a node of this process that listens to the simulator's diagnostics and sends commands."""

    def __init__(self, folder: Path) -> None:
        """Join a domain that no other program uses, until `close`."""
        import rclpy
        from rclpy.experimental.events_executor import EventsExecutor

        self.folder = folder
        self._reservation = contextlib.ExitStack()
        self.number = self._reservation.enter_context(reserved_domain())
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        find_ament_prefix()
        self._context = rclpy.Context()
        self._context.init(domain_id=self.number)
        self.node = rclpy.create_node("bench", context=self._context)
        self.reports: list[tuple[int, dict[str, str]]] = []
        self._listen("/diagnostics", self._on_report)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()
        self._publishers: dict[str, Any] = {}
        self._count = itertools.count()

    def _spin(self) -> None:
        while not self._ended.is_set():
            self._executor.spin_once(timeout_sec=0.05)

    def _listen(self, name: str, receive: Callable[[Any], None]) -> Any:
        topic = read_topics()[name]
        return self.node.create_subscription(message_class(topic.type), name, receive, qos_profile(topic))

    def _on_report(self, message: Any) -> None:
        stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
        self.reports.append((stamp, {v.key: v.value for s in message.status for v in s.values}))

    @contextlib.contextmanager
    def hearing(self, name: str, receive: Callable[[Any], None]) -> Iterator[None]:
        """Subscribe to a topic while the context is open."""
        subscription = self._listen(name, receive)
        try:
            yield
        finally:
            self.node.destroy_subscription(subscription)

    def publisher(self, name: str) -> Any:
        """Create a publisher of a command topic, and wait until the simulator subscribes to it."""
        if name not in self._publishers:
            topic = read_topics()[name]
            kind = message_class(topic.type)
            self._publishers[name] = self.node.create_publisher(kind, name, qos_profile(topic))
        publisher = self._publishers[name]
        wait_until(lambda: publisher.get_subscription_count() > 0)
        return publisher

    @contextlib.contextmanager
    def process(self, module: str, *arguments: str) -> Iterator[tuple[subprocess.Popen[bytes], Path]]:
        """Run a module of this project in the domain; yield the process and the file of its output."""
        log = self.folder / f"{module}_{next(self._count)}.log"
        environment = domain_environment(self.number)
        with log.open("wb") as stream:
            command = [sys.executable, "-m", module, *arguments]
            process = subprocess.Popen(
                command, env=environment, stdout=stream, stderr=subprocess.STDOUT, start_new_session=True
            )
        try:
            yield process, log
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
            try:
                process.wait(PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    @contextlib.contextmanager
    def simulator(self, scene: Path | str, **parameters: Any) -> Iterator[tuple[int, Path]]:
        """Run a simulator that records to this folder if `record` is true.

        Yields:
            Its process id and log, once its diagnostics have arrived.
        """
        values = {"scene": str(scene), "rate": TICK_HZ, "real_time_factor": 0.0, "method": "auto", **parameters}
        recording = self.folder / "bags"
        if values.pop("record", False):
            values["record"] = str(recording)
        words = [w for key, value in values.items() for w in ("-p", f"{key}:={json.dumps(value).strip(chr(34))}")]
        self.reports.clear()
        try:
            with self.process("crawler_ros.node.simulator", "--ros-args", *words) as (process, log):
                read_log = log.read_text
                if values.get("publish.diagnostics", True):
                    wait_until(lambda: self.reports or process.poll() is not None)
                else:
                    wait_until(lambda: "waiting for commands" in read_log() or process.poll() is not None)
                if process.poll() is not None:
                    raise RuntimeError(f"the simulator ended: {read_log()}")
                yield process.pid, log
        finally:
            shutil.rmtree(recording, ignore_errors=True)

    def rate(self, seconds: float, driven: bool = False) -> float:
        """Measure ticks per second; see `cost`."""
        return self.cost(seconds, (), driven)[0]

    def cost(self, seconds: float, pids: Sequence[int], driven: bool = False) -> tuple[float, list[float]]:
        """Measure ticks per second from the stamps and tick counts of the diagnostics, and processor time per tick.

        Returns:
            Ticks per second [Hz], and the processor time of each process per tick [us].
        """
        if driven:  # a trajectory of a long body has 40 MB
            wait_until(lambda: bool(self.reports) and not self.reports[-1][1]["rows waiting"].startswith("0 "))
        first = len(self.reports) + 1  # the next report may still belong to the start
        wait_until(lambda: len(self.reports) > first)
        (began, before), started = self.reports[first], time.monotonic()
        used = [cpu_seconds(pid) for pid in pids]
        lasts = seconds - 0.2  # by this clock as well: on a busy processor several reports arrive together
        wait_until(lambda: min(self.reports[-1][0] - began, (time.monotonic() - started) * NS) >= lasts * NS)
        ended, after = self.reports[-1]
        used = [cpu_seconds(pid) - u for pid, u in zip(pids, used, strict=True)]
        if driven and after["rows waiting"].startswith("0 "):
            raise RuntimeError(f"the trajectory ended within {seconds:g} s: the drives of the bench are too short")
        ticks = int(after["ticks"]) - int(before["ticks"])
        return ticks / ((ended - began) / NS), [1e6 * u / ticks for u in used]

    def close(self) -> None:
        """Leave the domain and release its reservation."""
        self._ended.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()
        self._reservation.close()


def build_trajectory(names: Sequence[str], rows: np.ndarray, spacing: float) -> Any:
    """Build the message of a long trajectory.

    Returns:
        A trajectory_msgs/JointTrajectory.
    """
    from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

    message = JointTrajectory(joint_names=list(names))
    for k, row in enumerate(rows):
        point = JointTrajectoryPoint(positions=row.tolist())
        ns = round(k * spacing * NS)
        point.time_from_start.sec, point.time_from_start.nanosec = ns // NS, ns % NS
        message.points.append(point)
    return message
