"""Episodes as recordings: the bytes that the simulator would have recorded, had a controller sent the same commands."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_model.run.ticks import tick_end_ns
from crawler_ros.wire.states import contact_names, joint_state_names

from .lanes import Lanes

if TYPE_CHECKING:
    from crawler_ros.recording.run_writer import RecordedTick


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
        from crawler_ros.recording.run_writer import write_run
    except ModuleNotFoundError as error:
        raise CrawlerError(f"save: {error.name} is not installed; pip install 'crawler-ros[ros]'") from None

    steps = lanes.steps_done(0)
    log = lanes.log[0]
    if steps >= log.shape[0]:
        raise CrawlerError(f"save: {steps} steps are more than are remembered, {log.shape[0] - 1}; set `steps`")
    about = {"episode": {"task": lanes.spec.task.name, "drawn": drawn}}
    scene = lanes.scene(drawn)
    return write_run(folder, scene, lanes.spec.rate, _list_ticks(scene, lanes.spec.rate, log[: steps + 1]), about)


def _list_ticks(scene: Scene, rate: Fraction, log: np.ndarray) -> Iterator[RecordedTick]:
    """Split the lines of the log; the first one is the start. A command takes its whole tick, as in the simulator."""
    from crawler_ros.recording.run_writer import RecordedTick

    body, count = scene.body, scene.columns.count
    widths = np.cumsum([count, 3 * len(joint_state_names(body)), 3 * len(contact_names(body))])
    before = log[0, :count]
    for k, line in enumerate(log):
        row, joints, contacts, x = np.split(line, widths)
        changed = row.tobytes() != before.tobytes()
        place = np.atleast_1d(body.share @ x.reshape(body.position.shape))
        ends = [tick_end_ns(k, rate) - tick_end_ns(k - 1, rate)] if changed else []
        yield RecordedTick(ends, [row] if changed else [], joints, contacts, tuple(place.tolist()))
        before = row
