"""The projection onto the stasis domain of a chain: exact, usually in linear time.

    minimise    sum_i (T_i - a_i)^2 / (2 k_i)
    subject to  -backward_i <= T_i - T_{i-1} <= forward_i,    T_{-1} = T_{n} = 0

for n links and n + 1 contacts. It is a catch-up step if the bounds are frictions, and the rate problem inside an exact
ramp if the bounds are rates of friction, infinite where a contact is free.

The method is dynamic programming from the first link to the last. The derivative of the cost-to-come is a
non-decreasing, piecewise-linear function of T_i. A link adds the line (T - a_i) / k_i. A contact splits the curve at
its zero, moves the left part by -backward, the right part by forward and leaves a plateau of zero between. Only the
breakpoints are stored, on two stacks that meet at the zero, each with a shift common to all its members; a breakpoint
stores by how much the slope grows outwards, and how high the curve jumps there (the ends of the domain are infinite
jumps). Johnson's algorithm for the fused lasso is of the same family. Where the zero passes many of them at every link,
`breakpoints` stores them in trees.
"""

from __future__ import annotations

import numpy as np

from ...compiled import lean
from ...rounding import CRITICAL, EPS, NOISE
from .breakpoints import JUMP, POSITION, REACH, SLOPE, project_in_trees

_MANY_MOVES, _ALWAYS_FEW = 24, 1024
"""Trees replace the stacks once more than `_MANY_MOVES` per link plus `_ALWAYS_FEW` breakpoints have changed stacks."""


def workspace(links: int) -> np.ndarray:
    """Allocate the scratch memory of `project`.

    Args:
        links: the largest number of links to be projected.

    Returns:
        An array of shape (2, 4, 2 links + 4) for the two stacks of breakpoints.
    """
    return np.empty((2, 4, 2 * links + 4))


@lean
def project(target, compliance, backward, forward, magnitude, tension, side, stacks):
    """Project `target` onto the stasis domain of a chain; the result is written into `tension` and `side`.

    Args:
        target: trial tensions a, shape (n,) [N].
        compliance: 1 / k > 0, shape (n,) [m/N].
        backward: bounds of T_{i-1} - T_i, shape (n + 1,) [N], inf where there is no bound.
        forward: bounds of T_i - T_{i-1}, likewise; -backward <= forward.
        magnitude: magnitude of the numbers whose small differences the bounds are, shape (n + 1,) [N]; it sets the
            rounding error of the bounds. Zeros where the bounds are given exactly.
        tension: output, shape (n,) [N].
        side: output, int8, shape (n + 1,): 1 where `forward` holds with equality, -1 where `backward` does, else 0.
            A value within rounding of a bound counts as on it.
        stacks: scratch from `workspace(n)` or larger.

    Returns:
        The number of breakpoints passed by the zero of the curve.
    """
    n = target.shape[0]
    left = stacks[0]
    right = stacks[1]
    n_left = 0
    n_right = 0
    shift_left = 0.0
    shift_right = 0.0
    moved = 0
    reach = magnitude[0]  # total shift of the curve since it was last restarted: the scale of its rounding error
    if backward[0] < np.inf:
        left[POSITION, 0] = -backward[0]
        left[SLOPE, 0] = 0.0
        left[JUMP, 0] = np.inf
        n_left = 1
        reach += abs(backward[0])
    if forward[0] < np.inf:
        right[POSITION, 0] = forward[0]
        right[SLOPE, 0] = 0.0
        right[JUMP, 0] = np.inf
        n_right = 1
        reach += abs(forward[0])

    for i in range(n):
        if moved > _MANY_MOVES * i + _ALWAYS_FEW:
            moved += project_in_trees(
                target,
                compliance,
                backward,
                forward,
                magnitude,
                tension,
                stacks,
                i,
                n_left,
                n_right,
                shift_left,
                shift_right,
                reach,
            )
            break
        flat = compliance[i]
        zero = target[i]
        slope_left = flat
        slope_right = flat
        value_left = 0.0
        value_right = 0.0
        if n_left > 0 and zero < left[POSITION, n_left - 1] + shift_left:
            here = left[POSITION, n_left - 1] + shift_left
            value = (here - zero) * flat
            slope = flat
            while True:
                jump = left[JUMP, n_left - 1]
                outer = max(slope + left[SLOPE, n_left - 1], flat)
                n_left -= 1
                moved += 1
                if jump >= value:
                    zero = here
                    value_left = value - jump
                    value_right = value
                    slope_left = outer
                    slope_right = slope
                    break
                value -= jump
                right[POSITION, n_right] = here - shift_right
                right[SLOPE, n_right] = slope - outer
                right[JUMP, n_right] = jump
                n_right += 1
                slope = outer
                if n_left > 0:
                    further = left[POSITION, n_left - 1] + shift_left
                    fall = slope * (here - further)
                    if fall < value:
                        value -= fall
                        here = further
                        continue
                zero = here - value / slope
                slope_left = slope
                slope_right = slope
                break
        elif n_right > 0 and zero > right[POSITION, n_right - 1] + shift_right:
            here = right[POSITION, n_right - 1] + shift_right
            value = (here - zero) * flat
            slope = flat
            while True:
                jump = right[JUMP, n_right - 1]
                outer = max(slope + right[SLOPE, n_right - 1], flat)
                n_right -= 1
                moved += 1
                if -jump <= value:
                    zero = here
                    value_left = value
                    value_right = value + jump
                    slope_left = slope
                    slope_right = outer
                    break
                value += jump
                left[POSITION, n_left] = here - shift_left
                left[SLOPE, n_left] = slope - outer
                left[JUMP, n_left] = jump
                n_left += 1
                slope = outer
                if n_right > 0:
                    further = right[POSITION, n_right - 1] + shift_right
                    rise = slope * (further - here)
                    if rise < -value:
                        value += rise
                        here = further
                        continue
                zero = here - value / slope
                slope_left = slope
                slope_right = slope
                break

        tension[i] = zero
        low = -backward[i + 1]
        high = forward[i + 1]
        stacks[0, REACH, i] = reach
        reach = 0.0 if low == -np.inf and high == np.inf else reach + magnitude[i + 1]
        if low > -np.inf:
            shift_left += low
            left[POSITION, n_left] = zero + low - shift_left
            left[SLOPE, n_left] = slope_left
            left[JUMP, n_left] = -value_left
            n_left += 1
            reach += abs(low)
        else:
            n_left = 0
            shift_left = 0.0
        if high < np.inf:
            shift_right += high
            right[POSITION, n_right] = zero + high - shift_right
            right[SLOPE, n_right] = slope_right
            right[JUMP, n_right] = value_right
            n_right += 1
            reach += abs(high)
        else:
            n_right = 0
            shift_right = 0.0

    after = 0.0
    behind = 0.0  # the same from the other end
    slip = 0.0  # shift of the previous tension onto its bound, not a distance for the next contact
    for i in range(n - 1, -1, -1):
        zero = tension[i]
        least = after - forward[i + 1]
        most = after + backward[i + 1]
        if least == -np.inf and most == np.inf:
            behind = 0.0
        else:
            behind += magnitude[i + 1] + (abs(forward[i + 1]) if least > -np.inf else abs(backward[i + 1]))
        close = 8.0 * EPS * (stacks[0, REACH, i] + behind + abs(zero) + abs(after)) + slip
        if zero <= least + close:
            tension[i] = least
            side[i + 1] = 1
            slip = zero - least if zero > least else slip
        elif zero >= most - close:
            tension[i] = most
            side[i + 1] = -1
            slip = most - zero if zero < most else slip
        else:
            side[i + 1] = 0
            slip = 0.0
        after = tension[i]
    close = 8.0 * EPS * (magnitude[0] + behind + abs(after)) + slip
    if after >= forward[0] - close:
        side[0] = 1
    elif after <= -backward[0] + close:
        side[0] = -1
    else:
        side[0] = 0
    return moved


