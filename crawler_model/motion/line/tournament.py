"""The kinetic tournament of the next events of all contacts: node n + i is contact i, node 1 holds the earliest.

It lasts from ramp to ramp: where no contact has an event, any contact below a node may be its winner.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inlined


@inlined
def _play(contacts, node):
    """Enter the winner of a node's children in it; returns whether that changes it."""
    n = contacts.shape[0]
    a, b = 2 * node, 2 * node + 1
    a = a - n if a >= n else contacts[a].winner
    b = b - n if b >= n else contacts[b].winner
    winner = a if contacts[a].next <= contacts[b].next else b
    changed = winner != contacts[node].winner
    contacts[node].winner = winner
    return changed


def find_winners(contacts: int) -> np.ndarray:
    """Find a contact below each node.

    Args:
        contacts: number of contacts N.

    Returns:
        Shape (N,); the entry of node 0, which is none, has no meaning.
    """
    node = np.maximum(np.arange(contacts), 1)
    while (node < contacts).any():
        node = np.where(node < contacts, 2 * node, node)
    return node - contacts


@inlined
def find_earliest(contacts):
    """Return the contact with the earliest event.

    Returns:
        Its index.
    """
    return contacts[1].winner if contacts.shape[0] > 1 else 0


@inlined
def schedule(contacts, i, when):
    """Change the next event of a contact.

    Args:
        when: place of its next event on the ramp.
    """
    if contacts[i].next == when:
        return
    contacts[i].next = when
    node = (contacts.shape[0] + i) >> 1
    while node >= 1:
        held = contacts[node].winner == i
        if not _play(contacts, node) and not held:
            return
        node >>= 1
