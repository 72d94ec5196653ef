"""The outgoing messages of a tick: the ledger and the states, encoded from the crawler and sent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.crawler.readout import Readout, find_turn
from crawler_model.run.screw import to_frame

from ..wire.messages import (
    CLOCK,
    JointStateMessage,
    MessageLayout,
    OdometryMessage,
    PoseMessage,
    TrajectoryMessage,
    encode_clock,
)
from ..wire.states import contact_names, joint_state_names, shown_contacts
from .intake.commanded_path import Vertex
from .outlet import Outlet

STATES = ("joint_states", "contact_states", "pose", "odom", "/clock")
"""The topics of the states, in the order in which they are sent."""


class Outgoing:
    """Encodes the constant parts of the messages of every tick once, and sends messages."""

    def __init__(self, scene: Scene, values: Mapping[str, Any], outlets: dict[str, Outlet]) -> None:
        """Encode the constant parts.

        Args:
            scene: the scene that runs.
            values: the parameters by name.
            outlets: the outgoing topics by name.
        """
        body, frame = scene.body, values["frame_id"]
        shown = outlets["contact_states"].wanted
        self.outlets = outlets
        self.ledger = TrajectoryMessage(list(scene.columns.names))
        self.joints = JointStateMessage(joint_state_names(body))
        self.contacts = JointStateMessage(contact_names(body) if shown else [], frame)
        self.readout = Readout(body, shown_contacts(body) if shown else np.zeros(0, np.int64))
        self._pose, self._odometry = PoseMessage(frame), OdometryMessage(frame, "base_link")

    def record_ledger(self, start_ns: int, vertices: Sequence[Vertex]) -> None:
        """Record the commands that a tick followed, if they are recorded.

        Args:
            start_ns: simulated time at its start [ns].
            vertices: the ends of its ramps.
        """
        outlet = self.outlets["applied_commands"]
        if outlet.recorded:
            outlet.record(self._encode_ledger(start_ns, vertices))

    def publish_ledger(self, start_ns: int, vertices: Sequence[Vertex]) -> None:
        """Publish the commands that a tick followed, after `record_ledger`; the arguments are the same."""
        outlet = self.outlets["applied_commands"]
        if outlet.publish is not None:
            outlet.publish(outlet.last if outlet.recorded else self._encode_ledger(start_ns, vertices))

    def _encode_ledger(self, start_ns: int, vertices: Sequence[Vertex]) -> bytes:
        times = [max(v.due_ns - start_ns, 0) for v in vertices]
        return self.ledger.encode(start_ns, times, [v.row for v in vertices])

    def send_states(self, crawler: Crawler, now_ns: int, seconds: float) -> None:
        """Send the states at the end of a tick.

        Args:
            crawler: the crawler.
            now_ns: simulated time [ns].
            seconds: duration of the tick [s]; infinite at the start.
        """
        outlets = self.outlets
        self.readout.read(crawler, seconds, self.joints.numbers, self.contacts.numbers)
        outlets["joint_states"].send(self.joints.encode(now_ns))
        if outlets["contact_states"].wanted:
            outlets["contact_states"].send(self.contacts.encode(now_ns))
        if outlets["pose"].wanted or outlets["odom"].wanted:
            y = crawler.net_translation
        if outlets["pose"].wanted:
            place = (y, 0.0) if isinstance(y, float) else y
            outlets["pose"].send(self._pose.encode(now_ns, place[0], place[1], crawler.yaw))
        if outlets["odom"].wanted:
            gain = crawler.body.share @ crawler.gained
            if crawler.body.turning is not None:  # a twist is expressed in the moving frame
                gain = to_frame(crawler.body, crawler.displacement, gain[None])[0]
            rate = find_turn(crawler) / seconds
            outlets["odom"].send(self._odometry.encode(now_ns, y, gain / seconds, crawler.yaw, rate))
        if outlets["/clock"].wanted:
            outlets["/clock"].send(encode_clock(now_ns))

    def layouts(self) -> dict[str, MessageLayout]:
        """Return the layouts of the states that are sent, by topic, in their order."""
        messages = (self.joints, self.contacts, self._pose, self._odometry)
        every = dict(zip(STATES, [*(message.layout for message in messages), CLOCK], strict=True))
        return {name: layout for name, layout in every.items() if self.outlets[name].wanted}

    def resend(self, newcomers: bool = True) -> None:
        """Publish the last states again, see `Outlet.resend`."""
        for name in ("/clock", *STATES[:-1]):
            self.outlets[name].resend(newcomers)
