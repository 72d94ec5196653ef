"""Rates in a block whose matrix is not symmetric, by its triangular decomposition: friction changes with elongations.

Its rows are all contacts of the body; those of contacts at rest are empty beside the diagonal.
"""

from __future__ import annotations

from ...compiled import lean
from ...rounding import EPS
from .ground.gradual import stiffness_of
from .path import limit_of
from .records import BACKWARD, FORWARD


@lean
def _fill(contacts, springs, model, couplings, matrix, count):
    """Fill the matrix, and set `pull` to the right-hand side; the bound of a contact that falls follows no springs."""
    block, ends = model.block, model.ends
    for r in range(count):
        e, c = block[r], contacts[block[r].contact]
        for j in range(count):
            matrix[r, j] = 0.0
        e.ground = e.pull = 0.0
        for k in range(c.first, c.last):
            e.ground += springs[ends[k].spring].stiffness
            if e.side != 0 and block[contacts[ends[k].other].row].side != 0:
                matrix[r, contacts[ends[k].other].row] -= springs[ends[k].spring].stiffness
        matrix[r, r] = e.ground
        if e.side != 0:
            matrix[r, r] += stiffness_of(e, model.ground)
            e.pull = e.load - limit_of(e)
    for k in range(couplings.each.shape[0]):
        coupling = couplings.each[k]
        piece, r = couplings.pieces[coupling.piece], contacts[coupling.contact].row
        side = block[r].side
        if side == 0 or contacts[coupling.contact].fallen & (FORWARD if side > 0 else BACKWARD):
            continue
        slope = piece.d_forward if side > 0 else -piece.d_backward
        for i, sign in ((coupling.a, -1.0), (coupling.b, 1.0)):
            if block[contacts[i].row].side != 0:
                matrix[r, contacts[i].row] += sign * slope


@lean
def decompose(contacts, springs, model, couplings, matrix, count):
    """Decompose the matrix of a block; `pull` of each row is then its right-hand side.

    Returns:
        False if it is singular.
    """
    if couplings is None:
        return True
    _fill(contacts, springs, model, couplings, matrix, count)
    rows = couplings.rows
    for c in range(count):
        rows[c] = c
    for c in range(count):
        best = c
        for r in range(c + 1, count):
            if abs(matrix[r, c]) > abs(matrix[best, c]):
                best = r
        if abs(matrix[best, c]) <= 64.0 * EPS * model.block[c].ground:
            return False
        if best != c:
            rows[c], rows[best] = rows[best], rows[c]
            for j in range(count):
                matrix[c, j], matrix[best, j] = matrix[best, j], matrix[c, j]
        for r in range(c + 1, count):
            if matrix[r, c] != 0.0:
                matrix[r, c] /= matrix[c, c]
                for j in range(c + 1, count):
                    matrix[r, j] -= matrix[r, c] * matrix[c, j]
    return True


@lean
def substitute(block, couplings, matrix, count):
    """Find the velocities that the pulls lead to, after decomposition.

    Returns:
        The largest one.
    """
    most = 0.0
    if couplings is None:
        return most
    for r in range(count):
        e = block[couplings.rows[r]]
        total = e.pull if e.side != 0 else 0.0
        for j in range(r):
            total -= matrix[r, j] * block[j].v
        block[r].v = total
    for r in range(count - 1, -1, -1):
        for j in range(r + 1, count):
            block[r].v -= matrix[r, j] * block[j].v
        block[r].v /= matrix[r, r]
        most = max(most, abs(block[r].v))
    return most
