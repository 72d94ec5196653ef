"""The ends of pieces: which contacts reach a bound there, when, and whether the derivative is one-sided.

The derivative is one-sided where the order of two events decides who stops, and where a contact is at its bound without
sliding although a change of the parameters would lift it off or push it over: such a kink is noted.
"""

from __future__ import annotations

from ..compiled import compiled

_AT_BOUND = 1e-10
"""A force closer to its bound than this, relative to the forces around the contact, is at its bound."""
SAME = 1e-8
"""Derivatives closer than this, relative to the terms whose difference they are, are equal."""
_SHORTEST = 1e-8
"""On a shorter part of a ramp a contact that has just left its bound is still close to it."""
INSTANT = 1e-11
"""Events closer together than this part of a ramp are simultaneous."""
V_BEFORE, ARRIVED = range(2)
"""Rows of the contacts at the end of the last piece: velocity; 1 if it reached a bound there, 2 if that instant depends
on the parameters."""
NO_END, CORNER, EVENT, TIE = range(4)
"""How the last piece ended: there was none; at a vertex of the commands; at an event; at events whose order depends on
the parameters."""


@compiled
def mark(kinks, ramp, place, contact):
    """Note a kink.

    Args:
        kinks: ramp, place and contact, shape (rows, 3); the first row counts.
        ramp: the ramp.
        place: the place on it.
        contact: the contact.
    """
    kinks[0, 0] += 1.0
    row = int(kinks[0, 0])
    if row < kinks.shape[0]:
        kinks[row, 0] = ramp
        kinks[row, 1] = place
        kinks[row, 2] = contact


@compiled
def pass_end(memory, event, sliding, velocity, ramp, place, dx, kinks, one_sided):
    """Carry the derivatives over the end of the last piece, and find the kinks there.

    Args:
        memory: rows V_BEFORE and ARRIVED, shape (2, N).
        event: how the last piece ended, as in `tangent.follow_tangent`.
        sliding: direction of each contact on the next piece, 0 if stuck, int8, shape (N,).
        velocity: on the next piece, shape (N,) [m per ramp].
        ramp: the ramp.
        place: where on it the pieces meet.
        dx: derivatives of the displacements, shape (N, P), changed in place.
        kinks: output, see `mark`.
        one_sided: output: parameters whose derivative is one-sided, bool, shape (P,).

    Returns:
        Whether contacts begin to slide there at places that depend on the parameters in different ways.
    """
    n = velocity.shape[0]
    columns = one_sided.shape[0]
    stopped = False
    arrived = False
    for i in range(n):
        stopped |= memory[V_BEFORE, i] != 0.0 and sliding[i] == 0
        arrived |= memory[ARRIVED, i] > 1.0
    kind = int(event[0])
    tied = stopped and (kind == TIE or (kind == CORNER and arrived))
    flags = (1 if kind == TIE else 2) * columns  # parameters that change the order, or the instant
    for i in range(n):
        moved = memory[V_BEFORE, i] != 0.0 and sliding[i] == 0
        if (memory[ARRIVED, i] > 1.0 and (sliding[i] == 0 or tied)) or (tied and moved):
            mark(kinks, ramp, place, i)
            for c in range(columns):
                one_sided[c] |= event[1 + flags + columns + c] != 0.0
        change = memory[V_BEFORE, i] - velocity[i]
        if kind >= EVENT and change != 0.0:
            for c in range(dx.shape[1]):
                dx[i, c] += change * event[1 + c]
    return arrived and (kind in (TIE, CORNER))


