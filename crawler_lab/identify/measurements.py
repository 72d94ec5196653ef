"""Measured motion: positions or elongations over time, and the commands that caused them."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crawler_model.arrays import frozen
from crawler_model.body.body import Body
from crawler_model.body.names import name_each, name_joints
from crawler_model.errors import CrawlerError
from crawler_model.scene.scene import Scene

_FEWEST = 8
_THOUSAND = (300.0, 3000.0)
"""Ratios of lengths that look like a mistake by a factor of a thousand."""
_IMPOSSIBLE, _MOST_IMPOSSIBLE = 10.0, 0.1
"""A value farther from the median than this many times the motion or the body is none, unless there are many."""
_YEAR = 3.15e7
_UNIX = (1e8, 1e10)
"""Unix time of today is between these [s]."""
_CLOCKS = {"ms": 1e3, "us": 1e6, "ns": 1e9}
_MOST_NAMED = 3
_ALIKE = 1e-5
"""Part of a motion below which differences are the rounding of a table of seven digits."""
_MILLIMETRES = (
    "look like millimetres or pixels: divide millimetres by 1000, or use --units mm if all lengths of a table are "
    "millimetres; multiply pixels by the length of one in metres"
)
_SCENE_IN_MILLIMETRES = "look like millimetres: divide them by 1000, or leave out --units mm if the table is in metres"


class MeasurementError(CrawlerError):
    """Measurements that cannot be used: infinite numbers, wrong units, columns of another body, too few rows."""


@dataclass(frozen=True, eq=False)
class Measurements:
    """One recording.

    Attributes:
        name: name of the recording, for messages.
        time: increasing, shape (T,) [s]; the scene starts at the first command, or without commands at the first time.
        channels: names of the measured quantities, shape (M,): `contact_i` (position along the ground), `link_j` or
            the name of a segment (elongation relative to the reference shape); in the plane `contact_i/x` and
            `contact_i/y` (position of a contact, or point of a body that turns).
        values: shape (T, M) [m]; NaN where a value is missing.
        command_names: names of the commanded columns, shape (C,), for example `link_0`; () if the scene's own drive
            was played.
        commands: shape (K, C), straight between rows [m, N].
        command_time: increasing, shape (K,) [s].
    """

    name: str
    time: np.ndarray
    channels: tuple[str, ...]
    values: np.ndarray
    command_names: tuple[str, ...] = ()
    commands: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    command_time: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0))

    @property
    def on_ground(self) -> np.ndarray:
        """Which channels are positions along the ground, not elongations, bool, shape (M,)."""
        return np.array([channel.startswith("contact_") for channel in self.channels], np.bool_)

    @property
    def axes(self) -> np.ndarray:
        """Which channels are positions along each measured axis, on a line the only one, shape (M, axes) [1]."""
        ends = np.array([channel.partition("/")[2] for channel in self.channels])
        return (
            np.array([self.on_ground & (ends == axis) for axis in np.unique(ends[self.on_ground])], float)
            .reshape(-1, len(self.channels))
            .T
        )

    def head(self, rows: int) -> Measurements:
        """Select the first rows.

        Args:
            rows: their number.

        Returns:
            The measurements up to then, with all commands that matter for them.
        """
        if rows >= self.time.size:
            return self
        keep = int(np.searchsorted(self.command_time, self.time[rows - 1])) + 1
        return dataclasses.replace(
            self,
            time=self.time[:rows],
            values=self.values[:rows],
            commands=self.commands[:keep],
            command_time=self.command_time[:keep],
        )


def channel_names(scene: Scene) -> tuple[str, ...]:
    """Name everything that can be measured on a scene.

    Args:
        scene: the scene.

    Returns:
        The isolated contacts, the links, then the segments; in the plane both coordinates of the contacts.
    """
    if scene.dimension == 2:
        return tuple(f"{name}/{axis}" for name in name_each("contact", scene.body.contacts) for axis in "xy")
    return (*name_each("contact", scene.body.isolated.size), *name_joints(scene.body))


def observation(body: Body, channels: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    """Build the linear map from displacements to measured values.

    Args:
        body: the body.
        channels: from `channel_names`.

    Returns:
        The map, shape (M, N), in the plane (M, 2 N), and what is added, shape (M,) [m].
    """
    if body.dimension == 2:
        names = [f"{name}/{axis}" for name in name_each("contact", body.contacts) for axis in "xy"]
        at = [names.index(channel) for channel in channels]
        return np.eye(len(names))[at], body.position.ravel()[at]
    matrix, added = np.zeros((len(channels), body.contacts)), np.zeros(len(channels))
    contacts = {name: int(i) for name, i in zip(name_each("contact", body.isolated.size), body.isolated, strict=True)}
    joints = {name: body.stations[ends] for name, ends in zip(name_joints(body), body.joints, strict=True)}
    for m, channel in enumerate(channels):
        if channel in contacts:
            matrix[m, contacts[channel]] = 1.0
            added[m] = body.position[contacts[channel]]
        else:
            matrix[m, joints[channel][1]] += 1.0
            matrix[m, joints[channel][0]] -= 1.0
    return matrix, added


def interpolate_rows(at: np.ndarray, time: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Interpolate each column of rows.

    Args:
        at: where to, shape (L,).
        time: of the rows, increasing, shape (K,).
        rows: shape (K, C).

    Returns:
        Shape (L, C).
    """
    return np.stack([np.interp(at, time, column) for column in rows.T], axis=1)


