"""Assemble waypoints from the drive of a scene."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arrays import frozen, join, read_numbers, refuse, spread
from ..body.body import Body
from ..body.columns import Columns
from ..body.drive import NS, Drive, strategy_waypoints, wave
from ..body.turning import SIDES, check_sides
from ..errors import SceneError
from ..rounding import CRITICAL
from .assemble_friction import planar_loads
from .friction_parts import FrictionRowsPart
from .parts import DrivePart, SceneParts, WavePart

_SAME_TIME = 1e-9
"""Part of a period by which times differ by rounding."""


def assemble_drive(
    parts: SceneParts, body: Body, columns: Columns, friction: np.ndarray, doubts: np.ndarray | None = None
) -> Drive:
    """Build the waypoints of the drive of a scene.

    Args:
        parts: the parts of the scene.
        body: its body.
        columns: layout of its commands.
        friction: friction and loads of the scene, the last columns of a row, shape (C - lengths,), for variations
            (M, C - lengths) [N, N/m].
        doubts: of variations, as for `refuse`.

    Returns:
        The drive, with the friction of the scene unless it commands friction.

    Raises:
        SceneError: if a row or value is invalid; the message names it.
    """
    part = parts.drive
    if part is None:
        rows = join((np.zeros(columns.lengths), friction))[..., None, :]
        if doubts is not None:
            return _build_waypoints(np.zeros(1), None, rows, columns, doubts)
        drive = Drive(frozen([0.0]), None, frozen(rows), columns)
        columns.check_equilibrium(drive.targets[0], "scene", SceneError)
        return drive
    friction = friction[..., None, :]
    if part.strategy is not None:
        return _build_strategy(body, columns, part, friction, doubts)
    if part.times is None:
        return _build_waves(body, columns, part, friction, doubts)
    times = read_numbers(part.times)
    if times.size == 0:
        raise SceneError("drive.times: empty; give at least the time 0")
    count = times.shape[-1]
    if parts.dimension == 2 and body.turning is None:
        actuation = _planar_rows(part.actuation, count, body.springs)
    else:
        item = "link(s) and segment" if body.segments else "link" if body.turning is None else "link(s) and joint"
        given = _rows(part.actuation, count, columns.actuation_sizes.size, "drive.actuation", item)
        actuation = np.repeat(given, columns.actuation_sizes, axis=-1)
    sides, loads = friction[..., : columns.frictions], friction[..., columns.frictions :]
    if isinstance(part.friction, FrictionRowsPart):
        read = _friction_rows if body.turning is None else _turning_friction_rows
        sides = read(part.friction, count, body, columns)
    if part.loads is not None:
        loads = _load_rows(part.loads, count, body, columns)
    return _build_waypoints(times, part.period, join((actuation, sides, loads)), columns, doubts)


def _rows(table: Any, rows: int, columns: int, field: str, item: str) -> np.ndarray:
    if not isinstance(table, tuple):
        return np.repeat(spread(table, columns, field, item)[..., None, :], rows, axis=-2)
    if len(table) != rows:
        raise SceneError(f"{field}: {len(table)} row(s) for {rows} time(s); give one row per time")
    for i, row in enumerate(table):
        if isinstance(row, tuple) and any(isinstance(v, tuple) for v in row):
            raise SceneError(f"{field}: row {i} holds lists; on a line each entry is a number (or dimension: 2)")
    each = [spread(row, columns, f"{field}: row {i}", item) for i, row in enumerate(table)]
    return np.stack(np.broadcast_arrays(*each), axis=-2)


def _friction_rows(part: FrictionRowsPart, rows: int, body: Body, columns: Columns) -> np.ndarray:
    if columns.planar:
        raise SceneError("drive.friction: direction-dependent friction is constant; remove this key")
    item = "contact(s) and segment" if body.segments else "contact"
    names = ("isotropic", "isotropic") if part.isotropic is not None else ("forward", "backward")
    both = [
        np.repeat(
            _rows(table, rows, columns.friction_sizes.size, f"drive.friction.{name}", item),
            columns.friction_sizes,
            axis=-1,
        )
        for name, table in zip(names, part.sides, strict=True)
    ]
    return join(both[: columns.sides])


def _turning_friction_rows(part: FrictionRowsPart, rows: int, body: Body, columns: Columns) -> np.ndarray:
    names = SIDES if part.isotropic is None else ("isotropic",) * len(SIDES)
    each = [
        _rows(table, rows, body.contacts, f"drive.friction.{name}", "point")
        for name, table in zip(names, part.quarters, strict=True)
    ]
    friction = np.stack(each, axis=-1)
    for i, row in enumerate(friction):
        check_sides(row, f"drive.friction: row {i}", SceneError)
    return friction.reshape(rows, columns.frictions)


def _load_rows(table: Any, rows: int, body: Body, columns: Columns) -> np.ndarray:
    if columns.planar is None:
        item = "contact(s) and segment" if body.segments else "contact"
        return _rows(table, rows, columns.loads, "drive.loads", item)
    if not isinstance(table, tuple):
        return np.tile(planar_loads(table, body.contacts, "drive.loads"), (rows, 1))
    if len(table) != rows:
        raise SceneError(f"drive.loads: {len(table)} row(s) for {rows} time(s); give one row per time")
    return np.array([planar_loads(row, body.contacts, f"drive.loads: row {i}") for i, row in enumerate(table)])


def _planar_rows(table: Any, rows: int, links: int) -> np.ndarray:
    if not isinstance(table, tuple) or len(table) != rows:
        count = len(table) if isinstance(table, tuple) else 0
        raise SceneError(f"drive.actuation: {count} row(s) for {rows} time(s); give one row per time")
    for i, row in enumerate(table):
        entries = row if isinstance(row, tuple) else (row,)
        wrong = [k for k, e in enumerate(entries) if not isinstance(e, tuple) or len(e) != 2]
        if len(entries) != links or wrong:
            found = f"entry {wrong[0]} is {entries[wrong[0]]}" if wrong else f"{len(entries)} entries"
            raise SceneError(
                f"drive.actuation: row {i}: {found}; in a planar scene a row is [x, y] for each of {links} link(s)"
            )
    return np.array(table).reshape(rows, 2 * links)


def _build_strategy(body: Body, columns: Columns, part: Any, friction: np.ndarray, doubts: np.ndarray | None) -> Drive:
    if (body.isolated.size, body.springs, len(body.segments)) != (2, 1, 0):
        raise SceneError(f"drive.strategy: strategies need 2 contacts and 1 link; this body has {body.describe()}")
    period = 1.0 if part.period is None else part.period
    times, actuation, mu = strategy_waypoints(part.strategy, part.length, part.friction, period)
    return _build_waypoints(
        times, period, join((actuation, mu, mu, friction[..., columns.frictions :])), columns, doubts
    )


def _build_waves(
    body: Body, columns: Columns, part: DrivePart, friction: np.ndarray, doubts: np.ndarray | None
) -> Drive:
    waves = [w for w in (part.wave, part.friction_wave) if w is not None]
    period = waves[0].period
    if any(w.period != period for w in waves):
        raise SceneError("drive.friction_wave.period: it must equal drive.wave.period")
    times = _merge_times(*(np.arange(w.samples + 1) * (period / w.samples) for w in waves))
    times[-1] = period
    apart = float(np.diff(times).min()) * NS
    if apart < 1.0 - _SAME_TIME:
        name = "wave" if part.wave is not None else "friction_wave"
        raise SceneError(
            f"drive.{name}.period: {period:g} s, with samples {apart:g} ns apart; they must be at least 1 ns apart"
        )
    actuation = np.zeros((times.size, columns.lengths))
    sides, loads = friction[..., : columns.frictions], friction[..., columns.frictions :]
    if part.wave is not None:
        middle = 0.5 * (body.position[body.ends[:, 0]] + body.position[body.ends[:, 1]])
        places = np.concatenate([middle[body.link_springs], *(middle[s.springs] for s in body.segments)])
        actuation = _sampled(part.wave, times, places)
    if part.friction_wave is not None:
        w = part.friction_wave
        refuse(
            np.atleast_1d(w.mean < abs(w.amplitude)),
            1,
            lambda _: (
                f"drive.friction_wave: mean {w.mean:g} N is less than the amplitude {abs(w.amplitude):g} N; "
                "friction must be >= 0 at all times"
            ),
            doubts,
        )
        places = np.concatenate([body.position[body.isolated], *(body.position[s.contacts] for s in body.segments)])
        mu = np.maximum(_sampled(w, times, places), 0.0)
        sides = join((mu, mu))
    return _build_waypoints(times, period, join((actuation, sides, loads)), columns, doubts)


def _merge_times(*grids: np.ndarray) -> np.ndarray:
    """Merge the waypoint times of several waves [s]; times that differ by rounding are one."""
    times = np.unique(np.concatenate(grids))
    return times[np.concatenate(([True], np.diff(times) > _SAME_TIME * times[-1]))]


def _sampled(part: WavePart, times: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Interpolate a wave linearly between its own samples at the waypoints, shape (..., W, places)."""
    phase = np.arange(part.samples + 1) / part.samples
    values = wave(part.mean, part.amplitude, part.wavelength, phase, places)
    at = times / part.period * part.samples
    before = np.minimum(np.floor(at + 1e-9).astype(np.int64), part.samples)
    after = np.minimum(before + 1, part.samples)
    rest = np.clip(at - before, 0.0, 1.0)
    rest[rest < 1e-8] = 0.0  # exactly on a sample
    first, last = values[..., before, :], values[..., after, :]
    return np.asarray(first + rest[:, None] * (last - first))


