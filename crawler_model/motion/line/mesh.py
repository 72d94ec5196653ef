"""Rates in any block, from the velocities: its springs eliminated like a network of resistors (star-mesh transform).

Conductances are only added, never subtracted. Commanded rates of stiff springs nearly cancel, though: with large ratios
of stiffness, the resulting velocities are corrected once by the exact residual forces, or digits would be lost. The
contacts of a block are numbered as a narrow band (reverse Cuthill-McKee); row r of the matrix holds the conductances to
the rows behind it.
"""

from __future__ import annotations

from ...compiled import inlined, lean
from ...rounding import CRITICAL, NOISE
from .dense import decompose, substitute
from .ground.couplings import add_growth, couplings_of, restore_limits
from .ground.gradual import force_of, profile_of, stiffness_of
from .path import limit_of


@inlined
def _connect(contacts, springs, model, matrix, count):
    """Enter the springs between sliding contacts in the matrix, and springs to contacts at rest as conductances."""
    block, ends = model.block, model.ends
    for r in range(count):
        e = block[r]
        e.reach = 0
        e.ground = 0.0
        if e.side == 0:
            continue
        e.ground = stiffness_of(e, model.ground)
        c = contacts[e.contact]
        e.pull = e.load - limit_of(e)
        for k in range(c.first, c.last):
            o = contacts[ends[k].other]
            stiffness = springs[ends[k].spring].stiffness
            if o.mark != c.mark or block[o.row].side == 0:
                e.ground += stiffness
            elif o.row > r:
                d = o.row - r - 1
                for f in range(e.reach, d + 1):
                    matrix[r, f] = 0.0
                e.reach = max(e.reach, d + 1)
                matrix[r, d] += stiffness


@inlined
def _eliminate(block, matrix, count):
    """Eliminate the sliding contacts in turn: each becomes springs between its neighbours."""
    for r in range(count):
        e = block[r]
        if e.side == 0:
            continue
        to_ground = e.ground
        for d in range(e.reach):
            e.ground += matrix[r, d]
        for d in range(e.reach):
            if matrix[r, d] == 0.0:
                continue
            part = matrix[r, d] / e.ground
            q = r + 1 + d
            f = block[q]
            f.ground += part * to_ground
            for j in range(f.reach, e.reach - d - 1):
                matrix[q, j] = 0.0
            f.reach = max(f.reach, e.reach - d - 1)
            for j in range(d + 1, e.reach):
                matrix[q, j - d - 1] += part * matrix[r, j]


@inlined
def eliminate(contacts, springs, model, matrix, count):
    """Eliminate the sliding contacts of a block: `ground` of each is then the pivot of its row."""
    _connect(contacts, springs, model, matrix, count)
    _eliminate(model.block, matrix, count)


@inlined
def _substitute(block, matrix, count):
    """Find the velocities that the pulls lead to, after elimination; returns the largest one."""
    for r in range(count):
        e = block[r]
        if e.side != 0:
            for d in range(e.reach):
                block[r + 1 + d].pull += matrix[r, d] / e.ground * e.pull
    most = 0.0
    for r in range(count - 1, -1, -1):
        e = block[r]
        e.v = 0.0
        if e.side != 0:
            total = e.pull
            for d in range(e.reach):
                total += matrix[r, d] * block[r + 1 + d].v
            e.v = total / e.ground
            most = max(most, abs(e.v))
    return most


@inlined
def _difference(a, b, c):
    """Compute a - b - c with one rounding (Knuth's sum of two numbers, twice)."""
    first = a - b
    part = first - a
    error = (a - (first - part)) - (b + part)
    second = first - c
    part = second - first
    return second + (error + ((first - (second - part)) - (c + part)))


@inlined
def _velocity_of(block, o, c):
    """Return the velocity of contact o, which a spring joins to contact c of the block; outside of it, o rests."""
    return block[o.row].v if o.mark == c.mark else 0.0


@lean
def _find_flows(contacts, springs, model, ramp, count):
    """Compute the rates of the forces of all springs, in each end, and the residual forces on sliding contacts."""
    block, ends = model.block, model.ends
    for r in range(count):
        e = block[r]
        c = contacts[e.contact]
        e.rough = e.v
        e.pull = 0.0
        for k in range(c.first, c.last):
            o, spring = contacts[ends[k].other], springs[ends[k].spring]
            source = 0.0 if ramp.fall.falling else ends[k].sign * spring.d_length
            ends[k].flow = spring.stiffness * _difference(_velocity_of(block, o, c), e.v, source)
            e.pull += ends[k].flow
        if e.side != 0:
            e.pull -= force_of(e, model.ground)


@inlined
def _prepare(contacts, springs, model, couplings, count):
    """Prepare the matrix of a block to find velocities; returns False if it is singular."""
    if couplings is None:
        eliminate(contacts, springs, model, model.matrix, count)
        return True
    restore_limits(couplings, model.block, count)
    return decompose(contacts, springs, model, couplings, model.matrix, count)


@inlined
def _find_velocities(block, matrix, couplings, count):
    """Find the velocities that the pulls lead to; returns the largest one."""
    if couplings is None:
        return _substitute(block, matrix, count)
    return substitute(block, couplings, matrix, count)


@inlined
def _correct(contacts, springs, model, matrix, count):
    """Add the velocities and the rates that residual forces lead to."""
    block, ends = model.block, model.ends
    _find_velocities(block, matrix, couplings_of(model.ground), count)
    for r in range(count):
        e = block[r]
        c = contacts[e.contact]
        for k in range(c.first, c.last):
            o = contacts[ends[k].other]
            ends[k].flow += springs[ends[k].spring].stiffness * (_velocity_of(block, o, c) - e.v)
    for r in range(count):
        block[r].v += block[r].rough


