"""Decoding of CDR bytes to arrays, many messages at once.

Messages of one topic with constant names and equal sizes have their numbers at equal positions: the positions are found
in the first message, and numpy reads the others. A message with another layout is read separately.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crawler_model.body.drive import NS

from ..wire.cdr import CdrReader
from .bag import BagError, Block

JOINT_STATE = "sensor_msgs/msg/JointState"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
POSE = "geometry_msgs/msg/PoseStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
_MOST_LAYOUTS = 64


class _Walk(CdrReader):
    """A pass through one message that collects the positions of its numbers and of the bytes that fix its layout."""

    def __init__(self, data: bytes) -> None:
        super().__init__(data)
        self.stamps: list[int] = []
        self.numbers: list[tuple[int, int]] = []
        self.fixed: list[tuple[int, int]] = [(1, 2)]

    def stamp(self) -> None:
        """Skip a time or duration."""
        self.stamps.append(self.skip(2, 4))

    def count(self) -> int:
        """Read the length of a sequence."""
        value = super().count()
        self.fixed.append((self.place - 4, self.place))
        return value

    def text(self) -> str:
        """Read a string."""
        text = super().text()
        self.fixed.append((self.fixed[-1][1], self.place))
        return text

    def skip_doubles(self, count: int | None = None) -> None:
        """Skip numbers, `count` of them or a sequence."""
        count = self.count() if count is None else count
        self.numbers.append((self.skip(count, 8), count))


@dataclass(frozen=True, eq=False)
class Layout:
    """The positions of the numbers in messages of one size.

    Attributes:
        names: joint names.
        stamps: position of the stamp, then of each point's time_from_start.
        numbers: position of each sequence of numbers, and its length.
        model: the bytes of one such message.
        mask: 255 for the bytes that are equal in all of them, else 0.
    """

    names: tuple[str, ...]
    stamps: np.ndarray
    numbers: tuple[tuple[int, int], ...]
    model: np.ndarray
    mask: np.ndarray


def _find_layout(kind: str, data: bytes) -> Layout:
    """Find where the numbers of a message are: of a trajectory only positions, of odometry only the pose."""
    names: tuple[str, ...] = ()
    walk = _Walk(data)
    if data[1] != 1:
        raise ValueError("not little-endian CDR")
    walk.stamp()
    walk.text()
    if kind == ODOMETRY:
        walk.text()
    if kind in (POSE, ODOMETRY):
        walk.skip_doubles(7)
    else:
        names = tuple(walk.text() for _ in range(walk.count()))
        if kind == JOINT_STATE:
            for _ in range(3):
                walk.skip_doubles()
        else:
            for _ in range(walk.count()):
                walk.skip_doubles()
                for _ in range(3):  # velocities, accelerations, effort
                    walk.skip_doubles()
                    walk.numbers.pop()
                walk.stamp()
    model = np.frombuffer(data, np.uint8)
    mask = np.zeros_like(model)
    for first, end in walk.fixed:
        mask[first:end] = 255
    return Layout(names, np.array(walk.stamps, np.int64), tuple(walk.numbers), model, mask)


def _read(layout: Layout, table: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Read messages of one layout, bytes of shape (K, size): times (K, stamps) [ns], numbers (K, length) of each."""
    words = table[:, layout.stamps[:, None] + np.arange(8)].copy().view("<i4").astype(np.int64)
    times = words[..., 0] * NS + (words[..., 1] & 0xFFFFFFFF)
    numbers = [table[:, a : a + 8 * n].copy().view("<f8").reshape(table.shape[0], n) for a, n in layout.numbers]
    return times, numbers


def rows_at(data: np.ndarray, first: np.ndarray, size: int) -> np.ndarray:
    """Copy pieces of equal size.

    Args:
        data: bytes, shape (B,).
        first: where each piece begins, shape (K,).
        size: its number of bytes.

    Returns:
        Shape (K, size).
    """
    if not first.size:  # there may be fewer bytes than one piece has
        return np.empty((0, size), np.uint8)
    # rows: an index for each byte takes ten times as long
    return np.lib.stride_tricks.sliding_window_view(data, size)[first]


