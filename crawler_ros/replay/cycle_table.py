"""Translation and energy of each cycle of a run, computed from a table of ramps."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

import numpy as np

from crawler_model import Scene
from crawler_model.body.drive import NS
from crawler_model.body.turning import TURNING_TOLERANCE
from crawler_model.run.transport import cost_of_transport, length_of, supporting_force

from .cycles import ROUNDING, find_cycles, signature_weights
from .ramps import RampTable

STEADY = 1e-3
"""Largest deviation of a steady cycle: of its shape in largest elongations, of its translation in the last cycle's."""


@dataclass(frozen=True)
class EnergyBalance:
    """The energy account of an interval of time.

    Attributes:
        work: work of the actuators [J].
        loads_work: work of the loads [J].
        dissipation: energy dissipated by friction [J].
        jump_loss: energy lost in jumps on patches of ground, not to friction [J].
        stored: change of the energy in the springs [J].
        residual: stored + dissipation + internal_dissipation + jump_loss - work - loads_work, relative to the largest
            of them [1].
        internal_dissipation: energy lost in springs with hysteresis [J].
    """

    work: float
    loads_work: float
    dissipation: float
    jump_loss: float
    stored: float
    residual: float
    internal_dissipation: float = 0.0


@dataclass(frozen=True)
class Cycle:
    """One cycle of the commands.

    Attributes:
        run: number of the run between resets.
        start: when it begins [s].
        end: when it ends [s].
        translation: net translation gained [m]; in the plane x and y.
        slip_forward: sum of the distances that contacts slid forward, for a segment the mean over its length [m].
        slip_backward: the same backward [m].
        energy: its energy account; None when the scene is not known.
        least_margin: least distance of a spring force from its bound [N]; None when the scene is not known.
        transient: whether its shape or translation still differs from the steady cycle by more than a thousandth.
        turned: angle by which the body turned [rad], whose translation is in its own frame at the start: along its
            heading and to the left; None for a body that does not turn.
        cost_of_transport: work / (distance * force) as `ManyRuns.cost_of_transport` defines it [1]; None where it does
            not move, or when the scene is not known.
    """

    run: int
    start: float
    end: float
    translation: float | tuple[float, ...]
    slip_forward: float
    slip_backward: float
    energy: EnergyBalance | None
    least_margin: float | None
    transient: bool
    turned: float | None = None
    cost_of_transport: float | None = None

    @property
    def speed(self) -> float:
        """Mean velocity [m/s]; in the plane its size."""
        gained = self.translation
        return (float(np.linalg.norm(gained)) if isinstance(gained, tuple) else gained) / (self.end - self.start)

    def as_plain(self) -> dict[str, Any]:
        """Convert to plain values for JSON.

        Returns:
            The attributes by name, as plain numbers, lists and text.
        """
        energy = dict.fromkeys(field.name for field in fields(EnergyBalance))
        plain = {**self.__dict__, **(energy if self.energy is None else asdict(self.energy))}
        del plain["energy"]
        if self.turned is None:
            del plain["turned"]
        plain["translation"] = list(self.translation) if isinstance(self.translation, tuple) else self.translation
        return plain


def account_of(table: RampTable, first: int = 0, last: int | None = None) -> EnergyBalance:
    """Sum the energies of some ramps; the stored energy of each run counts from its own start.

    Args:
        table: the ramps.
        first: the ramp at whose end the account opens.
        last: the ramp at whose end it closes; None for the last of all.

    Returns:
        The account.
    """
    last = table.run.size - 1 if last is None else last
    rows = slice(first + 1, last + 1)
    same = table.run[first + 1 : last + 1] == table.run[first:last]
    sums = (table.work, table.loads_work, table.dissipation, table.jump_loss, table.internal_dissipation)
    work, loads_work, dissipation, jump_loss, internal = (float(v[rows].sum()) for v in sums)
    change = np.diff(table.stored[first : last + 1])
    stored = float(table.stored[last] - table.stored[first]) if same.all() else float(change[same].sum())
    peak = float(table.stored[first : last + 1].max(initial=0.0))
    size = max(abs(work), abs(loads_work), abs(dissipation), abs(stored), peak)
    residual = abs(stored + dissipation + internal + jump_loss - work - loads_work) / size if size > 0.0 else 0.0
    return EnergyBalance(
        work=work,
        loads_work=loads_work,
        dissipation=dissipation,
        jump_loss=jump_loss,
        stored=stored,
        residual=residual,
        internal_dissipation=internal,
    )