@inlined
def _find_pulls(springs, block, ground, count):
    """Enter the springs of a path in its rows, each contact that slides eliminated into the next one, and all pulls.

    `ground` of each is then the reciprocal of the pivot of its row: divisions take longer than all else.
    """
    to_ground = joined = part = 0.0
    for r in range(count):
        e, behind = block[r], block[r + 1]
        if e.side == 0:
            joined = 0.0
            continue
        near = springs[e.spring].stiffness if e.spring >= 0 else 0.0
        far = springs[behind.spring].stiffness if behind.spring >= 0 else 0.0
        slides = r + 1 < count and behind.side != 0
        e.ground = stiffness_of(e, ground)
        e.pull = e.load - limit_of(e)
        if not slides:
            e.ground += far
        if joined == 0.0:
            e.ground += near
        else:
            e.ground += part * to_ground
        to_ground, joined = e.ground, far if slides else 0.0
        e.ground = 1.0 / (e.ground + joined)
        part = joined * e.ground
        e.joined, e.part = joined, part


@inlined
def _sweep(block, count):
    """Find the velocities that the pulls on a path lead to, after elimination; returns the largest one."""
    part = pull = most = v = 0.0
    for r in range(count):
        e = block[r]
        if e.side == 0:
            part = 0.0
            continue
        e.pull += part * pull
        part, pull = e.part, e.pull
    for r in range(count - 1, -1, -1):
        e = block[r]
        v = (e.pull + e.joined * v) * e.ground if e.side != 0 else 0.0
        e.v = v
        most = max(most, abs(v))
    return most


@inlined
def _solve_chain(springs, block, ground, profile, ramp, count):
    """Solve a path of a chain on gradual ground, as `solve_mesh`; `flow` of each row is then set, not those of ends.

    Returns:
        Whether it is one.
    """
    if profile is None:
        return False
    if ramp.search.path == 0:
        return False
    _find_pulls(springs, block, ground, count)
    most = _sweep(block, count)
    moves, v = 0.0 if ramp.fall.falling else 1.0, 0.0
    for r in range(count + 1):
        e = block[r]
        e.flow, e.rough = 0.0, e.v if r < count else 0.0
        if e.spring >= 0:
            e.flow = springs[e.spring].stiffness * _difference(e.rough, v, moves * springs[e.spring].d_length)
        v = e.rough
    for r in range(count):
        e = block[r]
        e.pull = block[r + 1].flow - e.flow
        if e.side != 0:
            e.pull -= force_of(e, ground)
    _sweep(block, count)
    v = 0.0
    for r in range(count + 1):
        e = block[r]
        own = e.v if r < count else 0.0
        if e.spring >= 0:
            e.flow += springs[e.spring].stiffness * (own - v)
        v = own
    for r in range(count):
        e = block[r]
        e.v += e.rough
        if e.side != 0:
            if abs(e.v) <= NOISE * most or (e.v * e.side < 0.0 and abs(e.v) <= CRITICAL * most):
                e.v = 0.0
            e.force = force_of(e, ground)
    for r in range(count):
        e, behind = block[r], block[r + 1]
        if e.side == 0:
            e.force = behind.flow - e.flow
            e.scale = abs(e.load) + abs(behind.flow) + abs(e.flow)
            if behind.spring >= 0 and r + 1 < count:
                e.scale += abs(springs[behind.spring].stiffness * behind.v)
            if r > 0:
                e.scale += abs(springs[e.spring].stiffness * block[r - 1].v)
    return True


@lean
def solve_mesh(contacts, springs, model, matrix, ramp, count):
    """Solve for the velocities of the sliding contacts of a block and the rates of the forces on its contacts at rest.

    An implicit step is not corrected: it finds forces, not their rates, and these forces leave flat springs out.

    Args:
        model: a `Model`, whose block and ends are changed in place; at least one contact at a spring of it is at rest.

    Returns:
        False if friction that changes with elongations leaves no velocities, or several.
    """
    if matrix is None:
        return True
    block, ends = model.block, model.ends
    if _solve_chain(springs, block, model.ground, profile_of(model.ground), ramp, count):
        return True
    if not _prepare(contacts, springs, model, couplings_of(model.ground), count):
        return False
    most = _find_velocities(block, matrix, couplings_of(model.ground), count)
    add_growth(contacts, couplings_of(model.ground), block, count)
    if not ramp.stepping:
        _find_flows(contacts, springs, model, ramp, count)
        _correct(contacts, springs, model, matrix, count)
        add_growth(contacts, couplings_of(model.ground), block, count)
    for r in range(count):
        e = block[r]
        if e.side != 0:
            if abs(e.v) <= NOISE * most or (e.v * e.side < 0.0 and abs(e.v) <= CRITICAL * most):
                e.v = 0.0
            e.force = force_of(e, model.ground)
    for r in range(count):
        e = block[r]
        c = contacts[e.contact]
        if e.side == 0:
            e.force = e.load if ramp.stepping else 0.0
            e.scale = abs(e.load)
            for k in range(c.first, c.last):
                o = contacts[ends[k].other]
                pull = springs[ends[k].spring].stiffness * _velocity_of(block, o, c)
                e.scale += abs(pull)
                if ramp.stepping:
                    e.force += pull
                else:  # the load, in which commands may cancel, does not show how large their pulls are
                    e.force += ends[k].flow
                    e.scale += abs(ends[k].flow)
    return True
