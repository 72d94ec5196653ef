"""Segments cut into elements: how many, and what each element and contact is made of.

An element is a spring, a contact stands for the ground halfway to its neighbours ([G] sections 3.3 and 3.4). The error
of the net translation is of first order in the length of an element, with a changing sign: the place where the body
stands still falls on a contact or between two. Where that place is known (`standing`), this error is predicted for
every mesh; the rest is measured: the drive is run on coarse grids, and what was not predicted is extrapolated.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import SceneError

MOST_UNMEASURED = 1000
"""Elements at most where no drive tells what accuracy takes."""
MOST_ELEMENTS = 1_000_000
"""More elements than this are refused."""

_ALL_TRIED = 24
"""Up to here every grid is tried."""
_TRIED = (*range(1, _ALL_TRIED + 1), 27, 29, 31, 34, 36, 39, 41, 44, 47, 50, 53)
"""Coarse grids."""
_TRIED_FINER = (61, 71, 83, 97, 113, 137, 163, 197, 239)
"""Grids tried where the coarse ones do not reach far enough."""
_VERIFIED = 600
"""Up to here a number that follows from other grids is tried itself."""
_SAFETY = 0.75
"""Part of the accuracy that is used up where an error is predicted, not measured."""
_MARGIN = 1.5
"""Safety on errors that are extrapolated."""
_PER_WAVE = 4
"""Elements a wavelength at least."""
MOST_WAVES_MEASURED = 13.0
"""Wavelengths in a segment up to which the error is measured; with more the grids would take seconds."""


def count_elements(
    gains: Callable[[int], np.ndarray],
    exact: np.ndarray,
    predict: Callable[[np.ndarray], np.ndarray],
    scale: float,
    accuracy: float,
    waves: float = 0.0,
) -> int:
    """Find a number of elements from which on the net translation is as accurate as asked.

    Args:
        gains: what is compared: net translation of each period (or of the whole run) with so many elements [m].
        exact: the same without error, or from a fine grid [m].
        predict: error of `gains` that standing contacts cause, of numbers of elements, both of shape (M,) [m].
        scale: largest change of length commanded [m].
        accuracy: error allowed, relative to `scale` [1].
        waves: wavelengths in the segment's length, 0 without a wave [1]; a mesh resolves each of them.

    Returns:
        The number: more than the least number from which on every grid is accurate enough, at most a few times more.

    Raises:
        SceneError: when it would be more than a million.
    """
    least = max(int(np.ceil(_PER_WAVE * waves)), 1)
    finer = max(1.0, 3.0 * least / _TRIED[-1])

    def measure(n: int) -> float:
        return float(np.abs(gains(n) - exact).max(initial=0.0)) / scale

    tried, measured, rest = np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
    for grids in (_TRIED, _TRIED_FINER):
        grid = np.unique([round(n * finer) for n in grids if n * finer >= least]).astype(np.int64)
        tried = np.concatenate((tried, grid))
        measured = np.concatenate((measured, [measure(n) for n in grid.tolist()]))
        rest = np.maximum(measured - predict(tried) / scale, 0.0)
        wanted = _first_good(tried, measured, rest, lambda n: predict(n) / scale, accuracy, least)
        if 2 * wanted <= tried[-1] or waves > 0.0:
            break
    while _ALL_TRIED < wanted <= _VERIFIED and measure(wanted) > 0.95 * accuracy:
        wanted += 1 + wanted // 8
    return _checked_count(wanted, accuracy)


def count_elements_of_waves(waves: float, accuracy: float) -> int:
    """Find a number of elements that resolves short waves.

    A mesh lets the body stand half an element off at most, so 1 / accuracy elements bound that error; what a wave adds
    is of second order in the elements a wavelength, and the smaller the shorter the waves are.

    Args:
        waves: wavelengths in the segment's length [1].
        accuracy: error allowed [1].

    Returns:
        The number.

    Raises:
        SceneError: when it would be more than a million.
    """
    return _checked_count(max(_PER_WAVE * waves, 1.0 / accuracy), accuracy)


def _checked_count(wanted: float, accuracy: float) -> int:
    if wanted > MOST_ELEMENTS:
        raise SceneError(f"accuracy {accuracy:g} would take {wanted:.0f} elements; at most {MOST_ELEMENTS} are allowed")
    return int(np.ceil(wanted))


def _first_good(
    tried: np.ndarray,
    measured: np.ndarray,
    rest: np.ndarray,
    predict: Callable[[np.ndarray], np.ndarray],
    accuracy: float,
    least: int,
) -> int:
    """Find the number of elements from which on no error is too large, beyond what is allowed where there is none.

    Args:
        tried: numbers of elements, increasing, shape (M,).
        measured: the relative error of each, shape (M,).
        rest: what of it was not predicted, shape (M,).
        predict: relative error that standing contacts cause, of numbers of elements.
        accuracy: relative error allowed.
        least: the least number that is taken.

    Returns:
        The number; beyond what is allowed where none is good.
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
    """Extrapolate the envelope of errors to finer grids, with the order that they have; the theory knows 1 and 2."""
    first, last = int(tried[0]), int(tried[-1])
    spans = ((max(first, last // 20), max(last // 6, 3 * first // 2)), (last // 2, last))
    coarse, fine = (_envelope(tried, errors, *span) for span in spans)
    second = fine[1] * fine[0] ** 1.5 <= coarse[1] * coarse[0] ** 1.5
    order = 2.0 if second else 1.0
    return fine[1] * (fine[0] / elements) ** order


def _envelope(tried: np.ndarray, errors: np.ndarray, first: int, last: int) -> tuple[float, float]:
    """Find the number of elements between two at which the error, grown with it, is largest, and the error there."""
    span = (tried >= first) & (tried <= last)
    worst = int((errors * tried)[span].argmax())
    return float(tried[span][worst]), float(errors[span][worst])
