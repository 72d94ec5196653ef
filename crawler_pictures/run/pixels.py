"""Reduction of a run to the pixels of a picture, without losing what is shorter than a pixel."""

from __future__ import annotations

import numpy as np

FORWARD, BACK, BOTH = 1, -1, 2
"""States of a contact besides 0, which is stick; `BOTH` where slips in both directions are joined."""
_CODES = np.array([2, 0, 1, 3], np.uint8)
_STATES = np.array([0, FORWARD, BACK, BOTH], np.int8)


def divide(edges: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Assign consecutive intervals to equal pixels; an interval shorter than a pixel has one pixel.

    Args:
        edges: edges of the intervals, not decreasing, shape (T + 1,).
        count: number of pixels P between the first and the last edge.

    Returns:
        For each pixel the first of its intervals, and the one after its last, each shape (P,).
    """
    span = float(edges[-1] - edges[0])
    exact = (edges - edges[0]) * (count / span if span > 0.0 else 0.0)
    at = np.rint(exact).astype(np.int64)
    inside = np.floor(0.5 * (exact[:-1] + exact[1:])).astype(np.int64)  # the pixel of one that rounding would close
    begin = np.minimum(np.where(at[1:] > at[:-1], at[:-1], inside), count - 1)
    end = np.where(at[1:] > at[:-1], at[1:], begin + 1)
    end[-1] = count
    pixel = np.arange(count)
    return np.searchsorted(end, pixel, side="right"), np.searchsorted(begin, pixel, side="right")


def join_states(state: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Join the states of intervals: a slip in any of them counts, in both directions as `BOTH`.

    Args:
        state: 1 forward, -1 back, 0 stuck, 2 both, shape (T, N).
        first: the first interval of each pixel, shape (P,).
        last: the one after its last, shape (P,).

    Returns:
        The states, int8, shape (P, N).
    """
    codes = _CODES[state.astype(np.int8) + 1]
    return _STATES[_reduce(np.bitwise_or, codes, first, last)]


def join_extremes(values: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Keep the value of greatest size of each pixel.

    Args:
        values: shape (T, N); NaN where there is none.
        first: the first interval of each pixel, shape (P,).
        last: the one after its last, shape (P,).

    Returns:
        Shape (P, N); NaN where no interval of the pixel has a value.
    """
    most, least = _reduce(np.fmax, values, first, last), _reduce(np.fmin, values, first, last)
    return np.where(most >= -least, most, least)


def _reduce(combine: np.ufunc, values: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Combine the rows `first` .. `last` - 1 of each pixel."""
    padded = np.concatenate((values, values[-1:]))
    pairs = np.column_stack((first, last)).ravel()
    return np.asarray(combine.reduceat(padded, pairs, axis=0)[::2])


def thin(time: np.ndarray, positions: np.ndarray, state: np.ndarray, most: int) -> tuple[np.ndarray, ...]:
    """Reduce the samples of a run to at most a number of them; every slip stays in the state.

    Args:
        time: end of each sample, shape (T,) [s].
        positions: at these times, shape (T, N) [m].
        state: in the sample that ends then, shape (T, N).
        most: largest number of samples.

    Returns:
        The three arrays, with positions at the end of each sample that remains.
    """
    if time.size <= most + 1:
        return time, positions, state
    first, last = divide(np.arange(time.size), most)
    joined = join_states(state[1:], first, last)
    return (
        np.append(time[:1], time[last]),
        np.concatenate((positions[:1], positions[last])),
        np.concatenate((state[:1], joined)),
    )
