"""Long sliding blocks of a ring, in which each contact has two springs.

The long blocks of chains (`chain.long`) also pass around a ring: their tables then have two positions for each contact,
so that a block that passes the place where the ring was numbered is a range of positions like any other. The ring is
copied into the memory of a chain whose last link leads back to the first contact, followed there from event to event,
and copied back at the end of the ramp, or at the first event that is more than contacts that start and stop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import compiled, lean
from ..chain import memory as chain
from ..chain.long.slides import displaced
from ..chain.long.solve import release_long, solve_long
from ..chain.long.tables import ENDS, tabulate
from ..chain.rates import settle, slack, update, update_tournament
from ..state import (
    BACKWARD,
    COMPLIANCE,
    CONTACT_ROWS,
    EVENTS,
    FORWARD,
    LINK_ROWS,
    LOAD,
    LOAD_CHANGE,
    LOAD_WORK,
    RELATIVE,
    STIFFNESS,
    TENSION,
    VISITED,
)
from ..tournament import begin_tournament
from ..translation import FEW_CONTACTS, FEW_FREE
from .margin import round_spring
from .memory import (
    CHANGE,
    RATE,
    ROW_ARRIVAL,
    ROW_COMING,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_FORCE,
    ROW_FORCE_RATE,
    ROW_LEAVING,
    ROW_SIDE,
    ROW_SINCE,
    ROW_V,
    SPRING_SINCE,
    contact_forces,
)

_MOST_SPAN = 1e5
"""Ratio of the largest stiffness of a ring to the least that long blocks can follow: elongations are sums of tensions
times compliances, so the energies of soft springs are known to fewer digits, at this ratio to 1e-12."""
_FAR = 1e-6
"""Part of all bounds by which the forces together are far from their bounds."""


class RingMemory(NamedTuple):
    """The order of the contacts around a ring, and memory for a ramp in that order.

    Attributes:
        order: the contacts around the ring, int, shape (N,).
        joints: the spring behind each of them, int, shape (N,).
        elasticity: rows STIFFNESS and COMPLIANCE in this order, shape (2, N), like the next four.
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, N).
        status: bits of the contacts, int8, shape (N,).
        scratch: memory of a chain, from `chain.memory.scratch`.
    """

    order: np.ndarray
    joints: np.ndarray
    elasticity: np.ndarray
    contacts: np.ndarray
    links: np.ndarray
    status: np.ndarray
    scratch: chain.Scratch


def memory(ends: np.ndarray, contacts: int) -> RingMemory | None:
    """Allocate the memory for a ring.

    Args:
        ends: the two contacts of each spring of a connected body, shape (S, 2).
        contacts: number of contacts N.

    Returns:
        The arrays; None if the body is no ring, or so short that events check all contacts.
    """
    n = contacts
    if n <= FEW_CONTACTS or n < chain.SHORTEST_LONG or len(ends) != n:
        return None
    if (np.bincount(ends.ravel(), minlength=n) != 2).any():
        return None
    return RingMemory(
        *_walk(ends),
        np.zeros((2, n)),
        np.zeros((CONTACT_ROWS, n)),
        np.zeros((LINK_ROWS, n)),
        np.zeros(n, np.int8),
        chain.scratch(n, laps=2),
    )


def _walk(ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Walk around a ring from contact 0; return its contacts, and the spring behind each of them."""
    n = len(ends)
    at = np.argsort(ends.ravel(), kind="stable").reshape(n, 2)  # both ends of springs at each contact
    order, joints = np.empty(n, np.int64), np.empty(n, np.int64)
    i, end = 0, int(at[0, 1])
    for k in range(n):
        order[k], joints[k] = i, end // 2
        far = end ^ 1
        i = int(ends.ravel()[far])
        end = int(at[i, 1] if at[i, 0] == far else at[i, 0])
    return order, joints


@lean
def _copy_in(ends, stiffness, contacts, links, status, floats, changes, bytes_, ring, s):
    """Copy a ring, updated to s, into the order around it."""
    own, own_bytes = ring.scratch.floats, ring.scratch.bytes
    for p in range(ring.order.shape[0]):
        i, j = ring.order[p], ring.joints[p]
        for row in range(CONTACT_ROWS):
            ring.contacts[row, p] = contacts[row, i]
        ring.status[p] = status[i]
        own[chain.ROW_D_FORWARD, p] = floats[ROW_D_FORWARD, i]
        own[chain.ROW_D_BACKWARD, p] = floats[ROW_D_BACKWARD, i]
        own[chain.ROW_V, p] = floats[ROW_V, i]
        own[chain.ROW_SINCE, p] = s
        own[chain.ROW_NEXT, p] = floats[ROW_ARRIVAL, i]
        own_bytes[chain.ROW_SIDE, p] = bytes_[ROW_SIDE, i]
        own_bytes[chain.ROW_LEAVING, p] = bytes_[ROW_LEAVING, i]
        own_bytes[chain.ROW_COMING, p] = bytes_[ROW_COMING, i]
        way = 1.0 if ends[j, 0] == i else -1.0
        ring.elasticity[STIFFNESS, p] = stiffness[j]
        ring.elasticity[COMPLIANCE, p] = 1.0 / stiffness[j]
        ring.links[TENSION, p] = way * links[TENSION, j]
        own[chain.ROW_D_ACTUATION, p] = way * changes[CHANGE, j]
        own[chain.ROW_RATE, p] = way * changes[RATE, j]
        own[chain.ROW_LINK_SINCE, p] = s