@compiled
def look_at_bounds(
    ends,
    stiffness,
    d_stiffness,
    tension,
    rate,
    change,
    target,
    d_target,
    place,
    length,
    ramp,
    arriving,
    sliding,
    dx,
    d_tension,
    forces,
    d_slack,
    d_size,
    memory,
    event,
    kinks,
    one_sided,
):
    """Find at the end of a piece which contacts reach a bound, and the derivative of where on the ramp they do.

    Args:
        ends: the two contacts of each spring, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        d_stiffness: its derivatives, shape (S, P).
        tension: at the end of the piece, shape (S,) [N].
        rate: of the tensions, shape (S,) [N per ramp].
        change: of the target along the ramp, shape (F,).
        target: at the end of the piece, shape (F,).
        d_target: its derivatives, shape (F, P).
        place: where on the ramp the piece ends.
        length: of the piece, as a part of the ramp.
        ramp: the ramp.
        arriving: bits of the bound that each contact reaches there, shape (N,).
        sliding: direction of each contact on the piece, 0 if stuck, int8, shape (N,).
        dx: derivatives of the displacements there, shape (N, P).
        d_tension: derivatives of the tensions there, shape (S, P).
        forces: scratch memory, shape (4, N).
        d_slack: scratch memory, shape (P,).
        d_size: scratch memory, shape (P,).
        memory: output: row ARRIVED, shape (2, N).
        event: output, as in `tangent.follow_tangent`.
        kinks: output, see `mark`.
        one_sided: output: parameters whose derivative is one-sided, bool, shape (P,).
    """
    n, columns = dx.shape
    springs = ends.shape[0]
    force, force_rate, size, rate_size = forces[0], forces[1], forces[2], forces[3]
    forces[:] = 0.0
    for s in range(springs):
        for end in range(2):
            i = ends[s, end]
            sign = 1.0 if end == 0 else -1.0
            force[i] += sign * tension[s]
            force_rate[i] += sign * rate[s]
            size[i] += abs(tension[s])
            rate_size[i] += abs(rate[s])
    corner = place == 1.0
    event[:] = 0.0
    event[0] = CORNER if corner else EVENT
    best = 0.0
    for i in range(n):
        memory[ARRIVED, i] = 0.0
        forward, backward = target[springs + i], target[springs + n + i]
        if sliding[i] != 0 or forward + backward == 0.0:
            continue
        above, below = forward - force[i], backward + force[i]
        near = _AT_BOUND * (size[i] + abs(forward) + abs(backward))
        ahead = arriving[i] == 1.0 if arriving[i] != 0.0 else above < below
        bound_rate = change[springs + i] if ahead else change[springs + n + i]
        closing = (force_rate[i] if ahead else -force_rate[i]) - bound_rate
        slack = above if ahead else below
        arrives = arriving[i] != 0.0
        if closing > _AT_BOUND * (rate_size[i] + abs(bound_rate)):
            arrives |= slack <= closing * INSTANT + 1e-4 * near
        if not arrives and (slack > near or length < _SHORTEST):
            continue
        for c in range(columns):
            bound = d_target[springs + i, c] if ahead else d_target[springs + n + i, c]
            d_slack[c] = bound
            d_size[c] = abs(bound)
        for s in range(springs):
            for end in range(2):
                if ends[s, end] == i:
                    sign = 1.0 if (end == 0) == ahead else -1.0
                    stretch = tension[s] / stiffness[s]
                    for c in range(columns):
                        d_slack[c] -= sign * d_tension[s, c]
                        terms = abs(dx[ends[s, 0], c]) + abs(dx[ends[s, 1], c]) + abs(d_target[s, c])
                        d_size[c] += stiffness[s] * terms + abs(d_stiffness[s, c] * stretch)
        depends = False
        for c in range(columns):
            if abs(d_slack[c]) > SAME * d_size[c]:
                depends = True
                event[1 + 3 * columns + c] = 1.0
        if not arrives:
            if depends:
                mark(kinks, ramp, place, i)
                for c in range(columns):
                    one_sided[c] |= abs(d_slack[c]) > SAME * d_size[c]
            continue
        memory[ARRIVED, i] = 2.0 if depends else 1.0
        if corner:
            continue
        if best > 0.0:  # another contact arrives at the same place
            for c in range(columns):
                other = d_slack[c] / closing
                if abs(other - event[1 + c]) > SAME * (d_size[c] / closing + event[1 + columns + c]):
                    event[0] = TIE
                    event[1 + 2 * columns + c] = 1.0
        if closing > best:
            best = closing
            for c in range(columns):
                event[1 + c] = d_slack[c] / closing
                event[1 + columns + c] = d_size[c] / closing