def are_reversed(body: Body, measured: Measurements) -> bool:
    """Determine whether the contacts of a body on a line are measured in the reverse order of its reference shape.

    Args:
        body: the body.
        measured: a recording.

    Returns:
        Whether they are, on average over time.
    """
    if body.dimension == 2:
        return False
    seen = measured.on_ground
    place, home = np.nanmean(measured.values[:, seen], axis=0), observation(body, measured.channels)[1][seen]
    return bool(((place - place.mean()) * (home - home.mean())).sum() < 0.0) if seen.sum() > 1 else False


def find_copies(body: Body, measured: Measurements) -> list[tuple[str, str]]:
    """Find contacts of a body on a line whose positions differ by a constant alone, as of one marker.

    Args:
        body: the body.
        measured: a recording.

    Returns:
        The names of each two of them; none that rest, or that noise tells apart.
    """
    if body.dimension == 2:
        return []
    found = []
    for one, other in itertools.combinations(np.flatnonzero(measured.on_ground), 2):
        values = measured.values[:, [one, other]]
        values = values[np.isfinite(values).all(axis=1)]
        if values.shape[0] >= _FEWEST and np.ptp(values @ [1.0, -1.0]) <= _ALIKE * np.ptp(values[:, 0]) > 0.0:
            found.append((measured.channels[one], measured.channels[other]))
    return found


def check_measurements(scene: Scene, measured: Measurements) -> Measurements:
    """Check a recording against a scene.

    Args:
        scene: the scene.
        measured: the recording.

    Returns:
        The recording with read-only float64 arrays, without the rows in which all channels are missing; its time begins
        at the first command, or without commands at the first row that was given, even if all is missing there.

    Raises:
        MeasurementError: with one line about the first problem.
    """
    name = measured.name
    arrays = {k: np.array(getattr(measured, k), dtype=np.float64) for k in ("time", "values", "commands")}
    command_time = np.array(measured.command_time, dtype=np.float64)
    if measured.command_names and command_time.size == 0:
        command_time = arrays["time"]
    _check_names(scene, measured)
    shape = (arrays["time"].size, len(measured.channels))
    if arrays["values"].shape != shape:
        raise MeasurementError(f"{name}: values of shape {arrays['values'].shape}; it must be {shape}")
    if measured.command_names and arrays["commands"].shape != (command_time.size, len(measured.command_names)):
        raise MeasurementError(
            f"{name}: commands of shape {arrays['commands'].shape}; "
            f"it must be {(command_time.size, len(measured.command_names))}"
        )
    if shape[0] < _FEWEST:
        raise MeasurementError(f"{name}: {shape[0]} rows are too few; at least {_FEWEST} are needed")
    check_times(name, "time", arrays["time"])
    _check_values(name, measured.channels, arrays["time"], arrays["values"])
    start = float(arrays["time"][0])
    _check_clock(name, "time", arrays["time"])
    if measured.command_names:
        check_times(name, "time of the commands", command_time)
        _check_clock(name, "time of the commands", command_time)
        commands = tuple(f"command/{column}" for column in measured.command_names)
        _check_commands(name, commands, command_time, arrays["commands"])
        start = float(command_time[0])
        for first, earlier, second, later in (
            ("commands", command_time, "measurements", arrays["time"]),
            ("measurements", arrays["time"], "commands", command_time),
        ):
            if earlier[-1] <= later[0]:
                raise MeasurementError(
                    f"{name}: the {first} end at {earlier[-1]:.12g} s, before the {second} begin at {later[0]:.12g} s; "
                    "both must have the same clock"
                )
    _check_units(scene, measured, arrays)
    seen = np.isfinite(arrays["values"]).any(axis=1)
    return Measurements(
        name,
        frozen(arrays["time"][seen] - start),
        tuple(measured.channels),
        frozen(arrays["values"][seen]),
        tuple(measured.command_names),
        frozen(arrays["commands"]),
        frozen(command_time - start),
    )


