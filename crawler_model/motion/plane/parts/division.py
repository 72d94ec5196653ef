"""The division of a body in the plane into parts that contacts at rest separate from each other."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ....compiled import compiled, lean
from ..frame import Frame, friction_of
from ..polygon import gap_in

_LAYERS = 4
"""Least number of layers of contacts at rest around those that move."""


class Neighbours(NamedTuple):
    """The contacts that springs join to each contact.

    Attributes:
        first: where the row of each contact begins, itself in front, int64, shape (n + 1,).
        other: the contact of each entry, int64, shape (E,).
    """

    first: np.ndarray
    other: np.ndarray


@compiled
def list_neighbours(ends, n):
    """List the neighbours of each contact.

    Args:
        ends: the contacts of each spring, int64, shape (S, 2).
        n: number of contacts.

    Returns:
        The neighbours.
    """
    first = np.zeros(n + 1, np.int64)
    for s in range(ends.shape[0]):
        for e in range(2):
            first[ends[s, e] + 1] += 1
    for i in range(n):
        first[i + 1] += first[i] + 1
    place = first[:n].copy()
    other = np.empty(first[n], np.int64)
    for i in range(n):
        other[place[i]] = i
        place[i] += 1
    for s in range(ends.shape[0]):
        for e in range(2):
            i = ends[s, e]
            other[place[i]] = ends[s, 1 - e]
            place[i] += 1
    return Neighbours(first, other)


@lean
def mark_beyond(frame, command, force, part, marked):
    """Mark the contacts whose force is beyond a part of their friction.

    Args:
        frame: the body.
        command: the command.
        force: shape (n, 2) [N].
        part: the part.
        marked: output, bool, shape (n,).

    Returns:
        How many these are.
    """
    count = 0
    for i in range(force.shape[0]):
        at, _, most = friction_of(frame, command, i)
        f0 = force[i, 0] / part
        f1 = force[i, 1] / part
        if frame.directions.shape[0] > 0:
            marked[i] = gap_in(frame, command, at, f0, f1) < 0.0
        else:
            marked[i] = math.hypot(f0, f1) > most
        count += marked[i]
    return count


@compiled
def spread(neighbours, ready, moving):
    """Add to the moving contacts all that are connected with them through contacts that are ready to move.

    Args:
        neighbours: the neighbours of each contact.
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
        for e in range(neighbours.first[i] + 1, neighbours.first[i + 1]):
            j = neighbours.other[e]
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
def divide(neighbours, moving, owner):
    """Assign contacts to parts: those that move, and around them half as many layers at rest, and some more.

    Moving contacts with no more than one contact between them are in the same part.

    Args:
        neighbours: the neighbours of each contact.
        moving: the contacts that move, bool, shape (n,).
        owner: output: a moving contact of its part, the same for all of the part; -1 outside, int64, shape (n,).
    """
    n = moving.shape[0]
    parent = np.arange(n)
    for j in range(n):
        joined = -1
        for e in range(neighbours.first[j], neighbours.first[j + 1]):
            if moving[neighbours.other[e]]:
                root = _root_of(parent, neighbours.other[e])
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
        for e in range(neighbours.first[i] + 1, neighbours.first[i + 1]):
            j = neighbours.other[e]
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
def frame_of(frame, members, strings, local):
    """Build a part of a body, without its springs to contacts outside.

    Args:
        frame: the body.
        members: the contacts of the part, neighbours close to each other.
        strings: the springs between them.
        local: output: number of each member in the part, int64, shape (n,).

    Returns:
        The part.
    """
    m = members.shape[0]
    for a in range(m):
        local[members[a]] = a
    ends = np.empty((strings.shape[0], 2), np.int64)
    stiffness = np.empty(2 * strings.shape[0])
    for b in range(strings.shape[0]):
        for e in range(2):
            ends[b, e] = local[frame.ends[strings[b], e]]
            stiffness[2 * b + e] = frame.stiffness[2 * strings[b] + e]
    guide = np.empty((m, 2), np.int64)
    for a in range(m):
        guide[a, 0] = guide[a, 1] = a
    return Frame(
        frame.vector,
        frame.position[members],
        ends,
        frame.joints,
        stiffness,
        np.zeros(stiffness.shape[0]),
        guide,
        np.zeros(m),
        frame.along_velocity,
        np.arange(m),
        frame.grip[members],
        frame.heading,
        frame.directions,
        frame.compliance,
    )
