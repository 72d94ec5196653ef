"""Instants of a crawler to draw, from a running one or from a recording."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.body.body import Body
from crawler_model.body.drive import NS

from ..recording.recorded_robot import Robot, noted_robot
from ..wire.states import StationReader

FRAME_EVERY_NS = 20_000_000


@dataclass(frozen=True, eq=False)
class Frame:
    """One instant to draw, of the stations and joints of a body (see `crawler_model.body.body.Body`).

    Shapes: displacement, in the plane x and y in turn, and state of each station, 1, 0 or -1 since the frame before;
    tension of each joint, in the plane its size; mu_plus and mu_minus of each station where a chain has no segments.
    """

    time_ns: int
    displacement: np.ndarray
    tension: np.ndarray
    state: np.ndarray
    forward: np.ndarray
    backward: np.ndarray

    def pack(self) -> bytes:
        """Encode the frame as bytes: the time, then all numbers as doubles."""
        numbers = (self.displacement, self.tension, self.state, self.forward, self.backward)
        return struct.pack("<q", self.time_ns) + np.concatenate(numbers).astype("<f8").tobytes()

    @staticmethod
    def unpack(data: bytes, body: Body) -> Frame:
        """Decode the bytes of `pack`."""
        (ns,) = struct.unpack_from("<q", data)
        cuts = np.cumsum(frame_sizes(body))
        x, tension, state, forward, backward = np.split(np.frombuffer(data, "<f8", int(cuts[-1]), 8), cuts[:-1])
        return Frame(ns, x, tension, state.astype(np.int8), forward, backward)


def frame_sizes(body: Body) -> list[int]:
    """Count the numbers of a frame.

    Args:
        body: the body.

    Returns:
        Entries of displacement, tension, state, forward and backward.
    """
    stations, joints = body.stations.size, body.joints.shape[0]
    friction = stations if has_stasis_bounds(body) else 0
    return [stations * body.dimension, joints, stations, friction, friction]


def has_stasis_bounds(body: Body) -> bool:
    """Return whether the bounds of each link's tension follow from its neighbours.

    Args:
        body: the body.

    Returns:
        True for a chain of isolated contacts.
    """
    return body.is_chain and not body.segments


def frame_of(crawler: Crawler, time_ns: int, state: np.ndarray) -> Frame:
    """Build a frame of a crawler.

    Args:
        crawler: the crawler.
        time_ns: simulated time [ns].
        state: motion of each of its contacts since the frame before.

    Returns:
        The frame.
    """
    body = crawler.body
    at = body.stations
    tension = crawler.joint_tension
    if body.dimension == 2:
        tension = np.linalg.norm(tension, axis=1)
    none = np.zeros(0)
    bounded = has_stasis_bounds(body)
    forward, backward = (crawler.forward[at], crawler.backward[at]) if bounded else (none, none)
    return Frame(time_ns, crawler.displacement[at].ravel(), tension, state[at], forward, backward)


def frames_of_recording(
    path: Path, scene: Scene | None = None, robot: Robot | None = None
) -> tuple[Scene, Iterator[Frame]]:
    """Read frames from a recording.

    Args:
        path: a bag folder or an .mcap file, complete or not.
        scene: the body, for a recording that does not hold its scene.
        robot: the crawler, where several were recorded; None for the one whose topics the recording lists, else for
            all.

    Returns:
        The scene and its frames, one per joint_states message.

    Raises:
        BagError: when it cannot be read, or its scene is missing.
    """
    from ..recording import bag

    head = bag.Bag({})
    records = bag.read(path, head)
    waiting = list(itertools.islice(records, 1))  # attachments precede the first message
    if scene is None:
        scene = bag.recorded_scene(path, head.attachments)
        if scene is None:
            raise bag.BagError(f"{path}: the recording does not hold its scene; name one with --scene")

    drawn = robot or noted_robot(head.attachments)
    return scene, in_sequence(_frames(itertools.chain(waiting, records), scene, drawn))


def in_sequence(frames: Iterable[Frame]) -> Iterator[Frame]:
    """Shift runs between resets so that each follows the one before, as a picture needs increasing times."""
    offset = last = 0
    for frame in frames:
        if frame.time_ns + offset < last:
            offset = last
        last = frame.time_ns + offset
        yield replace(frame, time_ns=last)


def _frames(records: Iterable[Any], scene: Scene, robot: Robot | None) -> Iterator[Frame]:
    from rosbags.typesys import Stores, get_typestore

    decode = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
    body, columns = scene.body, scene.columns
    bounded = has_stasis_bounds(body)
    n = body.contacts if bounded else 0
    forward, backward = scene.drive.forward[0][:n], scene.drive.backward[0][:n]
    stations = StationReader(body)
    for record in records:
        name = record.topic.rsplit("/", 1)[-1] if robot is None else robot.meant(record.topic)
        if name == "applied_commands":
            points = decode(record.data, record.type).points
            if points:
                friction = np.asarray(points[-1].positions)[columns.lengths :]
                forward, backward = friction[:n], friction[n : 2 * n]
        elif name == "joint_states":
            message = decode(record.data, record.type)
            stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
            x, v = stations.read(message.position), stations.read(message.velocity)
            tension = message.effort[body.dimension :]
            if body.dimension == 2:
                v, tension = np.linalg.norm(v, axis=1), np.linalg.norm(tension.reshape(-1, 2), axis=1)
            moving = np.abs(v) > 1e-9 * np.abs(message.velocity).max(initial=0.0)
            yield Frame(stamp, x.ravel(), tension, (np.sign(v) * moving).astype(np.int8), forward, backward)


def thin(frames: Iterable[Frame], every_ns: int = FRAME_EVERY_NS) -> Iterator[Frame]:
    """Yield frames at least `every_ns` apart; a slip between two of them shows in the later one."""
    shown: int | None = None
    moved: np.ndarray | None = None
    for frame in frames:
        moved = frame.state if moved is None else np.where(frame.state != 0, frame.state, moved)
        if shown is not None and 0 <= frame.time_ns - shown < every_ns:
            continue
        shown = frame.time_ns
        yield Frame(frame.time_ns, frame.displacement, frame.tension, moved, frame.forward, frame.backward)
        moved = None
