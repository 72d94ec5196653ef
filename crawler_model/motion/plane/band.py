"""Banded systems of equations without symmetry."""

from __future__ import annotations

from ...compiled import compiled


@compiled
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
    for j in range(n):
        last = min(n, j + reach + 1)
        pivot = j
        scale = 0.0
        for r in range(max(0, j - reach), last):
            scale = max(scale, abs(band[j, middle + r - j]))
        for r in range(j + 1, last):
            if abs(band[j, middle + r - j]) > abs(band[j, middle + pivot - j]):
                pivot = r
        top = band[j, middle + pivot - j]
        if top == 0.0:
            return 0.0
        least = min(least, abs(top) / scale)
        end = min(n, j + middle + 1)
        if pivot != j:
            for c in range(j, end):
                at = middle + j - c
                other = middle + pivot - c
                band[c, at], band[c, other] = band[c, other], band[c, at]
            right[j], right[pivot] = right[pivot], right[j]
        for r in range(j + 1, last):
            band[j, middle + r - j] /= top
            right[r] -= band[j, middle + r - j] * right[j]
        for c in range(j + 1, end):
            factor = band[c, middle + j - c]
            if factor != 0.0:
                for r in range(j + 1, last):
                    band[c, middle + r - c] -= band[j, middle + r - j] * factor
    for j in range(n - 1, -1, -1):
        right[j] /= band[j, middle]
        for r in range(max(0, j - middle), j):
            right[r] -= band[j, middle + r - j] * right[j]
    return least