def _build_waypoints(
    times: np.ndarray, period: Any, rows: np.ndarray, columns: Columns, doubts: np.ndarray | None
) -> Drive:
    """Build and check a drive: times (W,) or (M, W) [s], rows (W, C) or (M, W, C), a period () or (M, 1) [s].

    A period ends at the last waypoint, and with the first row, if it does so but for rounding: sin(2 pi) is not 0.
    """
    if period is not None:
        period, rows = _close(times, period, rows)
    _check_times(times, period, doubts)
    frictions = slice(columns.lengths, columns.lengths + columns.frictions)

    def negative(row: int, i: int) -> str:
        name, value = columns.names[columns.lengths + i], rows[row, columns.lengths + i]
        return f"drive.friction: row {row}, {name}: {value:g}; friction must be >= 0"

    def open_end(i: int) -> str:
        last, first = rows[-1, i], rows[0, i]
        digits = 6 if f"{last:g}" != f"{first:g}" else 17
        return (
            f"drive.{columns.kind(i)}: the last row, at the period's end, has {last:.{digits}g} for {columns.names[i]} "
            f"and the first {first:.{digits}g}; a drive with a period must end as it begins"
        )

    refuse(~(rows[..., frictions] >= 0.0), 2, negative, doubts)
    if period is not None:
        closes = np.atleast_1d(period) == times[..., -1:]
        refuse(closes & (rows[..., 0, :] != rows[..., -1, :]), 1, open_end, doubts)
    drive = Drive(frozen(times), period, frozen(rows), columns)
    if doubts is not None and columns.loads and not columns.patched:
        doubts |= columns.lacks_equilibrium(drive.targets).any(axis=(0, -1))
    for row, target in enumerate(drive.targets if columns.loads and doubts is None else ()):
        columns.check_equilibrium(target, f"drive: row {row}", SceneError)
    return drive


