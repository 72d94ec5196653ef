"""A run without a simulator as the recording that the simulator would have made of it."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.run.ticks import tick_end_ns

from ..wire.messages import TrajectoryMessage, lay_out_joint_state, lay_out_pose, list_pose
from ..wire.states import contact_names, joint_state_names
from ..wire.topics import read_topics
from .attachments import describe_run
from .bag_writer import BagWriter

_FRAME = "world"
_FLUSHED = 1000
"""Number of ticks after which the file is written to disk."""


@dataclass(frozen=True, eq=False)
class RecordedTick:
    """The end of a tick.

    Attributes:
        ends_ns: times of the ends of its ramps after its start, shape (V,) [ns].
        rows: command rows there, shape (V, C); V = 0 for the start, and for a tick that held the command in force.
        joints: readings, as `Readout.read` writes them, shape (3, J).
        contacts: readings of the contacts, shape (3, M).
        pose: net translation x, in the plane also y [m] and yaw [rad].
    """

    ends_ns: list[int]
    rows: list[np.ndarray]
    joints: np.ndarray
    contacts: np.ndarray
    pose: tuple[float, ...]


def write_run(
    folder: Path, scene: Scene, rate: Fraction, ticks: Iterable[RecordedTick], more: dict[str, Any] | None = None
) -> Path:
    """Record a run.

    Args:
        folder: a folder that does not exist yet, or an empty one.
        scene: the scene.
        rate: ticks per second [Hz].
        ticks: the start, then the end of each tick.
        more: further attachments by name, plain data.

    Returns:
        The folder.

    Raises:
        FileExistsError: if the folder is not empty.
    """
    names = ("joint_states", "contact_states", "pose", "applied_commands")
    attachments = describe_run(scene, Crawler(scene), {"rate": float(rate)}, "/crawler")
    bag = BagWriter(folder, {**attachments, "topics": {name: f"/{name}" for name in names}, **(more or {})})
    try:
        channels = {name: bag.add_topic(read_topics()[name], f"/{name}") for name in names}
        _write_ticks(bag, scene, rate, ticks, channels)
    finally:
        bag.close()
    return folder


def _write_ticks(
    bag: BagWriter, scene: Scene, rate: Fraction, ticks: Iterable[RecordedTick], channels: dict[str, int]
) -> None:
    body, now = scene.body, time.time_ns()
    ledger = TrajectoryMessage(scene.columns.names)
    joints, contacts = lay_out_joint_state(joint_state_names(body)), lay_out_joint_state(contact_names(body), _FRAME)
    pose = lay_out_pose(_FRAME)
    for k, tick in enumerate(ticks):
        ns = tick_end_ns(k, rate)
        found = [
            ("joint_states", joints.encode(ns, tick.joints.ravel())),
            ("contact_states", contacts.encode(ns, tick.contacts.ravel())),
            ("pose", pose.encode(ns, list_pose(*tick.pose))),
        ]
        if k:
            start = tick_end_ns(k - 1, rate)
            found.insert(0, ("applied_commands", ledger.encode(start, tick.ends_ns, tick.rows)))
        for name, data in found:
            now += 1
            bag.write(channels[name], now, now, data)
        if k % _FLUSHED == 0:
            bag.flush()
