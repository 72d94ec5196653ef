"""Derivatives of a piecewise linear path with respect to parameters, carried from piece to piece.

At a fixed place on the ramp the sliding contacts follow from the stuck ones, as their forces stay at their bounds:

    K_SS Dx_S = (D of the pull of the actuators)_S - (DK x)_S - K_SM Dx_M - (D of the bounds)_S,

so only contacts that stop remember. At an event, where a free contact reaches its bound at the place s*,

    Ds* = - D slack / (d slack / ds),

and as x is continuous there, Dx changes by (v before - v after) Ds*. At a vertex of the commands Ds* = 0.
"""

from __future__ import annotations

import numpy as np

from ..compiled import compiled
from ..motion.pieces import FROM, HEADER, RAMP, UNTIL
from .elimination import eliminate_many
from .kinks import ARRIVED, INSTANT, NO_END, SAME, V_BEFORE, look_at_bounds, mark, pass_end

_STILL = 1e-12
"""A velocity below this part of the largest one is rounding."""


@compiled
def _find_sliding(velocity, target, springs, sliding):
    """Find which contacts slide on a piece: 1 forward, -1 backward, 0 stuck; without friction 1. Return how many."""
    n = velocity.shape[0]
    fastest = np.abs(velocity).max()
    count = 0
    for i in range(n):
        sliding[i] = 0
        if abs(velocity[i]) > _STILL * fastest:
            sliding[i] = 1 if velocity[i] > 0.0 else -1
        elif target[springs + i] + target[springs + n + i] == 0.0:
            sliding[i] = 1
        count += sliding[i] != 0
    return count


@compiled
def _balance(ends, stiffness, d_stiffness, tension, order, band, sliding, work, ground, d_target, dx, load):
    """Solve for the derivatives of the sliding contacts at a fixed place; return False if none is stuck."""
    n, columns = dx.shape
    springs = ends.shape[0]
    for i in range(n):
        for c in range(columns):
            if sliding[i] > 0:
                load[i, c] = -d_target[springs + i, c]
            elif sliding[i] < 0:
                load[i, c] = d_target[springs + n + i, c]
    for s in range(springs):
        a, b = ends[s, 0], ends[s, 1]
        stretch = tension[s] / stiffness[s]
        for c in range(columns):
            pull = d_stiffness[s, c] * stretch - stiffness[s] * d_target[s, c]
            load[a, c] += pull
            load[b, c] -= pull
    return eliminate_many(order, band, sliding, work, ground, load, dx)


@compiled
def _shift_all(velocity, dx, before, elements, share, sliding, d_target, ramp, place, kinks, one_sided):
    """Choose the translation where all contacts slide, as `choose_translation` does, and find whether it is a kink."""
    n, columns = dx.shape
    springs = d_target.shape[0] - 2 * n
    fastest = np.abs(velocity).max()
    pair = -1
    for j in range(elements.shape[0]):
        a, b = velocity[elements[j, 0]], velocity[elements[j, 1]]
        if a * b < 0.0 and abs(a + b) <= 1e-9 * fastest:
            pair = j
    marked = False
    for c in range(columns):
        shift = 0.0
        if pair >= 0:
            a, b = elements[pair, 0], elements[pair, 1]
            shift = 0.5 * ((before[a, c] + before[b, c]) - (dx[a, c] + dx[b, c]))
        else:
            for i in range(n):
                shift += share[i] * (before[i, c] - dx[i, c])
        total = 0.0
        size = 0.0
        for i in range(n):
            dx[i, c] += shift
            change = d_target[springs + i, c] if sliding[i] > 0 else -d_target[springs + n + i, c]
            total += change
            size += abs(change)
        if pair < 0 or abs(total) > SAME * size:
            one_sided[c] = True
            marked = True
    if marked:
        for i in range(n):
            mark(kinks, ramp, place, i)


@compiled
def _tensions(ends, stiffness, d_stiffness, tension, d_target, dx, d_tension):
    """Compute the derivatives of the tensions."""
    for s in range(ends.shape[0]):
        a, b = ends[s, 0], ends[s, 1]
        stretch = tension[s] / stiffness[s]
        for c in range(dx.shape[1]):
            d_tension[s, c] = stiffness[s] * (dx[b, c] - dx[a, c] - d_target[s, c]) + d_stiffness[s, c] * stretch