@lean
def _copy_back(ends, stiffness, contacts, links, status, floats, changes, bytes_, ring, lines, s):
    """Copy a ring, updated to s, back from the order around it; rates of springs at moving contacts are not known."""
    own, own_bytes = ring.scratch.floats, ring.scratch.bytes
    for p in range(ring.order.shape[0]):
        i, j = ring.order[p], ring.joints[p]
        moved = displaced(ring.contacts, lines, p)
        contacts[RELATIVE, i] += moved
        if contacts.shape[0] > CONTACT_ROWS:
            contacts[LOAD_WORK, i] += contacts[LOAD, i] * moved
        for row in range(RELATIVE):
            contacts[row, i] = ring.contacts[row, p]
        side = own_bytes[chain.ROW_SIDE, p]
        status[i] = ring.status[p]
        floats[ROW_V, i] = own[chain.ROW_V, p]
        floats[ROW_SINCE, i] = s
        floats[ROW_ARRIVAL, i] = np.inf
        if side != 0:  # that of a contact that goes on sliding is not computed again
            floats[ROW_FORCE_RATE, i] = floats[ROW_D_FORWARD, i] if side > 0 else -floats[ROW_D_BACKWARD, i]
        bytes_[ROW_SIDE, i] = side
        bytes_[ROW_LEAVING, i] = own_bytes[chain.ROW_LEAVING, p]
        links[TENSION, j] = ring.links[TENSION, p] if ends[j, 0] == i else -ring.links[TENSION, p]
        changes[SPRING_SINCE, j] = s
        changes[RATE, j] = -stiffness[j] * changes[CHANGE, j]  # as between contacts at rest
    contact_forces(ends, links[TENSION], floats[ROW_FORCE])


@lean
def _reach(ring, marks, s, p, way):
    """Count the contacts at their bounds on one side of the contact at p, at most all others."""
    n = ring.order.shape[0]
    count = 0
    while count < n:
        q = p + way * (count + 1)
        q += n if q < 0 else (-n if q >= n else 0)
        settle(ring.status, ring.scratch.floats, ring.scratch.bytes, s, q)
        if ring.status[q] == 0:
            break
        count += 1 + max(marks[ENDS, q], 0)
    return count


@lean
def _distance(ring, marks, wall, most, s):
    """Sum at s the distances of the contacts at rest from their nearest bounds, until the sum exceeds `most`.

    That takes one step for each contact at rest, of which `wall` is one, and for each block between them.
    """
    n = ring.order.shape[0]
    near = 0.0
    i = wall
    while i < wall + n and near <= most:
        p = i if i < n else i - n
        if ring.scratch.bytes[chain.ROW_SIDE, p] == 0:
            above, below = slack(ring.contacts, ring.links, ring.scratch.floats, s, p)
            near += abs(min(above, below))
        i += 1 + max(marks[ENDS, p], 0)
    return near


@lean
def _may_slide_at_once(ring, marks, wall, far, s):
    """Return whether all contacts may be at their bounds from s to the end of the ramp; `margin` decides if they are.

    A distance from the nearest bound is concave in s and never negative: if it vanishes at two later places, it
    vanishes from here on.
    """
    if _distance(ring, marks, wall, far, s) > far or _distance(ring, marks, wall, far, s + (1.0 - s) / 3.0) > far:
        return False
    return _distance(ring, marks, wall, far, s + (1.0 - s) / 1.5) <= far


@lean
def _blur(ends, stiffness, contacts, links, changes):
    """Compute the largest rounding error of the force on a contact."""
    most = 0.0
    for j in range(stiffness.shape[0]):
        most = max(most, round_spring(stiffness, contacts, links, changes, j, ends[j, 0], ends[j, 1]))
    return 2.0 * most


@lean
def _take_event(ring, tree, leaves, account, lines, nodes, marks, order, parts, hits, wall, s):
    """Solve for the rates after all contacts that reach a bound at s have reached it.

    Returns whether that succeeded, by how much the number of free contacts grew, the work, and a contact at rest;
    before, that is `wall`.
    """
    n = ring.order.shape[0]
    floats, bytes_ = ring.scratch.floats, ring.scratch.bytes
    count = 0
    simple = True
    while tree[2] <= s:
        p = int(tree[3])
        settle(ring.status, floats, bytes_, s, p)
        simple &= bytes_[chain.ROW_LEAVING, p] == 0
        ring.status[p] |= bytes_[chain.ROW_COMING, p]
        floats[chain.ROW_NEXT, p] = np.inf
        update_tournament(tree, leaves, floats, p)
        hits[count] = p
        count += 1
    if not simple:
        return False, 0, 0, wall
    freed = 0
    spent = 0
    for k in range(count):
        p = int(hits[k])
        if bytes_[chain.ROW_SIDE, p] != 0 or bytes_[chain.ROW_LEAVING, p] != 0:
            continue  # solved together with one before
        before = _reach(ring, marks, s, p, -1)
        behind = _reach(ring, marks, s, p, 1)
        if before + behind + 1 >= n:
            return False, freed, spent, wall
        contact = p if p > before else p + n
        solved, more, effort = solve_long(
            ring.elasticity,
            ring.contacts,
            ring.links,
            ring.status,
            floats,
            bytes_,
            tree,
            leaves,
            account,
            lines,
            nodes,
            marks,
            order,
            parts,
            0,
            s,
            contact - before,
            contact + behind,
            contact,
        )
        freed += more
        spent += effort
        if not solved:
            return False, freed, spent, wall
        wall = (contact - before - 1) % n
    return True, freed, spent, wall


