"""The number of elements of a segment for a given accuracy.

An element is a spring, and a contact represents the ground halfway to its neighbours ([G] sections 3.3 and 3.4). The
error of the net translation is of first order in the length of an element, with a changing sign: the point at which the
body is at rest falls on a contact or between two contacts. If that point is known (`standing`), this error is predicted
for every grid. The remaining error is measured by running the drive on coarse grids, and extrapolated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import SceneError

MOST_UNMEASURED = 1000
"""Upper limit of elements if there is no drive to measure the accuracy with."""
MOST_ELEMENTS = 1_000_000
"""Upper limit of elements."""

_ALL_TRIED = 24
"""All grids up to this number of elements are tried."""
_TRIED = (*range(1, _ALL_TRIED + 1), 27, 29, 31, 34, 36, 39, 41, 44, 47, 50, 53)
"""Coarse grids to try."""
_TRIED_FINER = (61, 71, 83, 97, 113, 137, 163, 197, 239)
"""Finer grids, tried if the coarse ones do not suffice."""
_VERIFIED = 600
"""Up to this number of elements, a result inferred from other grids is verified by a run."""
_SAFETY = 0.75
"""Part of the accuracy available for errors that are predicted, not measured."""
_MARGIN = 1.5
"""Safety factor for extrapolated errors."""
_PER_WAVE = 4
"""Minimum number of elements per wavelength."""
MOST_WAVES_MEASURED = 13.0
"""Number of wavelengths in a segment up to which the error is measured; beyond it, the runs would take seconds."""


def count_elements(
    gains: Callable[[int], np.ndarray],
    exact: np.ndarray,
    predict: Callable[[np.ndarray], np.ndarray],
    scale: float,
    accuracy: float,
    waves: float = 0.0,
) -> int:
    """Find a number of elements from which on the net translation has the required accuracy in every period.

    From there on the translation is also unique, or not, as it is on the finest grid.

    Args:
        gains: net translation of each period (or at each waypoint) for a number of elements, then both ends of the
            interval of translations that solve the model as well, from the one chosen, 0 where it is unique [m].
        exact: the same without error, or from a fine grid [m].
        predict: error of `gains` due to standing contacts for numbers of elements, both of shape (M,) [m].
        scale: largest commanded change of length [m].
        accuracy: allowed error, relative to `scale` [1].
        waves: number of wavelengths in the segment, 0 without a wave [1]; a grid resolves each of them.

    Returns:
        The number: at least the smallest one from which on every grid is accurate enough, at most a few times larger.

    Raises:
        SceneError: if it would exceed a million.
    """
    least = max(int(np.ceil(_PER_WAVE * waves)), 1)
    finer = max(1.0, 3.0 * least / _TRIED[-1])

    def measure(n: int) -> float:
        found = gains(n)
        if _is_unique(found) != _is_unique(exact):
            return np.inf
        differs = found != exact  # both may be infinite
        return float(np.abs(found[differs] - exact[differs]).max(initial=0.0)) / scale

    tried, measured, rest = np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    for grids in (_TRIED, _TRIED_FINER):
        grid = np.unique([round(n * finer) for n in grids if n * finer >= least]).astype(np.int64)
        tried = np.concatenate((tried, grid))
        measured = np.concatenate((measured, [measure(n) for n in grid.tolist()]))
        rest = np.maximum(np.where(measured < np.inf, measured, 0.0) - predict(tried) / scale, 0.0)
        wanted = _first_good(tried, measured, rest, lambda n: predict(n) / scale, accuracy, least)
        if 2 * wanted <= tried[-1] or waves > 0.0:
            break
    while _ALL_TRIED < wanted <= _VERIFIED and measure(wanted) > 0.95 * accuracy:
        wanted += 1 + wanted // 8
    return _checked_count(wanted, accuracy)


def _is_unique(gains: np.ndarray) -> bool:
    """Determine from the interval at their end whether the translations are unique."""
    return not gains[-2:].any()


def count_elements_of_waves(waves: float, accuracy: float) -> int:
    """Find a number of elements that resolves short waves.

    On a grid the standing point of the body is off by half an element at most, so 1 / accuracy elements bound that
    error; the error of a wave is of second order in the elements per wavelength, and smaller for shorter waves.

    Args:
        waves: number of wavelengths in the segment [1].
        accuracy: allowed error [1].

    Returns:
        The number.

    Raises:
        SceneError: if it would exceed a million.
    """
    return _checked_count(max(_PER_WAVE * waves, 1.0 / accuracy), accuracy)


def _checked_count(wanted: float, accuracy: float) -> int:
    if wanted > MOST_ELEMENTS:
        raise SceneError(f"accuracy {accuracy:g} would need {wanted:.0f} elements; at most {MOST_ELEMENTS} are allowed")
    return int(np.ceil(wanted))


def _first_good(
    tried: np.ndarray,
    measured: np.ndarray,
    rest: np.ndarray,
    predict: Callable[[np.ndarray], np.ndarray],
    accuracy: float,
    least: int,
) -> int:
    """Find the number of elements from which on no error is too large; above the allowed maximum if there is none.

    Args:
        tried: numbers of elements, increasing, shape (M,).
        measured: relative error of each, shape (M,).
        rest: part of the error that was not predicted, shape (M,).
        predict: relative error due to standing contacts for numbers of elements.
        accuracy: allowed relative error.
        least: the smallest admissible number.

    Returns:
        The number.
    """
    last = int(tried[-1])
    exactly = int((measured > 0.95 * accuracy).nonzero()[0].max(initial=-1))
    good_from = least if exactly < 0 else int(tried[exactly]) + 1
    others = np.arange(max(_ALL_TRIED + 1, least), last + 1)
    at_least = np.maximum.accumulate(rest[::-1])[::-1]  # on this grid and all finer ones
    bound = predict(others) + at_least[np.minimum(np.searchsorted(tried, others / _MARGIN), tried.size - 1)]
    beyond = np.unique(np.geomspace(last + 1, 4 * MOST_ELEMENTS, 6000).astype(np.int64))
    all_others = np.concatenate((others, beyond))
    bounds = np.concatenate((bound, predict(beyond) + _MARGIN * _extrapolate(tried, rest, beyond)))
    return max(good_from, 1 + int(all_others[bounds > _SAFETY * accuracy].max(initial=0)))


def _extrapolate(tried: np.ndarray, errors: np.ndarray, elements: np.ndarray) -> np.ndarray:
    """Extrapolate the envelope of errors to finer grids, with the observed order, 1 or 2."""
    first, last = int(tried[0]), int(tried[-1])
    spans = ((max(first, last // 20), max(last // 6, 3 * first // 2)), (last // 2, last))
    coarse, fine = (_envelope(tried, errors, *span) for span in spans)
    second = fine[1] * fine[0] ** 1.5 <= coarse[1] * coarse[0] ** 1.5
    order = 2.0 if second else 1.0
    return fine[1] * (fine[0] / elements) ** order


def _envelope(tried: np.ndarray, errors: np.ndarray, first: int, last: int) -> tuple[float, float]:
    """Find the number of elements in a range at which error times number is largest, and the error there."""
    span = (tried >= first) & (tried <= last)
    worst = int((errors * tried)[span].argmax())
    return float(tried[span][worst]), float(errors[span][worst])
