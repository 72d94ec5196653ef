"""A node whose peers cannot flood its log, as they can with rclpy's warning about each incompatible endpoint."""

from __future__ import annotations

import faulthandler
import os
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind

from ...wire.facts import LogText
from ..intake.refusals import Throttle

_MOST_WARNED = 100


class QuietNode(Node):
    """Warns about endpoints with another type or incompatible QoS at most once a second for each topic."""

    def __init__(self, name: str, **options: Any) -> None:
        """Create the node.

        Args:
            name: name of the node.
            **options: for rclpy's Node.
        """
        self.throttle = Throttle(lambda text: self.get_logger().warning(text))
        self._warned: set[str] = set()
        self.leaves_within_s: float | None = None  # set where the process ends with the node
        super().__init__(name, **options)

    def warn_once(self, text: str) -> None:
        """Log a warning unless the same one was logged before.

        Args:
            text: the line.
        """
        if text not in self._warned and len(self._warned) < _MOST_WARNED:
            self._warned.add(text)
            self.get_logger().warning(text)

    def leave(self) -> None:
        """Remove the node from the graph; where that does not end in time, end the process, with status 1.

        If another node leaves at that moment, Fast DDS 2.14 may wait for ever, while it holds the interpreter's lock:
        its participant waits for a callback, which waits for the participant.
        """
        if self.leaves_within_s is not None:
            self._nowhere = open(os.devnull, "w")  # noqa: SIM115 (it stays open)
            faulthandler.dump_traceback_later(self.leaves_within_s, exit=True, file=self._nowhere)
        self.destroy_node()

    def create_publisher(self, msg_type: Any, topic: str, *args: Any, **options: Any) -> Any:
        """Create a publisher, as rclpy's Node does."""
        if options.get("event_callbacks") is None:
            options["event_callbacks"] = PublisherEventCallbacks(**self._warnings(topic, "subscription"))
        return super().create_publisher(msg_type, topic, *args, **options)

    def create_subscription(self, msg_type: Any, topic: str, *args: Any, **options: Any) -> Any:
        """Create a subscription, as rclpy's Node does."""
        if options.get("event_callbacks") is None:
            options["event_callbacks"] = SubscriptionEventCallbacks(**self._warnings(topic, "publisher"))
        return super().create_subscription(msg_type, topic, *args, **options)

    def _warnings(self, topic: str, peer: str) -> dict[str, Any]:
        def on_qos(event: Any) -> None:
            policy = qos_policy_name_from_kind(event.last_policy_kind)
            text = f"a {peer} of {topic} has incompatible QoS ({policy}): {LogText.NOTHING_PASSES.value}"
            self.throttle.warn(f"{peer} of {topic}", text)

        def on_type(_: Any) -> None:
            text = f"a {peer} of {topic} has another message type: {LogText.NOTHING_PASSES.value}"
            self.throttle.warn(f"{peer} of {topic}", text)

        return {"incompatible_qos": on_qos, "incompatible_type": on_type}
