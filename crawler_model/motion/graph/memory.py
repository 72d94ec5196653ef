"""The memory in which ramps of a graph of springs are followed, and what is computed in it."""

from __future__ import annotations

import numpy as np

from ...compiled import compiled
from .active_set import move

# Rows of the scratch floats.
(
    ROW_D_FORWARD,
    ROW_D_BACKWARD,
    ROW_V,
    ROW_FORCE,
    ROW_FORCE_RATE,
    ROW_LOAD,
    ROW_LOWER,
    ROW_UPPER,
    ROW_GRAIN,
    ROW_GUESS,
    ROW_MIDDLE,
    ROW_MIDDLE_B,
    ROW_ROUNDING,
) = range(13)
_FLOAT_ROWS = 13


def scratch(contacts: int, springs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Make the scratch memory for a graph.

    Args:
        contacts: number of contacts N.
        springs: number of springs S.

    Returns:
        Floats of the contacts, floats of the springs, and flags of the contacts, as `follow` takes them.
    """
    return np.zeros((_FLOAT_ROWS, contacts)), np.zeros((2, springs)), np.zeros((3, contacts), np.int8)


@compiled
def contact_forces(ends, tension, force):
    """Compute the force of the springs on each contact.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        tension: of the springs, shape (S,) [N].
        force: output, shape (N,) [N].
    """
    for i in range(force.shape[0]):
        force[i] = 0.0
    for s in range(ends.shape[0]):
        force[ends[s, 0]] += tension[s]
        force[ends[s, 1]] -= tension[s]


@compiled
def add_load(ends, stiffness, change, load, grain):
    """Add the force on each contact when the springs' rest lengths change, and its numbers' size.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: of the springs, shape (S,) [N/m].
        change: of the rest lengths, shape (S,) [m].
        load: added to, shape (N,) [N].
        grain: likewise, sums of absolute values.
    """
    for s in range(ends.shape[0]):
        pull = stiffness[s] * change[s]
        load[ends[s, 0]] -= pull
        load[ends[s, 1]] += pull
        grain[ends[s, 0]] += abs(pull)
        grain[ends[s, 1]] += abs(pull)


@compiled
def displace(network, stiffness_work, floats, bytes_, rounds):
    """Call `move` with the contacts in the order of the band; lower, upper, load and grain are rows of floats.

    Args:
        network: order and band of `graph_kernel`.
        stiffness_work: its memory.
        floats: rows of this module, shape (13, N); velocities are written.
        bytes_: sides of the contacts, int8, shape (1, N), written.
        rounds: most rounds of the active set.

    Returns:
        The verdict of `move`, and its rounds.
    """
    order, band = network
    work, kernel_floats, sliding = stiffness_work
    n = order.shape[0]
    load, lower, upper, grain, v = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    side = np.empty(n, np.int8)
    for p in range(n):
        i = order[p]
        load[p], lower[p], upper[p] = floats[ROW_LOAD, i], floats[ROW_LOWER, i], floats[ROW_UPPER, i]
        grain[p], v[p] = floats[ROW_GRAIN, i], floats[ROW_GUESS, i]
    verdict, turns = move(band, load, lower, upper, grain, rounds, work, kernel_floats, sliding, v, side)
    for p in range(n):
        floats[ROW_V, order[p]] = v[p]
        bytes_[0, order[p]] = side[p]
    return verdict, turns
