"""Results of many runs: columns, rows and tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any, overload

import numpy as np

from crawler_model.notebook import write_html
from crawler_model.run.arrow import Tabular, load_library
from crawler_model.scene.scene import Scene

from .rows import COMPARED, COUNTS, DONE, FORCES, LENGTHS, SCREW
from .vary import Variations

_STATUS = np.array(["not run", "done", "invalid"])
COLUMNS = ("status", *LENGTHS, *FORCES, *COMPARED, *SCREW, "unique", *COUNTS, "kernel_s")
"""The results with an entry for each run."""
_VECTORS = (*LENGTHS, "efficiency", "period_efficiency")
"""Results with two components in the plane."""
UNITS = {
    **dict.fromkeys(LENGTHS, "m"),
    "work": "J",
    "dissipation": "J",
    "stored": "J",
    "residual": "1",
    "violation": "N",
    "visited_margin": "1",
    "efficiency": "m/J",
    "period_work": "J",
    "period_dissipation": "J",
    "period_efficiency": "m/J",
    "cost_of_transport": "1",
    "body_lengths": "1",
    "dx": "m",
    "dy": "m",
    "dyaw": "rad",
}
"""Units of the numbers in a table."""


@dataclass(frozen=True, eq=False, repr=False)
class ManyRuns(Tabular):
    """Results of many runs, one row each. Arrays are read-only; NaN, 0 and False for runs that are not done.

    It is a sequence: `runs[3]` is a row with the same names, `runs[10:20]` are the results of these runs.

    Attributes:
        status: "done", "invalid", or "not run" after an interrupt, shape (M,).
        reason: reason why a run is invalid, "" for the others.
        net_translation: y at the end, shape (M,); (M, 2) if a scene is planar [m].
        gained: y at the end minus y at the start, of the same shape [m].
        per_period: y gained in the last whole period, of the same shape [m]; NaN without a whole period.
        settling: difference of the last two periods, of the same shape [m]; NaN with fewer than two.
        work: work of the actuators, shape (M,) [J].
        dissipation: energy lost to friction, shape (M,) [J].
        stored: change of the energy stored in the springs, shape (M,) [J].
        residual: error of the energy balance, see `Energy`, relative to the largest of work, dissipation and stored
            energy, also of that stored at a waypoint, shape (M,).
        violation: largest amount by which a spring force exceeds its bound, shape (M,) [N].
        visited_margin: how close all contacts came to sliding at once, shape (M,); for bodies of more than 256
            contacts and with catch_up only at the ends of ramps.
        period_work: work of the actuators in the last whole period, shape (M,) [J]; NaN without one.
        period_dissipation: energy lost to friction in the last whole period, shape (M,) [J]; NaN without one.
        cost_of_transport: work / (distance * force) of the last whole period, shape (M,): the distance is |per_period|,
            for a body that turns the length of (dx, dy); the force is the sum of `body.weights`, or else the sum
            of (mu_plus + mu_minus) / 2, its mean over a period. NaN without a whole period, and for a body that does
            not travel.
        body_lengths: per_period in lengths of the body (in the plane, this distance), shape (M,).
        dx: how far a body that turns went forward in the last whole period, in its own frame as in
            `Trajectory.per_period`, shape (M,) [m]; NaN without a period, and for bodies that do not turn.
        dy: how far it went to the left, shape (M,) [m].
        dyaw: how far it turned, shape (M,) [rad].
        unique: False if the translation was not determined on some stretch, shape (M,).
        events: number of linear pieces, shape (M,).
        overspent: number of ramps whose budget of work was exceeded, shape (M,).
        unsolved: number of ramps that were not solved, shape (M,).
        periods: number of whole periods, shape (M,).
        kernel_s: time spent in compiled kernels, for runs that went together a share of the call's, shape (M,) [s].
        interrupted: True if Ctrl-C stopped the runs; completed runs are included.
        wall_s: wall-clock time [s].
        varied: for each key that `vary` varied its value in each run, shape (M,); empty for other scenes.
    """

    status: np.ndarray
    reason: tuple[str, ...]
    net_translation: np.ndarray
    gained: np.ndarray
    per_period: np.ndarray
    settling: np.ndarray
    work: np.ndarray
    dissipation: np.ndarray
    stored: np.ndarray
    residual: np.ndarray
    violation: np.ndarray
    visited_margin: np.ndarray
    period_work: np.ndarray
    period_dissipation: np.ndarray
    cost_of_transport: np.ndarray
    body_lengths: np.ndarray
    dx: np.ndarray
    dy: np.ndarray
    dyaw: np.ndarray
    unique: np.ndarray
    events: np.ndarray
    overspent: np.ndarray
    unsolved: np.ndarray
    periods: np.ndarray
    kernel_s: np.ndarray
    interrupted: bool
    wall_s: float
    varied: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def efficiency(self) -> np.ndarray:
        """`gained` per energy lost to friction, gained / dissipation, of its shape [m/J]; NaN where nothing is lost."""
        return _per_energy(self.gained, self.dissipation)

    @property
    def period_efficiency(self) -> np.ndarray:
        """The same of the last whole period, per_period / period_dissipation [m/J]; NaN without one."""
        return _per_energy(self.per_period, self.period_dissipation)

    def __len__(self) -> int:
        """Count the runs."""
        return len(self.reason)

    @overload
    def __getitem__(self, at: int) -> RunRow: ...
    @overload
    def __getitem__(self, at: slice) -> ManyRuns: ...
    def __getitem__(self, at: int | slice) -> RunRow | ManyRuns:
        """Select one run, or several."""
        if isinstance(at, slice):
            columns = {name: getattr(self, name)[at] for name in COLUMNS}
            varied = {key: values[at] for key, values in self.varied.items()}
            return replace(self, reason=self.reason[at], varied=varied, **columns)
        place = range(len(self))[at]
        values = {name: getattr(self, name)[place] for name in (*COLUMNS, "efficiency", "period_efficiency")}
        return RunRow(
            **{n: v if np.ndim(v) else v.item() for n, v in values.items() if n != "status"},
            status=str(values["status"]),
            reason=self.reason[place],
        )

    def __iter__(self) -> Iterator[RunRow]:
        """Iterate over the runs."""
        return (self[i] for i in range(len(self)))

    def __repr__(self) -> str:
        """Describe the results in one line."""
        counts = ", ".join(f"{(self.status == s).sum()} {s}" for s in _STATUS[1:])
        return f"ManyRuns({len(self)} runs: {counts}, {self.wall_s:.3g} s)"

    def _repr_html_(self) -> str:
        """Describe the results in a notebook."""
        shown = ("per_period", "gained", "work", "dissipation", "cost_of_transport")
        facts: list[tuple[str, Any]] = [(s, int((self.status == s).sum())) for s in _STATUS.tolist()]
        facts += [(f"{name} [{UNITS[name]}]", _range(getattr(self, name))) for name in shown]
        return write_html(f"ManyRuns: {len(self)} runs in {self.wall_s:.3g} s", facts)

    def to_table(self) -> Any:
        """Convert to a table with a row for each run.

        Returns:
            A pyarrow.Table: the varied values, status, reason, then every number, with its unit in the metadata of the
            column; two columns, `_x` and `_y`, for a displacement in the plane; dx, dy and dyaw if a body turns; null
            where a run is not done or has no such number.

        Raises:
            CrawlerError: if pyarrow is not installed.
        """
        pa = load_library("pyarrow", "to_table")
        fields, columns = [], []

        def add_column(name: str, array: Any, unit: str | None = None) -> None:
            fields.append(pa.field(name, array.type, metadata=None if unit is None else {"unit": unit}))
            columns.append(array)

        for key, values in self.varied.items():
            add_column(key, pa.array(values))
        add_column("status", pa.array(self.status.tolist()))
        add_column("reason", pa.array(list(self.reason)))
        for name, unit in UNITS.items():
            column = getattr(self, name)
            if name in SCREW and np.isnan(column).all():
                continue
            for axis, values in zip(("_x", "_y"), column.T, strict=True) if column.ndim == 2 else (("", column),):
                add_column(name + axis, pa.array(values, mask=~np.isfinite(values)), unit)
        for name in ("unique", *COUNTS):
            add_column(name, pa.array(getattr(self, name), mask=self.status != "done"))
        return pa.Table.from_arrays(columns, schema=pa.schema(fields))


class RunRow(SimpleNamespace):
    """Results of one run: the names of `ManyRuns` with a number each, in the plane shape (2,) for displacements."""


def name_numbers(scene: Scene) -> tuple[str, ...]:
    """Name the numbers in the table of a sweep.

    Args:
        scene: the scene that is varied.

    Returns:
        Their names, in the plane with `_x` and `_y` for the components of vectors.
    """
    names = [name for name in (*UNITS, "unique", *COUNTS) if name not in SCREW or scene.body.turning is not None]
    vectors = _VECTORS if scene.dimension == 2 else ()
    return tuple(name + axis for name in names for axis in (("_x", "_y") if name in vectors else ("",)))


def _range(values: np.ndarray) -> str:
    """Write the least and the greatest number, in the plane of both axes; nothing where there is none."""
    known = values[np.isfinite(values)]
    return f"{known.min():.6g} .. {known.max():.6g}" if known.size else "-"


def _per_energy(gained: np.ndarray, spent: np.ndarray) -> np.ndarray:
    spent = spent.reshape(-1, *(1,) * (gained.ndim - 1))
    ratio = np.divide(gained, spent, out=np.full(gained.shape, np.nan), where=spent > 0.0)
    ratio.flags.writeable = False
    return ratio


def gather(
    scenes: Sequence[Scene], rows: np.ndarray, reasons: dict[int, str], interrupted: bool, wall_s: float
) -> ManyRuns:
    """Build the results from rows.

    Args:
        scenes: the scenes that were run, of length M.
        rows: rows of dtype ROW, shape (M,).
        reasons: reasons for invalid rows by index.
        interrupted: whether the runs were stopped.
        wall_s: wall-clock time [s].

    Returns:
        The results.
    """
    done = rows["status"] == DONE
    planar = bool((rows["dimension"] == 2).any())
    columns = {}
    for name in (*LENGTHS, *FORCES, *COMPARED, *SCREW):
        column = rows[name].copy()
        column[~done] = np.nan
        columns[name] = column if planar or column.ndim == 1 else column[:, 0].copy()
    for name in ("unique", *COUNTS, "kernel_s"):
        columns[name] = rows[name].copy()
    columns["status"] = _STATUS[rows["status"]]
    for column in columns.values():
        column.flags.writeable = False
    reason = tuple(reasons.get(i, "") for i in range(rows.size))
    varied = dict(scenes.values) if isinstance(scenes, Variations) else {}
    return ManyRuns(reason=reason, interrupted=interrupted, wall_s=wall_s, varied=varied, **columns)
