"""Episodes as recordings: the bytes that the simulator would have recorded, had a controller sent the same commands."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import Crawler, CrawlerError, Scene
from crawler_model.run.ticks import tick_end_ns
from crawler_ros.recording.attachments import describe_run
from crawler_ros.wire.messages import JointStateMessage, PoseMessage, TrajectoryMessage
from crawler_ros.wire.states import contact_names, joint_state_names
from crawler_ros.wire.topics import read_topics

from .lanes import Lanes

_FRAME = "world"
_FLUSHED = 1000
"""Number of steps after which the file is written to disk."""


def write_episode(folder: Path, lanes: Lanes, drawn: dict[str, Any]) -> Path:
    """Record the present episode of a single environment.

    Args:
        folder: a folder that does not exist yet, or an empty one.
        lanes: the state and the log of the environment.
        drawn: the values drawn for the episode.

    Returns:
        The folder.

    Raises:
        CrawlerError: if the episode is longer than its log, or mcap is not installed.
        FileExistsError: if the folder is not empty.
    """
    try:
        from crawler_ros.recording.bag_writer import BagWriter
    except ModuleNotFoundError as error:
        raise CrawlerError(f"save: {error.name} is not installed; pip install 'crawler-ros[ros]'") from None

    steps = lanes.steps_done(0)
    log = lanes.log[0]
    if steps >= log.shape[0]:
        raise CrawlerError(f"save: {steps} steps are more than are remembered, {log.shape[0] - 1}; set `steps`")
    scene = lanes.scene(drawn)
    attachments = describe_run(scene, Crawler(scene), {"rate": float(lanes.spec.rate)}, "/crawler")
    names = ("joint_states", "contact_states", "pose", "applied_commands")
    attachments |= {"topics": {name: f"/{name}" for name in names}}
    attachments |= {"episode": {"task": lanes.spec.task.name, "drawn": drawn}}
    bag = BagWriter(folder, attachments)
    try:
        _write_steps(bag, scene, lanes, log[: steps + 1], {n: bag.add_topic(read_topics()[n], f"/{n}") for n in names})
    finally:
        bag.close()
    return folder


def _write_steps(bag: Any, scene: Scene, lanes: Lanes, log: np.ndarray, channels: dict[str, int]) -> None:
    body, count = scene.body, scene.columns.count
    ledger = TrajectoryMessage(list(scene.columns.names))
    joints, contacts = JointStateMessage(joint_state_names(body)), JointStateMessage(contact_names(body), _FRAME)
    pose = PoseMessage(_FRAME)
    widths = np.cumsum([count, joints.numbers.size, contacts.numbers.size])
    now = time.time_ns()

    def write(name: str, data: bytes) -> None:
        nonlocal now
        now += 1
        bag.write(channels[name], now, now, data)

    for step, line in enumerate(log):
        row, joint, contact, x = np.split(line, widths)
        if step:
            changed = row.tobytes() != log[step - 1, :count].tobytes()
            start = tick_end_ns(step - 1, lanes.spec.rate)
            write("applied_commands", ledger.encode(start, [0] if changed else [], [row] if changed else []))
        ns = tick_end_ns(step, lanes.spec.rate)
        joints.numbers[:] = joint.reshape(joints.numbers.shape)
        contacts.numbers[:] = contact.reshape(contacts.numbers.shape)
        write("joint_states", joints.encode(ns))
        write("contact_states", contacts.encode(ns))
        place = body.share @ x.reshape(body.position.shape)
        write("pose", pose.encode(ns, *np.atleast_1d(place)))
        if step % _FLUSHED == 0:
            bag.flush()
