"""Ticks of a run: their rate, their ends in whole nanoseconds, and how many there are."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from ..body.drive import NS
from ..errors import CommandError

DEFAULT_RATE = 100.0
"""Ticks per second where none are asked for, here and in the parameters of the node [Hz]."""


def tick_end_ns(tick: int, rate: Fraction) -> int:
    """Compute the end of a tick, floor(k 10^9 / rate), without drift.

    Args:
        tick: k, 0 for the start.
        rate: ticks per second [Hz].

    Returns:
        Simulated time [ns].
    """
    return tick * NS * rate.denominator // rate.numerator


def tick_ends(first: int, last: int, rate: Fraction, end_ns: int) -> np.ndarray:
    """Compute the ends of some ticks of a run; the last tick of the run may be cut short.

    Args:
        first: the first tick, from 1.
        last: the last tick.
        rate: ticks per second [Hz].
        end_ns: end of the run [ns].

    Returns:
        Shape (last - first + 1,), int64 [ns].
    """
    k = np.arange(last - first + 1)
    (whole, rest), (begin, over) = (divmod(t * NS * rate.denominator, rate.numerator) for t in (1, first))
    if max(begin + k.size * whole, (k.size + 1) * rate.numerator) >= 1 << 63:
        k = k.astype(object)  # integers of any size
    return np.minimum(begin + k * whole + (over + k * rest) // rate.numerator, end_ns).astype(np.int64)


def count_ticks(end_ns: int, rate: Fraction) -> int:
    """Count the ticks of a run, with one that is cut short.

    Args:
        end_ns: end of the run [ns].
        rate: ticks per second [Hz].

    Returns:
        Their number.
    """
    return -(-end_ns * rate.numerator // (NS * rate.denominator))


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.integer, np.floating))


def _write(value: float) -> str:
    """Write what was given: an integer may be beyond all floats, and it may be no number."""
    try:
        return f"{float(value):g}" if _is_number(value) else repr(value)
    except OverflowError:
        return f"an integer of {int(value).bit_length()} bits"


def check_duration(seconds: float) -> float:
    """Check the duration of a run.

    Args:
        seconds: duration [s].

    Returns:
        The same as a float [s].

    Raises:
        CommandError: if it is out of range.
    """
    if not _is_number(seconds) or not 0.0 <= seconds < 9e9:
        raise CommandError(f"duration: {_write(seconds)} s; it must be a number between 0 and 9e9")
    return float(seconds)


def rational_rate(rate: float) -> Fraction:
    """Convert a rate to the rational number that was probably intended.

    Args:
        rate: ticks per second [Hz], between 1e-9 and 1e9.

    Returns:
        The nearest fraction with a denominator of at most 10^6, or the exact value for low rates.

    Raises:
        CommandError: if it is out of range.
    """
    if not _is_number(rate) or not 1e-9 <= rate <= 1e9:
        raise CommandError(f"rate: {_write(rate)} Hz; it must be a number between 1e-9 and 1e9")
    exact = Fraction(float(rate))
    near = exact.limit_denominator(10**6)
    return near if abs(near - exact) <= exact / 10**12 else exact
