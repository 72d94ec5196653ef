"""Banded systems of equations without symmetry."""

from __future__ import annotations

from ...compiled import lean


@lean
def solve_band(band, reach, right):
    """Solve a banded system by Gaussian elimination with partial pivoting.

    Loops run over slices: an index with an offset may be negative to numba, which then does not vectorize.

    Args:
        band: element (r, c) of the matrix at [c, 2 reach + r - c], shape (n, 3 reach + 1), overwritten.
        reach: largest distance of an element from the diagonal.
        right: right side, shape (n,), overwritten by the solution.

    Returns:
        Smallest pivot relative to the largest element of its column before elimination, 0 if the matrix is singular.
    """
    n = right.shape[0]
    middle = 2 * reach
    least = 1.0
    end = 0
    for j in range(n):
        last = min(n, j + reach + 1)
        scale = 0.0
        above = band[j, middle - min(j, reach) : middle]
        for k in range(above.shape[0]):
            scale = max(scale, abs(above[k]))
        pivot = 0
        below = band[j, middle : middle + last - j]
        for k in range(below.shape[0]):
            if abs(below[k]) > abs(below[pivot]):
                pivot = k
        top = below[pivot]
        if top == 0.0:
            return 0.0
        least = min(least, abs(top) / max(scale, abs(top)))
        end = max(end, min(n, j + pivot + reach + 1))  # of the upper triangle, which grows by pivoting
        if pivot > 0:
            for c in range(j, end):
                at = middle + j - c
                band[c, at], band[c, at + pivot] = band[c, at + pivot], band[c, at]
            right[j], right[j + pivot] = right[j + pivot], right[j]
        below = below[1:]
        rest = right[j + 1 : last]
        for k in range(below.shape[0]):
            below[k] /= top
        for k in range(below.shape[0]):
            rest[k] -= below[k] * right[j]
        for c in range(j + 1, end):
            factor = band[c, middle + j - c]
            if factor != 0.0:
                column = band[c, middle + j + 1 - c : middle + last - c]
                for k in range(below.shape[0]):
                    column[k] -= below[k] * factor
    for j in range(n - 1, -1, -1):
        right[j] /= band[j, middle]
        first = max(0, j - middle)
        rest = right[first:j]
        above = band[j, middle + first - j : middle]
        for k in range(above.shape[0]):
            rest[k] -= above[k] * right[j]
    return least