class Decoder:
    """Reads the messages of one topic; numbers of joints are in the order of the first message, whatever their own."""

    def __init__(self, topic: str, kind: str, parts: bool = False) -> None:
        """Start without a layout; the first message determines it.

        Args:
            topic: its name, for errors.
            kind: JOINT_STATE, TRAJECTORY, POSE or ODOMETRY.
            parts: whether a message may hold some of the joints, as where several programs publish the states of one
                robot; numbers of the others are NaN, and joints that appear later are added behind.
        """
        self.topic = topic
        self.names: tuple[str, ...] | None = None
        self._kind = kind
        self._parts = parts
        self._layouts: dict[int, Layout] = {}

    def read(self, block: Block, which: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, list[np.ndarray]]]:
        """Read some messages of a block.

        Args:
            block: the block.
            which: indices of the messages in it, shape (K,).

        Returns:
            Groups of messages of one size: their indices in `which`, times (K, 1 + points) [ns], and their sequences.

        Raises:
            BagError: when bytes are not a message of this type, their numbers are not as many as their joints, or
                earlier messages have other joints.
        """
        groups = []
        sizes = block.size[which]
        for size in np.unique(sizes).tolist():
            at = np.flatnonzero(sizes == size)
            table = rows_at(block.data, block.first[which[at]], size)
            layout = self._layouts.get(size)
            if layout is None:
                data = table[0].tobytes()
                layout, plain = self._find(data, block)
                if plain is data:
                    self._layouts[size] = layout
                    if len(self._layouts) > _MOST_LAYOUTS:
                        del self._layouts[next(iter(self._layouts))]
            same = np.zeros(at.size, bool)
            if layout.model.size == size:
                same = ~((table ^ layout.model) & layout.mask).any(axis=1)
            if same.any():
                groups.append((at[same], *self._read(layout, table[same])))
            for row in np.flatnonzero(~same):
                own, plain = self._find(table[row].tobytes(), block)
                groups.append((at[row : row + 1], *self._read(own, np.frombuffer(plain, np.uint8)[None])))
        return groups

    def _read(self, layout: Layout, table: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Read messages of one layout as `_read`, with the numbers in the order of our names."""
        times, numbers = _read(layout, table)
        names, own = self.names or (), layout.names
        if own == names:
            return times, numbers
        places = [names.index(name) for name in own]
        ordered = []
        for part in numbers:
            if part.shape[1] not in (0, len(own)):
                raise BagError(f"{self.topic}: {part.shape[1]} numbers for the {len(own)} joints {', '.join(own[:4])}")
            row = np.full((part.shape[0], len(names) if part.shape[1] else 0), np.nan)
            row[:, places[: part.shape[1]]] = part
            ordered.append(row)
        return times, ordered

    def _find(self, data: bytes, block: Block) -> tuple[Layout, bytes]:
        """Find the layout of a message; re-encode it first if its encoding differs from ours."""
        try:
            layout = _find_layout(self._kind, data)
        except ValueError:
            data = self._reencode(data, block)
            layout = _find_layout(self._kind, data)
        if self.names is None:
            self.names = layout.names
        elif self._parts:
            self.names += tuple(name for name in dict.fromkeys(layout.names) if name not in self.names)
        elif sorted(layout.names) != sorted(self.names):
            before, after = ", ".join(self.names[:4]), ", ".join(layout.names[:4])
            raise BagError(
                f"{block.source}: {self.topic}: its joints change from {before} to {after}: "
                "two robots on one topic cannot be told apart"
            )
        return layout, data

    def _reencode(self, data: bytes, block: Block) -> bytes:
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_JAZZY)
        try:
            return bytes(store.serialize_cdr(store.deserialize_cdr(data, self._kind), self._kind, little_endian=True))
        except Exception as error:
            raise BagError(
                f"{block.source}: {self.topic}: a message of {len(data)} bytes is not a {self._kind} ({error})"
            ) from None
