"""From the drive of a scene to its waypoints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..arrays import frozen, spread
from ..body import drive as drives
from ..body.drive import Drive
from ..errors import SceneError
from .assemble import friction_row
from .scene import DrivePart, FrictionRowsPart, Scene, WavePart

if TYPE_CHECKING:
    pass


def build_drive(scene: Scene) -> Drive:
    """Make waypoints of a scene's drive.

    Args:
        scene: the scene.

    Returns:
        The drive, with the scene's friction where it commands none.

    Raises:
        SceneError: naming the row or value that does not fit.
    """
    columns, part = scene.columns, scene.drive
    friction = friction_row(scene)
    if part is None:
        row = np.concatenate((np.zeros(columns.lengths), friction))
        return Drive(frozen([0.0]), None, frozen(row[None]), columns)
    if part.strategy is not None:
        return _build_strategy(scene, part)
    if part.times is None:
        return _build_waves(scene, part, friction)
    times = np.array(part.times)
    rows = np.zeros((times.size, columns.count))
    rows[:, columns.lengths :] = friction
    if scene.dimension == 2:
        rows[:, : columns.lengths] = _planar_rows(part.actuation, times.size, scene.mesh.springs)
    else:
        item = "link(s) and segment" if scene.mesh.segments else "link"
        given = _rows(part.actuation, times.size, columns.actuation_sizes.size, "drive.actuation", item)
        rows[:, : columns.lengths] = np.repeat(given, columns.actuation_sizes, axis=1)
    if isinstance(part.friction, FrictionRowsPart):
        if columns.planar:
            raise SceneError("drive.friction: friction given by directions is constant; leave it out")
        item = "contact(s) and segment" if scene.mesh.segments else "contact"
        names = ("isotropic", "isotropic") if part.friction.isotropic is not None else ("forward", "backward")
        both = [
            np.repeat(
                _rows(table, times.size, columns.friction_sizes.size, f"drive.friction.{name}", item),
                columns.friction_sizes,
                axis=1,
            )
            for name, table in zip(names, part.friction.sides, strict=True)
        ]
        rows[:, columns.lengths :] = np.hstack(both[: columns.sides])
    return drives.build_waypoints(times, part.period, rows, columns)


def _rows(table: Any, rows: int, columns: int, field: str, item: str) -> np.ndarray:
    if isinstance(table, float):
        return np.full((rows, columns), table)
    if len(table) != rows:
        raise SceneError(f"{field}: {len(table)} row(s) for {rows} time(s); give one row per time")
    for i, row in enumerate(table):
        if isinstance(row, tuple) and any(isinstance(v, tuple) for v in row):
            raise SceneError(f"{field}: row {i} holds lists; on a line each entry is a number (or dimension: 2)")
    return np.array([spread(row, columns, f"{field}: row {i}", item) for i, row in enumerate(table)])


def _planar_rows(table: Any, rows: int, links: int) -> np.ndarray:
    if not isinstance(table, tuple) or len(table) != rows:
        count = len(table) if isinstance(table, tuple) else 1
        raise SceneError(f"drive.actuation: {count} row(s) for {rows} time(s); give one row per time")
    for i, row in enumerate(table):
        entries = row if isinstance(row, tuple) else (row,)
        wrong = [k for k, e in enumerate(entries) if not isinstance(e, tuple) or len(e) != 2]
        if len(entries) != links or wrong:
            found = f"entry {wrong[0]} is {entries[wrong[0]]}" if wrong else f"{len(entries)} entries"
            raise SceneError(
                f"drive.actuation: row {i}: {found}; a planar scene gives [x, y] for each of {links} link(s)"
            )
    return np.array(table).reshape(rows, 2 * links)


def _build_strategy(scene: Scene, part: DrivePart) -> Drive:
    columns = scene.columns
    mesh = scene.mesh
    if (mesh.isolated.size, mesh.springs, len(mesh.segments)) != (2, 1, 0):
        raise SceneError(f"drive.strategy: strategies drive 2 contacts on 1 link, this body has {mesh.describe()}")
    assert part.strategy is not None
    assert part.length is not None
    assert isinstance(part.friction, float)
    period = 1.0 if part.period is None else part.period
    times, actuation, mu = drives.strategy_waypoints(part.strategy, part.length, part.friction, period)
    return drives.build_waypoints(times, period, np.hstack((actuation, mu, mu)), columns)


def _build_waves(scene: Scene, part: DrivePart, friction: np.ndarray) -> Drive:
    mesh, columns = scene.mesh, scene.columns
    waves = [w for w in (part.wave, part.friction_wave) if w is not None]
    period = waves[0].period
    if any(w.period != period for w in waves):
        raise SceneError("drive.friction_wave.period: it must be that of drive.wave")
    times = drives.merge_times(*(np.arange(w.samples + 1) * (period / w.samples) for w in waves))
    times[-1] = period
    rows = np.zeros((times.size, columns.count))
    rows[:, columns.lengths :] = friction
    if part.wave is not None:
        middle = 0.5 * (mesh.position[mesh.ends[:, 0]] + mesh.position[mesh.ends[:, 1]])
        places = np.concatenate([middle[mesh.link_springs], *(middle[s.springs] for s in mesh.segments)])
        rows[:, : columns.lengths] = _sampled(part.wave, times, places)
    if part.friction_wave is not None:
        w = part.friction_wave
        if w.mean < abs(w.amplitude):
            raise SceneError(
                f"drive.friction_wave: mean {w.mean:g} N is less than the amplitude {abs(w.amplitude):g} N; "
                "friction must be >= 0 all the time"
            )
        places = np.concatenate([mesh.position[mesh.isolated], *(mesh.position[s.contacts] for s in mesh.segments)])
        mu = np.maximum(_sampled(w, times, places), 0.0)
        rows[:, columns.lengths :] = np.hstack((mu, mu))
    return drives.build_waypoints(times, period, rows, columns)


def _sampled(part: WavePart, times: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Read a wave, straight between its own samples, at the waypoints, shape (W, places)."""
    phase = np.arange(part.samples + 1) / part.samples
    values = drives.wave(part.mean, part.amplitude, part.wavelength, phase, places)
    at = times / part.period * part.samples
    before = np.minimum(np.floor(at + 1e-9).astype(np.int64), part.samples)
    after = np.minimum(before + 1, part.samples)
    rest = np.clip(at - before, 0.0, 1.0)
    rest[rest < 1e-8] = 0.0  # on a sample, to the bit
    return values[before] + rest[:, None] * (values[after] - values[before])
