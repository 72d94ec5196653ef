"""The division of a body in the plane into parts that contacts at rest separate from each other."""

from __future__ import annotations

import numpy as np

from ....compiled import compiled, lean
from ..friction import STUCK, corners_of, excess
from ..springs import Springs

_LAYERS = 4
"""Least number of layers of contacts at rest around those that move."""


@compiled
def mark_beyond(force, friction, directions, part, marked):
    """Mark the contacts whose force is beyond a part of their friction.

    Args:
        force: shape (n, 2) [N].
        friction: mu, shape (n, max(m, 1)) [N].
        directions: unit vectors, shape (m, 2).
        part: the part.
        marked: output, bool, shape (n,).

    Returns:
        How many these are.
    """
    corners = corners_of(friction, directions)
    count = 0
    for i in range(force.shape[0]):
        motion, _, _ = excess(force[i, 0] / part, force[i, 1] / part, friction[i], directions, corners[i], 0.0)
        marked[i] = motion != STUCK
        count += marked[i]
    return count


@compiled
def spread(springs, ready, moving):
    """Add to the moving contacts all that are connected with them through contacts that are ready to move.

    Args:
        springs: the springs.
        ready: contacts whose force is on its bound, bool, shape (n,).
        moving: changed in place, bool, shape (n,).

    Returns:
        How many contacts are marked as moving.
    """
    queue = np.empty(moving.shape[0], np.int64)
    count = 0
    for i in range(moving.shape[0]):
        if moving[i]:
            queue[count] = i
            count += 1
    done = 0
    while done < count:
        i = queue[done]
        done += 1
        for e in range(springs.first[i] + 1, springs.first[i + 1]):
            j = springs.other[e]
            if ready[j] and not moving[j]:
                moving[j] = True
                queue[count] = j
                count += 1
    return count


@lean
def _root_of(parent, i):
    """Find the representative of the set of a contact."""
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@compiled
def divide(springs, moving, owner):
    """Assign contacts to parts: those that move, and around them half as many layers at rest, and some more.

    Moving contacts with no more than one contact between them are in the same part.

    Args:
        springs: the springs.
        moving: the contacts that move, bool, shape (n,).
        owner: output: a moving contact of its part, the same for all of the part; -1 outside, int64, shape (n,).
    """
    n = moving.shape[0]
    parent = np.arange(n)
    for j in range(n):
        joined = -1
        for e in range(springs.first[j], springs.first[j + 1]):
            if moving[springs.other[e]]:
                root = _root_of(parent, springs.other[e])
                if joined >= 0:
                    parent[root] = joined
                else:
                    joined = root
    size = np.zeros(n, np.int64)
    layer = np.zeros(n, np.int64)
    queue = np.empty(n, np.int64)
    count = 0
    for i in range(n):
        owner[i] = -1
        if moving[i]:
            owner[i] = _root_of(parent, i)
            size[owner[i]] += 1
            queue[count] = i
            count += 1
    done = 0
    while done < count:
        i = queue[done]
        done += 1
        if layer[i] >= _LAYERS + size[owner[i]] // 2:
            continue
        for e in range(springs.first[i] + 1, springs.first[i + 1]):
            j = springs.other[e]
            if owner[j] < 0:
                owner[j] = owner[i]
                layer[j] = layer[i] + 1
                queue[count] = j
                count += 1


@compiled
def sort_by(keys, items, n):
    """Sort items by their keys.

    Args:
        keys: the key of each item, 0 .. n - 1, or -1 for items to leave out.
        items: numbers of the items, in the order in which those of the same key shall stay.
        n: number of keys.

    Returns:
        The items, and where those of each key begin, shape (n + 1,).
    """
    begin = np.zeros(n + 1, np.int64)
    for item in items:
        if keys[item] >= 0:
            begin[keys[item] + 1] += 1
    for k in range(n):
        begin[k + 1] += begin[k]
    place = begin[:n].copy()
    found = np.empty(begin[n], np.int64)
    for item in items:
        if keys[item] >= 0:
            found[place[keys[item]]] = item
            place[keys[item]] += 1
    return found, begin


@compiled
def springs_between(springs, members, strings, owner):
    """Build the springs of a part, tied to the contacts at rest around it.

    Args:
        springs: the springs of the body.
        members: the contacts of the part, in the order of the springs.
        strings: the springs between them.
        owner: the part of each contact, shape (n,).

    Returns:
        The springs.
    """
    m = members.shape[0]
    local = np.empty(owner.shape[0], np.int64)
    tied = np.empty(m, np.int64)
    outermost = 0
    entries = 0
    for a in range(m):
        local[members[a]] = a
        entries += springs.first[members[a] + 1] - springs.first[members[a]]
    first = np.empty(m + 1, np.int64)
    other = np.empty(entries, np.int64)
    entry = np.empty(entries)
    count = 0
    for a in range(m):
        i = members[a]
        first[a] = count
        for e in range(springs.first[i], springs.first[i + 1]):
            if owner[springs.other[e]] == owner[i]:
                other[count] = local[springs.other[e]]
                entry[count] = springs.entry[e]
                count += 1
        if count - first[a] < springs.first[i + 1] - springs.first[i]:
            tied[outermost] = a
            outermost += 1
    first[m] = count
    ends = np.empty((strings.shape[0], 2), np.int64)
    stiffness = np.empty(strings.shape[0])
    for b in range(strings.shape[0]):
        ends[b, 0] = local[springs.ends[strings[b], 0]]
        ends[b, 1] = local[springs.ends[strings[b], 1]]
        stiffness[b] = springs.stiffness[strings[b]]
    row = other[:count], entry[:count]
    return Springs(ends, stiffness, first, *row, np.arange(m), springs.compliance, tied[:outermost])
