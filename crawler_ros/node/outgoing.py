"""The messages that the simulator sends: recorded, then published."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import Scene

from .encoder import LEDGER, STATES, TickEncoder
from .intake.commanded_path import Vertices, hold

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
        self.publish: Any = None if publisher is None else publisher.handle.publish_raw
        """Publishes the bytes of a message; None if the topic is not published."""
        self._recorder = recorder
        self.channel = -1 if channel is None else channel
        """The channel of the recording; -1 if the topic is not recorded."""
        self.wanted = self.publish is not None or channel is not None
        self._publisher = publisher
        self._latched = publisher is not None and publisher.qos_profile.durability.name != "VOLATILE"
        self._subscribers = 0
        self._start = b""

    def send(self, data: bytes) -> None:
        """Record and publish a message.

        Args:
            data: its CDR bytes.
        """
        self.record(data)  # before a subscriber can answer
        if self.publish is not None:
            self.publish(data)

    def record(self, data: bytes) -> None:
        """Record a message, if there is a recording.

        Args:
            data: its CDR bytes.
        """
        if self._recorder is not None and self.channel >= 0:
            now = self._recorder.now_ns()
            self._recorder.record(self.channel, now, now, data)

    def is_heard(self) -> bool:
        """Determine whether a message that is published now can be received: at once, or later if it is latched."""
        return self.publish is not None and (self._latched or self._publisher.get_subscription_count() > 0)

    def publish_start(self, data: bytes) -> None:
        """Publish what holds at the start.

        Args:
            data: the CDR bytes of a message.
        """
        self._start, self._subscribers = data, self._publisher.get_subscription_count()
        self.publish(data)  # who comes after they were counted is sent it again, at worst twice

    def resend_start(self) -> None:
        """Publish it again where there are more subscribers than before."""
        before, self._subscribers = self._subscribers, self._publisher.get_subscription_count()
        if self._subscribers > before:
            self.publish(self._start)


class Outgoing:
    """Sends the ledger and the states of ticks, of one or of many."""

    def __init__(
        self, scene: Scene, values: Mapping[str, Any], outlets: Mapping[str, Outlet], recorder: Recorder | None
    ) -> None:
        """Encode the constant parts of the messages.

        Args:
            scene: the scene that runs.
            values: the parameters by name.
            outlets: the outgoing topics by name.
            recorder: the recorder, if there is one.
        """
        self._recorder, self._columns = recorder, scene.columns.count
        topics = {name: outlets[name] for name in (*STATES, LEDGER) if outlets[name].wanted}
        self.encoder = TickEncoder(scene, values["frame_id"], {n: outlet.channel for n, outlet in topics.items()})
        self._ledger = topics.pop(LEDGER, None)
        self._states = [(outlet, *self.encoder.places[name]) for name, outlet in topics.items()]
        self._unrecorded = 0, 0, np.zeros(0, np.int64)

    def send(self, taken: Vertices, read: np.ndarray, sent: np.ndarray, began_ns: int) -> None:
        """Record all messages of K ticks, then publish them: of each tick the states first, for which controllers wait.

        The times of the records are spread over the time that the ticks took.

        Args:
            taken: what the ticks followed.
            read: as for `TickEncoder.encode`, shape (K,).
            sent: likewise.
            began_ns: when the first tick began [ns, steady clock].
        """
        states, ledger = self._states, self._ledger
        if ledger is not None and ledger.publish is None:
            ledger = None
        if sent.size > 1:  # whether it is heard takes as long to find out as to publish it once
            states = [state for state in states if state[0].is_heard()]
            ledger = ledger if ledger is not None and ledger.is_heard() else None
            if self._recorder is None and not states and ledger is None:
                return
        data, places = self._record(taken, self._ledger is not None, read, sent, began_ns)
        begins = self.encoder.ledger_begins
        for begin, middle, end in places:
            if end > middle:
                for outlet, first, last in states:
                    outlet.publish(bytes(data[middle + first : middle + last]))
            if ledger is not None:
                ledger.publish(bytes(data[begin + begins : middle]))

    def _record(
        self, taken: Vertices, ledger: bool, read: np.ndarray, sent: np.ndarray, began_ns: int
    ) -> tuple[memoryview, list[list[int]]]:
        """Encode the messages of ticks and record them; return what `TickEncoder.encode` does."""
        recorder, recorded = self._recorder, self._unrecorded
        if recorder is not None:
            recorded = recorder.now_ns(), time.monotonic_ns() - began_ns, recorder.numbers
        data, places = self.encoder.encode(taken, ledger, read, sent, recorded)
        if recorder is not None:
            recorder.record_all(data)
        return data, places

    def send_start(self) -> None:
        """Send the state at the start, which was read into the first row; it has no ledger."""
        always, start = np.ones(1, np.bool_), hold(np.zeros(2, np.int64), self._columns)
        data, _ = self._record(start, False, always, always, time.monotonic_ns())
        for outlet, first, last in self._states:
            outlet.publish_start(bytes(data[first:last]))

    def resend(self) -> None:
        """Publish the state at the start again where there are more subscribers than before, the clock first."""
        for outlet, _, _ in reversed(self._states):
            outlet.resend_start()
