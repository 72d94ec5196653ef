"""The unknowns of a gait: evenly spaced waypoints of a drive, and numbers of its scene."""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.body.drive import Drive
from crawler_model.errors import SceneError
from crawler_model.scene.assemble_start import relax_loaded
from crawler_model.scene.assembly import Assembly
from crawler_model.scene.scene import Scene

from ..derivative.parameters import Derivatives, changing_keys, collect_pieces, differentiate_arrays
from ..sweep.keys import check_form, expand_keys, find_path
from ..sweep.stack import stack, stack_scenes
from ..sweep.vary import Variations


@dataclass(frozen=True, eq=False)
class Table:
    """Evenly spaced waypoints of a period.

    Attributes:
        waypoints: number of waypoints K.
        period: [s].
        links: number of links, segments and joints J whose actuation is unknown.
        friction: whether the friction of each contact and segment is unknown, too, equal in both directions.
        column_of: for each column of a command row the unknown of its waypoint that it shows, or -1, shape (C,).
        low: lower bounds of the unknowns of a waypoint, shape (J,) or (J + contacts and segments,) [m, 1, N, N/m].
        high: upper bounds of the same shape.
        span: length by which an unknown is multiplied to get a change of length, 1 for links, shape (J,) [1, m].
        held: the actuation of each link, segment and joint, in the plane of each component of a link, NaN where it is
            unknown [m, 1, rad].
        axes: number of components of the actuation of a link.
    """

    waypoints: int
    period: float
    links: int
    friction: bool
    column_of: np.ndarray
    low: np.ndarray
    high: np.ndarray
    span: np.ndarray
    held: np.ndarray
    axes: int = 1

    @functools.cached_property
    def moved(self) -> np.ndarray:
        """Links, segments and joints whose actuation is unknown, shape (J,)."""
        return np.flatnonzero(np.isnan(self.held))

    @property
    def width(self) -> int:
        """Number of unknowns of a waypoint."""
        return int(self.low.size)

    def names(self) -> tuple[str, ...]:
        """Name the unknowns by the keys of the drive, waypoint by waypoint.

        Returns:
            Names such as `drive.actuation[0][1]`.
        """
        return tuple(
            f"drive.actuation[{i}]{self._place(int(self.moved[j]))}"
            if j < self.links
            else f"drive.friction.isotropic[{i}][{j - self.links}]"
            for i in range(self.waypoints)
            for j in range(self.width)
        )

    def _place(self, column: int) -> str:
        """Write the indices of an actuation in its row."""
        return f"[{column}]" if self.axes == 1 else f"[{column // self.axes}][{column % self.axes}]"


