"""The working memory for ramps of a graph of springs, and computations on it."""

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
    ROW_MAGNITUDE,
    ROW_GUESS,
    ROW_MIDDLE,
    ROW_MIDDLE_B,
    ROW_ROUNDING,
    ROW_ARRIVAL,
) = range(14)
_FLOAT_ROWS = 14
# Rows of the scratch bytes: side of a contact, bound that it approaches, bounds at which it stays; constant zeros.
ROW_SIDE, ROW_COMING, ROW_HELD, ROW_NO_STATUS = range(4)
_BYTE_ROWS = 4


def scratch(contacts: int, springs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Allocate the scratch memory for a graph.

    Args:
        contacts: number of contacts N.
        springs: number of springs S.

    Returns:
        Floats of the contacts, floats of the springs, and flags of the contacts, for `follow`.
    """
    return np.zeros((_FLOAT_ROWS, contacts)), np.zeros((2, springs)), np.zeros((_BYTE_ROWS, contacts), np.int8)


@compiled
def contact_forces(ends, tension, force):
    """Compute the force of the springs on each contact.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        tension: tensions of the springs, shape (S,) [N].
        force: output, shape (N,) [N].
    """
    for i in range(force.shape[0]):
        force[i] = 0.0
    for s in range(ends.shape[0]):
        force[ends[s, 0]] += tension[s]
        force[ends[s, 1]] -= tension[s]


@compiled
def add_load(ends, stiffness, change, load, magnitude):
    """Add the forces on the contacts due to changes of rest lengths, and the magnitudes of their terms.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: stiffness of the springs, shape (S,) [N/m].
        change: changes of the rest lengths, shape (S,) [m].
        load: forces, shape (N,) [N], added to.
        magnitude: sums of absolute values, shape (N,) [N], added to.
    """
    for s in range(ends.shape[0]):
        pull = stiffness[s] * change[s]
        load[ends[s, 0]] -= pull
        load[ends[s, 1]] += pull
        magnitude[ends[s, 0]] += abs(pull)
        magnitude[ends[s, 1]] += abs(pull)


@compiled
def displace(network, stiffness_work, floats, bytes_, rounds):
    """Call `move` with the contacts in the order of the band; lower, upper, load and magnitude are rows of floats.

    Args:
        network: order and band of the `Network`.
        stiffness_work: memory from `active_set.workspace`.
        floats: rows of this module, shape (14, N); velocities are written.
        bytes_: flags of the contacts, int8, shape (4, N); sides are written.
        rounds: upper limit of rounds of the active set.

    Returns:
        The verdict of `move`, and its number of rounds.
    """
    order, band = network
    work, kernel_floats, sliding = stiffness_work
    n = order.shape[0]
    load, lower, upper, magnitude, v = np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    side = np.empty(n, np.int8)
    for p in range(n):
        i = order[p]
        load[p], lower[p], upper[p] = floats[ROW_LOAD, i], floats[ROW_LOWER, i], floats[ROW_UPPER, i]
        magnitude[p], v[p] = floats[ROW_MAGNITUDE, i], floats[ROW_GUESS, i]
    verdict, turns = move(band, load, lower, upper, magnitude, rounds, work, kernel_floats, sliding, v, side)
    for p in range(n):
        floats[ROW_V, order[p]] = v[p]
        bytes_[ROW_SIDE, order[p]] = side[p]
    return verdict, turns
