"""Labels of the pictures of stasis domains, and the choice of the instants that they show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from crawler_model import Trajectory, simulate
from crawler_model.body.drive import NS
from crawler_model.body.plan import Plan
from crawler_model.theory.stasis import StasisDomain, directions_of, domain_evolution, section_forces

from .numbers import shorten

STYLE: dict[Any, Any] = {"font.size": 9, "axes.titlesize": 9, "mathtext.fontset": "dejavusans"}
"""matplotlib settings of these pictures."""
FACE, SECTION = "#f2dcda", "#e0605a"
_MOST_PANELS, MOST_TIMES, MOST_BARS = 6, 16, 40
_SAMPLES, _MOST_SAMPLES = 1200, 4_000_000
TRANSLATION = {1: r"$v_m \geq 0$", -1: r"$v_m \leq 0$"}


def section_path(scene: Plan, tension: np.ndarray) -> np.ndarray:
    """Compute the section forces of a run, shape (T, N - 1) [N]: in a chain they are the tensions themselves."""
    return tension if scene.body.is_chain else section_forces(scene.body.spring_force(tension))


def simulated(scene: Plan, periods: int) -> Trajectory:
    """Run a few periods of the drive, or all of a drive without a period."""
    drive = scene.drive
    span = float(drive.times[-1]) if drive.period is None else drive.period * periods
    if span == 0.0:
        return simulate(scene, 0.0)
    ticks = int(np.clip(_MOST_SAMPLES / scene.body.contacts, 8 * periods, _SAMPLES * periods))
    return simulate(scene, span, float(np.clip(ticks / span, 1e-9, 1e9)))


def last_period(run: Trajectory) -> np.ndarray:
    """Find the rows of a run's last period, or all of them."""
    period = run.scene.drive.period
    return np.flatnonzero(run.time >= (0.0 if period is None else run.time[-1] - period * (1.0 + 1e-9)))


def is_constant(scene: Plan) -> bool:
    """Return whether friction is constant."""
    drive = scene.drive
    return not (np.ptp(drive.forward, axis=0).any() or np.ptp(drive.backward, axis=0).any())


def shown_waypoints(scene: Plan) -> list[tuple[float, StasisDomain]]:
    """Choose the waypoints whose domains are drawn: one if friction is constant, else at most six."""
    times, domains = domain_evolution(scene.drive)
    if is_constant(scene):
        return [(0.0, domains[0])]
    period = scene.drive.period
    rows = [i for i in range(len(domains)) if period is None or times[i] < period]
    if len(rows) > _MOST_PANELS:
        rows = [rows[len(rows) * i // _MOST_PANELS] for i in range(_MOST_PANELS)]
    return [(float(times[i]), domains[i]) for i in rows]


def friction_at(scene: Plan, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Interpolate the friction that a scene commands.

    Args:
        scene: a body on a line.
        time_s: times, shape (T,) [s].

    Returns:
        mu_plus and mu_minus, linear between waypoints, each of shape (T, N) [N].
    """
    springs, contacts = scene.body.springs, scene.body.contacts
    targets = scene.drive.sample(np.rint(time_s * NS).astype(np.int64))
    return targets[:, springs:][:, :contacts], targets[:, springs + contacts :][:, :contacts]


def title(scene: Plan) -> str:
    """Name a picture, and the ground that its domain belongs to."""
    name = shorten(scene.name, 45).replace("$", r"\$")  # it may stand next to formulas
    where = scene.ground.even_part
    return f"stasis domain: {name}" + (f", {where}" if where else "")


def verdict(domains: Sequence[StasisDomain]) -> str:
    """Describe the possible directions of motion."""
    directions = directions_of(domains)
    if directions == {1, -1}:
        return "forward and backward motion are both possible"
    if directions:
        return f"only {'forward' if directions == {1} else 'backward'} motion is possible"
    return "no facet: at the boundary several contacts are at their bounds at once"


def symbol(scene: Plan) -> str:
    """Return the symbol: T for the tension of a link, Q for the force through a section."""
    return "T" if scene.body.is_chain else "Q"


def quantity(scene: Plan) -> str:
    """Return the name of the quantity drawn: in a chain sections and links are the same."""
    return "tension" if symbol(scene) == "T" else "section force"


def label_of(scene: Plan, section: int) -> str:
    """Return the axis label of a section force."""
    if scene.body.segments:
        place = float(scene.body.position[section : section + 2].mean())
        return f"{quantity(scene)} at {place:.3g} m [N]  (> 0: stretched)"
    return f"{quantity(scene)} ${symbol(scene)}_{{{section}}}$ [N]  (> 0: stretched)"
