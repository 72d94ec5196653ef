"""The tournament of the next events of all contacts: which is the first, after a few of them have changed."""

from __future__ import annotations

import numpy as np

from ..compiled import lean


@lean
def _play(tree, node):
    """Enter the winner of a node's children in it; returns whether that changes it."""
    child = 4 * node if tree[4 * node] <= tree[4 * node + 2] else 4 * node + 2
    place = 2 * node
    if tree[child] == tree[place] and tree[child + 1] == tree[place + 1]:
        return False
    tree[place] = tree[child]
    tree[place + 1] = tree[child + 1]
    return True


@lean
def begin_tournament(tree, leaves, places):
    """Enter the next events of all contacts in a tournament.

    Args:
        tree: the tournament, a heap with the place of the event and the contact of each winner, the root at 2 and 3,
            shape (4 M,); changed in place.
        leaves: number of its leaves M, a power of two.
        places: place of the next event of each contact, shape (N,).
    """
    n = places.shape[0]
    for i in range(leaves):
        place = 2 * (leaves + i)
        tree[place] = places[i] if i < n else np.inf
        tree[place + 1] = i
    for node in range(leaves - 1, 0, -1):
        _play(tree, node)


@lean
def enter_event(tree, leaves, place, i):
    """Enter another next event of contact i in a tournament.

    Args:
        tree: the tournament, from `begin_tournament`, changed in place.
        leaves: number of its leaves.
        place: place of the event.
        i: the contact.
    """
    node = leaves + i
    if tree[2 * node] == place:
        return
    tree[2 * node] = place
    node >>= 1
    while node >= 1 and _play(tree, node):
        node >>= 1
