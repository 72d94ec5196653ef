"""Panels of the friction of single contacts in the plane, and the pictures of bodies that turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from crawler_model import Trajectory
from crawler_model.body.drive import NS
from crawler_model.body.plan import Plan
from crawler_model.body.turning import forward_angles

from .colors import FORWARD
from .domain_text import last_period
from .numbers import shorten
from .style import open_figure, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_PANELS, MOST_SETS = 9, 6
"""Contacts, and sets of each, that are drawn."""


def draw_panels(
    scene: Plan,
    what: str,
    sets: Mapping[int, Sequence[np.ndarray]],
    name: str,
    force: np.ndarray,
    slides: np.ndarray,
    reach: float,
    components: tuple[str, str],
) -> Figure:
    """Draw what friction holds at each contact, and the path of the force on it, in green where it slides.

    Args:
        scene: the scene; its name, and the ground that the sets belong to, are written above all panels.
        what: what the panels show.
        sets: the outlines of the sets of forces that friction holds, by contact, each of shape (V, 2) [N].
        name: what a contact is called.
        force: shape (T, N, 2) [N].
        slides: whether a contact slides, bool, shape (T, N).
        reach: how far the axes reach [N].
        components: names of both components of the force.

    Returns:
        The figure, three panels in a row.
    """
    columns = min(len(sets), 2 if page().narrow else 3)
    rows = -(-len(sets) // columns)
    figure = open_figure(4.2 * columns, 4.8 * rows)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    title, where = f"{shorten(scene.name, 45)}: {what}", scene.ground.even_part
    figure.suptitle(f"{title}\n(the sets hold {where})" if where else title, parse_math=False)
    for axis, (i, outlines) in zip(axes, sets.items(), strict=False):
        for outline in outlines:
            axis.fill(*outline.T, facecolor="#f2dcda", edgecolor="#c83c3c", linewidth=1.2, alpha=0.6)
        axis.plot(*force[:, i].T, color="black", linewidth=1.0)
        sliding = np.where(slides[:, i, None], force[:, i], np.nan)
        axis.plot(*sliding.T, "o-", color=FORWARD, linewidth=3.0, markersize=7)
        axis.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
        axis.set(xlabel=components[0], ylabel=components[1])
        axis.set_title(f"{name} {i}" + ("" if page().paper else ": green while it slides"))
        axis.locator_params(nbins=5)
    for axis in axes[len(sets) :]:
        axis.set_axis_off()
    return figure


def draw_turning(scene: Plan, run: Trajectory) -> Figure:
    """Draw what friction holds at each point of a body that turns, of at most nine, in the frame of its friction.

    Args:
        scene: the scene.
        run: its run; the last period is drawn.

    Returns:
        The figure.
    """
    columns, contacts = scene.columns, scene.body.contacts
    targets = scene.drive.targets[:, columns.lengths :][:, : columns.frictions].reshape(-1, contacts, 4)
    friction = np.unique(targets, axis=0)
    shown = np.flatnonzero(friction.any(axis=(0, 2)))[:MOST_PANELS]
    rows = last_period(run)
    return draw_panels(
        scene,
        "what friction holds at each point, and the force on it over the last period, in its frame",
        {i: [_outline(sides) for sides in friction[:MOST_SETS, i]] for i in shown.tolist()},
        "point",
        forces_in_frames(run, rows),
        run.contact_state[rows] != 0,
        1.1 * float(friction.max()),
        ("forward [N]", "left [N]"),
    )


def forces_in_frames(run: Trajectory, rows: np.ndarray) -> np.ndarray:
    """Compute the force of springs and loads on each point of a body that turns, in the frame of its friction.

    Args:
        run: a run.
        rows: times of the run, by index, shape (K,).

    Returns:
        Along and across the forward direction of each point, shape (K, N, 2) [N].
    """
    scene, body = run.scene, run.scene.body
    assert body.turning is not None
    x = run.displacement[rows]
    force = body.force_at(x, run.tension[rows])
    if scene.columns.loads:
        targets = scene.drive.sample(np.rint(run.time[rows] * NS).astype(np.int64))
        force = force + targets[:, -2 * body.contacts :].reshape(force.shape)
    angle = forward_angles(body.turning, body.position + x)
    cos, sin = np.cos(angle), np.sin(angle)
    ahead = cos * force[..., 0] + sin * force[..., 1]
    return np.stack((ahead, cos * force[..., 1] - sin * force[..., 0]), axis=-1)


def _outline(sides: np.ndarray) -> np.ndarray:
    """Compute the forces at which a point slides, a quarter of an ellipse between two sides each, (V, 2) [N]."""
    angle = np.linspace(0.0, 2.0 * np.pi, 361)
    cos, sin = np.cos(angle), np.sin(angle)
    forward, backward, left, right = sides
    return np.column_stack((cos * np.where(cos >= 0.0, forward, backward), sin * np.where(sin >= 0.0, left, right)))
