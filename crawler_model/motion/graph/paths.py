"""Blocks of a graph whose contacts form a path: their rates are those of a chain.

Contacts with at most two springs each, between two walls or between a wall and a free end, are a chain. Its velocities
are sums along the path. At most events a contact joins such a block and another one stops: the contact whose velocity
contradicts its bound most stops and becomes a wall, then the parts beside it are summed again. If that does not lead to
a solution, the projection of `chain.projection` finds it. Where stiffness spans many decades, sums would lose digits
that elimination keeps: such a path is solved like any other block.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import lean
from ...rounding import CRITICAL, EPS, NOISE
from ..chain.projection import chain_velocities, project, shape_gain, workspace
from ..chain.wide import spans_decades
from ..state import (
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    COMPLEMENTARITY,
    DISSIPATION,
    FORWARD,
    WORK,
)
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
_TRIAL, _COMPLIANCE, _CLIMB, _TENSION, _GAIN, _VELOCITY, _BACKWARD, _FORWARD, _MAGNITUDE = range(9)
"""Rows of the lines, in the direction of the path: the rate of the tension of each spring if no contact slid, its
compliance, the rate of the force on each contact while it slides; the rates of the tensions, of the elongations and of
the contacts that are found; and the last three for the projection."""
_LINES = 9
_MOST_STOPS = 8
"""If more contacts than this stop at an event, the projection solves the path."""


class PathMemory(NamedTuple):
    """Memory for one path; it holds no data between events.

    Attributes:
        walk: the path around its middle column, int, shape (2, 2 N + 3).
        lines: what belongs to its contacts and springs, shape (9, N + 1).
        sides: the bound that each of its contacts is at, int8, shape (N + 1,).
        parts: parts of the path that are still to be solved, and the contacts that stop, int, shape (P, 3).
        stacks: memory for `project`.
    """

    walk: np.ndarray
    lines: np.ndarray
    sides: np.ndarray
    parts: np.ndarray
    stacks: np.ndarray


def memory(contacts: int) -> PathMemory:
    """Allocate the memory for a path.

    Args:
        contacts: number of contacts N of the graph; a wall can be at both ends of a path.

    Returns:
        The arrays.
    """
    return PathMemory(
        np.zeros((2, 2 * contacts + 3), np.int64),
        np.zeros((_LINES, contacts + 1)),
        np.zeros(contacts + 1, np.int8),
        np.zeros((_MOST_STOPS + 2, 3), np.int64),
        workspace(contacts),
    )


@lean
def find_path(layout, status, floats, bytes_, marks, number, paths, s, contact):
    """Find the block of contacts at their bounds around a contact, with the walls around, if it is a path with a wall.

    Args:
        layout: fields of the `Layout`.
        status: bits of the contacts; they are settled.
        floats: places since which rates hold.
        bytes_: bounds that contacts leave.
        marks: row 0: number of the last block that a contact is in, as for `find_block`, changed in place.
        number: of the new block.
        paths: its walk is written, around the middle.
        s: place on the ramp, 0 .. 1.
        contact: the contact, at a bound.

    Returns:
        The columns of the first and of the last contact in the walk; the last is before the first if it is no path.
    """
    _, _, starts, others, springs = layout[:5]
    walk = paths.walk
    middle = walk.shape[1] // 2
    if starts[contact + 1] - starts[contact] > 2:
        return 0, -1
    walk[_PATH, middle] = contact
    marks[0, contact] = number
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
            marks[0, j] = number
            end = starts[j] + (1 if springs[starts[j]] == spring else 0)
            i = j
        if way == 0:
            first = at
        else:
            last = at
    return first, last if walls > 0 else -1


@lean
def _sum_part(lines, sides, a, b):
    """Compute the velocities of the contacts a..b of a path if all of them slide, between walls or ends of the path.

    Returns the contact that contradicts its bound most, or -1.
    """
    end = sides.shape[0] - 1
    tension, velocity = lines[_TENSION], lines[_VELOCITY]
    trial, compliance, climb = lines[_TRIAL], lines[_COMPLIANCE], lines[_CLIMB]
    base = 0.0
    rise = 0.0
    length = 0.0
    pull = 0.0
    if a > 0:
        length = compliance[a - 1]
        pull = trial[a - 1] * length
    for k in range(a, b + 1):
        rise += climb[k]
        if k < end:
            length += compliance[k]
            pull += (trial[k] - rise) * compliance[k]
    v = 0.0
    if b == end:
        base = -rise
    elif a > 0:
        base = pull / length
    else:
        v = pull
    rate = base
    size = abs(v)
    if a > 0:
        tension[a - 1] = base
        v = shape_gain(base, trial[a - 1], compliance[a - 1])
        size = abs(v)
    for k in range(a, b + 1):
        velocity[k] = v
        if k < end:
            rate += climb[k]
            tension[k] = rate
            gain = shape_gain(rate, trial[k], compliance[k])
            v += gain
            size += abs(gain)
    worst = CRITICAL * size
    found = -1
    for k in range(a, b + 1):
        against = -sides[k] * velocity[k]
        if against > worst:
            worst = against
            found = k
        elif against > 0.0 or against > -NOISE * size:
            velocity[k] = 0.0
    return found


@lean
def _stop_few(lines, sides, parts, first, last):
    """Solve for the rates of a path whose contacts first..last can slide; a few of them stop.

    Returns whether that succeeded.
    """
    end = sides.shape[0] - 1
    parts[0, 0] = first
    parts[0, 1] = last
    todo = 1
    stops = 0
    while todo > 0:
        todo -= 1
        a, b = parts[todo, 0], parts[todo, 1]
        if b < a:  # the spring between two walls
            if b >= 0 and a <= end:
                lines[_TENSION, b] = lines[_TRIAL, b]
            continue
        worst = _sum_part(lines, sides, a, b)
        if worst < 0:
            continue
        if stops == _MOST_STOPS:
            return False
        parts[stops, 2] = worst
        stops += 1
        parts[todo, 0], parts[todo, 1] = a, worst - 1
        parts[todo + 1, 0], parts[todo + 1, 1] = worst + 1, b
        todo += 2
    for k in range(stops):
        j = parts[k, 2]
        before = lines[_TENSION, j - 1] if j > 0 else 0.0
        after = lines[_TENSION, j] if j < end else 0.0
        inwards = sides[j] * (lines[_CLIMB, j] - (after - before))
        if not inwards > 16.0 * EPS * (abs(before) + abs(after) + abs(lines[_CLIMB, j])):
            return False
        sides[j] = 0
        lines[_VELOCITY, j] = 0.0
    return True


@lean
def _project_path(contacts, status, floats, lines, sides, path, stacks):
    """Solve for the rates of a path by the projection; return the number of breakpoints that were passed."""
    n = path.shape[0]
    for k in range(n):
        i = path[k]
        bound_rates(status, floats, i)
        lines[_FORWARD, k] = floats[ROW_UPPER, i]
        lines[_BACKWARD, k] = -floats[ROW_LOWER, i]
        changing = floats[ROW_D_FORWARD, i] != 0.0 or floats[ROW_D_BACKWARD, i] != 0.0
        lines[_MAGNITUDE, k] = contacts[FORWARD, i] + contacts[BACKWARD, i] if changing else 0.0
    trial, compliance, tension = lines[_TRIAL, : n - 1], lines[_COMPLIANCE, : n - 1], lines[_TENSION, : n - 1]
    backward, forward, magnitude = lines[_BACKWARD, :n], lines[_FORWARD, :n], lines[_MAGNITUDE, :n]
    passed = project(trial, compliance, backward, forward, magnitude, tension, sides, stacks)
    gain = lines[_GAIN, : n - 1]
    for k in range(n - 1):
        gain[k] = shape_gain(tension[k], trial[k], compliance[k])
    chain_velocities(gain, sides, lines[_VELOCITY, :n], 0, n - 1)
    return passed


@lean
def project_ring(ends, stiffness, ring, tension, floats, bytes_, paths, cut):
    """Solve an implicit step of a ring, one of whose contacts is held at rest.

    Args:
        ends: the two contacts of each spring, shape (N, 2).
        stiffness: stiffness of the springs, shape (N,) [N/m].
        ring: a `RingMemory`.
        tension: tensions of the springs if no contact slid, shape (N,) [N].
        floats: memory of the ramp: rows ROW_LOWER and ROW_UPPER are the bounds of the forces; ROW_V is written.
        bytes_: row ROW_SIDE is written.
        paths: memory of the path around the ring.
        cut: place around the ring of the contact that is held.

    Returns:
        The place of a contact that rests within its bounds, opposite the other one if possible; -1 if all others slide.
    """
    order, joints = ring.order, ring.joints
    n = order.shape[0]
    lines, sides = paths.lines, paths.sides
    for k in range(n + 1):
        p = cut + k if cut + k < n else cut + k - n
        i, j = order[p], joints[p]
        held = k == 0 or k == n
        lines[_FORWARD, k] = np.inf if held else floats[ROW_UPPER, i]
        lines[_BACKWARD, k] = np.inf if held else -floats[ROW_LOWER, i]
        lines[_MAGNITUDE, k] = 0.0
        if k < n:
            lines[_TRIAL, k] = tension[j] if ends[j, 0] == i else -tension[j]
            lines[_COMPLIANCE, k] = 1.0 / stiffness[j]
    trial, compliance, found = lines[_TRIAL, :n], lines[_COMPLIANCE, :n], lines[_TENSION, :n]
    project(trial, compliance, lines[_BACKWARD], lines[_FORWARD], lines[_MAGNITUDE], found, sides, paths.stacks)
    gain = lines[_GAIN, :n]
    for k in range(n):
        gain[k] = shape_gain(found[k], trial[k], compliance[k])
    chain_velocities(gain, sides, lines[_VELOCITY], 0, n)
    opposite = -1
    for k in range(n):
        p = cut + k if cut + k < n else cut + k - n
        bytes_[ROW_SIDE, order[p]] = sides[k]
        floats[ROW_V, order[p]] = lines[_VELOCITY, k]
        if sides[k] == 0 and k > 0 and (opposite < 0 or 2 * k <= n):
            opposite = p
    return opposite


@lean
def solve_path(
    ends, stiffness, layout, contacts, links, status, floats, changes, bytes_, account, paths, first, last, places, s
):
    """Solve for the rates of a path at s, and find the next events that change.

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
        places: output: positions of the contacts whose next events may have changed, int, shape (N + 1,).
        s: place on the ramp, 0 .. 1.

    Returns:
        How many positions there are, 0 if the stiffness spans too many decades for sums along the path; how many of
        these contacts were free or leaving before; and the work: contacts solved plus breakpoints passed.
    """
    place = layout[1]
    path, joints = paths.walk[_PATH, first : last + 1], paths.walk[_JOINTS, first:last]
    lines, sides = paths.lines, paths.sides[: last - first + 1]
    n = path.shape[0]
    dissipation = 0.0
    complementarity = account[COMPLEMENTARITY]
    single = True
    for k in range(n):
        i = path[k]
        lost, gap = advance_contact(contacts, floats, s, i)
        dissipation += lost
        complementarity = max(complementarity, gap)
        forward = status[i] & AT_FORWARD != 0
        backward = status[i] & AT_BACKWARD != 0
        single &= not (forward and backward)
        sides[k] = int(forward) - int(backward)
        lines[_CLIMB, k] = floats[ROW_D_FORWARD, i] if forward else -floats[ROW_D_BACKWARD, i]
    work = 0.0
    for k in range(n - 1):
        spring = joints[k]
        work += advance_spring(links, changes, s, spring)
        pull = -stiffness[spring] * changes[CHANGE, spring]
        lines[_TRIAL, k] = pull if ends[spring, 0] == path[k] else -pull
        lines[_COMPLIANCE, k] = 1.0 / stiffness[spring]
    account[DISSIPATION] += dissipation
    account[COMPLEMENTARITY] = complementarity
    account[WORK] += work
    if spans_decades(lines[_COMPLIANCE, : n - 1]):
        return 0, 0, 0
    effort = n
    left_wall, right_wall = status[path[0]] == 0, status[path[n - 1]] == 0
    for k in (0, n - 1):
        lines[_VELOCITY, k] = 0.0
    if not (single and _stop_few(lines, sides, paths.parts, left_wall + 0, n - 1 - right_wall)):
        effort += _project_path(contacts, status, floats, lines, sides, path, paths.stacks)
    for k in range(n - 1):
        rate = lines[_TENSION, k]
        changes[RATE, joints[k]] = rate if ends[joints[k], 0] == path[k] else -rate
    count = 0
    was_free = 0
    for k in range(n):
        i = path[k]
        side = sides[k]
        floats[ROW_V, i] = lines[_VELOCITY, k]
        if s == 0.0 or side == 0 or side != bytes_[ROW_SIDE, i] or not single:
            was_free += bytes_[ROW_SIDE, i] == 0
            bytes_[ROW_SIDE, i] = side
            bound_rates(status, floats, i)
            find_arrival(ends, stiffness, layout, contacts, links, status, floats, changes, bytes_, s, i)
            places[count] = place[i]
            count += 1
    return count, was_free, effort
