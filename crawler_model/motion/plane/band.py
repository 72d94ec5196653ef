"""Banded systems of equations without symmetry."""

from __future__ import annotations

from ...compiled import lean


@lean
def solve_band(band, reach, right):
    """Solve a banded system by Gaussian elimination with partial pivoting.

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
        for k in range(1, min(j, reach) + 1):
            scale = max(scale, abs(band[j, middle - k]))
        pivot = 0
        for k in range(1, last - j):
            if abs(band[j, middle + k]) > abs(band[j, middle + pivot]):
                pivot = k
        top = band[j, middle + pivot]
        if top == 0.0:
            return 0.0
        least = min(least, abs(top) / max(scale, abs(top)))
        end = max(end, min(n, j + pivot + reach + 1))  # of the upper triangle, which grows by pivoting
        if pivot > 0:
            for c in range(j, end):
                at = middle + j - c
                band[c, at], band[c, at + pivot] = band[c, at + pivot], band[c, at]
            right[j], right[j + pivot] = right[j + pivot], right[j]
        for k in range(1, last - j):
            band[j, middle + k] /= top
            right[j + k] -= band[j, middle + k] * right[j]
        for c in range(j + 1, end):
            at = middle + j - c
            factor = band[c, at]
            if factor != 0.0:
                for k in range(1, last - j):
                    band[c, at + k] -= band[j, middle + k] * factor
    for j in range(n - 1, -1, -1):
        right[j] /= band[j, middle]
        for k in range(1, min(j, middle) + 1):
            right[j - k] -= band[j, middle - k] * right[j]
    return least