@dataclass(frozen=True)
class Cycle:
    """A candidate: arrays from which its periodic regime follows.

    Attributes:
        plan: body, start and drive; the first waypoint is in force at the start, the others belong to the period.
        seconds: duration of the ramp to each waypoint of the period, shape (K,) [s].
    """

    plan: Assembly
    seconds: np.ndarray

    @functools.cached_property
    def share(self) -> np.ndarray:
        """Weight of each waypoint in a mean over time, shape (K,)."""
        return np.asarray(0.5 * (self.seconds + np.roll(self.seconds, -1)) / self.seconds.sum())


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns, and the candidates that they describe.

    Attributes:
        base: the scene, with a relaxed start; with a table it has no drive.
        keys: numbers of the scene, by dotted keys.
        table: the waypoints, or None if the scene's own drive is played.
        low: lower bounds of the numbers of the scene, then of the waypoints, shape (P,).
        high: upper bounds of the same shape.
        original: the scene as it was given.
    """

    base: Scene
    keys: tuple[str, ...]
    table: Table | None
    low: np.ndarray
    high: np.ndarray
    original: Scene

    @functools.cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, shape (P,): numbers of the scene, then the waypoints."""
        return self.keys + (self.table.names() if self.table is not None else ())

    def split(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Split unknowns into numbers of the scene and waypoints.

        Returns:
            Shape (keys,), and shape (K, width) or None without a table.
        """
        first = len(self.keys)
        return values[:first], None if self.table is None else values[first:].reshape(self.table.waypoints, -1)

    def _scene(self, numbers: np.ndarray) -> Scene:
        if not self.keys:
            return self.base
        return Variations(self.base, self._columns(numbers[None]), (1,))[0]

    def _columns(self, numbers: np.ndarray) -> dict[str, np.ndarray]:
        """Name the numbers of candidates, shape (M, keys), by the keys that change with them, each of shape (M,)."""
        return {each: np.ascontiguousarray(numbers[:, i]) for i, keys in enumerate(self._changing) for each in keys}

    @functools.cached_property
    def _changing(self) -> list[tuple[str, ...]]:
        """The keys that change with each number: its own, and its twin's in the row that closes a drive."""
        return [changing_keys(self.base, key, find_path(self.base, key)) for key in self.keys]

    def cycle(self, values: np.ndarray) -> Cycle:
        """Build a candidate.

        Returns:
            Its arrays.

        Raises:
            SceneError: if numbers of the scene do not fit together.
        """
        numbers, waypoints = self.split(values)
        return self._cycle(self._scene(numbers), waypoints)

    def cycles(self, values: np.ndarray) -> Cycle:
        """Build many candidates together.

        Args:
            values: the unknowns, shape (M, P).

        Returns:
            Their arrays: in the plan they have a leading axis of candidates, as in a stack of variations.

        Raises:
            SceneError: if numbers of the scene do not fit together, or change its mesh; then build them one by one.
        """
        count, first = values.shape[0], len(self.keys)
        columns = self._columns(values[:, :first])
        whole = stack(Variations(self.base, columns, (count,))) if columns else stack_scenes([self.base] * count)
        for reason in whole.reasons.values():
            raise SceneError(reason)
        waypoints = None if self.table is None else values[:, first:].reshape(count, self.table.waypoints, -1)
        return self._assemble(whole.assembly, self.base.drive, waypoints)

    @property
    def _starts_relaxed(self) -> bool:
        """Whether candidates start relaxed at their first waypoint, which loads and bent springs do not allow.

        On patches, where the first periods count, they do as a scene does that is written `start: relaxed`.

        Where bodies in the plane start does not matter, and to relax a body that turns takes as long as a period.
        """
        body = self.base.body
        if self.table is None or self._is_patched:
            return self.table is not None
        return self.base.columns.slope_load is None and not body.bends and body.dimension == 1

    @property
    def _is_patched(self) -> bool:
        return self.base.ground.differs != ""

    def _assemble(self, part: Assembly, drive: Drive, waypoints: np.ndarray | None) -> Cycle:
        """Build a candidate, or many together, from arrays of the scene and the times of its drive."""
        rows, seconds = self._rows(drive, part.drive.rows, waypoints)
        path = Drive(np.arange(rows.shape[-2], dtype=np.float64), None, rows, part.columns)
        start = part.start_displacement
        if self._starts_relaxed:
            start = part.body.relaxed(path.targets[..., 0, : part.body.lengths])
        return Cycle(Assembly(part.parts, part.body, part.ground, part.columns, path, start), seconds)

    def _rows(self, drive: Drive, given: np.ndarray, waypoints: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        """Build the rows of candidates, the row of the start first, and the durations of the ramps to the others."""
        if self.table is None or waypoints is None:
            seconds, order = _period_of(drive)
            if self.base.body.turning is not None or self._is_patched:  # gains count from the first waypoint on
                seconds, order = np.roll(seconds, 1), np.roll(order, 1)
            return np.concatenate((given[..., :1, :], given[..., order, :]), axis=-2), seconds
        rows = np.repeat(given[..., :1, :], 1 + self.table.waypoints, axis=-2)
        shown = self.table.column_of >= 0
        rows[..., 1:, shown] = waypoints[..., self.table.column_of[shown]]
        still = np.flatnonzero(~np.isnan(self.table.held))
        rows[..., 1:, still] = self.table.held[still]
        if self._starts_relaxed:
            rows[..., 0, :] = rows[..., 1, :]
        return rows, np.full(self.table.waypoints, self.table.period / self.table.waypoints)

    def _cycle(self, scene: Scene, waypoints: np.ndarray | None) -> Cycle:
        cycle = self._assemble(scene, scene.drive, waypoints)
        if self._is_patched and self._starts_relaxed:
            return dataclasses.replace(cycle, plan=relax_loaded(cycle.plan))
        return cycle

    def differentiate(self, values: np.ndarray) -> tuple[Cycle, Derivatives]:
        """Build a candidate, and differentiate its arrays.

        Returns:
            The candidate, and the derivatives of its arrays with respect to the unknowns.

        Raises:
            SceneError: if numbers of the scene do not fit together, or cannot change.
        """
        numbers, waypoints = self.split(values)
        scene = self._scene(numbers)
        cycle = self._cycle(scene, waypoints)
        body, first, count = scene.body, len(self.keys), len(self.names)
        rows = cycle.plan.drive.rows.shape[0]
        width = cycle.plan.drive.targets.shape[1]
        stiffness, start = np.zeros((body.springs, count)), np.zeros((body.contacts, count))
        targets = np.zeros((rows, width, count))
        pieces = np.zeros((*collect_pieces(body).shape, count))
        if self.keys:
            of_keys = differentiate_arrays(scene, self.keys, "optimise")
            pieces[:, :, :first] = of_keys.pieces
            stiffness[:, :first], start[:, :first] = of_keys.stiffness, of_keys.start
            if self.table is None:
                targets[0, :, :first] = of_keys.targets[0]
                targets[1:, :, :first] = of_keys.targets[_period_of(scene.drive)[1]]
            else:
                targets[:, :, :first] = of_keys.targets[0]
        if self.table is not None:
            targets[1:, :, first:] = self._table_targets
            replaced = (self._table_targets != 0.0).any(axis=(0, 2))
            targets[1:, replaced, :first] = 0.0
        if self._starts_relaxed:
            targets[0] = targets[1]
            start = np.ascontiguousarray(body.relaxed(targets[0, : body.springs].T).T)
        none = np.zeros((rows, count))
        return cycle, Derivatives(self.names, values, stiffness, pieces, targets, start, none, np.zeros(count))

    @functools.cached_property
    def _table_targets(self) -> np.ndarray:
        """Derivatives of the targets at the waypoints with respect to the waypoints, shape (K, F, K width)."""
        table, columns = self.table, self.base.columns
        assert table is not None
        one = columns.spread((table.column_of == np.arange(table.width)[:, None]).astype(np.float64)).T
        all_targets = np.zeros((table.waypoints, one.shape[0], table.waypoints, table.width))
        for i in range(table.waypoints):
            all_targets[i, :, i] = one
        return all_targets.reshape(table.waypoints, one.shape[0], -1)

    def document(self, values: np.ndarray) -> dict[str, Any]:
        """Build the document of a candidate, which plays it.

        Returns:
            The input of `Scene.model_validate`.

        Raises:
            SceneError: if numbers of the scene do not fit together.
        """
        numbers, waypoints = self.split(values)
        document = self._scene(numbers).document()
        if self.table is not None and waypoints is not None:
            document["drive"] = _write_table(self.table, waypoints)
            if not self._is_patched:
                document.pop("start", None)
        if "start" in self.original.document():
            document["start"] = self.original.document()["start"]
        try:
            Scene.model_validate(document)
        except SceneError:
            document["start"] = "relaxed"
            Scene.model_validate(document)
        return document


def _period_of(drive: Drive) -> tuple[np.ndarray, np.ndarray]:
    """Find the waypoints of a period, the first one last: durations of the ramps to them, and rows."""
    assert drive.period is not None
    rows = np.flatnonzero(drive.times < drive.period)
    order = np.append(rows[1:], rows[0])
    times = np.append(drive.times[rows[1:]], drive.period)
    return np.diff(times, prepend=0.0), order


def _write_table(table: Table, waypoints: np.ndarray) -> dict[str, Any]:
    closed = np.vstack((waypoints, waypoints[:1]))
    times = table.period * np.arange(table.waypoints + 1) / table.waypoints
    times[-1] = table.period
    drive: dict[str, Any] = {"times": times.tolist(), "period": table.period}
    actuation = np.tile(table.held, (table.waypoints + 1, 1))
    actuation[:, table.moved] = closed[:, : table.links]
    if table.axes > 1:
        actuation = actuation.reshape(table.waypoints + 1, -1, table.axes)
    drive["actuation"] = actuation.tolist()
    if table.friction:
        drive["friction"] = {"isotropic": closed[:, table.links :].tolist()}
    return drive


def with_numbers(unknowns: Unknowns, factors: dict[str, float]) -> Unknowns:
    """Multiply numbers of the scene that are not unknown.

    Args:
        factors: by dotted key; one that names a list multiplies all its numbers.

    Returns:
        The same unknowns for the other scene.

    Raises:
        SceneError: if a key is unknown, names no number or nothing but zeros, or leads to an invalid scene.
    """
    scene, values = unknowns.base, dict[str, np.ndarray]()
    for key, factor in factors.items():
        names = expand_keys(scene, [key], "robust")
        check_form(scene, names, "robust")
        origins = {name: Variations(scene, {name: np.zeros(1)}, (1,)).origin(name) for name in names}
        if not any(origins.values()):
            raise SceneError(f"robust: {key} is 0, which no factor changes; leave it out")
        values |= {name: np.array([origin * factor]) for name, origin in origins.items()}
    return dataclasses.replace(unknowns, base=Variations(scene, values, (1,))[0])