def tabulate_cycles(table: RampTable, scene: Scene | None) -> tuple[tuple[Cycle, ...], str]:
    """Find the cycles of a recording and compute their translations and energies.

    Args:
        table: its ramps.
        scene: the scene that ran; None when it is not known.

    Returns:
        The cycles in order, and their source: "drive", "recurrence" or "none".
    """
    if table.run.size == 0:
        return (), "none"
    count = 0 if scene is None else scene.columns.count
    drive = None if scene is None or scene.drive.holds else scene.drive
    cycles: list[Cycle] = []
    sources = []
    for run in np.unique(table.run).tolist():
        first, path = table.path(run)
        for stretch in find_cycles(path, drive, signature_weights(count)):
            sources.append(stretch.source)
            cycles += _tabulate(table, run, first + np.array(stretch.bounds), scene)
    return tuple(cycles), "none" if not cycles else sources[0]


def _tabulate(table: RampTable, run: int, rows: np.ndarray, scene: Scene | None) -> list[Cycle]:
    y, shape = table.origin, table.shape
    gained, equal, turned = y[rows[1:]] - y[rows[:-1]], ROUNDING, None
    if table.turns:  # its steps end in other places when it is turned
        tolerance = None if scene is None else scene.tolerance
        equal, turned = tolerance or TURNING_TOLERANCE, np.diff(table.yaw[rows])
        cos, sin = np.cos(table.yaw[rows[:-1]]), np.sin(table.yaw[rows[:-1]])
        gained = np.column_stack((cos * gained[:, 0] + sin * gained[:, 1], cos * gained[:, 1] - sin * gained[:, 0]))
    # rounding is judged against the largest elongation, and against the largest translation of a cycle
    near = equal * max(table.shape_size, float(np.abs(gained).max(initial=0.0)))
    closes = np.abs(shape[rows[1:]] - shape[rows[:-1]]).max(axis=1) <= max(near, STEADY * table.shape_size)
    last = max(near, STEADY * float(np.linalg.norm(gained[-1])))
    steady = closes & (np.abs(gained - gained[-1]).max(axis=1) <= last)
    bounds = list(zip(rows[:-1].tolist(), rows[1:].tolist(), strict=True))
    known = bool(np.isfinite(table.work[rows[0] + 1 : rows[-1] + 1]).all())
    energies = [account_of(table, first, last) for first, last in bounds] if known else []
    costs = _costs_of(table, scene, energies, gained) if known and scene is not None else [None] * len(bounds)
    made = []
    for k, (first, last) in enumerate(bounds):
        inside = slice(first + 1, last + 1)
        translation = gained[k].tolist()
        made.append(
            Cycle(
                run=run,
                start=float(table.end_ns[first]) / NS,
                end=float(table.end_ns[last]) / NS,
                translation=translation[0] if len(translation) == 1 else tuple(translation),
                slip_forward=float(table.forward[inside].sum()),
                slip_backward=float(table.backward[inside].sum()),
                energy=energies[k] if known else None,
                least_margin=float(table.margin[inside].min()) if known else None,
                transient=not bool(steady[k]),
                turned=None if turned is None else float(turned[k]),
                cost_of_transport=costs[k],
            )
        )
    return made


def _costs_of(table: RampTable, scene: Scene, energies: list[EnergyBalance], gained: np.ndarray) -> list[float | None]:
    """Compute the costs of transport of cycles, as `crawler sweep` does."""
    size = max(length_of(scene.body), float(np.abs(table.net_translation).max()))
    work, distance = np.array([energy.work for energy in energies]), np.linalg.norm(gained, axis=1)
    costs = cost_of_transport(supporting_force(scene), work, distance, np.full(work.size, size))
    return [cost if np.isfinite(cost) else None for cost in costs.tolist()]
