"""The arrays of a run that its pictures show; a recording and a `Trajectory` are converted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from crawler_model.body.columns import Columns
from crawler_model.body.plan import Plan
from crawler_model.run.trajectory import TimedJump


@dataclass(frozen=True, eq=False)
class Commands:
    """Commands of one kind over time.

    Attributes:
        what: as "change of rest length" or "friction".
        unit: as "m".
        names: of the K curves.
        values: shape (T, K).
    """

    what: str
    unit: str
    names: tuple[str, ...]
    values: np.ndarray

    @property
    def changes(self) -> bool:
        """Whether any of them changes in the run."""
        return bool((self.values != self.values[:1]).any())


@dataclass(frozen=True, eq=False)
class Gains:
    """The net translation of each cycle, and the slips of the last one.

    Attributes:
        gained: along x, shape (P,) [m].
        transient: whether the cycle differs from the steady one, shape (P,).
        slips: slip forward and back of all parts in the last cycle [m]; None when they are not known.
        parts: number of contacts and segments among which the slips are divided; None when it is not known.
    """

    gained: np.ndarray
    transient: np.ndarray
    slips: tuple[float, float] | None = None
    parts: int | None = None


@dataclass(frozen=True, eq=False)
class RunArrays:
    """A run as plain arrays: T samples, N contacts, J links and segments. Unknown numbers are NaN.

    Attributes:
        title: name of the run.
        notes: lines below it.
        time: end of each sample, shape (T,) [s].
        positions: of each contact at that time, shape (T, N), in the plane (T, N, 2) [m].
        state: in the sample that ends then, 1 forward, -1 back, 0 stuck, 2 both, in the plane 1 sliding, shape (T, N).
        net_translation: y, shape (T,), in the plane (T, 2) [m].
        tension: shape (T, J), in the plane (T, J, 2) [N].
        least: least tension in the stasis domain while the others are unchanged, shape (T, J) [N].
        most: the greatest, shape (T, J) [N].
        contacts: names of the contacts, "trunk/contact_7" inside a segment, shape (N,).
        links: names of the links and segments, "trunk/element_7" for a spring of a segment, shape (J,).
        place: reference positions, shape (N,), in the plane (N, 2) [m].
        ends: the two contacts of each link in a picture of the plane, shape (J, 2); none where they are not known.
        commands: the commands by kind.
        energy: curves of energy by name, each shape (T,) [J].
        cycles: starts of the cycles, shape (K,) [s].
        gains: the net translation of each cycle; None without cycles.
        rests: intervals in which nothing moved [s].
        jumps: jumps on patches of ground.
        scene: the scene, for its ground and its friction in the plane; None when it is not known.
        force: of springs and loads on each contact in the plane, shape (T, N, 2) [N]; None when it is not known,
            and for a body that turns, whose friction has no fixed directions to draw.
        share: weight of each contact in the net translation, shape (N,); None when it is not known.
        marks: of the links, as in `crawler_pictures.marks`, shape (T, J); shape (T, 0) if none can be marked.
        own: tension of each actuator without the passive spring beside it, from `marks.own_tensions`.
    """

    title: str
    notes: tuple[str, ...]
    time: np.ndarray
    positions: np.ndarray
    state: np.ndarray
    net_translation: np.ndarray
    tension: np.ndarray
    least: np.ndarray
    most: np.ndarray
    contacts: tuple[str, ...]
    links: tuple[str, ...]
    place: np.ndarray
    ends: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    commands: tuple[Commands, ...] = ()
    energy: dict[str, np.ndarray] = field(default_factory=dict)
    cycles: np.ndarray = field(default_factory=lambda: np.zeros(0))
    gains: Gains | None = None
    rests: Sequence[tuple[float, float]] = ()
    jumps: Sequence[TimedJump] = ()
    scene: Plan | None = None
    force: np.ndarray | None = None
    share: np.ndarray | None = None
    marks: np.ndarray = field(default_factory=lambda: np.zeros((0, 0), np.int8))
    own: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def planar(self) -> bool:
        """Whether the body moves in the plane."""
        return self.positions.ndim == 3

    @property
    def mean(self) -> np.ndarray:
        """Path of the mean of the body, which begins at the mean of all contacts if their weights are not known [m]."""
        start = np.average(self.positions[0], axis=0, weights=self.share)
        return np.asarray(start + self.net_translation - self.net_translation[0])


def planar_forces(scene: Plan, tension: np.ndarray, rows: np.ndarray) -> np.ndarray | None:
    """Compute the force of springs and loads on each contact, which friction holds while the contact does not slide.

    Args:
        scene: the scene.
        tension: shape (T, J, 2) [N].
        rows: the command rows in force, shape (T, C).

    Returns:
        Shape (T, N, 2) [N]; None on a line, and for loads that are not known.
    """
    if scene.body.dimension != 2:
        return None
    force = scene.body.spring_force(tension)
    slope = scene.columns.slope_load
    if slope is None:
        return force
    return force + scene.columns.target(rows)[:, -slope.size :].reshape(force.shape) if rows.shape[1] else None


def sort_commands(columns: Columns, rows: np.ndarray) -> tuple[Commands, ...]:
    """Sort the columns of command rows by kind; friction that is equal in both directions becomes one curve.

    Args:
        columns: the layout of the rows.
        rows: shape (T, C).

    Returns:
        Rest lengths, strains or rest angles, friction of contacts and of segments, and loads, where there are any;
        vectors by component.
    """
    names, lengths, half = columns.names, columns.lengths, int(columns.friction_sizes.sum())
    links = int(columns.actuation_sizes[: columns.links].sum())
    strain = ("strain", "1") if columns.joints is None else ("change of rest angle", "rad")
    found = [("change of rest length", "m", range(links)), (*strain, range(links, lengths))]
    alone = int(columns.friction_sizes[: columns.contacts].sum())
    both = [rows[:, lengths + k : lengths + half + k + 1 : half] for k in range(half)] if columns.sides == 2 else []
    kinds = [Commands(what, unit, tuple(names[k] for k in at), rows[:, at]) for what, unit, at in found if len(at)]
    for unit, at in (("N", range(alone)), ("N/m", range(alone, half))):
        curves: list[tuple[str, np.ndarray]] = []
        for k in at:
            name = names[lengths + k]
            if both and (both[k][:, 0] == both[k][:, 1]).all():
                curves.append((name.removesuffix("/forward"), both[k][:, 0]))
            elif both:
                other = f"{name.removesuffix('/forward')}/backward"
                curves += [(name, both[k][:, 0]), (other, both[k][:, 1])]
            else:
                curves.append((name.removesuffix("/friction"), rows[:, lengths + k]))
        if curves:
            what = "friction of segments" if unit == "N/m" and alone else "friction"
            table = np.column_stack([curve for _, curve in curves])
            kinds.append(Commands(what, unit, tuple(name for name, _ in curves), table))
    first = lengths + columns.frictions
    divided = first + int(columns.load_sizes[: columns.contacts].sum())
    for unit, at in (("N", range(first, min(divided, columns.count))), ("N/m", range(divided, columns.count))):
        if at:
            what = "load of segments" if unit == "N/m" and columns.contacts else "load"
            kinds.append(Commands(what, unit, tuple(names[k].removesuffix("/load") for k in at), rows[:, at]))
    return tuple(part for kind in kinds for part in _split_components(kind))


def _split_components(kind: Commands) -> list[Commands]:
    """Split vectors into a kind for each component, whose curves have the names of the vectors."""
    if not all(name.endswith(("/x", "/y")) for name in kind.names):
        return [kind]
    return [
        Commands(f"{kind.what} along {axis}", kind.unit, tuple(n[:-2] for n in kind.names[k::2]), kind.values[:, k::2])
        for k, axis in enumerate("xy")
    ]