@compiled
def _command_derivative(rows, d_rows, before, after, part, d_part, d_target):
    """Compute the derivative of a target between two rows of the drive."""
    for f in range(d_target.shape[0]):
        step = rows[after, f] - rows[before, f]
        for c in range(d_target.shape[1]):
            start = d_rows[before, f, c]
            d_target[f, c] = start + part * (d_rows[after, f, c] - start) + step * d_part[c]


@compiled
def follow_tangent(
    ends,
    stiffness,
    d_stiffness,
    order,
    band,
    elements,
    share,
    rows,
    d_rows,
    before,
    after,
    part,
    d_part,
    targets,
    start,
    tensions,
    pieces,
    dx,
    d_start,
    memory,
    event,
    d_records,
    works,
    d_works,
    kinks,
    one_sided,
    samples,
):
    """Carry derivatives along ramps whose pieces are known.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        d_stiffness: its derivatives, shape (S, P).
        order: from `build_band`, like the next one.
        band: stiffness in the band, shape (N, width).
        elements: both contacts of each element of a segment, shape (Q, 2).
        share: weight of each contact in the net translation, shape (N,).
        rows: targets of the drive's waypoints, shape (W, F).
        d_rows: their derivatives, shape (W, F, P).
        before: the waypoint before each ramp's end, shape (V,).
        after: the waypoint after it, shape (V,).
        part: place of the ramp's end between them, shape (V,).
        d_part: its derivatives, shape (V, P).
        targets: at the end of each ramp, shape (V, F).
        start: the target in force before, shape (F,), changed in place.
        tensions: at the start of each ramp, shape (V, S) [N].
        pieces: from `follow_pieces`, shape (K, 3 + 2 N).
        dx: derivatives of the displacements, shape (N, P), changed in place.
        d_start: derivatives of the target in force, shape (F, P), changed in place.
        memory: rows V_BEFORE and ARRIVED, shape (2, N), changed in place; zero at first.
        event: how the last piece ended, then Ds*, the size of its terms, 1 for parameters that change the order of
            several events, and 1 for parameters that any of them depends on, shape (1 + 4 P,), changed in place; zero
            at first.
        d_records: output: derivatives of the displacements after each ramp, shape (V, N, P).
        works: output: work of the actuators in each ramp, shape (V,) [J].
        d_works: output: its derivatives, shape (V, P).
        kinks: output: ramp, place and contact, shape (rows, 3); the first row counts.
        one_sided: output: parameters whose derivative is one-sided, bool, shape (P,).
        samples: whether the displacement at the end of every ramp is a result: it has a kink where a contact reaches
            its bound just there, even if it slides on.
    """
    n, columns = dx.shape
    springs = ends.shape[0]
    size = start.shape[0]
    sliding = np.zeros(n, np.int8)
    velocity = np.zeros(n)
    arriving = np.zeros(n)
    work = np.empty(band.shape)
    ground = np.empty(n)
    load = np.empty((n, columns))
    earlier = np.empty((n, columns))
    forces = np.empty((4, n))
    tension, rate, change, target = np.empty(springs), np.empty(springs), np.empty(size), np.empty(size)
    d_end, d_target = np.empty((size, columns)), np.empty((size, columns))
    d_before, d_after = np.empty((springs, columns)), np.empty((springs, columns))
    d_slack, d_size = np.empty(columns), np.empty(columns)
    bounds = springs + 2 * n
    piece = 0
    for v in range(targets.shape[0]):
        _command_derivative(rows, d_rows, before[v], after[v], part[v], d_part[v], d_end)
        for f in range(bounds):
            change[f] = targets[v, f] - start[f]
        for s in range(springs):
            tension[s] = tensions[v, s]
        works[v] = 0.0
        d_works[v] = 0.0
        place = 0.0
        if int(event[0]) == NO_END:  # the start: a contact at its bound is at a kink unless it stays there
            rate[:] = 0.0
            sliding[:] = 0
            _tensions(ends, stiffness, d_stiffness, tension, d_start, dx, d_after)
            look_at_bounds(
                ends,
                stiffness,
                d_stiffness,
                tension,
                rate,
                0.0 * change,
                start,
                d_start,
                place,
                1.0,
                v,
                arriving,
                sliding,
                dx,
                d_after,
                forces,
                d_slack,
                d_size,
                memory,
                event,
                kinks,
                one_sided,
            )
            event[:] = 0.0
        while True:
            logged = piece < pieces.shape[0] and int(pieces[piece, RAMP]) == v
            if not logged and place > 0.0:
                break
            until = 1.0
            velocity[:] = 0.0
            arriving[:] = 0.0
            if logged:
                until = pieces[piece, UNTIL]
                if until > 1.0 - 1e-13:
                    until = 1.0
                for i in range(n):
                    velocity[i] = pieces[piece, HEADER + i]
                    arriving[i] = pieces[piece, HEADER + n + i]
                place = pieces[piece, FROM]
                piece += 1
                if until - place < INSTANT and until < 1.0:
                    place = until
                    continue
            middle = 0.5 * (place + until)
            for f in range(bounds):
                target[f] = start[f] + middle * change[f]
            number = _find_sliding(velocity, target, springs, sliding)
            for i in range(n):
                if abs(velocity[i]) <= _STILL * np.abs(velocity).max():
                    velocity[i] = 0.0
            mixed = pass_end(memory, event, sliding, velocity, v, place, dx, kinks, one_sided)
            length = until - place
            for f in range(bounds):
                target[f] = start[f] + until * change[f]
                for c in range(columns):
                    d_target[f, c] = d_start[f, c] + place * (d_end[f, c] - d_start[f, c])
            if mixed and number < n:
                _balance(ends, stiffness, d_stiffness, tension, order, band, sliding, work, ground, d_target, dx, load)
            _tensions(ends, stiffness, d_stiffness, tension, d_target, dx, d_before)
            for s in range(springs):
                rate[s] = stiffness[s] * ((velocity[ends[s, 1]] - velocity[ends[s, 0]]) - change[s])
                works[v] -= (tension[s] + 0.5 * length * rate[s]) * change[s] * length
                for c in range(columns):
                    part_of = (tension[s] + 0.5 * length * rate[s]) * (d_end[s, c] - d_start[s, c])
                    d_works[v, c] -= length * (0.5 * d_before[s, c] * change[s] + part_of)
                tension[s] += length * rate[s]
            for f in range(bounds):
                for c in range(columns):
                    d_target[f, c] = d_start[f, c] + until * (d_end[f, c] - d_start[f, c])
            if number > 0:
                if number == n:
                    earlier[:] = dx
                held = _balance(
                    ends, stiffness, d_stiffness, tension, order, band, sliding, work, ground, d_target, dx, load
                )
                if not held:
                    _shift_all(
                        velocity, dx, earlier, elements, share, sliding, d_target[:bounds], v, place, kinks, one_sided
                    )
            _tensions(ends, stiffness, d_stiffness, tension, d_target, dx, d_after)
            for s in range(springs):
                for c in range(columns):
                    d_works[v, c] -= 0.5 * length * d_after[s, c] * change[s]
            look_at_bounds(
                ends,
                stiffness,
                d_stiffness,
                tension,
                rate,
                change,
                target,
                d_target,
                until,
                length,
                v,
                arriving,
                sliding,
                dx,
                d_after,
                forces,
                d_slack,
                d_size,
                memory,
                event,
                kinks,
                one_sided,
            )
            for i in range(n):
                memory[V_BEFORE, i] = velocity[i]
                if samples and until == 1.0 and memory[ARRIVED, i] > 1.0:
                    mark(kinks, v, until, i)
                    for c in range(columns):
                        one_sided[c] |= event[1 + 3 * columns + c] != 0.0
            place = until
            if until == 1.0:
                break
        for f in range(size):
            start[f] = targets[v, f]
            for c in range(columns):
                d_start[f, c] = d_end[f, c]
        d_records[v] = dx
