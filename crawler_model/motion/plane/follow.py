"""Ramps of the commands in the plane, one after the other."""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from ..state import PLANAR_GAINED as GAINED
from ..state import PLANAR_TENSION as TENSION
from ..state import PLANAR_X as X
from ..state import PLANAR_X_REST as X_REST
from ..state import record_spent
from .cone import solve_with_clarabel
from .implicit_step import MOST_SWEEPS, project_planar
from .parts.follow import LARGE, follow_in_parts
from .ramp import follow_ramp, is_still
from .springs import Springs, laplacian_of
from .walk import KNOWN, LENGTH, NOT_UNIQUE, PATIENCE, PLACE, RAMP, STAGES

_PATIENCE = 16.0
"""Substeps of a large body after which a ramp goes on in parts, if it can; after each failure twice as many."""
_LAST_SWEEPS = 20
"""Sweeps that refine the solution of Clarabel."""


@compiled
def _follow(
    springs, directions, contacts, links, friction, targets, tolerance, most_steps, account, records, progress, *memory
):
    """Follow the ramps from the place in `progress`; return False if a step has to be solved by the caller."""
    n = friction.shape[0]
    body = springs, directions, contacts, links, friction
    first = _PATIENCE if n >= LARGE else np.inf
    patience = first
    while progress[RAMP] < targets.shape[0]:
        v = int(progress[RAMP])
        limits = targets[v], tolerance, most_steps, account
        if progress[LENGTH] == 0.0:  # a new ramp
            progress[PLACE] = is_still(links, friction, contacts, targets[v])
            progress[PATIENCE] = patience = first
        while progress[PLACE] < 1.0:
            if not follow_ramp(*body, *limits, progress, *memory):
                return False
            if progress[PLACE] < 1.0:
                rest = 1.0 - progress[PLACE]
                followed = follow_in_parts(*body, targets[v], tolerance * rest, most_steps, account, memory[0])
                progress[PLACE] = 1.0 if followed == 1.0 else progress[PLACE] + followed * rest
                patience = first if followed > 0.0 else 2.0 * patience
                progress[PATIENCE] = patience
        progress[LENGTH] = 0.0
        if records.shape[0] > 0:
            records[v, : 2 * n] = contacts[X].ravel()
            records[v, 2 * n : 4 * n] = contacts[X_REST].ravel()
            written = 4 * n + 2 * links.shape[1]
            records[v, 4 * n : written] = links[TENSION].ravel()
            if records.shape[1] > written:
                record_spent(account, records[v])
        progress[RAMP] += 1.0
    return True


def follow(
    springs: Springs,
    directions: np.ndarray,
    contacts: np.ndarray,
    links: np.ndarray,
    friction: np.ndarray,
    targets: np.ndarray,
    tolerance: float,
    most_steps: int,
    account: np.ndarray,
    records: np.ndarray,
) -> None:
    """Follow straight ramps of the commands to each of the targets in turn.

    Args:
        springs: the springs of the body, from `build_springs`.
        directions: unit vectors d_k, counterclockwise, shape (m, 2); m = 0 for isotropic friction.
        contacts: rows X, X_REST (the rounding rest of X) and GAINED (since the call) [m], and with loads LOAD [N],
            shape (3, n, 2) or (4, n, 2), changed in place.
        links: rows TENSION [N] and ACTUATION [m], shape (2, S, 2), changed in place; the tension must be
            k (x_b - x_a - L), and is recomputed from displacements and their rests after every substep.
        friction: mu, shape (n, max(m, 1)) [N], changed in place.
        targets: L, mu and with loads the loads at each ramp's end, flattened, shape (V, 2 S + n max(m, 1) [+ 2 n]).
        tolerance: approximate largest displacement error per ramp [m].
        most_steps: upper limit of implicit steps tried in one ramp; equal steps then complete it.
        account: total account, shape (14,), added to.
        records: output: x, its rest and tension after each ramp, flattened, shape (V, 4 n + 2 S), or no rows.
    """
    n = contacts.shape[1]
    contacts[GAINED] = 0.0
    progress = np.zeros(NOT_UNIQUE + STAGES)
    stages, motions = np.zeros((STAGES, n, 2)), np.zeros((STAGES, n), np.int64)
    problem = np.empty((n, 2 + friction.shape[1]))
    memory = (MOST_SWEEPS, stages, motions, problem)
    state = (directions, contacts, links, friction, targets, tolerance, most_steps, account, records, progress)
    while not _follow(springs, *state, *memory):
        stage = int(progress[KNOWN])
        spring, mu = problem[:, :2].copy(), problem[:, 2:].copy()
        stages[stage] = solve_with_clarabel(laplacian_of(springs.ends, springs.stiffness, n), spring, mu, directions)
        unique = project_planar(springs, spring, mu, directions, _LAST_SWEEPS, stages[stage], motions[stage])[2]
        progress[KNOWN] = stage + 1
        progress[NOT_UNIQUE + stage] = not unique
