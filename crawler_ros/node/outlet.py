"""A topic that the simulator publishes and records."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..recording.recorder import Recorder


class Outlet:
    """Sends the messages of one topic to its subscribers and to the recording."""

    def __init__(self, publisher: Any, recorder: Recorder | None, channel: int | None) -> None:
        """Store the publisher and the recording channel.

        Args:
            publisher: rclpy's publisher; None to publish nothing.
            recorder: the recorder, if there is one.
            channel: the recorder's channel; None to record nothing.
        """
        # Publisher.publish calls this with bytes after checking their type, which takes as long again
        self.publish = None if publisher is None else publisher.handle.publish_raw
        """Publishes the bytes of a message; None if the topic is not published."""
        self._recorder = None if channel is None else recorder
        self.channel = -1 if channel is None else channel
        """The channel of the recording; -1 if the topic is not recorded."""
        self.recorded = channel is not None
        """Whether the topic is recorded."""
        self.wanted = self.publish is not None or self.recorded
        self._publisher = publisher
        self._latched = publisher is not None and publisher.qos_profile.durability.name != "VOLATILE"
        self.last = b""
        """The last message."""
        self._subscribers = 0

    def send(self, data: bytes) -> None:
        """Publish and record a message.

        Args:
            data: its CDR bytes.
        """
        self.record(data)  # before a subscriber can answer
        if self.publish is not None:
            self.publish(data)

    def record(self, data: bytes) -> None:
        """Record a message that is published later.

        Args:
            data: its CDR bytes.
        """
        self.last = data
        if self._recorder is not None:
            now = self._recorder.now_ns()
            self._recorder.record(self.channel, now, now, data)

    def is_heard(self) -> bool:
        """Determine whether a message that is published now can be received: at once, or later if it is latched."""
        return self.publish is not None and (self._latched or self._publisher.get_subscription_count() > 0)

    def resend(self, newcomers: bool = True) -> None:
        """Publish the last message again if there are more subscribers than at the last call.

        Args:
            newcomers: False when all present subscribers have received it already.
        """
        if self.publish is None:
            return
        before, self._subscribers = self._subscribers, self._publisher.get_subscription_count()
        if newcomers and self._subscribers > before:
            self.publish(self.last)
