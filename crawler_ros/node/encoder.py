"""The messages of ticks, of one or of many, encoded by one compiled call."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from crawler_model import Scene
from crawler_model.crawler.readout import Readout

from ..recording.record_head import message_head
from ..wire.messages import CLOCK, TrajectoryMessage, lay_out_joint_state, lay_out_odometry, lay_out_pose
from ..wire.states import contact_names, joint_state_names, shown_contacts
from .intake.commanded_path import Vertices
from .kernels import encode_ticks

STATES = ("joint_states", "contact_states", "pose", "odom", "/clock")
"""The topics of the states, in the order in which they are sent."""
LEDGER = "applied_commands"
_MOST_TICKS = 256
_MOST_CONTACTS = 65536
"""Contacts of all ticks of one call together, so that their messages take at most some ten MB. With fewer, the calls
around each compiled call would count: with 16 ticks of a thousand contacts, they took a third of the time."""


class TickEncoder:
    """Encodes what is constant in the ledger and in the states once, and writes the rest over it.

    Each message stands behind the head of its record if it is recorded. The ledger of a tick comes before its states,
    because it holds what leads to them.
    """

    def __init__(self, scene: Scene, frame: str, channels: Mapping[str, int]) -> None:
        """Encode the constant parts, and allocate memory for what is read at the ends of ticks.

        Args:
            scene: the scene that runs.
            frame: the frame of positions on the ground.
            channels: of each topic that is encoded, its channel in the recording, or -1 if it is not recorded.
        """
        body = scene.body
        shown = "contact_states" in channels
        self.readout = Readout(body, shown_contacts(body) if shown else np.zeros(0, np.int64))
        self.most = max(1, min(_MOST_TICKS, _MOST_CONTACTS // body.contacts))
        """Largest number of ticks that are encoded together."""
        joint_names, shown_names = joint_state_names(body), contact_names(body) if shown else []
        widths = 3 * len(joint_names), 3 * len(shown_names), 7
        ends = self.most * np.cumsum((0, *widths))
        numbers = np.empty(ends[-1])
        of_joints, of_contacts, poses = (
            numbers[a:b].reshape(self.most, w) for (a, b), w in zip(itertools.pairwise(ends), widths, strict=True)
        )
        self.joints, self.contacts = of_joints.reshape(self.most, 3, -1), of_contacts.reshape(self.most, 3, -1)
        """What `Readout.read` reads, shape (most, 3, J) and (most, 3, M): to be filled in for the ticks read."""
        self.poses = poses
        """x, y, the last two of the orientation's quaternion, the velocity along both axes and the rate of the angle,
        shape (most, 7): to be filled in likewise. On a line only x and its velocity change."""
        poses[:] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0

        layouts = {
            "joint_states": (lay_out_joint_state(joint_names), ends[0], widths[0]),
            "contact_states": (lay_out_joint_state(shown_names, frame), ends[1], widths[1]),
            "pose": (lay_out_pose(frame), ends[2], widths[2]),
            "odom": (lay_out_odometry(frame, "base_link"), ends[2], widths[2]),
            "/clock": (CLOCK, 0, 0),
        }
        states, messages, fields = b"", list[list[int]](), list[list[int]]()
        self.places: dict[str, tuple[int, int]] = {}
        """Of each topic of the states, in the order of `STATES`: where its message begins and ends in them."""
        for name, (layout, first, width) in layouts.items():
            if name in channels:
                head, states = _add_head(states, channels[name], len(layout.data))
                begin = len(states)
                messages.append([channels[name], head, begin + layout.stamp])
                for place, count in layout.numbers:
                    fields.append([begin + place, 8 * first, 8 * width, 8 * count])
                    first += count
                states += layout.data
                self.places[name] = begin, len(states)
        self._states = _as_bytes(states), np.array(messages), np.array(fields), numbers.view(np.uint8)
        ledger = TrajectoryMessage(scene.columns.names)
        channel = channels.get(LEDGER, -1)
        head, data = _add_head(b"", channel, 0)
        self.ledger_begins = begin = len(data)
        """Where the message begins in the ledger."""
        places = [begin + place for place in (ledger.stamp, ledger.count, ledger.points)]
        self._ledger = _as_bytes(data + ledger.data), np.array([channel, head, *places, ledger.spacing, ledger.time])
        self._most_bytes, self._spacing = self._states[0].size + self._ledger[0].size, ledger.spacing
        self._bounds = np.empty((self.most, 3), np.int64)

    def encode(
        self, taken: Vertices, ledger: bool, read: np.ndarray, sent: np.ndarray, recorded: tuple[int, int, np.ndarray]
    ) -> tuple[memoryview, list[list[int]]]:
        """Encode the messages of K ticks.

        Args:
            taken: what the ticks followed.
            ledger: whether to encode that.
            read: whether each tick has been read, into the next row of `joints`, `contacts` and `poses`, shape (K,).
            sent: whether its states are encoded; only of ticks that have been read, shape (K,).
            recorded: the time of the records of the last tick, and how long all ticks took [ns, wall]; the number of
                the next message on each channel, which is counted on.

        Returns:
            The bytes of all messages; and of each tick the places of its ledger and of its states in them, and where
            the latter end.
        """
        out = np.empty(sent.size * self._most_bytes + taken.due_ns.size * self._spacing, np.uint8)
        bounds = self._bounds[: sent.size]
        encode_ticks(
            self._states,
            (*self._ledger, ledger),
            (taken.times_ns, read, sent),
            (taken.due_ns, taken.rows.view(np.uint8), taken.first),
            recorded,
            (out, bounds),
        )
        places = bounds.tolist()
        return out.data[: places[-1][2]], places


def _add_head(data: bytes, channel: int, size: int) -> tuple[int, bytes]:
    """Add the head of a record if there is a channel; return its place, -1 without one, and the bytes with it."""
    return (-1, data) if channel < 0 else (len(data), data + message_head(channel + 1, 0, 0, 0, size))


def _as_bytes(data: bytes) -> np.ndarray:
    return np.array(bytearray(data), np.uint8)
