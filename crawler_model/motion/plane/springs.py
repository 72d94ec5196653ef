"""The springs of a body in the plane as a sparse matrix, and banded systems of equations.

A spring joins two contacts only, so a row of the weighted Laplacian K holds a contact and its few neighbours. Systems
of equations for sliding contacts are solved in an order in which neighbours are close to each other (reverse
Cuthill-McKee): their matrices are bands, and the time grows linearly with the length of a body.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...compiled import compiled, lean
from ...rounding import EPS

if TYPE_CHECKING:
    from scipy.sparse import csr_array


class Springs(NamedTuple):
    """Springs between contacts, and K by rows.

    Attributes:
        ends: the contacts a, b of each spring, int, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        first: where the row of each contact begins, its own entry in front, int64, shape (N + 1,).
        other: contact of each entry, int64, shape (E,).
        entry: K_ij, shape (E,) [N/m]; the same for both coordinates.
        order: contacts, neighbours close to each other, int64, shape (N,).
        compliance: a bound on the relative displacement of two contacts per force between them [m/N].
        tied: the contacts with springs to fixed places, int64; if there are none, a translation changes no force.
    """

    ends: np.ndarray
    stiffness: np.ndarray
    first: np.ndarray
    other: np.ndarray
    entry: np.ndarray
    order: np.ndarray
    compliance: float
    tied: np.ndarray


def laplacian_of(ends: np.ndarray, stiffness: np.ndarray, contacts: int) -> csr_array:
    """Build the weighted Laplacian K of the springs.

    Args:
        ends: the contacts a, b of each spring, int, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        contacts: number of contacts N.

    Returns:
        K, shape (N, N) [N/m].
    """
    from scipy.sparse import csr_array

    a, b = ends.T
    rows, columns = np.concatenate((a, b, a, b)), np.concatenate((a, b, b, a))
    values = np.concatenate((stiffness, stiffness, -stiffness, -stiffness))
    return csr_array((values, (rows, columns)), shape=(contacts, contacts))


def build_springs(ends: np.ndarray, stiffness: np.ndarray, contacts: int) -> Springs:
    """Build the rows of K and the order of the contacts.

    Args:
        ends: the contacts a, b of each spring, int, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        contacts: number of contacts N; the body is connected.

    Returns:
        The springs.
    """
    from scipy.sparse.csgraph import reverse_cuthill_mckee

    matrix = laplacian_of(ends, stiffness, contacts)
    order = reverse_cuthill_mckee(matrix, symmetric_mode=True).astype(np.int64)
    row = np.repeat(np.arange(contacts), np.diff(matrix.indptr))
    sort = np.lexsort((matrix.indices, matrix.indices != row, row))
    first, other, entry = matrix.indptr.astype(np.int64), matrix.indices[sort].astype(np.int64), matrix.data[sort]
    compliance = _greatest_compliance(first, other, entry, order)
    ends, stiffness, tied = np.array(ends, np.int64), np.array(stiffness), np.empty(0, np.int64)
    return Springs(ends, stiffness, first, other, entry, order, compliance, tied)


@lean
def diagonal(springs, i):
    """Return K_ii.

    Args:
        springs: the springs.
        i: the contact.

    Returns:
        The sum of the stiffnesses of its springs [N/m].
    """
    return springs.entry[springs.first[i]]


@compiled
def solve_band_in_place(matrix, right):
    """Solve a positive definite system by Cholesky factorisation.

    An unknown whose pivot is no more than rounding is kept at 0.

    Args:
        matrix: element (p, p + d) of the matrix at [p, d], shape (n, width), overwritten.
        right: the right side, shape (n,), overwritten by the solution.
    """
    n, width = matrix.shape
    least = EPS * matrix[:, 0]
    for j in range(n):
        reach = min(width, n - j)
        root = math.sqrt(matrix[j, 0]) if matrix[j, 0] > least[j] else np.inf
        matrix[j, 0] = root
        for d in range(1, reach):
            matrix[j, d] /= root
        right[j] /= root
        for d in range(1, reach):
            factor = matrix[j, d]
            if factor != 0.0:
                for e in range(d, reach):
                    matrix[j + d, e - d] -= factor * matrix[j, e]
                right[j + d] -= factor * right[j]
    for j in range(n - 1, -1, -1):
        total = right[j]
        for d in range(1, min(width, n - j)):
            total -= matrix[j, d] * right[j + d]
        right[j] = total / matrix[j, 0]


@compiled
def _greatest_compliance(first, other, entry, order):
    """Compute a bound on the compliance between any two contacts, from the inverse of K with contact 0 held.

    K = U' D U is factorised, U with ones on its diagonal. Of the inverse Z only the diagonal and the band are needed,
    from the last row to the first (Takahashi, Fagan and Chin, 1973): Z = D^-1 U'^-1 + (1 - U) Z, so that

        Z_ij = -sum_{k > i} U_ik Z_kj  for j > i,    Z_ii = 1 / D_i - sum_{k > i} U_ik Z_ik.

    Args:
        first: as in `Springs`, shape (N + 1,).
        other: likewise, shape (E,).
        entry: likewise, shape (E,) [N/m].
        order: likewise, shape (N,).

    Returns:
        Largest relative displacement of two contacts per force between them [m/N].
    """
    n = order.shape[0] - 1
    place = np.empty(n + 1, np.int64)
    at = 0
    for p in range(n + 1):
        place[order[p]] = at
        at += order[p] != 0
    width = 1
    for i in range(1, n + 1):
        for e in range(first[i], first[i + 1]):
            if other[e] != 0:
                width = max(width, place[other[e]] - place[i] + 1)
    upper = np.zeros((n, width))
    for i in range(1, n + 1):
        for e in range(first[i], first[i + 1]):
            if other[e] != 0 and place[other[e]] >= place[i]:
                upper[place[i], place[other[e]] - place[i]] = entry[e]
    for j in range(n):
        reach = min(width, n - j)
        for d in range(1, reach):
            factor = upper[j, d] / upper[j, 0]
            if factor != 0.0:
                for e in range(d, reach):
                    upper[j + d, e - d] -= factor * upper[j, e]
        for d in range(1, reach):
            upper[j, d] /= upper[j, 0]
    inverse = np.zeros((n, width))
    most = 0.0
    second = 0.0
    for j in range(n - 1, -1, -1):
        reach = min(width, n - j)
        for d in range(1, reach):
            for k in range(1, reach):
                low = min(d, k)
                inverse[j, d] -= upper[j, k] * inverse[j + low, max(d, k) - low]
        inverse[j, 0] = 1.0 / upper[j, 0]
        for k in range(1, reach):
            inverse[j, 0] -= upper[j, k] * inverse[j, k]
        if inverse[j, 0] > most:
            second = most
            most = inverse[j, 0]
        else:
            second = max(second, inverse[j, 0])
    return most + second
