"""Instants of a crawler to draw, from a running one or from a recording."""

from __future__ import annotations

import contextlib
import struct
import sys
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.body.body import Body
from crawler_model.body.drive import NS
from crawler_model.body.plan import Plan
from crawler_model.motion.jump import Jump
from crawler_model.run.trajectory import TimedJump
from crawler_pictures.ground import has_stasis_bounds, local_bounds
from crawler_pictures.marks import can_be_marked, mark_joints

from ..recording.recorded_robot import Robot, noted_robot
from ..wire.states import StationReader

FRAME_EVERY_NS = 20_000_000
_HEAD, _JUMP = struct.Struct("<qq"), struct.Struct("<dqddd")


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant to draw, of the stations and joints of a body (see `crawler_model.body.body.Body`).

    Shapes: displacement, in the plane x and y in turn, and state of each station, 1, 0 or -1 since the frame before;
    tension of each link and segment, for vector springs in the plane its size; bounds of the spring forces on each
    station where a chain has no segments: friction of the ground there, shifted by the loads; command row in force;
    jumps since the frame before; of each joint, if any has a limit of tension: -1 slack, 1 stalled, else 0.
    """

    time_ns: int
    displacement: np.ndarray
    tension: np.ndarray
    state: np.ndarray
    forward: np.ndarray
    backward: np.ndarray
    row: np.ndarray
    jumps: tuple[TimedJump, ...] = ()
    yields: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int8))

    def pack(self) -> bytes:
        """Encode the frame as bytes: the time, the number of jumps, all numbers as doubles, the jumps."""
        numbers = (self.displacement, self.tension, self.state, self.forward, self.backward, self.row, self.yields)
        jumps = b"".join(_pack_jump(jump) for jump in self.jumps)
        return _HEAD.pack(self.time_ns, len(self.jumps)) + np.concatenate(numbers).astype("<f8").tobytes() + jumps

    @staticmethod
    def unpack(data: bytes, scene: Plan) -> Frame:
        """Decode the bytes of `pack`."""
        ns, count = _HEAD.unpack_from(data)
        cuts = np.cumsum(_frame_sizes(scene))
        x, tension, state, forward, backward, row, yields = np.split(
            np.frombuffer(data, "<f8", int(cuts[-1]), _HEAD.size), cuts[:-1]
        )
        begin = _HEAD.size + 8 * int(cuts[-1])
        jumps = tuple(_unpack_jump(data, begin + k * _JUMP.size) for k in range(count))
        return Frame(ns, x, tension, state.astype(np.int8), forward, backward, row, jumps, yields.astype(np.int8))


def _pack_jump(jump: TimedJump) -> bytes:
    """Encode a jump; not a number stands for no border."""
    border = np.nan if jump.border is None else jump.border
    return _JUMP.pack(jump.time, jump.contact, border, jump.distance, jump.loss)


def _unpack_jump(data: bytes, place: int) -> TimedJump:
    time, contact, border, distance, loss = _JUMP.unpack_from(data, place)
    return TimedJump(time, contact, None if np.isnan(border) else border, distance, loss)


def read_frames(source: BinaryIO, scene: Plan) -> Iterator[Frame]:
    """Read the frames that `Frame.pack` wrote one after another; an incomplete one at the end is left out.

    Args:
        source: stream that waits for all bytes requested.
        scene: the scene.

    Yields:
        The frames.
    """
    numbers = 8 * sum(_frame_sizes(scene))
    while len(head := source.read(_HEAD.size)) == _HEAD.size:
        size = numbers + _HEAD.unpack(head)[1] * _JUMP.size
        rest = source.read(size)
        if len(rest) == size:
            yield Frame.unpack(head + rest, scene)


def _frame_sizes(scene: Plan) -> list[int]:
    """Count the entries of displacement, tension, state, forward, backward, the command row and yields."""
    body = scene.body
    stations, joints = body.stations.size, body.joints.shape[0]
    friction = stations if has_stasis_bounds(body) else 0
    limited = joints if can_be_marked(body) else 0
    return [stations * body.dimension, joints, stations, friction, friction, scene.drive.rows.shape[-1], limited]


def time_jumps(jumps: Iterable[Jump], start_ns: int, ends_ns: Sequence[int]) -> tuple[TimedJump, ...]:
    """Compute the times of jumps in ramps that were followed in one call.

    Args:
        jumps: the jumps.
        start_ns: when the first ramp begins [ns].
        ends_ns: when each of them ends [ns].

    Returns:
        The same jumps with simulated times.
    """
    made = []
    for jump in jumps:
        begin, end = ends_ns[jump.ramp - 1] if jump.ramp else start_ns, ends_ns[jump.ramp]
        when = (begin + jump.fraction * (end - begin)) / NS
        made.append(TimedJump(when, jump.contact, jump.border, jump.distance, jump.loss))
    return tuple(made)


def frame_of(crawler: Crawler, time_ns: int, state: np.ndarray, jumps: tuple[TimedJump, ...] = ()) -> Frame:
    """Build a frame of a crawler.

    Args:
        crawler: the crawler.
        time_ns: simulated time [ns].
        state: motion of each of its contacts since the frame before.
        jumps: the jumps since then.

    Returns:
        The frame.
    """
    at = crawler.body.stations
    motion = crawler.displacement[at], crawler.joint_elongation, crawler.joint_tension, state[at]
    return frame_of_tick(crawler.scene, time_ns, *motion, crawler.row, jumps)


def frame_of_tick(
    scene: Plan,
    time_ns: int,
    displacement: np.ndarray,
    elongation: np.ndarray,
    tension: np.ndarray,
    state: np.ndarray,
    row: np.ndarray,
    jumps: tuple[TimedJump, ...] = (),
) -> Frame:
    """Build a frame of the end of a tick.

    Args:
        scene: the scene.
        time_ns: simulated time [ns].
        displacement: of each station, shape (Q,), in the plane (Q, 2) [m].
        elongation: of each joint, shape (J,) [m]; used where joints can be marked.
        tension: of each joint, shape (J,), in the plane (J, 2), for a body that turns torques too [N].
        state: motion of each station since the frame before.
        row: the command row in force.
        jumps: the jumps since the frame before.

    Returns:
        The frame.
    """
    body = scene.body
    forward = backward = np.zeros(0)
    if has_stasis_bounds(body):
        forward, backward = local_bounds(scene, scene.columns.target(row), displacement)
    yields = np.zeros(0, np.int8)
    if can_be_marked(body):
        actuation = scene.columns.target(row)[: body.springs]
        yields = mark_joints(body, elongation, body.joint_sum(actuation), tension)
    sizes = _sizes(body, tension)
    return Frame(time_ns, displacement.ravel(), sizes, state, forward, backward, row, jumps, yields)


def _sizes(body: Body, tension: np.ndarray) -> np.ndarray:
    """Return the tension of each joint, for vector springs its size; for a body that turns of each link."""
    if body.turning is not None:
        return tension[: body.springs]
    return tension if body.dimension == 1 else np.linalg.norm(tension.reshape(-1, 2), axis=1)


def frames_of_recording(
    path: Path,
    scene: Scene | None = None,
    robot: Robot | None = None,
    jumps: Sequence[tuple[int, TimedJump]] = (),
) -> tuple[Scene, Iterator[Frame]]:
    """Read frames from a recording.

    Args:
        path: a bag folder or an .mcap file, complete or not.
        scene: the body, for a recording that does not hold its scene.
        robot: the crawler, where several were recorded; None for the one whose topics the recording lists, or the
            only one.
        jumps: numbers of runs between resets and jumps in them, in order, as a simulation of the recording finds them:
            the recorded states do not hold them.

    Returns:
        The scene and its frames, one per joint_states message; without any, reading them raises a BagError.

    Raises:
        BagError: when it cannot be read, its scene is missing, or several crawlers were recorded.
    """
    from ..recording import bag

    head = bag.examine(path)
    if scene is None:
        scene = bag.recorded_scene(path, head.attachments)
        if scene is None:
            raise bag.BagError(f"{path}: the recording does not hold its scene; name one with --scene")

    drawn = robot or noted_robot(head.attachments)
    return scene, in_sequence(_frames(path, bag.read(path), scene, drawn, jumps))


def in_sequence(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Shift runs between resets so that each follows the one before, as a picture needs increasing times."""
    offset = last = 0
    for frame in frames:
        if frame.time_ns + offset < last:
            offset = last
        last = frame.time_ns + offset
        jumps = tuple(replace(jump, time=jump.time + offset / NS) for jump in frame.jumps)
        yield replace(frame, time_ns=last, jumps=jumps)


