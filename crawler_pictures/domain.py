"""Pictures of stasis domains, with the direction of motion that each side allows and the path of a run.

Tensions are drawn as they are, positive when stretched; [G] draws the same sets in -T.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from crawler_model import SceneError, Trajectory
from crawler_model.body.drive import NS
from crawler_model.body.plan import Plan
from crawler_model.body.planar_loads import split_target
from crawler_model.theory.stasis import holds_loads

from .domain_many import draw_many, draw_three
from .domain_panels import MOST_PANELS, MOST_SETS, draw_panels, draw_turning
from .domain_text import STYLE, last_period, simulated
from .domain_two import draw_two
from .style import own_style, write_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_domain(scene: Plan, png: Path) -> None:
    """Draw the stasis domain of a scene on one page, with the run of its drive in it.

    For two contacts: the box of both spring forces and its section, an interval; with constant friction also the
    sweeping process, with commanded friction the boxes at the waypoints; below, tension and interval over time. For
    three contacts: the polygon for each commanded friction, its sides marked with the direction that they allow. For
    more: projections onto two sections, and the range of each. In the plane: the set of admissible friction forces of
    each contact, and the path of its spring force; for bodies that turn both in the frame of the point's friction.

    Args:
        scene: the scene; without a drive, only its start is drawn in the domain.
        png: the file to write.

    Raises:
        SceneError: if the set is empty, because walls or other ground hold what friction on even ground does not.
    """
    if scene.body.dimension == 1 and not holds_loads(scene.drive.forward, scene.drive.backward):
        raise SceneError(
            "loads: friction on even ground does not hold them along the drive, so that there is no stasis domain; "
            "`simulate --png` draws the run"
        )
    contacts = scene.body.contacts
    run = simulated(scene, 2 if contacts == 2 else 3)
    draw = {2: draw_two, 3: draw_three}.get(contacts, draw_many)
    if scene.body.dimension == 2:
        draw = _draw_plane if scene.body.turning is None else draw_turning
    with own_style(STYLE):
        write_figure(draw(scene, run), png, 100)


def _draw_plane(scene: Plan, run: Trajectory) -> Figure:
    """Draw each contact's friction set and spring force, of at most nine contacts."""
    body, drive = scene.body, scene.drive
    rows = last_period(run)
    force = np.array([body.spring_force(t) for t in run.tension[rows]])
    if scene.columns.loads:
        targets = drive.sample(np.rint(run.time[rows] * NS).astype(np.int64))
        force = force + split_target(body, scene.directions, targets)[2]
    friction = np.unique(split_target(body, scene.directions, drive.targets)[1], axis=0)
    return draw_panels(
        scene,
        "admissible friction forces of each contact, and its spring force over the last period",
        {
            i: [_friction_outline(mu, scene.directions) for mu in friction[:MOST_SETS, i]]
            for i in range(min(body.contacts, MOST_PANELS))
        },
        "contact",
        force,
        run.contact_state[rows] != 0,
        1.1 * float(friction.max()),
        ("$g_x$ [N]", "$g_y$ [N]"),
    )


def _friction_outline(mu: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """Compute the boundary of a contact's friction set, closed, shape (V, 2) [N]."""
    if directions.shape[0] == 0:
        angle = np.linspace(0.0, 2.0 * np.pi, 181)
        return mu[0] * np.column_stack((np.cos(angle), np.sin(angle)))
    pairs = np.stack((directions, np.roll(directions, -1, axis=0)), axis=1)
    corners = np.linalg.solve(pairs, np.column_stack((mu, np.roll(mu, -1)))[..., None])[..., 0]
    return np.vstack((corners, corners[:1]))