def _check_names(scene: Scene, measured: Measurements) -> None:
    """Check that all columns belong to the scene, and that all its actuators are commanded if any is."""
    known = channel_names(scene)
    if not measured.channels:
        raise MeasurementError(f"{measured.name}: nothing is measured; it must have at least one of {', '.join(known)}")
    for channel in measured.channels:
        if channel not in known:
            raise MeasurementError(
                f"{measured.name}: column {channel} does not belong to {scene.name}, which has {', '.join(known)}; "
                "is it a recording of another body?"
            )
    for names in (measured.channels, measured.command_names):
        twice = next((n for n in names if names.count(n) > 1), None)
        if twice is not None:
            raise MeasurementError(f"{measured.name}: column {twice} is given twice")
    columns = scene.columns.names
    for column in measured.command_names:
        if column not in columns:
            raise MeasurementError(
                f"{measured.name}: command/{column} does not belong to {scene.name}, whose commands are "
                f"{', '.join(columns)}; is it a recording of another body?"
            )
    actuators = columns[: scene.columns.lengths]
    missing = [column for column in actuators if column not in measured.command_names]
    if measured.command_names and missing:
        raise MeasurementError(
            f"{measured.name}: no column command/{missing[0]}; the commands of all of {', '.join(actuators)} are needed"
        )
    if not measured.command_names and scene.parts.drive is None:
        raise MeasurementError(
            f"{measured.name}: no commands, and {scene.name} has no drive; add the columns "
            f"{', '.join(f'command/{column}' for column in actuators)}"
        )


def check_times(name: str, what: str, time: np.ndarray, rows: np.ndarray | None = None) -> None:
    """Check that times are given and increase.

    Args:
        name: name of the recording, for messages.
        what: what is timed.
        time: the times, shape (T,) [s].
        rows: numbers of the rows in messages, shape (T,); by default they count from 0.

    Raises:
        MeasurementError: naming the first row that is wrong.
    """
    numbers = np.arange(time.size) if rows is None else rows
    if not np.isfinite(time).all():
        row = int(np.flatnonzero(~np.isfinite(time))[0])
        raise MeasurementError(f"{name}: {what} is missing in row {numbers[row]}; every row needs it, in seconds")
    back = np.flatnonzero(np.diff(time) <= 0.0)
    if back.size:
        row = int(back[0])
        raise MeasurementError(
            f"{name}: {what} {time[row + 1]:g} s in row {numbers[row + 1]} does not come after {time[row]:g} s; it "
            "must increase"
        )


def _check_clock(name: str, what: str, time: np.ndarray) -> None:
    """Check that times are of a clock in seconds, and of a record that a person made."""
    for unit, per_second in _CLOCKS.items():
        if _UNIX[0] < time[0] / per_second < _UNIX[1] and time[0] > _UNIX[1]:
            raise MeasurementError(
                f"{name}: {what} begins at {time[0]:.12g} s, which looks like Unix time in {unit}: use --units {unit}"
            )
    if time[-1] - time[0] > _YEAR:
        raise MeasurementError(
            f"{name}: {what} lasts {(time[-1] - time[0]) / _YEAR:.3g} years; it must be in seconds, or name its unit "
            f"with --units {', '.join(_CLOCKS)}"
        )