def _frames(
    path: Path, records: Iterable[Any], scene: Scene, robot: Robot | None, jumps: Sequence[tuple[int, TimedJump]]
) -> Iterator[Frame]:
    from rosbags.typesys import Stores, get_typestore

    from ..recording.bag import BagError

    deserialize = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
    body, row = scene.body, scene.drive.rows[0]
    ahead, run, last = deque(jumps), 0, 0
    motion = _MotionReader(body)
    damaged, empty = 0, True

    def decode(data: bytes, kind: str) -> Any:
        """Decode a message; None if its bytes are damaged, whatever error that causes, or do not fit the scene."""
        nonlocal damaged
        with contextlib.suppress(Exception):
            message = deserialize(data, kind)
            sizes = [message.position, message.velocity, message.effort] if kind.endswith("JointState") else []
            rows = [] if kind.endswith("JointState") else [point.positions for point in message.points]
            if all(v.size == motion.size for v in sizes) and all(len(r) == row.size for r in rows):
                return message
        damaged += 1
        return None

    topics: dict[str, str] = {}
    for record in records:
        name = record.topic.rsplit("/", 1)[-1] if robot is None else robot.meant(record.topic)
        if name in ("applied_commands", "joint_states") and record.topic != topics.setdefault(name, record.topic):
            both = f"{topics[name]} and {record.topic}"
            raise BagError(f"{path}: several crawlers were recorded, with {both}; name one with --namespace")
        if name == "applied_commands":
            commanded = decode(record.data, record.type)
            if commanded is not None and commanded.points:
                row = np.array(commanded.points[-1].positions)
        elif name == "joint_states":
            message = decode(record.data, record.type)
            if message is None:
                continue
            stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
            x, state, tension = motion.read(message, stamp == 0)
            run += stamp == 0 and last > 0
            last, passed = stamp, []
            while ahead and (ahead[0][0], round(ahead[0][1].time * NS)) <= (run, stamp):
                passed.append(ahead.popleft()[1])
            empty = False
            yield frame_of_tick(scene, stamp, x, message.position[body.dimension :], tension, state, row, tuple(passed))
    if damaged:
        print(f"{path}: left out {damaged} messages that are damaged or do not fit the scene", file=sys.stderr)
    if empty:
        raise BagError(f"{path}: the recording has no state to draw")


