"""Measured positions and commands in recordings, of the simulator or of a robot with other topics."""

from __future__ import annotations

import itertools
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_ros.recording import bag
from crawler_ros.recording.decode import JOINT_STATE, TRAJECTORY, Decoder
from crawler_ros.recording.recorded_robot import noted_robot, robot_in
from crawler_ros.wire.states import contact_names

from .measurements import MeasurementError, Measurements, channel_names

_FEWEST = 8
_MOST_NAMED = 10
_KINDS = {"contact_states": JOINT_STATE, "joint_states": JOINT_STATE, "applied_commands": TRAJECTORY}


def read_bag(path: Path, scene: Scene, topics: Mapping[str, str]) -> list[Measurements]:
    """Read the runs of a recording: positions from `contact_states`, else `joint_states`, and commands.

    A run begins at the start of the recording and wherever the simulator was reset. Columns of friction and loads that
    never change in a run are values of the scene, not commands, unless the drive of the scene commands them.

    Args:
        path: a bag folder or an .mcap file; of a folder of bags, the newest is read.
        scene: the scene that was measured.
        topics: recorded names by names in the table of topics; others are as the recording lists them.

    Returns:
        One for each run, in order; a run of a few ticks is left out if there are longer ones.

    Raises:
        BagError: when the file is not a recording.
        MeasurementError: when it contains no positions or no commands.
    """
    path = bag.newest(path)
    head = bag.Bag({})
    blocks = list(bag.read_blocks(path, head))
    robot = noted_robot(head.attachments) or robot_in("/")
    recorded = {channel.topic for channel, _ in head.channels.values()}
    wanted = {name: topics.get(name, robot.recorded(name)) for name in _KINDS}
    for name, given in topics.items():
        if given not in recorded:
            raise MeasurementError(f"{path}: no topic {given} for {name}; recorded are {', '.join(sorted(recorded))}")
    kind = next((name for name in ("contact_states", "joint_states") if wanted[name] in recorded), None)
    if "joint_states" in topics and "contact_states" not in topics:
        kind = "joint_states"
    if kind is None:
        raise MeasurementError(
            f"{path}: neither contact_states nor joint_states was recorded; name one with --topic joint_states=..., "
            f"recorded are {', '.join(sorted(recorded))}"
        )
    if wanted["applied_commands"] not in recorded:
        raise MeasurementError(
            f"{path}: no commands were recorded; name their topic with --topic applied_commands=..., "
            f"recorded are {', '.join(sorted(recorded))}"
        )
    names, stamps, values, _ = _read(blocks, head, wanted[kind], JOINT_STATE)
    columns, begin, points, after = _read(blocks, head, wanted["applied_commands"], TRAJECTORY)
    known = channel_names(scene)
    used = [i for i, name in enumerate(names) if name in known]
    _list_unused(path, scene, [name for name in names if name not in known])
    position = _in_columns([row[0] for row in values], len(names))[:, used]
    channels = tuple(names[i] for i in used)
    if kind == "joint_states" and "contact_0" in channels:  # along the ground: x_0, without the reference position
        position[:, channels.index("contact_0")] += float(scene.body.position[scene.body.isolated[0]])
    if not any(points):
        raise MeasurementError(f"{path}: {wanted['applied_commands']} contains no command")
    states, commands = _runs(stamps), _runs(begin)
    if len(states) != len(commands):
        raise MeasurementError(
            f"{path}: {len(states)} run(s) of {wanted[kind]}, but {len(commands)} of {wanted['applied_commands']}; "
            "each run needs its commands"
        )
    longest = max(rows.stop - rows.start for rows in states)
    found = []
    for number, (rows, sent) in enumerate(zip(states, commands, strict=True)):
        if rows.stop - rows.start < min(_FEWEST, longest) or not any(points[sent]):
            continue
        name = path.name if len(states) == 1 else f"{path.name} run {number}"
        time, measured = _join(stamps[rows], position[rows])
        named, used_commands, instants = _commands(
            scene, columns, begin[sent], points[sent], after[sent], int(time[-1])
        )
        found.append(Measurements(name, time / NS, channels, measured, named, used_commands, instants))
    return found


def _list_unused(path: Path, scene: Scene, names: Sequence[str]) -> None:
    """Print which joints the scene lacks; the ends of segments are among its contacts."""
    lacking = [name for name in names if name not in contact_names(scene.body)]
    if lacking:
        more = f" and {len(lacking) - _MOST_NAMED} more" if len(lacking) > _MOST_NAMED else ""
        text = f"joints not used, which {scene.name} does not have: {', '.join(lacking[:_MOST_NAMED])}{more}"
        print(f"crawler: {path.name}: {text}", file=sys.stderr)


