"""Recordings made without ROS: the model's states in the bytes that the node would have sent."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from crawler_model import Crawler, Scene, load_scene
from crawler_model.body.drive import NS
from crawler_model.crawler.readout import Readout
from crawler_model.run.ticks import rational_rate, tick_end_ns
from crawler_ros.recording.attachments import versions
from crawler_ros.recording.bag import read
from crawler_ros.recording.bag_writer import BagWriter
from crawler_ros.wire.messages import TrajectoryMessage, lay_out_joint_state, lay_out_pose, list_pose
from crawler_ros.wire.states import contact_names, joint_state_names, shown_contacts
from crawler_ros.wire.topics import read_topics

Message = tuple[str, int, bytes]
STATES = ("joint_states", "contact_states", "pose")


def play(scene: Scene, first_ns: int, last_ns: int, rate: float = 100.0) -> Iterator[tuple[int, list, list]]:
    """The ticks of a scene whose drive starts at `first_ns`: start, offsets and rows of the vertices."""
    ratio, drive, columns = rational_rate(rate), scene.drive, scene.columns
    plain = dataclasses.replace(columns, index=np.arange(columns.count), factor=np.ones(columns.count), slope_load=None)
    rows_of = dataclasses.replace(drive, columns=plain)  # its targets are rows
    tick = 0
    in_force = drive.rows[0]
    while (end := tick_end_ns(tick + 1, ratio)) <= last_ns:
        start = tick_end_ns(tick, ratio)
        ns = np.array([end]) - first_ns
        way, rows = drive.waypoints_between(max(start - first_ns, -1), int(ns[0])) if ns[0] >= 0 else ([], [])
        vertices = [(int(t) + first_ns - start, drive.rows[r]) for t, r in zip(way, rows, strict=True)]
        if ns[0] >= 0 and (len(way) == 0 or way[-1] < ns[0]):
            vertices.append((end - start, rows_of.sample(ns)[0]))
        kept = []
        for due, row in vertices:
            if row.tobytes() != in_force.tobytes():
                kept.append((due, row))
                in_force = row
        yield start, [due for due, _ in kept], [row for _, row in kept]
        tick += 1


def hold(first: int, count: int, rate: float = 100.0) -> Iterator[tuple[int, list, list]]:
    """Ticks in which nothing is commanded, from tick `first` on."""
    for tick in range(first, first + count):
        yield tick_end_ns(tick, rational_rate(rate)), [], []


def messages(scene: Scene, ticks, rate: float = 100.0, crawler: Crawler | None = None) -> Iterator[Message]:
    """What a node sends in these ticks, the state at the start first."""
    crawler = crawler or Crawler(scene)
    ratio = rational_rate(rate)
    ledger = TrajectoryMessage(list(scene.columns.names))
    names = joint_state_names(scene.body), contact_names(scene.body)
    joints, contacts = lay_out_joint_state(names[0]), lay_out_joint_state(names[1], "world")
    of_joints, of_contacts = (np.zeros((3, len(each))) for each in names)
    pose, readout = lay_out_pose("world"), Readout(scene.body, shown_contacts(scene.body))

    def states(ns: int, seconds: float) -> Iterator[Message]:
        readout.read(crawler, seconds, of_joints, of_contacts)
        yield "joint_states", ns, joints.encode(ns, of_joints.ravel())
        yield "contact_states", ns, contacts.encode(ns, of_contacts.ravel())
        yield "pose", ns, pose.encode(ns, list_pose(*np.atleast_1d(crawler.net_translation), yaw=crawler.yaw))

    yield from states(0, np.inf)
    for start, offsets, rows in ticks:
        width = scene.columns.index.size
        crawler.follow(scene.columns.target(np.array(rows)) if rows else np.empty((0, width)))
        yield "applied_commands", start, ledger.encode(start, offsets, rows)
        end = tick_end_ns(round(start * ratio / NS) + 1, ratio)
        yield from states(end, (end - start) / NS)


def attachments(scene: Scene, rate: float = 100.0) -> dict:
    method = Crawler(scene).method
    return {"scene": scene.document(), "parameters": {"rate": rate, "method": method}, "versions": versions()}


def write(folder: Path, sent, attached: dict, namespace: str = "/") -> Path:
    """Write messages as the recorder does."""
    bag = BagWriter(folder, attached)
    channels: dict[str, int] = {}
    for k, (name, _, data) in enumerate(sent):
        if name not in channels:
            channels[name] = bag.add_topic(read_topics()[name.rpartition("/")[2]], namespace + name)
        bag.write(channels[name], 10**18 + k, 10**18 + k, data)
        if k % 200 == 199:
            bag.flush()
    bag.close()
    return folder


def record(folder: Path, scene: str | Scene, periods: float, wait: float = 0.3, rate: float = 100.0) -> Path:
    """Record a scene that waits and then plays its drive."""
    loaded = load_scene(scene) if isinstance(scene, str) else scene
    first = round(wait * NS)
    last = first + round(periods * (loaded.drive.period or 0.0) * NS)
    return write(folder, messages(loaded, play(loaded, first, last, rate), rate), attachments(loaded, rate))


def rewrite(
    source: Path, folder: Path, change: Callable[[str, int, bytes], list[Message]], attached: dict | None
) -> Path:
    """Write a recording again with each message changed; `attached` None leaves attachments out."""
    from crawler_ros.wire.messages import read_stamp

    def all_messages() -> Iterator[Message]:
        for r in read(source):
            name = r.topic.removeprefix("/")
            if name in ("applied_commands", *STATES):
                yield from change(name, read_stamp(r.data), r.data)

    return write(folder, all_messages(), attached or {})
