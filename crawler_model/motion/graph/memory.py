"""The working memory for ramps of a graph of springs, and computations on it."""

from __future__ import annotations

import numpy as np

from ...compiled import inlined, lean
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
    ROW_MIDDLE,
    ROW_MIDDLE_B,
    ROW_ARRIVAL,
    ROW_SINCE,
    ROW_BEFORE,  # RELATIVE at the start of the ramp
    # in the order of the band
    _PLACED_LOAD,
    _PLACED_LOWER,
    _PLACED_UPPER,
    _PLACED_MAGNITUDE,
    _PLACED_V,
) = range(19)
_FLOAT_ROWS = 19
# Rows of the scratch bytes: side of a contact, bound that it approaches, bounds that it leaves; constant zeros; whether
# it slid, and its side, at the end of the ramp; sides in the order of the band.
ROW_SIDE, ROW_COMING, ROW_LEAVING, ROW_NO_STATUS, ROW_LAST, _PLACED_SIDE = range(6)
_BYTE_ROWS = 6
# Rows of the changes of the springs: of the rest lengths along the ramp; rates of the tensions, or the tensions of a
# catch-up step; the place on the ramp since which the rates hold.
CHANGE, RATE, SPRING_SINCE = range(3)
_CHANGE_ROWS = 3
# Rows of the lists: marks of the contacts, two rows, see `find_block`; contacts of a block; contacts of an event;
# positions of a block; constant: all positions.
ROW_MARKS, ROW_QUEUE, ROW_HITS, ROW_PLACES, ROW_ALL = 0, 2, 3, 4, 5
_LIST_ROWS = 6


def scratch(contacts: int, springs: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Allocate the scratch memory for a graph.

    Args:
        contacts: number of contacts N.
        springs: number of springs S.

    Returns:
        Floats of the contacts, floats of the springs, flags of the contacts, the tournament of their next events, and
        lists of them, for `follow`. They are allocated once, as ramps of small bodies take no longer than allocations.
    """
    lists = np.zeros((_LIST_ROWS, contacts + 1), np.int64)
    lists[ROW_ALL] = np.arange(contacts + 1)
    return (
        np.zeros((_FLOAT_ROWS, contacts)),
        np.zeros((_CHANGE_ROWS, springs)),
        np.zeros((_BYTE_ROWS, contacts), np.int8),
        np.zeros(4 << max(contacts - 1, 1).bit_length()),
        lists,
    )


@lean
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


@lean
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


@inlined
def displace(network, stiffness_work, floats, bytes_, rounds, places):
    """Call `move` with the contacts in the order of the band; lower, upper, load and magnitude are rows of floats.

    Args:
        network: layout and conductances of the `Network`.
        stiffness_work: memory from `GraphMotion.scratch`.
        floats: rows of this module, shape (19, N); velocities are changed.
        bytes_: flags of the contacts, int8, shape (6, N); sides are changed.
        rounds: upper limit of rounds of the active set.
        places: positions of the contacts to solve for, as for `move`.

    Returns:
        The verdict of `move`, and its number of rounds.
    """
    layout, conductances = network
    order = layout[0]
    load, lower, upper, magnitude = (
        floats[_PLACED_LOAD],
        floats[_PLACED_LOWER],
        floats[_PLACED_UPPER],
        floats[_PLACED_MAGNITUDE],
    )
    v, side = floats[_PLACED_V], bytes_[_PLACED_SIDE]
    for p in places:
        i = order[p]
        load[p], lower[p], upper[p] = floats[ROW_LOAD, i], floats[ROW_LOWER, i], floats[ROW_UPPER, i]
        magnitude[p], v[p], side[p] = floats[ROW_MAGNITUDE, i], floats[ROW_V, i], bytes_[ROW_SIDE, i]
    work, rows, ints, sliding, _ = stiffness_work
    net = (conductances, *layout[5:])
    verdict, turns = move(net, load, lower, upper, magnitude, rounds, work, rows, ints, sliding, v, side, places)
    for p in places:
        floats[ROW_V, order[p]] = v[p]
        bytes_[ROW_SIDE, order[p]] = side[p]
    return verdict, turns