def leave_out_impossible(scene: Scene, measured: Measurements) -> tuple[Measurements, list[str]]:
    """Leave out values that stand for no measurement, such as -9999.

    Args:
        scene: the scene.
        measured: a recording of it, checked.

    Returns:
        The recording, with NaN instead of them; and one line for each channel that has any.
    """
    length, values, lines = float(np.ptp(scene.body.position)), measured.values.copy(), []
    for m, channel in enumerate(measured.channels):
        seen = values[:, m][np.isfinite(values[:, m])]
        low, middle, high = np.quantile(seen, (0.05, 0.5, 0.95))
        far = np.abs(values[:, m] - middle) > _IMPOSSIBLE * max(length, high - low)
        if not 0 < far.sum() <= min(_MOST_IMPOSSIBLE * seen.size, seen.size - _FEWEST):
            continue
        at = ", ".join(f"{values[k, m]:.6g} at {measured.time[k]:.6g} s" for k in np.flatnonzero(far)[:_MOST_NAMED])
        more = ", ..." if far.sum() > _MOST_NAMED else ""
        lines.append(
            f"{measured.name}: {channel}: {int(far.sum())} of {seen.size} values are left out, as they are far from "
            f"all others: {at}{more}"
        )
        values[far, m] = np.nan
    return (dataclasses.replace(measured, values=frozen(values)) if lines else measured), lines


def _check_values(name: str, channels: Sequence[str], time: np.ndarray, values: np.ndarray) -> None:
    """Check that no value is infinite, and that no channel is missing nearly everywhere."""
    infinite = np.argwhere(np.isinf(values))
    if infinite.size:
        row, column = (int(i) for i in infinite[0])
        raise MeasurementError(
            f"{name}: {channels[column]} is {values[row, column]:g} in row {row} (time {time[row]:g} s); it must be "
            "finite, or NaN where it is missing"
        )
    for channel, count in zip(channels, np.isfinite(values).sum(axis=0).tolist(), strict=True):
        if count < _FEWEST:
            raise MeasurementError(
                f"{name}: {channel} has {count} value(s) and is missing in all other rows; at least {_FEWEST} are "
                "needed, or leave out the column"
            )


def _check_commands(name: str, columns: Sequence[str], time: np.ndarray, commands: np.ndarray) -> None:
    bad = ~np.isfinite(commands)
    if bad.any():
        row, column = (int(i) for i in np.argwhere(bad)[0])
        raise MeasurementError(
            f"{name}: a gap: {columns[column]} is {commands[row, column]:g} in row {row} (time {time[row]:g} s), and "
            f"{int(bad.sum())} command(s) in all are not finite; leave out these rows: commands are straight between "
            "rows"
        )


def _check_units(scene: Scene, measured: Measurements, arrays: dict[str, np.ndarray]) -> None:
    """Compare the lengths of measurements and commands with the body's, where both are known."""
    name, values, commands = measured.name, arrays["values"], arrays["commands"]
    own = observation(scene.body, measured.channels)[1]
    axes = [np.flatnonzero(axis) for axis in measured.axes.T.astype(bool)]
    contacts = max((axis.tolist() for axis in axes), key=lambda axis: float(np.ptp(own[axis])), default=[])
    if len(contacts) > 1:
        first, last = contacts[int(np.argmin(own[contacts]))], contacts[int(np.argmax(own[contacts]))]
        between = values[:, last] - values[:, first]
        seen = between[np.isfinite(between)]  # empty if they were never seen together, which tells nothing
        expected = float(own[last] - own[first])
        apart = float(np.median(seen)) if seen.size else expected
        words = (
            f"{name}: {measured.channels[first]} and {measured.channels[last]} are {apart:g} apart, in the scene "
            f"{expected:g} m"
        )
        if _THOUSAND[0] < abs(apart) / expected < _THOUSAND[1]:
            raise MeasurementError(f"{words}; the numbers {_MILLIMETRES}")
        if _THOUSAND[0] < expected / max(abs(apart), 1e-300) < _THOUSAND[1]:
            raise MeasurementError(f"{words}; the lengths of the scene {_SCENE_IN_MILLIMETRES}")
    length = float(np.ptp(scene.body.position)) or 1.0
    lengths = [c for c, column in enumerate(measured.command_names) if column.startswith("link_")]
    elongations = [m for m, channel in enumerate(measured.channels) if channel.startswith("link_")]
    for what, found in (("command/", commands[:, lengths]), ("", values[:, elongations])):
        most = float(np.nanmax(np.abs(found), initial=0.0))
        if most > _THOUSAND[0] * 0.1 * length:
            raise MeasurementError(
                f"{name}: {what}link columns reach {most:g}, but the body is {length:g} m long; the numbers "
                f"{_MILLIMETRES}"
            )
