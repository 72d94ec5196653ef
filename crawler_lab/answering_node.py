"""Nodes that answer the states of a crawler with trajectories, and end with one line where they cannot."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.experimental.events_executor import EventsExecutor

from crawler_model import CrawlerError
from crawler_model.body.drive import NS
from crawler_ros.node.intake.peers import SecondSimulator, Silence
from crawler_ros.node.life.quiet_node import QuietNode
from crawler_ros.node.life.stop import StopFlag, end_on_signals
from crawler_ros.wire.messages import NO_CHANGE, TrajectoryMessage
from crawler_ros.wire.topics import message_class, qos_profile, read_topics

_REPORT_EVERY_S, _LOOK_EVERY_S, _GONE_S = 5.0, 0.5, 3.0
"""How often the node reports, and looks for the simulator; how long this may be away, as between two starts."""


class AnsweringNode(QuietNode):
    """Sends trajectories on `joint_trajectory` as answers to states."""

    def __init__(self, name: str, **options: Any) -> None:
        """Create the node before its topics.

        Args:
            name: name of the node.
            **options: for rclpy's Node.
        """
        super().__init__(name, **options)
        self.problem, self.done = "", StopFlag()
        self._last_ns = -1  # stamp of the last state
        self._pending: list[bytes] = []

    def open_commands(self, names: Sequence[str]) -> None:
        """Open the topic of the commands.

        Args:
            names: of the numbers that are commanded.
        """
        self._message = TrajectoryMessage(names)
        topics = read_topics()
        topic = topics["joint_trajectory"]
        self._publisher = self.create_publisher(message_class(topic.type), topic.name, qos_profile(topic))
        self._states = topics["joint_states"].name
        self._second = SecondSimulator(self, self._states)
        self.create_timer(0.05, self.send)

    def send(self, *commands: bytes) -> None:
        """Send commands, and those that wait, once there is somebody to receive them.

        Args:
            *commands: CDR bytes of trajectories.
        """
        self._pending += commands
        if self._publisher.get_subscription_count():
            for data in self._pending:
                self._publisher.publish(data)
            self._pending = []

    def fail(self, problem: str) -> None:
        """End the node with an error.

        Args:
            problem: one line.
        """
        self.problem = self.problem or problem
        self.done.set()

    def report_following(self) -> None:
        """Log how it goes, every few seconds; a node that has nothing to log is silent."""

    def answer_states(self) -> None:
        """Answer states until the node is done or a signal arrives.

        Raises:
            CrawlerError: with its problem, if it has one.
        """
        end_on_signals(self.done)
        executor = EventsExecutor()
        executor.add_node(self)
        reported = looked = met = time.monotonic()
        silence = Silence()
        while not self.done.is_set():
            executor.spin_once(timeout_sec=0.1)
            self.throttle.flush()
            now = time.monotonic()
            if now - looked > _LOOK_EVERY_S:
                looked = now
                met = now if self._last_ns < 0 or self.count_publishers(self._states) else met
                if now - met > _GONE_S:
                    self.fail(f"the simulator disappeared at simulated time {self._last_ns / NS:.3f} s")
            if now - reported > _REPORT_EVERY_S:
                reported = now
                if self._last_ns < 0:
                    text = "still waiting for states: start crawler-simulator in the same namespace and domain"
                    self.get_logger().info(text)
                else:
                    self.report_following()
            if silence.has_lasted(self._last_ns < 0 and self._publisher.get_subscription_count() > 0):
                self._publisher.publish(NO_CHANGE)
        self.leave()
        if self.problem:
            raise CrawlerError(self.problem)


def described(text: str) -> ParameterDescriptor:
    """Describe a parameter that does not change while the node runs.

    Args:
        text: its meaning.

    Returns:
        Its descriptor.
    """
    return ParameterDescriptor(description=text, read_only=True)
