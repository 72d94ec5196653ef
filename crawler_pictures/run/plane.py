"""A run in the plane, seen from above: the path of every contact and of the body, slips, and the friction."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from crawler_model.body.plan import Plan

from ..colors import BOUND, FORWARD, LINES
from .kymograph import PLATE, place_legend, write_title

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_MOST_ARROWS = 60
_SHORTEST = 0.02
"""Part of the picture's extent below which a slip has no arrow."""


def draw_plane(
    axis: Axes, positions: ArrayLike, state: ArrayLike, mean: np.ndarray, ends: ArrayLike, names: list[str]
) -> None:
    """Draw the paths of all contacts and of the mean of the body, with an arrow for each slip.

    Args:
        axis: axes to draw on: m over m, of equal scale.
        positions: shape (T, N, 2) [m].
        state: 1 sliding from the sample before to this one, 0 stuck, shape (T, N).
        mean: of the body, shape (T, 2) [m].
        ends: the two contacts of each link, shape (J, 2).
        names: names of the contacts.
    """
    from matplotlib.lines import Line2D

    place, moving = np.asarray(positions), np.asarray(state) != 0
    for row, color, width in ((0, "#c4c4c4", 1.4), (-1, "#505050", 2.0)):
        for a, b in np.asarray(ends):
            axis.plot(*place[row, [a, b]].T, color=color, linewidth=width, zorder=1)
        axis.plot(*place[row].T, "o", color=color, markersize=5, zorder=4, linestyle="none")
    for i in range(place.shape[1]):
        color = LINES[i] if place.shape[1] <= len(LINES) else "#a0a0a0"
        axis.plot(*place[:, i].T, color=color, linewidth=1.0, zorder=2)
    axis.plot(*mean.T, color="black", linewidth=1.6, linestyle="--", zorder=3)
    axis.plot(*mean[-1], "x", color="black", markersize=6, zorder=4)
    if place.shape[1] <= len(LINES):
        _name_contacts(axis, place, np.asarray(ends), names)
    drawn, count = _draw_slips(axis, place, moving)
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.12)
    axis.set(xlabel="x [m]", ylabel="y [m]")
    slips = f"{count or 'no'} slip{'s' * (count > 1)}"
    which = f"arrows: the {drawn} longest of {slips}" if drawn else f"{slips}, too short for arrows"
    which = f"{'all ' * (count > 1)}{slips}" if drawn == count else which
    write_title(axis, f"from above; {which}")
    place_legend(
        axis,
        [
            Line2D([], [], color="#c4c4c4", marker="o", linewidth=1.4, label="start"),
            Line2D([], [], color="#505050", marker="o", linewidth=2.0, label="end"),
            Line2D([], [], color="black", linestyle="--", linewidth=1.6, label="mean of the body"),
            Line2D([], [], color=FORWARD, marker=">", linewidth=2.0, label="slip"),
        ],
    )


