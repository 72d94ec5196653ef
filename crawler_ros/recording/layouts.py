"""CDR bytes to arrays, many messages at once.

Messages of one topic whose names never change and whose sizes are equal have their numbers in equal places: the places
are found in the first of them, and the others are read by numpy. A message that does not look like it is read alone.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

from crawler_model.body.drive import NS

from .bag import BagError, Block

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
POSE = "geometry_msgs/msg/PoseStamped"
_HEAD = 4
_LONGEST = 1 << 28
_MOST_LAYOUTS = 64


@dataclass(eq=False)
class _Walk:
    """A walk through one message that notes where its numbers are and which bytes give it its form."""

    data: bytes
    place: int = _HEAD
    stamps: list[int] = field(default_factory=list)
    numbers: list[tuple[int, int]] = field(default_factory=list)
    fixed: list[tuple[int, int]] = field(default_factory=list)

    def align(self, size: int) -> None:
        self.place += -(self.place - _HEAD) % size

    def stamp(self) -> None:
        self.align(4)
        self.stamps.append(self.place)
        self.place += 8

    def count(self) -> int:
        self.align(4)
        (value,) = struct.unpack_from("<I", self.data, self.place)
        self.fixed.append((self.place, self.place + 4))
        self.place += 4
        if value > _LONGEST:
            raise ValueError("a sequence longer than any message")
        return int(value)

    def text(self) -> str:
        length = self.count()
        self.fixed.append((self.place, self.place + length))
        text = bytes(self.data[self.place : self.place + length])
        self.place += length
        return text.rstrip(b"\0").decode()

    def doubles(self, count: int | None = None) -> None:
        count = self.count() if count is None else count
        if count:
            self.align(8)
        self.numbers.append((self.place, count))
        self.place += 8 * count


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the numbers of messages of one size stand.

    Attributes:
        names: joint names.
        stamps: where the stamp begins, then where each point's time_from_start does.
        numbers: where each sequence of numbers begins, and its length.
        fixed: the bytes that are equal in all such messages, as places.
        model: what they are.
    """

    names: tuple[str, ...]
    stamps: np.ndarray
    numbers: tuple[tuple[int, int], ...]
    fixed: np.ndarray
    model: np.ndarray


def find_layout(kind: str, data: bytes) -> Layout:
    """Find where the numbers of a message stand.

    Args:
        kind: JOINT_STATE, TRAJECTORY or POSE.
        data: its CDR bytes, little-endian.

    Returns:
        The layout. Of a trajectory's points the positions alone are numbers.

    Raises:
        ValueError: when it is no such message.
    """
    walk = _Walk(data)
    names: tuple[str, ...] = ()
    try:
        if data[1] != 1:
            raise ValueError("not little-endian CDR")
        walk.stamp()
        walk.text()
        if kind == POSE:
            walk.doubles(7)
        else:
            names = tuple(walk.text() for _ in range(walk.count()))
            if kind == JOINT_STATE:
                for _ in range(3):
                    walk.doubles()
            else:
                for _ in range(walk.count()):
                    walk.doubles()
                    for _ in range(3):  # velocities, accelerations, effort
                        walk.doubles()
                        walk.numbers.pop()
                    walk.stamp()
    except (struct.error, IndexError) as error:
        raise ValueError(str(error)) from None
    if walk.place > len(data):
        raise ValueError("it ends too early")
    fixed = np.concatenate([np.arange(a, b) for a, b in walk.fixed]).astype(np.int64)
    model = np.frombuffer(data, np.uint8)[fixed].copy()
    return Layout(names, np.array(walk.stamps, np.int64), tuple(walk.numbers), fixed, model)


def _read(layout: Layout, table: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Read messages of one layout, bytes of shape (K, size): times (K, stamps) [ns], numbers (K, length) of each."""
    words = table[:, layout.stamps[:, None] + np.arange(8)].copy().view("<i4").astype(np.int64)
    times = words[..., 0] * NS + (words[..., 1] & 0xFFFFFFFF)
    numbers = [table[:, a : a + 8 * n].copy().view("<f8").reshape(table.shape[0], n) for a, n in layout.numbers]
    return times, numbers


class Decoder:
    """Reads the messages of one topic."""

    def __init__(self, topic: str, kind: str) -> None:
        """Know nothing yet; the first message tells.

        Args:
            topic: its name, for messages to people.
            kind: JOINT_STATE, TRAJECTORY or POSE.
        """
        self.topic = topic
        self.names: tuple[str, ...] | None = None
        self.alone = 0
        """Messages that had to be read one by one."""
        self._kind = kind
        self._layouts: dict[int, Layout] = {}

    def read(self, block: Block, which: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, list[np.ndarray]]]:
        """Read some messages of a block.

        Args:
            block: the block.
            which: places of the messages in it, shape (K,).

        Returns:
            Groups of messages of one size: their places in `which`, times (K, 1 + points) [ns], and their sequences.

        Raises:
            BagError: when bytes are no message of this type, or speak of other joints than those before.
        """
        groups = []
        sizes = block.size[which]
        for size in np.unique(sizes).tolist():
            at = np.flatnonzero(sizes == size)
            table = block.data[block.first[which[at]][:, None] + np.arange(size)]
            layout = self._layouts.get(size)
            if layout is None:
                data = table[0].tobytes()
                layout, plain = self._find(data)
                if plain is data:
                    self._layouts[size] = layout
                    if len(self._layouts) > _MOST_LAYOUTS:
                        del self._layouts[next(iter(self._layouts))]
            if layout.fixed.size and layout.fixed[-1] < size:
                same = (table[:, layout.fixed] == layout.model).all(axis=1) & (table[:, 1] == 1)
            else:
                same = np.zeros(at.size, bool)
            if same.any():
                groups.append((at[same], *_read(layout, table[same])))
            for row in np.flatnonzero(~same):
                self.alone += 1
                own, plain = self._find(table[row].tobytes())
                groups.append((at[row : row + 1], *_read(own, np.frombuffer(plain, np.uint8)[None])))
        return groups

    def _find(self, data: bytes) -> tuple[Layout, bytes]:
        """Find the layout of a message; what is encoded in another way is put into ours first."""
        try:
            layout = find_layout(self._kind, data)
        except ValueError:
            data = self._encode_plainly(data)
            layout = find_layout(self._kind, data)
        if self.names is None:
            self.names = layout.names
        elif layout.names != self.names:
            raise BagError(
                f"{self.topic}: its joints change from {', '.join(self.names[:4])} to {', '.join(layout.names[:4])}: "
                "two robots on one topic cannot be told apart"
            )
        return layout, data

    def _encode_plainly(self, data: bytes) -> bytes:
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_JAZZY)
        try:
            return bytes(store.serialize_cdr(store.deserialize_cdr(data, self._kind), self._kind, little_endian=True))
        except Exception as error:
            raise BagError(f"{self.topic}: a message of {len(data)} bytes is no {self._kind} ({error})") from None
