"""Ramps of a recording without a scene: recorded positions, ground forces and commands, but no tensions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..recording import bag
from ..recording.decode import JOINT_STATE, ODOMETRY, POSE, TRAJECTORY, Decoder
from ..recording.recorded_robot import Robot
from .health import Survey
from .parts import Parts, parts_by_name
from .ramps import Piece, RampTable, Sink

_NOISE = 1e-13


def observe(
    survey: Survey,
    robot: Robot,
    table: RampTable,
    sinks: Sequence[Sink],
    progress: Callable[[float], None] | None = None,
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Convert a recording to ramps, one per state.

    Args:
        survey: survey of the recording.
        robot: the crawler.
        table: table to fill; its net translation and yaw come from `pose` or `odom` if recorded, else its net
            translation is the mean of contacts and segments.
        sinks: callables that receive the pieces.
        progress: called with the fraction done, in [0, 1].

    Returns:
        The names of the contacts, and the names of the stations.

    Raises:
        BagError: when no state was recorded.
    """
    states = "contact_states" if robot.recorded("contact_states") in survey.topics else "joint_states"
    if robot.recorded(states) not in survey.topics:
        raise bag.BagError(
            f"{survey.path}: neither contact_states nor joint_states was recorded: the motion is not known"
        )
    kinds = {states: JOINT_STATE, "applied_commands": TRAJECTORY, "pose": POSE, "odom": ODOMETRY}
    decoders = {n: Decoder(robot.recorded(n), k) for n, k in kinds.items() if robot.recorded(n) in survey.topics}
    where = "pose" if "pose" in decoders else "odom"
    head = bag.Bag({})
    reader = _Reader(states)
    poses: list[np.ndarray] = []
    receivers: list[Sink] = [table, *sinks]
    for block in bag.read_blocks(survey.path, head, progress):
        read = {}
        for name, decoder in decoders.items():
            which = head.find(block, decoder.topic)
            if which.size:
                read[name] = _in_order(decoder.read(block, which), which.size)
        if where in read:
            poses.append(np.column_stack((read[where][0], read[where][1][:, 0])))
        reader.command(*read.get("applied_commands", (None, None)))
        if states in read:
            piece = reader.piece(*read[states], decoders[states].names or ())
            for sink in receivers:
                sink(piece)
    table.finish()
    if poses:
        _use_poses(table, np.concatenate(poses))
    stations = () if reader.parts is None else reader.parts.station_names
    names = _name_contacts(decoders[states].names or ())
    return names if states == "contact_states" else names[:1], stations