def _close(times: np.ndarray, period: Any, rows: np.ndarray) -> tuple[Any, np.ndarray]:
    """Let the period end at the last waypoint, and this be the first row, where only rounding makes them differ."""
    last, end = times[..., -1:], np.atleast_1d(period)
    end = np.where(np.abs(last - end) <= CRITICAL * last, last, end)
    first, final = rows[..., 0, :], rows[..., -1, :]
    if (first != final).any():
        near = np.abs(final - first) <= CRITICAL * np.abs(rows).max(axis=-2)
        rows = rows.copy()
        rows[..., -1, :] = np.where(near, first, final)
    return float(end[0]) if end.ndim == 1 else end, rows


def _check_times(times: np.ndarray, period: Any, doubts: np.ndarray | None) -> None:
    ns = np.rint(times * NS)
    refuse(times[..., :1] != 0.0, 1, lambda _: "drive.times: the first time must be 0", doubts)

    def out_of_order(i: int) -> str:
        return (
            f"drive.times: entry {i + 1} ({times[i + 1]:g} s) does not come after entry {i} ({times[i]:g} s); "
            "waypoints are at least a nanosecond apart"
        )

    refuse(np.diff(ns) < 1.0, 1, out_of_order, doubts)
    if period is None:
        return
    end, last = np.atleast_1d(period), times[..., -1:]
    refuse(~(end * NS >= 1.0), 1, lambda _: f"drive.period: {period:g} s; it must be at least 1e-9 s", doubts)
    refuse(
        end < last,
        1,
        lambda _: f"drive.period: {period:g} s ends before the last waypoint at {times[-1]:g} s",
        doubts,
    )
    refuse(
        (end > last) & (np.rint(end * NS) - ns[..., -1:] < 1.0),
        1,
        lambda _: f"drive.period: {period!r} s is less than a nanosecond after the last waypoint",
        doubts,
    )
