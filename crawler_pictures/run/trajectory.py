"""A `Trajectory` as the arrays of a page."""

from __future__ import annotations

import numpy as np

from crawler_model import Trajectory
from crawler_model.body.drive import NS
from crawler_model.body.names import name_every_contact, name_every_spring
from crawler_model.theory.stasis import stasis_bounds

from ..marks import mark_springs, own_tensions
from ..numbers import error_of, write_length
from .arrays import Gains, RunArrays, planar_forces, sort_commands


def read_trajectory(run: Trajectory) -> RunArrays:
    """Convert a run of the model to the arrays of its page.

    Args:
        run: the run.

    Returns:
        The arrays, with tensions of all springs, and with bounds on ground that is the same everywhere.
    """
    scene, body, drive = run.scene, run.scene.body, run.scene.drive
    rows = drive.sample_rows(np.rint(run.time * NS).astype(np.int64))
    target = drive.columns.target(rows)
    least = most = np.full((run.time.size, body.springs), np.nan)
    if body.is_chain and scene.ground.track is None:
        s, n = body.springs, body.contacts
        least, most = stasis_bounds(run.tension, target[:, s : s + n], target[:, s + n : s + 2 * n])
    gains = None
    turns = body.turning is not None
    notes = [f"simulated: {run.method}, {run.ticks} ticks at {run.rate:g} Hz"]
    if turns:
        notes += _describe_turning(run)
    if run.per_period.size and not turns:
        gained = run.per_period.reshape(run.per_period.shape[0], -1)[:, 0]
        gains = Gains(gained, np.zeros(gained.size, bool))
    period = drive.period
    places = body.position + run.displacement
    marks, own = np.zeros((run.time.size, 0), np.int8), np.zeros((run.time.size, 0))
    if body.bends:
        z, length = body.elongation(run.displacement), target[:, : body.springs]
        own, marks = own_tensions(body, z, length), mark_springs(body, z, length, run.tension)
    return RunArrays(
        title=scene.name,
        notes=tuple(notes),
        time=run.time,
        positions=places,
        state=run.contact_state if body.dimension == 1 else np.abs(run.contact_state),
        net_translation=run.net_translation,
        tension=run.tension[:, : body.springs],
        least=least,
        most=most,
        contacts=name_every_contact(body),
        links=name_every_spring(body)[: body.springs],
        place=body.position,
        ends=body.ends,
        commands=sort_commands(drive.columns, rows),
        cycles=np.zeros(0) if period is None else np.arange(0.0, float(run.time[-1]), period),
        gains=gains,
        jumps=run.jumps,
        scene=scene,
        force=None if turns else planar_forces(scene, run.tension, rows),
        share=body.share,
        marks=marks,
        own=own,
    )


def _describe_turning(run: Trajectory) -> list[str]:
    """Describe how a body turned, and its gain in the last period."""
    found = [f"turned by {run.yaw[-1] - run.yaw[0]:.6g} rad; tensions belong to the links"]
    if run.per_period.size:
        size, error = float(np.abs(run.displacement).max()), error_of(run.scene)
        dx, dy = (write_length(value, size, error) for value in run.per_period[-1, :2])
        turned = write_length(run.per_period[-1, 2], 1.0, 1e-6)
        found.append(f"last period: {dx} m along its heading, {dy} m to the left, turned by {turned} rad")
    return found
