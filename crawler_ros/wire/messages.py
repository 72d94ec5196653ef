"""Encoding of arrays as CDR bytes: the published bytes are the recorded bytes.

A message whose names never change has a fixed layout: it is encoded once, and each tick overwrites the stamp and the
numbers in place. The encoding is plain XCDR1, little-endian, with zeroed gaps, so that equal
states have equal bytes.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crawler_model.body.drive import NS

from .cdr import ENCAPSULATION, CdrWriter

_STAMP = struct.Struct("<iI")


def _put_stamp(buffer: bytearray, place: int, ns: int) -> None:
    _STAMP.pack_into(buffer, place, *divmod(ns, NS))


@dataclass(frozen=True)
class MessageLayout:
    """An encoded message, and where the parts of it are that change from tick to tick.

    Attributes:
        data: the CDR bytes.
        stamp: place of the stamp, two integers of 4 bytes.
        numbers: places and counts of its sequences of doubles, in order.
    """

    data: bytes
    stamp: int
    numbers: tuple[tuple[int, int], ...] = ()

    def encode(self, stamp_ns: int, numbers: Sequence[float] = ()) -> bytes:
        """Return the bytes of a message.

        Args:
            stamp_ns: the stamp [ns].
            numbers: the doubles of all its sequences, one after another.
        """
        buffer, first = bytearray(self.data), 0
        _put_stamp(buffer, self.stamp, stamp_ns)
        for place, count in self.numbers:
            struct.pack_into(f"<{count}d", buffer, place, *numbers[first : first + count])
            first += count
        return bytes(buffer)


@dataclass(frozen=True)
class TrajectoryLayout:
    """An encoded trajectory of two points, from which one with any number of points can be put together.

    Attributes:
        data: the CDR bytes; without points it ends behind their number.
        stamp: place of the stamp.
        count: place of the number of points, an integer of 4 bytes.
        positions: place of the positions of the first point.
        spacing: bytes from one point to the next; the last point ends 4 bytes earlier.
        times: place of the time of the first point, two integers of 4 bytes.
    """

    data: bytes
    stamp: int
    count: int
    positions: int
    spacing: int
    times: int


class JointStateMessage:
    """A sensor_msgs/JointState with fixed names."""

    def __init__(self, names: Sequence[str], frame: str = "") -> None:
        """Encode the message once.

        Args:
            names: the M joint names.
            frame: the header's frame_id.
        """
        cdr = CdrWriter()
        self._stamp = cdr.header(frame)
        cdr.texts(names)
        places = [cdr.doubles(len(names)) for _ in range(3)]
        self._buffer = cdr.buffer
        # three sequences of equal length are equally spaced: they are the rows of one array
        spacing = places[1] - places[0]
        self.numbers = np.ndarray((3, len(names)), np.float64, self._buffer, places[0], (spacing, 8))
        self.position, self.velocity, self.effort = self.numbers
        self.layout = MessageLayout(bytes(self._buffer), self._stamp, tuple((p, len(names)) for p in places))
        """Its numbers: the three sequences of `numbers`."""

    def encode(self, stamp_ns: int) -> bytes:
        """Return the bytes for the present `position`, `velocity` and `effort`, the rows of `numbers`, (3, M)."""
        _put_stamp(self._buffer, self._stamp, stamp_ns)
        return bytes(self._buffer)


def find_orientation(yaw: float) -> tuple[float, float]:
    """Compute z and w of the quaternion of a rotation about z; x and y are 0.

    Args:
        yaw: its angle [rad].

    Returns:
        sin(yaw / 2), cos(yaw / 2), the latter >= 0 however often the body turned round.
    """
    yaw = math.remainder(yaw, 2.0 * math.pi)
    return math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def list_pose(x: float, y: float = 0.0, yaw: float = 0.0) -> list[float]:
    """List the numbers of a pose on the ground.

    Args:
        x: position [m].
        y: position [m].
        yaw: angle of the orientation about z [rad].

    Returns:
        x and y, and z and w of the orientation.
    """
    return [x, y, *find_orientation(yaw)]


def lay_out_pose(frame: str) -> MessageLayout:
    """Lay out a geometry_msgs/PoseStamped on the ground.

    Args:
        frame: the header's frame_id.

    Returns:
        Its layout; the numbers are those of `list_pose`.
    """
    cdr = CdrWriter()
    stamp = cdr.header(frame)
    place = cdr.align(8)
    cdr.buffer += bytes(7 * 8)
    return MessageLayout(bytes(cdr.buffer), stamp, ((place, 2), (place + 5 * 8, 2)))


def lay_out_odometry(frame: str, child: str) -> MessageLayout:
    """Lay out a nav_msgs/Odometry on the ground; its numbers are exact, so its covariances are zero.

    Args:
        frame: the header's frame_id.
        child: child_frame_id, the frame of the twist.

    Returns:
        Its layout; the numbers are those of `list_pose`, the velocity along the two axes of the child frame [m/s], and
        the rate of the angle [rad/s].
    """
    cdr = CdrWriter()
    stamp = cdr.header(frame)
    cdr.text(child)
    place = cdr.align(8)
    cdr.buffer += bytes((7 + 36 + 6 + 36) * 8)
    numbers = (place, 2), (place + 5 * 8, 2), (place + 43 * 8, 2), (place + 48 * 8, 1)
    return MessageLayout(bytes(cdr.buffer), stamp, numbers)


class TrajectoryMessage:
    """A trajectory_msgs/JointTrajectory with fixed names and any number of points, positions only."""

    def __init__(self, names: Sequence[str]) -> None:
        """Store the parts that do not change.

        Args:
            names: the M joint names.
        """
        self._names = list(names)
        self._layouts: dict[int, tuple[bytearray, int, list[np.ndarray], list[int]]] = {}

    def _layout(self, points: int) -> tuple[bytearray, int, list[np.ndarray], list[int]]:
        cdr = CdrWriter()
        stamp = cdr.header("")
        cdr.texts(self._names)
        cdr.pack("I", points)
        positions, times = [], []
        for _ in range(points):
            positions.append(cdr.doubles(len(self._names)))
            for _ in range(3):  # velocities, accelerations, effort
                cdr.doubles(0)
            times.append(cdr.stamp(0))
        views = [np.frombuffer(cdr.buffer, np.float64, len(self._names), p) for p in positions]
        return cdr.buffer, stamp, views, times

    def encode(self, stamp_ns: int, times_ns: Sequence[int], positions: Sequence[np.ndarray]) -> bytes:
        """Return the bytes of a trajectory.

        Args:
            stamp_ns: the header's stamp [ns].
            times_ns: time_from_start of each point [ns].
            positions: of each point, shape (M,).

        Returns:
            The CDR bytes.
        """
        points = len(times_ns)
        layout = self._layouts.get(points)
        if layout is None:
            layout = self._layout(points)
            if points <= 8:  # cache the common ones
                self._layouts[points] = layout
        buffer, stamp, views, times = layout
        for view, place, position, ns in zip(views, times, positions, times_ns, strict=True):
            view[:] = position
            _put_stamp(buffer, place, ns)
        _put_stamp(buffer, stamp, stamp_ns)
        return bytes(buffer)

    def layout(self) -> TrajectoryLayout:
        """Return the layout of all trajectories with these names."""
        buffer, stamp, _, times = self._layout(2)
        count, positions = len(self._layout(0)[0]) - 4, times[0] - 8 * len(self._names) - 3 * 4  # three empty sequences
        return TrajectoryLayout(bytes(buffer), stamp, count, positions, times[1] - times[0], times[0])


NO_CHANGE = TrajectoryMessage([]).encode(0, [0], [np.zeros(0)])
"""The trajectory that changes nothing: a simulator in lock-step, silent between commands, answers it with one tick."""


def read_stamp(data: bytes) -> int:
    """Read the stamp of a message that begins with a std_msgs/Header, without decoding the rest.

    Args:
        data: its CDR bytes, little-endian.

    Returns:
        The stamp [ns].
    """
    seconds, ns = struct.unpack_from("<iI", data, len(ENCAPSULATION))
    return int(seconds * NS + ns)


CLOCK = MessageLayout(ENCAPSULATION + bytes(_STAMP.size), len(ENCAPSULATION))
"""The layout of a rosgraph_msgs/Clock."""


def encode_string(text: str) -> bytes:
    """Encode a std_msgs/String."""
    cdr = CdrWriter()
    cdr.text(text)
    return bytes(cdr.buffer)


def encode_diagnostics(
    stamp_ns: int, statuses: Sequence[tuple[int, str, str, str, Sequence[tuple[str, str]]]]
) -> bytes:
    """Encode a diagnostic_msgs/DiagnosticArray.

    Args:
        stamp_ns: the header's stamp [ns].
        statuses: level (0 ok, 1 warn, 2 error), name, message, hardware id, and (key, value) pairs of each.

    Returns:
        The CDR bytes.
    """
    cdr = CdrWriter()
    place = cdr.header("")
    cdr.pack("I", len(statuses))
    for level, name, message, hardware, values in statuses:
        cdr.pack("B", level)
        for value in (name, message, hardware):
            cdr.text(value)
        cdr.pack("I", len(values))
        for key, value in values:
            cdr.text(key)
            cdr.text(value)
    _put_stamp(cdr.buffer, place, stamp_ns)
    return bytes(cdr.buffer)