def _name_contacts(axis: Axes, place: np.ndarray, ends: np.ndarray, names: list[str]) -> None:
    """Name each contact at its last position, in the direction in which most room is left by paths and links."""
    part = np.linspace(0.0, 1.0, 21)[:, None]
    links = [place[row, a] + part * (place[row, b] - place[row, a]) for row in (0, -1) for a, b in ends]
    taken = np.concatenate([place[:: max(place.shape[0] // 400, 1)].reshape(-1, 2), *links])
    angle = 2.0 * np.pi * np.arange(16) / 16
    around = np.column_stack((np.cos(angle), np.sin(angle)))
    reach = 0.04 * float(np.ptp(taken, axis=0).max())
    for i, name in enumerate(names):
        room = np.linalg.norm(place[-1, i] + reach * around[:, None] - taken, axis=2).min(axis=1)
        axis.annotate(
            name.removeprefix("contact_"),
            place[-1, i],
            tuple(12.0 * around[room.argmax()]),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=9,
            color=LINES[i],
            bbox=PLATE,
            zorder=5,
        )


def _draw_slips(axis: Axes, place: np.ndarray, moving: np.ndarray) -> tuple[int, int]:
    """Draw the longest slips as arrows; return how many are drawn, and how many there are."""
    starts, ends = [np.zeros((0, 2))], [np.zeros((0, 2))]
    for i in range(place.shape[1]):
        edges = np.diff(np.concatenate(([False], moving[1:, i], [False])).astype(np.int8))
        starts.append(place[np.flatnonzero(edges == 1), i])
        ends.append(place[np.flatnonzero(edges == -1), i])
    start, end = np.concatenate(starts), np.concatenate(ends)
    length = np.linalg.norm(end - start, axis=1)
    extent = float(np.ptp(place.reshape(-1, 2), axis=0).max())
    chosen = np.argsort(-length, kind="stable")[:_MOST_ARROWS]
    chosen = chosen[length[chosen] > _SHORTEST * extent]
    for k in chosen.tolist():
        arrow = {"arrowstyle": "-|>", "color": FORWARD, "linewidth": 1.8, "shrinkA": 0, "shrinkB": 0, "alpha": 0.85}
        axis.annotate("", end[k], start[k], arrowprops=arrow, zorder=3)
    return chosen.size, length.size


def draw_friction(axis: Axes, scene: Plan, force: ArrayLike | None = None) -> None:
    """Draw the set of forces that friction holds at each contact, at the start of the drive, and the forces of a run.

    While friction is constant, a contact slides exactly where its force is on the border of its set.

    Args:
        axis: axes to draw on: N over N, of equal scale.
        scene: a scene in the plane.
        force: of springs and loads on each contact, shape (T, N, 2) [N]; None if it is not known.
    """
    columns, directions = scene.columns, scene.drive.columns.directions
    values = scene.drive.rows[0, columns.lengths : columns.lengths + columns.frictions].reshape(columns.contacts, -1)
    angle = np.linspace(0.0, 2.0 * np.pi, 721)
    unit = np.column_stack((np.cos(angle), np.sin(angle)))
    groups: dict[bytes, list[int]] = {}
    for i in range(columns.contacts):
        groups.setdefault(values[i].tobytes(), []).append(i)
    for contacts in list(groups.values())[: len(LINES)]:
        bound = values[contacts[0]]
        if directions is None or directions.size == 0:
            reach = np.full(angle.size, bound[0])
        else:
            along = unit @ directions.T
            reach = np.where(along > 1e-12, bound / np.maximum(along, 1e-12), np.inf).min(axis=1)
        axis.plot(*(reach[:, None] * unit).T, color="#404040", linewidth=1.4)
        text = f"contact {', '.join(map(str, contacts))}" if len(groups) > 1 else ""
        axis.annotate(text, (0.0, -reach[540]), (3, -10), textcoords="offset points", fontsize=8, bbox=PLATE, zorder=4)
    axis.axhline(0.0, color=BOUND, linewidth=0.5, zorder=0)
    axis.axvline(0.0, color=BOUND, linewidth=0.5, zorder=0)
    for direction, bound in zip([] if directions is None else directions, values[0], strict=False):
        x, y = (bound * direction).tolist()
        axis.annotate("", (x, y), (0.0, 0.0), arrowprops={"arrowstyle": "->", "color": BOUND, "shrinkB": 0})
    if force is not None:
        _draw_forces(axis, np.asarray(force))
    axis.set_aspect("equal", adjustable="datalim")
    axis.margins(0.12)
    axis.locator_params(axis="x", nbins=4)
    axis.set(xlabel="x [N]", ylabel="y [N]")
    left = len(groups) - len(LINES)
    more = f" ({left} more kinds are left out)" if left > 0 else ""
    write_title(axis, f"friction holds forces inside{more}")


def _draw_forces(axis: Axes, force: np.ndarray) -> None:
    """Draw the path of the force on each contact, and the force at the end of the run as a vector."""
    from matplotlib.lines import Line2D

    for i in np.argsort(-np.linalg.norm(force[-1], axis=1)).tolist():  # the shortest vectors above the others
        color = LINES[i] if force.shape[1] <= len(LINES) else "#a0a0a0"
        axis.plot(*force[:, i].T, color=color, linewidth=0.9, alpha=0.7, zorder=2)
        axis.plot(*np.stack((np.zeros(2), force[-1, i])).T, color=color, linewidth=1.8, zorder=3)
        axis.plot(*force[-1, i], "o", color=color, markersize=5, zorder=3)
    words = [str(i) for i in range(force.shape[1])] if force.shape[1] <= len(LINES) else ["each"]
    colors = LINES if len(words) > 1 else ("#a0a0a0",)
    handles = [Line2D([], [], color=c, linewidth=1.8, label=word) for c, word in zip(colors, words, strict=False)]
    handles.append(Line2D([], [], color="#404040", marker="o", markersize=5, label="at the end"))
    style: Any = {"fontsize": 8, "title_fontsize": 8, "ncols": 3, "frameon": False, "columnspacing": 1.0}
    axis.legend(handles=handles, loc="upper center", title="force on contact", **style)
