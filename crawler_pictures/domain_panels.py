"""Panels of the friction of single contacts in the plane, and the pictures of bodies that turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crawler_model import Trajectory
from crawler_model.body.drive import NS
from crawler_model.body.plan import Plan
from crawler_model.body.turning import forward_angles

from .colors import FORWARD
from .domain_text import last_period

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PANELS = 9


def make_panels(count: int) -> tuple[Figure, np.ndarray]:
    """Make a figure with a panel for each contact.

    Args:
        count: number of contacts, at least 1.

    Returns:
        The figure, and its axes, three in a row.
    """
    from matplotlib.figure import Figure

    columns = min(count, 3)
    rows = -(-count // columns)
    figure = Figure(figsize=(4.2 * columns, 4.4 * rows), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False)


def draw_path(axis: Axes, force: np.ndarray, slides: np.ndarray) -> None:
    """Draw the path of a force, in green where the contact slides.

    Args:
        axis: the panel.
        force: shape (T, 2) [N].
        slides: whether it slides, bool, shape (T,).
    """
    axis.plot(*force.T, color="black", linewidth=1.0)
    axis.plot(*np.where(slides[:, None], force, np.nan).T, "o-", color=FORWARD, linewidth=3.0, markersize=7)


def draw_turning(scene: Plan, run: Trajectory) -> Figure:
    """Draw what friction holds at each point of a body that turns, of at most nine, in the frame of its friction.

    Args:
        scene: the scene.
        run: its run, of which the last period is drawn.

    Returns:
        The figure.
    """
    columns, contacts = scene.columns, scene.body.contacts
    targets = scene.drive.targets[:, columns.lengths :][:, : columns.frictions].reshape(-1, contacts, 4)
    friction = np.unique(targets, axis=0)
    shown = np.flatnonzero(friction.any(axis=(0, 2)))[:MOST_PANELS]
    figure, axes = make_panels(shown.size)
    figure.suptitle(
        f"{scene.name}: what friction holds at each point, and the force on it over the last period, in its frame",
        parse_math=False,
    )
    rows = last_period(run)
    force, slides = forces_in_frames(run, rows), run.contact_state[rows] != 0
    reach = 1.1 * float(friction.max())
    for k, axis in enumerate(axes.flat):
        if k >= shown.size:
            axis.set_axis_off()
            continue
        i = int(shown[k])
        for sides in friction[:6, i]:
            axis.fill(*_outline(sides).T, facecolor="#f2dcda", edgecolor="#c83c3c", linewidth=1.2, alpha=0.6)
        draw_path(axis, force[:, i], slides[:, i])
        axis.set_title(f"point {i}: green while it slides")
        axis.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach))
        axis.set(xlabel="forward [N]", ylabel="left [N]")
        axis.locator_params(nbins=5)
    return figure


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
