"""Decoding of received bytes to arrays: every length is checked before data of that length is read.

The middleware's own decoder writes a line to standard error for each damaged message and creates an object for each
point of a trajectory. Here numpy reads the points of a trajectory, all of equal layout at once.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.errors import CommandError

from ...wire.cdr import HEAD, CdrReader, wrong_nanosec

_WITHOUT_DIMENSIONS = b"\x00\x01\x00\x00\x00\x00\x00\x00"
_ARRAY_COUNT = struct.Struct("<I4x")
_ARRAY_COUNT_AT, _ARRAY_AT = 12, 20
"""In a Float64MultiArray without dimensions, little-endian, as almost every one is: place of its count and numbers."""


@dataclass(frozen=True, eq=False)
class ReceivedTrajectory:
    """A trajectory_msgs/JointTrajectory as arrays.

    Attributes:
        stamp_ns: the header's stamp [ns].
        names: the N joint names.
        times_ns: time_from_start of each point, shape (P,) [ns].
        positions: shape (P, N).
        has_more: whether a point has velocities, accelerations or efforts.
    """

    stamp_ns: int
    names: tuple[str, ...]
    times_ns: np.ndarray
    positions: np.ndarray
    has_more: bool


def read_array(data: bytes) -> np.ndarray:
    """Read the numbers of a std_msgs/Float64MultiArray.

    Args:
        data: its CDR bytes.

    Returns:
        Shape (M,), a view of the bytes.

    Raises:
        CommandError: when the bytes are not such a message.
    """
    if data[: len(_WITHOUT_DIMENSIONS)] == _WITHOUT_DIMENSIONS and len(data) > _ARRAY_AT:
        (size,) = _ARRAY_COUNT.unpack_from(data, _ARRAY_COUNT_AT)
        if 0 <= len(data) - (_ARRAY_AT + 8 * size) < 8:
            return np.frombuffer(data, "<f8", size, _ARRAY_AT)
    reader = CdrReader(data)
    for _ in range(reader.count()):  # dimensions: label, size, stride
        reader.text()
        reader.skip(2, 4)
    reader.skip(1, 4)  # data_offset
    values = reader.doubles()
    reader.end(1)
    return values


def read_joints(data: bytes) -> tuple[tuple[str, ...], np.ndarray, bool]:
    """Read the positions of a sensor_msgs/JointState.

    Args:
        data: its CDR bytes.

    Returns:
        The names of the joints; their positions, as many as the message has; and whether it has velocities or efforts.

    Raises:
        CommandError: when the bytes are not such a message.
    """
    reader = CdrReader(data)
    reader.ns()
    reader.text()  # frame_id
    names = _names(reader)
    positions, velocities, efforts = (reader.doubles() for _ in range(3))
    reader.end(3)
    return names, positions, bool(velocities.size or efforts.size)


def _names(reader: CdrReader) -> tuple[str, ...]:
    count = reader.count()
    reader.skip(count, 4)  # a name has at least four bytes: refuse counts that cannot be true
    reader.place -= 4 * count
    return tuple(reader.text() for _ in range(count))


def read_trajectory(data: bytes) -> ReceivedTrajectory:
    """Read a trajectory_msgs/JointTrajectory.

    Args:
        data: its CDR bytes.

    Returns:
        The trajectory.

    Raises:
        CommandError: when the bytes are not such a message, a time has 1e9 nanoseconds or more, or a point does not
            have one position per name.
    """
    reader = CdrReader(data)
    stamp_ns = reader.ns()
    reader.text()  # frame_id
    names = _names(reader)
    points = reader.count()
    if points > (len(data) - reader.place) // 24:  # four counts and a time
        raise CommandError(f"not a message of this type: {points} points in {len(data)} bytes")
    times = np.zeros(points, dtype=np.int64)
    positions = np.zeros((points, len(names)))
    has_more = False
    done, run, before = 0, 1, (-1, -1)
    while done < points:
        first = reader.place
        positions[done] = _positions(reader, done, len(names))
        sizes = [reader.doubles().size for _ in range(3)]  # velocities, accelerations, effort
        has_more = has_more or any(sizes)
        times[done] = reader.ns()
        done += 1
        form = ((first - HEAD) % 8, reader.place - first)
        if form != before or form[1] % 8:
            before, run = form, 1
            continue
        run = min(2 * run, points - done, (len(data) - reader.place) // form[1])
        if run == 0:
            continue
        like = _read_equal_points(data, reader.order, first, reader.place, run, positions[done:], times[done:])
        reader.place += like * form[1]
        done += like
        if like < run:
            run = 1
    reader.end(4 * points)
    return ReceivedTrajectory(stamp_ns, names, times, positions, has_more)


def _positions(reader: CdrReader, point: int, names: int) -> np.ndarray:
    values = reader.doubles()
    if values.size != names:
        raise wrong_point(point, values.size, names)
    return values


def wrong_point(point: int, positions: int, names: int) -> CommandError:
    """Build the error of a point that does not have one position per name."""
    return CommandError(f"trajectory: point {point} has {positions} position(s) for {names} name(s)")


def _read_equal_points(
    data: bytes, order: str, model: int, first: int, most: int, positions: np.ndarray, times: np.ndarray
) -> int:
    """Read up to `most` points with the layout of the one from `model` to `first`; return how many there are."""
    size, names = first - model, positions.shape[1]
    table = np.frombuffer(data, np.uint8, most * size, first).reshape(most, size)
    form = np.zeros(size, dtype=bool)  # the bytes of the counts
    reader = CdrReader(data)
    reader.place = model
    begins = []
    for _ in range(4):  # positions, velocities, accelerations, effort
        form[reader.place - model : reader.place - model + 4] = True
        count = reader.count()
        begins.append(reader.skip(count, 8) - model)
    begin = begins[0]
    expected = np.frombuffer(data, np.uint8, size, model)[form]
    same = (table[:, form] == expected).all(axis=1)
    like = most if same.all() else int(np.argmin(same))
    rows = table[:like]
    positions[:like] = np.ascontiguousarray(rows[:, begin : begin + 8 * names]).view(order + "f8")
    words = np.ascontiguousarray(rows[:, size - 8 :])
    seconds, rest = words[:, :4].copy().view(order + "i4")[:, 0], words[:, 4:].copy().view(order + "u4")[:, 0]
    if rest.max(initial=0) >= NS:
        raise wrong_nanosec(int(rest.max()))
    times[:like] = seconds.astype(np.int64) * NS + rest
    return like