def _in_order(groups: list[Any], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Put groups of messages of one kind back in order: stamps (K,), the last three sequences or fewer (K, n, M)."""
    stamps = np.zeros(count, np.int64)
    width = max((n.shape[1] for _, _, numbers in groups for n in numbers), default=0)
    depth = max((min(len(numbers), 3) for _, _, numbers in groups), default=0)
    table = np.full((count, depth, width), np.nan)
    for at, times, numbers in groups:
        stamps[at] = times[:, 0]
        for k, values in enumerate(numbers[-3:]):
            table[at, depth - min(len(numbers), 3) + k, : values.shape[1]] = values
    return stamps, table


def _name_contacts(names: tuple[str, ...]) -> tuple[str, ...]:
    """Name the contacts of entries of a state; in the plane each contact has one entry per axis."""
    return tuple(name.removesuffix("/x") for name in names if not name.endswith("/y"))


class _Reader:
    """Converts states and commands block by block."""

    def __init__(self, states: str) -> None:
        self._whole = states == "contact_states"
        self._run, self._last_ns = 0, -1
        self._position: np.ndarray | None = None
        self._begin: np.ndarray | None = None
        self.parts: Parts | None = None
        self._stamps, self._rows = np.zeros(0, np.int64), np.zeros((0, 0))

    def command(self, stamps: np.ndarray | None, rows: np.ndarray | None) -> None:
        """Add the ledger of a block; ticks without a point hold."""
        if stamps is None or rows is None or rows.shape[1] == 0:
            return
        known = ~np.isnan(rows[:, -1]).any(axis=1)
        if self._rows.size:
            stamps = np.append(self._stamps[-1:], stamps[known])
            rows = np.vstack((self._rows[-1:], rows[known, -1]))
        else:
            stamps, rows = stamps[known], rows[known, -1]
        self._stamps, self._rows = stamps, rows

    def piece(self, stamps: np.ndarray, numbers: np.ndarray, names: tuple[str, ...]) -> Piece:
        """Build the piece of the states of a block."""
        planar = any(name.endswith("/x") for name in names)
        count = stamps.size
        before = np.append(self._last_ns, stamps[:-1])
        begins = (stamps == 0) & (before > 0)
        run = self._run + np.cumsum(begins)
        position = numbers[:, 0] if self._whole else numbers[:, 0, : 1 + planar]
        ground = numbers[:, 2] if self._whole else numbers[:, 2, : 1 + planar]
        earlier = np.vstack((position[:1] if self._position is None else self._position[None], position[:-1]))
        gained = np.where((begins | (before < 0))[:, None], 0.0, position - earlier)
        # differences of positions are subject to rounding
        moved = np.abs(gained) > _NOISE * np.abs(position).max(initial=0.0)
        gained = gained * moved
        shape = (count, -1, 2) if planar else (count, -1)
        place = position.reshape(shape)
        if self._begin is None:
            self._begin = position[0].copy()
        if self.parts is None:
            self.parts = parts_by_name(_name_contacts(names)[: place.shape[1]], place[0])
        moved_by = (position - self._begin).reshape(shape)
        y = moved_by.mean(axis=1) if planar else self.parts.average(moved_by).mean(axis=1)
        forward, backward = self.parts.slid(gained.reshape(shape))
        nothing, unknown = np.zeros((count, 0)), np.full(count, np.nan)
        elongation = np.diff(place, axis=1)
        if planar:  # distances to the next contacts, as a body may turn
            elongation = np.hstack([np.linalg.norm(place[:, k:] - place[:, :-k], axis=2) for k in (1, 2)])
        rows = self._rows.shape[1]
        command = np.zeros((count, rows))
        if rows:
            at = np.searchsorted(self._stamps, stamps, side="left") - 1
            command = self._rows[np.maximum(at, 0)]
        self._run, self._last_ns, self._position = int(run[-1]), int(stamps[-1]), position[-1].copy()
        return Piece(
            run=run,
            start_ns=np.where(begins | (before < 0), stamps, before),
            end_ns=stamps,
            ends_tick=np.ones(count, bool),
            command=command,
            position=place,
            gained=gained.reshape(shape),
            station_gained=gained.reshape(shape)[:, self.parts.stations],
            forward=forward,
            backward=backward,
            ground=ground.reshape(shape),
            elongation=elongation,
            tension=nothing.reshape(count, 0, 2) if planar else nothing,
            least=nothing,
            most=nothing,
            net_translation=y,
            work=unknown,
            loads_work=unknown,
            dissipation=unknown,
            jump_loss=unknown,
            internal_dissipation=unknown,
            stored=unknown,
            margin=unknown,
            nearest=np.full(count, -1),
            visited=unknown,
            unique=np.ones(count, bool),
        )


def _use_poses(table: RampTable, poses: np.ndarray) -> None:
    """Replace the net translations, and the yaw where it changes, by recorded poses if each state has one."""
    run = np.cumsum(np.append(False, (poses[1:, 0] == 0) & (poses[:-1, 0] > 0)))
    place = {key: i for i, key in enumerate(zip(run.tolist(), poses[:, 0].astype(np.int64).tolist(), strict=True))}
    at = np.array([place.get(key, -1) for key in zip(table.run.tolist(), table.end_ns.tolist(), strict=True)])
    if at.size and (at >= 0).all():
        table.net_translation = table.origin = poses[at, 1 : 1 + table.net_translation.shape[1]]
        yaw = 2.0 * np.arctan2(poses[at, 6], poses[at, 7])
        if yaw.any() and table.net_translation.shape[1] == 2:
            table.yaw = np.concatenate([np.unwrap(yaw[table.run == one]) for one in np.unique(table.run)])