def find_moving(body: Body, moved: np.ndarray) -> np.ndarray:
    """Find which stations of a body that turns move, also without friction.

    Args:
        body: the body.
        moved: how far each moved, shape (..., Q, 2) [m].

    Returns:
        1 for each that moved by more than rounding, else 0; int8, shape (..., Q).
    """
    size = np.linalg.norm(moved, axis=-1)
    largest = size.max(axis=-1, initial=0.0, keepdims=True)
    return (size > np.maximum(1e-9 * largest, 1e-12 * np.ptp(body.position, axis=0).max())).astype(np.int8)


class _MotionReader:
    """Reads the stations and the tensions of the joints from messages of joint_states, one after another."""

    def __init__(self, body: Body) -> None:
        self._body, self._stations = body, StationReader(body)
        self.size = self._stations.size
        self._before: np.ndarray | None = None

    def read(self, message: Any, begins: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return displacement and state of each station, and each tension; where a run begins, all stations rest."""
        body, x = self._body, self._stations.read(message.position)
        if body.turning is not None:  # velocities of angles do not tell exactly which stations rest
            moved = np.zeros_like(x) if begins or self._before is None else x - self._before
            self._before = x
            return x, find_moving(body, moved), message.effort[3:]
        v, tension = self._stations.read(message.velocity), message.effort[body.dimension :]
        if body.dimension == 2:
            v = np.linalg.norm(v, axis=1)
        moving = np.abs(v) > 1e-9 * np.abs(message.velocity).max(initial=0.0)
        return x, (np.sign(v) * moving).astype(np.int8), tension


def thin(frames: Iterable[Frame], every_ns: int = FRAME_EVERY_NS) -> Iterator[Frame]:
    """Yield frames at least `every_ns` apart and the last one; a slip or jump between two shows in the later one."""
    shown: int | None = None
    moved: np.ndarray | None = None
    jumps: tuple[TimedJump, ...] = ()
    for frame in frames:
        jumps += frame.jumps
        moved = frame.state if moved is None else np.where(frame.state != 0, frame.state, moved)
        if shown is not None and 0 <= frame.time_ns - shown < every_ns:
            continue
        shown = frame.time_ns
        yield replace(frame, state=moved, jumps=jumps)
        moved, jumps = None, ()
    if moved is not None:
        yield replace(frame, state=moved, jumps=jumps)
