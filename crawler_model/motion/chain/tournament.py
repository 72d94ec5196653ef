"""The tournament of the next events of the contacts of a chain."""

from __future__ import annotations

from ...compiled import compiled
from .memory import ROW_ENTERED, ROW_NEXT


@compiled
def sooner(next_event, a, b):
    """Choose the contact with the earlier event.

    Args:
        next_event: place of the next event of each contact, shape (N,).
        a: a contact, or -1 for none.
        b: another one, or -1.

    Returns:
        The one with the earlier event.
    """
    if a < 0:
        return b
    if b < 0:
        return a
    return a if next_event[a] <= next_event[b] else b


@compiled
def update_tournament(tree, leaves, floats, i):
    """Update the tournament after the next event of contact i has changed.

    Args:
        tree: the tournament, a heap with the winners, changed in place.
        leaves: number of leaves, a power of two.
        floats: rows ROW_NEXT, and ROW_ENTERED, which is changed in place.
        i: the contact.
    """
    if floats[ROW_NEXT, i] == floats[ROW_ENTERED, i]:
        return
    floats[ROW_ENTERED, i] = floats[ROW_NEXT, i]
    node = (leaves + i) >> 1
    while node >= 1:
        tree[node] = sooner(floats[ROW_NEXT], tree[2 * node], tree[2 * node + 1])
        node >>= 1
