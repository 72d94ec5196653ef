"""The projection of a chain whose stiffness spans many decades, in double-double arithmetic.

The zero of a stiff link's curve lies at k dL. Next to a link that is softer by a factor r, its rounding changes the
elongation of the soft link by r eps dL. This is the same dynamic program as `projection.project`, but positions, slopes
and jumps are sums of two floats (Dekker 1971), so that even for a factor of 1e16 the error is below float resolution.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled, lean
from ...rounding import EPS
from ..state import AT_BACKWARD, BACKWARD, FORWARD, TENSION
from .memory import ROW_D_BACKWARD, ROW_D_FORWARD, ROW_RATE

WIDE = 1e4
"""Stiffness ratio above which the projection uses two floats per number; below it, rounding errors are < 1e-11 dL."""

_POSITION, _SLOPE, _JUMP = range(3)
_SPLITTER = 134217729.0
_NOTHING = (0.0, 0.0)


@lean
def spans_decades(compliance):
    """Check whether the stiffness of a chain spans so many decades that its projection needs two floats per number.

    Args:
        compliance: 1 / k, shape (n,) [m/N].

    Returns:
        True if it does.
    """
    least = np.inf
    most = 0.0
    for value in compliance:
        least = min(least, value)
        most = max(most, value)
    return most > WIDE * least


@compiled
def _tidy(high, low):
    total = high + low
    return total, low - (total - high)


@compiled
def add(a, b):
    """Add two numbers, each represented by two floats.

    Args:
        a: the larger float and the rest.
        b: likewise.

    Returns:
        Their sum, likewise.
    """
    high = a[0] + b[0]
    part = high - a[0]
    rest = (a[0] - (high - part)) + (b[0] - part)
    low = a[1] + b[1]
    part = low - a[1]
    rest_low = (a[1] - (low - part)) + (b[1] - part)
    high, rest = _tidy(high, rest + low)
    return _tidy(high, rest + rest_low)


@compiled
def subtract(a, b):
    """Subtract b from a, each represented by two floats.

    Args:
        a: the larger float and the rest.
        b: likewise.

    Returns:
        Their difference, likewise.
    """
    return add(a, (-b[0], -b[1]))


@compiled
def multiply(a, b):
    """Multiply two numbers, each represented by two floats.

    Args:
        a: the larger float and the rest.
        b: likewise.

    Returns:
        Their product, likewise.
    """
    high = a[0] * b[0]
    part = _SPLITTER * a[0]
    a_high = part - (part - a[0])
    a_low = a[0] - a_high
    part = _SPLITTER * b[0]
    b_high = part - (part - b[0])
    b_low = b[0] - b_high
    rest = ((a_high * b_high - high) + a_high * b_low + a_low * b_high) + a_low * b_low
    return _tidy(high, rest + (a[0] * b[1] + a[1] * b[0]))


@compiled
def _divide(a, b):
    """Divide a by b."""
    first = a[0] / b[0]
    rest = subtract(a, multiply((first, 0.0), b))
    second = rest[0] / b[0]
    rest = subtract(rest, multiply((second, 0.0), b))
    return add(_tidy(first, second), (rest[0] / b[0], 0.0))


@compiled
def _push(stack, place, position, slope, jump):
    for part in range(2):
        stack[_POSITION, part, place] = position[part]
        stack[_SLOPE, part, place] = slope[part]
        stack[_JUMP, part, place] = jump[part]


@compiled
def _read(stack, row, place):
    return stack[row, 0, place], stack[row, 1, place]


@compiled
def _pass_zero(near, n_near, shift_near, far, n_far, shift_far, direction, zero, flat):
    """Move the zero outwards past breakpoints of the stack `near`, which move to the stack `far`.

    Returns the lengths of both stacks, the zero, the heights of the curve before and beyond it, and the slopes there.
    """
    here = add(_read(near, _POSITION, n_near - 1), shift_near)
    distance = subtract(here, zero) if direction < 0.0 else subtract(zero, here)
    slope = (flat, 0.0)
    height = multiply(distance, slope)
    while True:
        jump = _read(near, _JUMP, n_near - 1)
        outer = add(slope, _read(near, _SLOPE, n_near - 1))
        if outer[0] < flat:
            outer = (flat, 0.0)
        n_near -= 1
        if jump[0] == np.inf:
            return n_near, n_far, here, height, jump, slope, outer
        beyond = subtract(jump, height)
        if beyond[0] >= 0.0:
            return n_near, n_far, here, height, beyond, slope, outer
        height = (-beyond[0], -beyond[1])
        _push(far, n_far, subtract(here, shift_far), subtract(slope, outer), jump)
        n_far += 1
        slope = outer
        step = _divide(height, slope)
        zero = subtract(here, step) if direction < 0.0 else add(here, step)
        if n_near == 0:
            return n_near, n_far, zero, _NOTHING, _NOTHING, slope, slope
        further = add(_read(near, _POSITION, n_near - 1), shift_near)
        distance = subtract(here, further) if direction < 0.0 else subtract(further, here)
        height = subtract(height, multiply(slope, distance))
        if height[0] <= 0.0:
            return n_near, n_far, zero, _NOTHING, _NOTHING, slope, slope
        here = further


@compiled
def project_wide(target, compliance, backward, forward, magnitude, tension, side):
    """Project `target` onto the stasis domain of a chain; the result is written into `tension` and `side`.

    Args:
        target: trial tensions a, shape (n,) [N].
        compliance: 1 / k > 0, shape (n,) [m/N].
        backward: bounds of T_{i-1} - T_i, shape (n + 1,) [N], inf where there is no bound.
        forward: bounds of T_i - T_{i-1}, likewise.
        magnitude: magnitude of the numbers whose rounding affects the bounds, shape (n + 1,) [N].
        tension: output, shape (n,) [N].
        side: output, int8, shape (n + 1,), as in `projection.project`.

    Returns:
        The number of breakpoints passed by the zero of the curve, times ten for the cost of the arithmetic.
    """
    n = target.shape[0]
    left = np.empty((3, 2, 2 * n + 2))
    right = np.empty((3, 2, 2 * n + 2))
    zeros = np.empty((n, 2))
    endless = (np.inf, 0.0)
    shift_left = _NOTHING
    shift_right = _NOTHING
    n_left = 0
    n_right = 0
    moved = 0
    if backward[0] < np.inf:
        _push(left, 0, (-backward[0], 0.0), _NOTHING, endless)
        n_left = 1
    if forward[0] < np.inf:
        _push(right, 0, (forward[0], 0.0), _NOTHING, endless)
        n_right = 1
    for i in range(n):
        flat = compliance[i]
        zero = (target[i], 0.0)
        slope_left = (flat, 0.0)
        slope_right = (flat, 0.0)
        jump_left = _NOTHING
        jump_right = _NOTHING
        before = n_left + n_right
        if n_left > 0 and subtract(zero, add(_read(left, _POSITION, n_left - 1), shift_left))[0] < 0.0:
            before = n_left
            n_left, n_right, zero, jump_right, jump_left, slope_right, slope_left = _pass_zero(
                left, n_left, shift_left, right, n_right, shift_right, -1.0, zero, flat
            )
            moved += before - n_left
        elif n_right > 0 and subtract(zero, add(_read(right, _POSITION, n_right - 1), shift_right))[0] > 0.0:
            before = n_right
            n_right, n_left, zero, jump_left, jump_right, slope_left, slope_right = _pass_zero(
                right, n_right, shift_right, left, n_left, shift_left, 1.0, zero, flat
            )
            moved += before - n_right
        zeros[i, 0], zeros[i, 1] = zero
        if backward[i + 1] < np.inf:
            shift_left = subtract(shift_left, (backward[i + 1], 0.0))
            position = subtract(subtract(zero, (backward[i + 1], 0.0)), shift_left)
            _push(left, n_left, position, slope_left, jump_left)
            n_left += 1
        else:
            n_left = 0
            shift_left = _NOTHING
        if forward[i + 1] < np.inf:
            shift_right = add(shift_right, (forward[i + 1], 0.0))
            position = subtract(add(zero, (forward[i + 1], 0.0)), shift_right)
            _push(right, n_right, position, slope_right, jump_right)
            n_right += 1
        else:
            n_right = 0
            shift_right = _NOTHING

    after = _NOTHING
    for i in range(n - 1, -1, -1):
        zero = (zeros[i, 0], zeros[i, 1])
        above = np.inf
        below = np.inf
        least = zero
        most = zero
        if forward[i + 1] < np.inf:
            least = subtract(after, (forward[i + 1], 0.0))
            above = subtract(zero, least)[0]
        if backward[i + 1] < np.inf:
            most = add(after, (backward[i + 1], 0.0))
            below = subtract(most, zero)[0]
        close = 8.0 * EPS * (magnitude[i + 1] + abs(zero[0]) + abs(after[0]))
        side[i + 1] = 1 if above <= close else -1 if below <= close else 0
        if above <= 0.0:
            zero = least
        elif below <= 0.0:
            zero = most
        tension[i] = zero[0]
        after = zero
    close = 8.0 * EPS * (magnitude[0] + abs(after[0]))
    side[0] = 1 if after[0] >= forward[0] - close else -1 if after[0] <= close - backward[0] else 0
    return 10 * moved


@lean
def uncertainty(contacts, links, floats, coming, s, i):
    """Compute the error of the place of an event that is due to the rounding of forces.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: tensions.
        floats: rates, and changes of the bounds.
        coming: the bound that the contact reaches.
        s: the place on the ramp.
        i: the contact.

    Returns:
        The error, as part of the ramp.
    """
    n = contacts.shape[1]
    size = abs(contacts[FORWARD, i]) + abs(s * floats[ROW_D_FORWARD, i])
    closing = floats[ROW_D_FORWARD, i]
    if coming == AT_BACKWARD:
        size = abs(contacts[BACKWARD, i]) + abs(s * floats[ROW_D_BACKWARD, i])
        closing = -floats[ROW_D_BACKWARD, i]
    for j in range(max(i - 1, 0), min(i + 1, n - 1)):
        size += abs(links[TENSION, j]) + abs(s * floats[ROW_RATE, j])
        closing += floats[ROW_RATE, j] if j < i else -floats[ROW_RATE, j]
    return min(EPS * (size + abs(closing)) / abs(closing), 1.0) if closing != 0.0 else 0.0