@lean
def shape_gain(tension, trial, compliance):
    """Compute the change of a link's elongation from its trial and final tension; rounding counts as zero.

    Args:
        tension: tension of the link, or its rate [N].
        trial: its value if no contact slid [N].
        compliance: compliance of the link [m/N].

    Returns:
        The change of its elongation [m].
    """
    change = tension - trial
    return change * compliance if abs(change) > 16.0 * EPS * (abs(tension) + abs(trial)) else 0.0


@lean
def chain_velocities(shape_rate, side, velocity, first, last):
    """Sum v_{i+1} = v_i + w_i over contacts first..last; contacts with `side` 0 and beyond the range are at rest.

    Args:
        shape_rate: w, the rate of each link's elongation, shape (N - 1,).
        side: the bound that each contact is at, 1, 0 or -1, int8, shape (N,).
        velocity: output, v of first..last, shape (N,).
        first: the first contact of the range.
        last: the last contact.

    Returns:
        True if nothing fixes the translation: the range is the whole chain and no contact is at rest.
    """
    n = side.shape[0]
    anchor = first
    free_translation = False
    if first > 0:
        velocity[first] = shape_rate[first - 1] if side[first] != 0 else 0.0
    else:
        while anchor <= last and side[anchor] != 0:
            anchor += 1
        if anchor <= last:
            velocity[anchor] = 0.0
        elif last == n - 1:
            free_translation = True
            anchor = first
            velocity[first] = 0.0
        else:
            anchor = last
            velocity[last] = -shape_rate[last]
    size = 0.0
    for i in range(max(first - 1, 0), min(last, n - 2) + 1):
        size += abs(shape_rate[i])
    for i in range(anchor - 1, first - 1, -1):
        velocity[i] = velocity[i + 1] - shape_rate[i]
    for i in range(anchor + 1, last + 1):
        velocity[i] = velocity[i - 1] + shape_rate[i - 1] if side[i] != 0 else 0.0
    if not free_translation:
        for i in range(first, last + 1):
            v = velocity[i]
            if abs(v) <= NOISE * size or (v * side[i] < 0.0 and abs(v) <= CRITICAL * size):
                velocity[i] = 0.0
    return free_translation
