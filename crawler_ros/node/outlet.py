"""A topic that the simulator sends on, with its recording."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..recording.recorder import Recorder


class Outlet:
    """Where the messages of one topic go: to who listens, and into the recording."""

    def __init__(self, publisher: Any, recorder: Recorder | None, channel: int | None) -> None:
        """Take both ways out.

        Args:
            publisher: rclpy's; None to publish nothing.
            recorder: the recording, if there is one.
            channel: its channel; None to record nothing.
        """
        # what Publisher.publish does with bytes once it has looked at their type: half of its time
        self._publish = None if publisher is None else publisher.handle.publish_raw
        self._record = None if recorder is None or channel is None else recorder.record
        self._now_ns = time.time_ns if recorder is None else recorder.now_ns
        self._channel = -1 if channel is None else channel
        self.wanted = self._publish is not None or self._record is not None
        self._publisher = publisher
        self._last = b""
        self._listeners = 0

    def send(self, data: bytes) -> None:
        """Publish and record a message.

        Args:
            data: its CDR bytes.
        """
        self._last = data
        if self._record is not None:  # before anybody can answer
            now = self._now_ns()
            self._record(self._channel, now, now, data)
        if self._publish is not None:
            self._publish(data)

    def greet(self, newcomers: bool = True) -> None:
        """Publish the last message again if somebody has come to listen since this was last asked.

        Args:
            newcomers: False when all who listen now have heard it.
        """
        if self._publish is None:
            return
        before, self._listeners = self._listeners, self._publisher.get_subscription_count()
        if newcomers and self._listeners > before:
            self._publish(self._last)