def _in_columns(rows: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Stack rows; what the first ones lack of joints that appeared later is NaN."""
    table = np.full((len(rows), width), np.nan)
    for k, row in enumerate(rows):
        table[k, : row.size] = row
    return table


def _join(stamps: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Join rows of one stamp, each of which may hold other joints; the first number of a joint counts."""
    time, place = np.unique(stamps, return_inverse=True)
    joined = np.full((time.size, rows.shape[1]), np.nan)
    for k, row in zip(place.tolist(), rows, strict=True):
        np.copyto(joined[k], row, where=np.isnan(joined[k]))
    return time, joined


def _commands(
    scene: Scene,
    columns: Sequence[str],
    begin: np.ndarray,
    points: list[list[np.ndarray]],
    after: list[np.ndarray],
    until: int,
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray]:
    """List the names of the commanded columns of a run, their values, and the times of these [s]."""
    known = scene.columns.names
    actuators = known[: scene.columns.lengths]
    commands = {name for name, commanded in zip(known, scene.commanded, strict=True) if commanded}
    points = _fill(points, len(columns))
    in_force = next(rows[0] for rows in points if rows).copy()
    for c, name in enumerate(columns):
        if name in actuators:
            in_force[c] = scene.drive.rows[0, known.index(name)]
    time, rows = _vertices(begin, points, after, until, in_force)
    moving = [c for c, name in enumerate(columns) if name in commands or float(np.ptp(rows[:, c])) > 0.0]
    return tuple(columns[c] for c in moving), rows[:, moving], time / NS


def _fill(points: list[list[np.ndarray]], width: int) -> list[list[np.ndarray]]:
    """Fill in what messages leave out: a name holds its last number, and before the first one this."""
    sizes = [len(rows) for rows in points]
    table = _in_columns([row for rows in points for row in rows], width)
    given = ~np.isnan(table)
    last = np.maximum.accumulate(np.where(given, np.arange(len(table))[:, None], -1), axis=0)
    last = np.where(last < 0, given.argmax(axis=0), last)
    filled = iter(np.take_along_axis(table, last, axis=0))
    return [list(itertools.islice(filled, size)) for size in sizes]


def _read(
    blocks: list[bag.Block], head: bag.Bag, topic: str, kind: str
) -> tuple[tuple[str, ...], np.ndarray, list[list[np.ndarray]], list[np.ndarray]]:
    """Read all messages of a topic in order: names, stamps [ns], sequences of numbers, times of points [ns]."""
    decoder = Decoder(topic, kind, parts=True)
    stamps: list[int] = []
    values: list[list[np.ndarray]] = []
    after: list[np.ndarray] = []
    for block in blocks:
        found = [
            (int(at[k]), times[k], [n[k] for n in numbers])
            for at, times, numbers in decoder.read(block, head.find(block, topic))
            for k in range(at.size)
        ]
        for _, times, numbers in sorted(found, key=lambda one: one[0]):
            stamps.append(int(times[0]))
            values.append(numbers)
            after.append(times[1:])
    return decoder.names or (), np.array(stamps, np.int64), values, after


def _runs(stamps: np.ndarray) -> list[slice]:
    """Split stamps where they go back, because the simulator was reset."""
    ends = [0, *(1 + np.flatnonzero(np.diff(stamps) < 0)).tolist(), stamps.size]
    return [slice(first, last) for first, last in itertools.pairwise(ends)]


def _vertices(
    begin: np.ndarray, points: list[list[np.ndarray]], after: list[np.ndarray], until: int, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """List times [ns], increasing, and rows of the commands of a run; a command is held until the next message.

    Rows follow the stamps `begin` by the times `after`, and `until` is the end [ns]; `first` is in force at the start.
    Commands that a tick followed at once, as they had arrived late, are a nanosecond apart: the motion depends on all.
    """
    times, rows = [int(begin[0])], [first]
    for stamp, row, offsets in zip(begin.tolist(), points, after, strict=True):
        if times[-1] >= until:
            break
        if row and stamp > times[-1]:
            times.append(stamp)
            rows.append(rows[-1])
        for point, offset in zip(row, offsets.tolist(), strict=True):
            times.append(max(stamp + int(offset), times[-1] + 1))
            rows.append(point)
    return np.array(times, np.int64), np.array(rows)
