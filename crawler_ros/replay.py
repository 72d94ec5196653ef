"""From a recording back to the model: what was commanded, simulated again, against what was recorded."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.drive import NS
from crawler_model.readout import Readout

from . import bag
from .states import joint_state_names


@dataclass(frozen=True)
class Resimulation:
    """How a recording compares with the same commands simulated again.

    Attributes:
        ticks: states compared.
        resets: how often simulated time went back to 0.
        identical: whether every number has the same bits.
        max_difference: largest difference of a displacement or elongation [m].
        first_difference: simulated time of the first difference [s]; None when there is none.
    """

    ticks: int
    resets: int
    identical: bool
    max_difference: float
    first_difference: float | None


def simulate_again(path: Path) -> Resimulation:
    """Follow a recording's ledger from its start and compare every recorded state.

    Args:
        path: a bag folder or an .mcap file that holds its scene and `applied_commands`.

    Returns:
        The comparison.

    Raises:
        BagError: when it cannot be read, or holds no scene.
    """
    from rosbags.typesys import Stores, get_typestore

    decode = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr
    head = bag.Bag({})
    crawler: Crawler | None = None
    ticks = resets = 0
    worst, first = 0.0, None
    for record in bag.read(path, head):
        if crawler is None:  # attachments stand before the first message
            if "scene" not in head.attachments:
                raise bag.BagError(f"{path}: it does not hold its scene, so it cannot be simulated again")
            scene = Scene.model_validate(head.attachments["scene"])
            start = Crawler(scene, head.attachments.get("parameters", {}).get("method"))
            crawler, readout = start.copy(), Readout(scene.mesh, np.zeros(0, np.int64))
            ours, none = np.zeros((3, len(joint_state_names(scene.mesh)))), np.zeros((3, 0))
        name = record.topic.rsplit("/", 1)[-1]
        if name == "applied_commands":
            points = decode(record.data, record.type).points
            if points:
                crawler.follow(scene.columns.target(np.array([p.positions for p in points])))
        elif name == "joint_states":
            message = decode(record.data, record.type)
            stamp = message.header.stamp.sec * NS + message.header.stamp.nanosec
            if stamp == 0 and ticks > 0:
                crawler, resets = start.copy(), resets + 1
            readout.read(crawler, np.inf, ours, none)
            if not (np.array_equal(ours[0], message.position) and np.array_equal(ours[2], message.effort)):
                worst = max(worst, float(np.abs(ours[0] - message.position).max()))
                first = stamp / NS if first is None else first
            ticks += 1
    return Resimulation(ticks, resets, ticks > 0 and first is None, worst, first)
