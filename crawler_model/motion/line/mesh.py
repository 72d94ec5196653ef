"""Rates in any block, from the velocities: its springs eliminated like a network of resistors (star-mesh transform).

Conductances are only added, never subtracted, so that large ratios of stiffness lose no digits. The contacts of a block
are numbered as a narrow band (reverse Cuthill-McKee); row r of the matrix holds the conductances to the rows behind it.
"""

from __future__ import annotations

from ...compiled import lean
from ...rounding import CRITICAL, NOISE
from .path import limit_of


@lean
def _connect(contacts, springs, model, count):
    """Enter the springs between sliding contacts in the matrix, and those to contacts at rest as conductances."""
    block, ends, matrix = model.block, model.ends, model.matrix
    for r in range(count):
        e = block[r]
        e.reach = 0
        e.ground = 0.0
        if e.side == 0:
            continue
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


@lean
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
            f.pull += part * e.pull
            f.ground += part * to_ground
            for j in range(f.reach, e.reach - d - 1):
                matrix[q, j] = 0.0
            f.reach = max(f.reach, e.reach - d - 1)
            for j in range(d + 1, e.reach):
                matrix[q, j - d - 1] += part * matrix[r, j]


@lean
def solve_mesh(contacts, springs, model, count):
    """Solve for the velocities of the sliding contacts of a block and the rates of the forces on those at rest.

    Args:
        contacts: CONTACT, shape (N,).
        springs: SPRING, shape (S,).
        model: a `Model`, whose block is changed in place; at least one contact at a spring of it is at rest.
        count: number of contacts of the block.
    """
    block, ends, matrix = model.block, model.ends, model.matrix
    _connect(contacts, springs, model, count)
    _eliminate(block, matrix, count)
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
    for r in range(count):
        e = block[r]
        c = contacts[e.contact]
        if e.side != 0:
            e.force = limit_of(e)
            if abs(e.v) <= NOISE * most or (e.v * e.side < 0.0 and abs(e.v) <= CRITICAL * most):
                e.v = 0.0
    for r in range(count):
        e = block[r]
        c = contacts[e.contact]
        if e.side == 0:
            e.force = e.load
            e.scale = abs(e.load)
            for k in range(c.first, c.last):
                o = contacts[ends[k].other]
                if o.mark == c.mark:
                    pull = springs[ends[k].spring].stiffness * block[o.row].v
                    e.force += pull
                    e.scale += abs(pull)
