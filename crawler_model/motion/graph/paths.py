"""Blocks of a graph whose contacts form a path: their rates are those of a chain.

Contacts with at most two springs each, between two walls or between a wall and a free end, are a chain. The projection
of `chain.projection` computes the rates of its tensions in one pass, without searching for an active set.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import lean
from ..chain.projection import chain_velocities, project, shape_gain, workspace
from ..state import BACKWARD, FORWARD
from .memory import (
    CHANGE,
    RATE,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_LOWER,
    ROW_SIDE,
    ROW_UPPER,
    ROW_V,
)
from .rates import advance_contact, advance_spring, bound_rates, find_arrival, settle

_PATH, _JOINTS = range(2)
"""Rows of the walk: the contacts along the path, and the spring behind each of them."""
_SIGN, _TRIAL, _COMPLIANCE, _BACKWARD, _FORWARD, _MAGNITUDE, _TENSION, _GAIN, _VELOCITY = range(9)
"""Rows of the lines: 1 or -1 for the direction of each spring, and what `project` and `chain_velocities` take."""
_LINES = 9


class PathMemory(NamedTuple):
    """Memory for one path; it holds no data between events."""

    walk: np.ndarray
    lines: np.ndarray
    sides: np.ndarray
    stacks: np.ndarray


def memory(contacts: int) -> PathMemory:
    """Allocate the memory for a path.

    Args:
        contacts: number of contacts N of the graph; a wall can be at both ends of a path.

    Returns:
        The arrays.
    """
    n = contacts + 1
    return PathMemory(
        np.zeros((2, 2 * n + 1), np.int64), np.zeros((_LINES, n)), np.zeros(n, np.int8), workspace(contacts)
    )


@lean
def find_path(layout, status, floats, bytes_, marks, number, paths, places, s, contact):
    """Find the block of contacts at their bounds around a contact, with the walls around, if it is a path with a wall.

    Args:
        layout: fields of the `Layout`.
        status: bits of the contacts; they are settled.
        floats: places since which rates hold.
        bytes_: bounds that contacts leave.
        marks: row 0: number of the last block that a contact is in, as for `find_block`, changed in place.
        number: of the new block.
        paths: its walk is written, around the middle.
        places: output: positions of its contacts along the path, with the walls at its ends, int, shape (N + 1,).
        s: place on the ramp, 0 .. 1.
        contact: the contact, at a bound.

    Returns:
        The columns of the first and of the last contact in the walk; the last is before the first if it is no path.
    """
    _, place, starts, others, springs = layout
    walk = paths.walk
    middle = walk.shape[1] // 2
    if starts[contact + 1] - starts[contact] > 2:
        return 0, -1
    walk[_PATH, middle] = contact
    walls = 0
    first = middle
    last = middle
    for way in range(2):
        i = contact
        at = middle
        end = starts[contact] + way
        while end < starts[i + 1]:
            j, spring = others[end], springs[end]
            if j == contact:
                return 0, -1
            walk[_JOINTS, at if way == 1 else at - 1] = spring
            at += 1 if way == 1 else -1
            walk[_PATH, at] = j
            settle(status, floats, bytes_, s, j)
            if status[j] == 0:
                walls += 1
                break
            if starts[j + 1] - starts[j] > 2:
                return 0, -1
            end = starts[j] + (1 if springs[starts[j]] == spring else 0)
            i = j
        if way == 0:
            first = at
        else:
            last = at
    if walls == 0:
        return 0, -1
    for k in range(first, last + 1):
        i = walk[_PATH, k]
        places[k - first] = place[i]
        if status[i] != 0:
            marks[0, i] = number
    return first, last


@lean
def solve_path(
    ends, stiffness, layout, contacts, links, status, floats, changes, bytes_, account, paths, first, last, s
):
    """Solve for the rates of a path at s, and find the next event of each of its contacts and of the walls at its ends.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: stiffness of the springs, shape (S,) [N/m].
        layout: fields of the `Layout`.
        contacts: rows X .. RELATIVE, updated in place to s.
        links: rows SHAPE .. ACTUATION_REF, likewise.
        status: bits of the contacts.
        floats: memory of the ramp: velocities, rates and events are written.
        changes: changes of the springs; rates are written.
        bytes_: sides, bounds that are approached and bounds that are left are written.
        account: account of the ramp, added to.
        paths: its walk is given.
        first: column of the first contact of the path in the walk.
        last: column of the last one.
        s: place on the ramp, 0 .. 1.

    Returns:
        The work: contacts solved plus breakpoints passed.
    """
    lines, sides = paths.lines, paths.sides
    path, joints = paths.walk[_PATH, first : last + 1], paths.walk[_JOINTS, first:last]
    n = path.shape[0]
    for k in range(n):
        i = path[k]
        advance_contact(contacts, floats, account, s, i)
        bound_rates(status, floats, i)
        lines[_FORWARD, k] = floats[ROW_UPPER, i]
        lines[_BACKWARD, k] = -floats[ROW_LOWER, i]
        changing = floats[ROW_D_FORWARD, i] != 0.0 or floats[ROW_D_BACKWARD, i] != 0.0
        lines[_MAGNITUDE, k] = contacts[FORWARD, i] + contacts[BACKWARD, i] if changing else 0.0
    for k in range(n - 1):
        spring = joints[k]
        advance_spring(links, changes, account, s, spring)
        sign = 1.0 if ends[spring, 0] == path[k] else -1.0
        lines[_SIGN, k] = sign
        lines[_TRIAL, k] = -sign * stiffness[spring] * changes[CHANGE, spring]
        lines[_COMPLIANCE, k] = 1.0 / stiffness[spring]
    side, tension, gain = sides[:n], lines[_TENSION, : n - 1], lines[_GAIN, : n - 1]
    trial, compliance = lines[_TRIAL, : n - 1], lines[_COMPLIANCE, : n - 1]
    backward, forward, magnitude = lines[_BACKWARD, :n], lines[_FORWARD, :n], lines[_MAGNITUDE, :n]
    passed = project(trial, compliance, backward, forward, magnitude, tension, side, paths.stacks)
    for k in range(n - 1):
        gain[k] = shape_gain(tension[k], trial[k], compliance[k])
        changes[RATE, joints[k]] = lines[_SIGN, k] * tension[k]
    chain_velocities(gain, side, lines[_VELOCITY, :n], 0, n - 1)
    for k in range(n):
        floats[ROW_V, path[k]] = lines[_VELOCITY, k]
        bytes_[ROW_SIDE, path[k]] = side[k]
    for k in range(n):
        find_arrival(ends, stiffness, layout, contacts, links, status, floats, changes, bytes_, s, path[k])
    return n + passed
