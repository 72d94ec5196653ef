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

    def encode(self, stamp_ns: int, numbers: Sequence[float] | np.ndarray = ()) -> bytes:
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


def lay_out_joint_state(names: Sequence[str], frame: str = "") -> MessageLayout:
    """Lay out a sensor_msgs/JointState.

    Args:
        names: the M joint names.
        frame: the header's frame_id.

    Returns:
        Its layout; the numbers are the positions, the velocities and the efforts.
    """
    cdr = CdrWriter()
    stamp = cdr.header(frame)
    cdr.texts(names)
    places = [cdr.doubles(len(names)) for _ in range(3)]
    return MessageLayout(bytes(cdr.buffer), stamp, tuple((place, len(names)) for place in places))


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
        Its layout; its numbers are what `list_pose` returns.
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
        Its layout; its numbers are what `list_pose` returns, the velocity along the two axes of the child frame [m/s],
        and the rate of the angle [rad/s].
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
        """Encode two points, from which a trajectory with any number of points can be put together.

        Args:
            names: the M joint names.
        """
        cdr = CdrWriter()
        self.stamp = cdr.header("")
        """Place of the stamp."""
        cdr.texts(names)
        self.count = cdr.pack("I", 0)
        """Place of the number of points, an integer of 4 bytes: without points the message ends behind it."""
        places = []
        for _ in range(2):
            places.append(cdr.doubles(len(names)))
            for _ in range(3):  # velocities, accelerations, effort
                cdr.doubles(0)
            self.time = cdr.stamp(0) - places[-1]
            """In a point: place of its time, two integers of 4 bytes."""
        self.points, self.spacing = places[0], places[1] - places[0]
        """Place of the positions of the first point, and bytes from one point to the next: the last ends 4 earlier."""
        self.data = bytes(cdr.buffer)

    def encode(self, stamp_ns: int, times_ns: Sequence[int], positions: Sequence[np.ndarray]) -> bytes:
        """Return the bytes of a trajectory.

        Args:
            stamp_ns: the header's stamp [ns].
            times_ns: time_from_start of each point [ns].
            positions: of each point, shape (M,).

        Returns:
            The CDR bytes.
        """
        buffer = bytearray(self.data[: self.points if len(times_ns) else self.count + 4])
        struct.pack_into("<I", buffer, self.count, len(times_ns))
        _put_stamp(buffer, self.stamp, stamp_ns)
        point = bytearray(self.data[self.points : self.points + self.spacing])
        for ns, position in zip(times_ns, positions, strict=True):
            point[: 8 * len(position)] = np.asarray(position, "<f8").tobytes()
            _put_stamp(point, self.time, ns)
            buffer += point
        return bytes(buffer[:-4] if len(times_ns) else buffer)


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
