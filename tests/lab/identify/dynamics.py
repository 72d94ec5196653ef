"""Robots with masses, viscous friction, or friction that is larger at rest, stepped through time.

The theta method of Moreau and Jean with theta = 1/2: in each step the velocities at its end balance all forces, with
exact friction. Nothing of it is shared with the model.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

_STEP = 5e-4
_SLOW = 2e-3
"""Speed at which friction has nearly fallen to that of sliding [m/s]."""


def step(
    document: dict[str, Any],
    times: np.ndarray,
    rows: np.ndarray,
    rate: float,
    mass: float = 2e-3,
    viscosity: float = 0.0,
    static: float = 0.0,
    damping: float = 0.1,
) -> tuple[np.ndarray, np.ndarray]:
    """Step a chain through its commands.

    Args:
        document: the chain, as `build_robot` draws it.
        times: of the commands, shape (K,) [s].
        rows: the commands, shape (K, N - 1) [m].
        rate: of the positions [1/s].
        mass: of each contact [kg].
        viscosity: force of each contact for each speed [N s/m].
        static: by how much more than sliding friction holds a contact that rests [1].
        damping: of the links, relative to the critical damping of two contacts [1].

    Returns:
        The times, shape (T,) [s], and the displacements there, shape (T, N) [m].
    """
    stiffness = np.array(document["body"]["links"]["stiffness"])
    forward, backward = (np.array(document["friction"][side]) for side in ("forward", "backward"))
    every = round(1.0 / (rate * _STEP))
    at = np.arange(round(times[-1] / _STEP) + 1) * _STEP
    lengths = np.stack([np.interp(at, times, column) for column in rows.T], axis=1)
    ends = np.diff(np.eye(forward.size), axis=0)
    spring = ends.T @ (stiffness[:, None] * ends)
    dashpots = 2.0 * damping * np.sqrt(0.5 * stiffness * mass)
    viscous = ends.T @ (dashpots[:, None] * ends) + viscosity * np.eye(forward.size)
    x = _step(mass, spring, viscous, (lengths * stiffness) @ ends, forward, backward, static, every)
    return at[::every], x


@numba.njit(cache=False)
def _step(mass, spring, viscous, force, forward, backward, static, every):  # type: ignore[no-untyped-def]
    n, h = forward.size, _STEP
    matrix = mass * np.eye(n) + 0.5 * h * viscous + 0.25 * h * h * spring
    x, v, shown = np.zeros(n), np.zeros(n), np.zeros((1 + (force.shape[0] - 1) // every, n))
    for k in range(force.shape[0] - 1):
        old = v.copy()
        right = mass * v + h * (0.5 * (force[k] + force[k + 1]) - spring @ (x + 0.25 * h * v) - 0.5 * viscous @ v)
        for _ in range(200):  # Gauss and Seidel
            change = 0.0
            for i in range(n):
                rest = right[i] - matrix[i] @ v + matrix[i, i] * v[i]
                more = h * (1.0 + static * np.exp(-abs(old[i]) / _SLOW))
                new = max(rest - more * forward[i], 0.0) + min(rest + more * backward[i], 0.0)
                new /= matrix[i, i]
                change = max(change, abs(new - v[i]))
                v[i] = new
            if change < 1e-12:
                break
        x += 0.5 * h * (old + v)
        if (k + 1) % every == 0:
            shown[(k + 1) // every] = x
    return shown