@lean
def can_follow(contacts, target, springs, ring, stiffness):
    """Check whether long blocks can follow a ramp of a ring.

    Args:
        contacts: rows X .. RELATIVE, shape (6, N).
        target: L, mu_plus and mu_minus at the ramp's end, shape (S + 2 N,) [m, N].
        springs: number of springs S.
        ring: a `RingMemory`.
        stiffness: stiffness of the springs, shape (S,) [N/m].

    Returns:
        True if its stiffness does not span too many decades, no contact is without friction anywhere on the ramp, and
        loads do not change on it.
    """
    n = ring.order.shape[0]
    least = np.inf
    most = 0.0
    for i in range(n):
        least = min(least, stiffness[i])
        most = max(most, stiffness[i])
        if not contacts[FORWARD, i] + contacts[BACKWARD, i] > 0.0:
            return False
        if not target[springs + i] + target[springs + n + i] > 0.0:
            return False
        if contacts.shape[0] > CONTACT_ROWS and contacts[LOAD_CHANGE, i] != 0.0:
            return False
    return most <= _MOST_SPAN * least


@compiled
def follow_ring(ends, stiffness, contacts, links, status, floats, changes, bytes_, account, ring, budget, s):
    """Follow a ring from s on, where all contacts and springs are updated and all rates are known.

    Args:
        ends: the two contacts of each spring, shape (N, 2).
        stiffness: stiffness of the springs, shape (N,) [N/m].
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        links: row TENSION is changed in place, shape (5, N).
        status: bits of the contacts, changed in place.
        floats: memory of the ramp, changed in place.
        changes: rates of the springs, changed in place.
        bytes_: sides and events, changed in place.
        account: account of the ramp, added to.
        ring: a `RingMemory`.
        budget: upper limit of work.
        s: place on the ramp, 0 .. 1.

    Returns:
        The place that was reached, 1 for the end of the ramp. Elsewhere all is updated to it, but rates and events are
        not known. Then the work, in contacts.
    """
    n = ring.order.shape[0]
    far = 4.0 * _blur(ends, stiffness, contacts, links, changes)
    _copy_in(ends, stiffness, contacts, links, status, floats, changes, bytes_, ring, s)
    own, own_bytes, tree = ring.scratch.floats, ring.scratch.bytes, ring.scratch.tree
    leaves = 1
    while leaves < n:
        leaves *= 2
    lines, nodes, order, marks, parts = chain.carve(ring.scratch.long_floats, ring.scratch.long_ints)
    tabulate(ring.elasticity[COMPLIANCE], ring.contacts, ring.links, own, lines, nodes, marks, s)
    begin_tournament(tree, leaves, own[chain.ROW_NEXT])
    free = 0
    wall = -1
    start = 0.0
    end = 0.0
    for p in range(n):
        if own_bytes[chain.ROW_SIDE, p] == 0:
            free += 1
            wall = p
        bounds = ring.contacts[FORWARD, p] + ring.contacts[BACKWARD, p]
        start += bounds
        end += bounds + (own[chain.ROW_D_FORWARD, p] + own[chain.ROW_D_BACKWARD, p])
    far += _FAR * (start + end)
    spent = 0
    while free > 0 and spent <= budget:
        if free <= FEW_FREE:
            near = _distance(ring, marks, wall, np.inf, s)
            account[VISITED] = min(account[VISITED], near / (start + s * (end - start)))
        if _may_slide_at_once(ring, marks, wall, far, s):
            break
        when = min(tree[2], 1.0)
        account[EVENTS] += when > s
        s = when
        if s == 1.0:
            break
        solved, freed, effort, wall = _take_event(
            ring, tree, leaves, account, lines, nodes, marks, order, parts, tree[4 * leaves :], wall, s
        )
        free += freed
        spent += effort
        if not solved:
            break
    for p in range(n):
        settle(ring.status, own, own_bytes, s, p)
    release_long(ring.contacts, ring.links, own, own_bytes, account, lines, nodes, marks, s, True)
    update(ring.contacts, ring.links, own, account, s, 0, n - 1)
    _copy_back(ends, stiffness, contacts, links, status, floats, changes, bytes_, ring, lines, s)
    return s, spent
