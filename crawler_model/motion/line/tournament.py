"""The kinetic tournament of the next events of all contacts: node n + i is contact i, node 1 holds the earliest."""

from __future__ import annotations

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


@inlined
def begin_tournament(contacts):
    """Find the winners of all nodes."""
    for node in range(contacts.shape[0] - 1, 0, -1):
        _play(contacts, node)


@inlined
def find_earliest(contacts):
    """Return the contact with the earliest event.

    Returns:
        Its index.
    """
    return contacts[1].winner if contacts.shape[0] > 1 else 0


@inlined
def schedule(contacts, i, when, begun):
    """Change the next event of a contact.

    Args:
        when: place of its next event on the ramp.
        begun: whether the tournament has begun.
    """
    if contacts[i].next == when:
        return
    contacts[i].next = when
    node = (contacts.shape[0] + i) >> 1
    while begun and node >= 1:
        held = contacts[node].winner == i
        if not _play(contacts, node) and not held:
            return
        node >>= 1
