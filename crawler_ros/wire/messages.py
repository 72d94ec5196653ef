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
        stamp: place of the stamp of the header.
        numbers: place of the first number.
        shape: shape of the numbers.
        strides: bytes from one number to the next, for each axis of that shape.
        times: place of the first of the times that have the first axis of the numbers in common; -1 without times.
    """

    data: bytes
    stamp: int
    numbers: int
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    times: int = -1


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
        first, second, _ = (cdr.doubles(len(names)) for _ in range(3))
        self._buffer = cdr.buffer
        # three sequences of equal length are equally spaced: they are the rows of one array
        self.numbers = np.ndarray((3, len(names)), np.float64, self._buffer, first, (second - first, 8))
        self.position, self.velocity, self.effort = self.numbers
        self.layout = MessageLayout(bytes(self._buffer), self._stamp, first, self.numbers.shape, self.numbers.strides)

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


class PoseMessage:
    """A geometry_msgs/PoseStamped on the ground."""

    def __init__(self, frame: str) -> None:
        """Encode the message once.

        Args:
            frame: the header's frame_id.
        """
        cdr = CdrWriter()
        self._stamp = cdr.header(frame)
        place = cdr.align(8)
        cdr.buffer += bytes(7 * 8)
        self._buffer = cdr.buffer
        self._pose = np.frombuffer(self._buffer, np.float64, 7, place)
        self._pose[6] = 1.0  # orientation.w
        self.layout = MessageLayout(bytes(self._buffer), self._stamp, place, (2,), (8,))

    def encode(self, stamp_ns: int, x: float, y: float = 0.0, yaw: float = 0.0) -> bytes:
        """Return the bytes for position.x = x, position.y = y [m] and an orientation turned by `yaw` about z [rad]."""
        self._pose[0] = x
        self._pose[1] = y
        self._pose[5:] = find_orientation(yaw)
        _put_stamp(self._buffer, self._stamp, stamp_ns)
        return bytes(self._buffer)


class OdometryMessage:
    """A nav_msgs/Odometry on the ground; its numbers are exact, so its covariances are zero."""

    def __init__(self, frame: str, child: str) -> None:
        """Encode the message once.

        Args:
            frame: the header's frame_id.
            child: child_frame_id, the frame of the twist.
        """
        cdr = CdrWriter()
        self._stamp = cdr.header(frame)
        cdr.text(child)
        place = cdr.align(8)
        cdr.buffer += bytes((7 + 36 + 6 + 36) * 8)
        self._buffer = cdr.buffer
        numbers = np.frombuffer(self._buffer, np.float64, 7 + 36 + 6 + 36, place)
        numbers[6] = 1.0  # orientation.w
        self._position, self._velocity = numbers[:2], numbers[43:45]
        self._orientation, self._rate = numbers[5:7], numbers[48:49]
        self.layout = MessageLayout(bytes(self._buffer), self._stamp, place, (2, 2), (43 * 8, 8))

    def encode(
        self,
        stamp_ns: int,
        position: np.ndarray | float,
        velocity: np.ndarray | float,
        yaw: float = 0.0,
        rate: float = 0.0,
    ) -> bytes:
        """Return the bytes of a message.

        Args:
            stamp_ns: the header's stamp [ns].
            position: net translation, a number on a line, shape (2,) in the plane [m].
            velocity: its velocity along the axes of the child frame, of the same shape [m/s].
            yaw: angle of the orientation about z [rad].
            rate: its rate [rad/s].

        Returns:
            The CDR bytes.
        """
        self._orientation[:] = find_orientation(yaw)
        self._rate[0] = rate
        self._position[: 1 if isinstance(position, float) else 2] = position
        self._velocity[: 1 if isinstance(velocity, float) else 2] = velocity
        _put_stamp(self._buffer, self._stamp, stamp_ns)
        return bytes(self._buffer)


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

    def layout(self, points: int) -> MessageLayout:
        """Return the layout of a trajectory.

        Args:
            points: number of its points P.

        Returns:
            The layout; its numbers are the positions, shape (P, M).
        """
        buffer, stamp, _, times = self._layout(points)
        size = len(self._names)
        if points == 0:
            return MessageLayout(bytes(buffer), stamp, 0, (0, size), (0, 8))
        after = 8 * size + 12  # positions, and the lengths of three empty sequences
        spacing = times[1] - times[0] if points > 1 else 0
        return MessageLayout(bytes(buffer), stamp, times[0] - after, (points, size), (spacing, 8), times[0])


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


CLOCK = MessageLayout(ENCAPSULATION + bytes(_STAMP.size), len(ENCAPSULATION), 0, (0,), (8,))
"""The layout of a rosgraph_msgs/Clock."""


def encode_clock(ns: int) -> bytes:
    """Encode a rosgraph_msgs/Clock."""
    return ENCAPSULATION + _STAMP.pack(*divmod(ns, NS))


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
