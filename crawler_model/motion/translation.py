"""The choice of the translation, and the distance from states in which it is not determined.

The shape of a crawler is always unique. The translation rates v that minimise the dissipation R(chi(w, v)) may fill an
interval, when friction balances (condition (*), [G] section 2.2). Everywhere in this package the translation nearest to
zero is then chosen from that interval. (An interval that exists only because a segment is divided into elements does
not count; see `choose_translation`.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..compiled import compiled, lean
from ..rounding import CRITICAL, NOISE

FEW_FREE, FEW_CONTACTS = 2, 256
"""After an event all contacts are checked for criticality if at most `FEW_FREE` are free, as the check then costs no
more than the solve, or if there are at most `FEW_CONTACTS`. Otherwise the visited margin is sampled at ramp ends."""


def visited_margin(force: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> float:
    """Compute how close all contacts are to sliding at once in one state.

        sum_i min(mu_plus_i - g_i, g_i + mu_minus_i) / sum_i (mu_plus_i + mu_minus_i)

    It is never smaller than `uniqueness_margin` of the friction of the same contacts. (Here the contacts of a segment
    count individually, while `commanded_margin` treats the segment as one block.)

    Args:
        force: spring force g on each contact, shape (N,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The margin [1]; 0 if all contacts are at a bound or there is no friction.
    """
    g, plus, minus = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (force, forward, backward)))
    return float(nearness(np.array(g), np.array(plus), np.array(minus)))


@compiled
def visited_margins(force, forward, backward):
    """Compute the visited margin of each of several states, as `visited_margin` does.

    Args:
        force: spring force g on each contact, shape (M, N) [N].
        forward: mu_plus, shape (M, N) [N].
        backward: mu_minus, shape (M, N) [N].

    Returns:
        Shape (M,) [1].
    """
    margins = np.empty(force.shape[0])
    for m in range(force.shape[0]):
        margins[m] = nearness(force[m], forward[m], backward[m])
    return margins


@lean
def nearness(force, forward, backward):
    """Compute the visited margin of a state without checking the arguments; see `visited_margin`.

    Args:
        force: g of the springs on each contact, shape (N,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        Sum of the distances to the nearest bounds, relative to the total friction [1]; 0 without friction.
    """
    near = 0.0
    total = 0.0
    for i in range(force.shape[0]):
        near += max(min(forward[i] - force[i], force[i] + backward[i]), 0.0)
        total += forward[i] + backward[i]
    return near / total if total > 0.0 else 0.0


@compiled
def find_translations(velocity, forward, backward):
    """Find the translation rates c that minimise sum_i R_i(v_i + c).

    Args:
        velocity: v up to a translation, shape (N,) [m per unit of the ramp].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The smallest and the largest of them.
    """
    n = velocity.shape[0]
    total = 0.0
    slope = 0.0
    for i in range(n):
        total += forward[i] + backward[i]
        slope -= backward[i]
    near = CRITICAL * total
    least = -np.inf
    if slope < -near:
        least = np.inf
    order = np.argsort(-velocity)
    for j in range(n):
        i = order[j]
        c = -velocity[i]
        slope += forward[i] + backward[i]
        if least == np.inf and slope >= -near:
            least = c
        if slope > near:
            return least, c
    return least, np.inf


@lean
def choose_translation(velocity, forward, backward, elements, share):
    """Add to the velocities the admissible translation whose net translation is nearest to zero.

    Where contacts represent lengths of ground, an interval may be an artefact of the discretisation: if at its
    midpoint the two ends of an element with friction slide in opposite directions, the continuum has a point at rest
    between them, which determines the translation. The midpoint is then chosen, and the translation counts as unique.

    Args:
        velocity: velocities up to a translation, shape (N,) [m per unit of the ramp], changed in place.
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].
        elements: both contacts of each element of a segment, shape (P, 2); no rows without segments.
        share: weight of each contact in the net translation, shape (N,); their sum is 1.

    Returns:
        Distances of the smallest and the largest admissible translation from the chosen one.
    """
    least, most = find_translations(velocity, forward, backward)
    net = 0.0
    size = 0.0
    for i in range(velocity.shape[0]):
        net += share[i] * velocity[i]
        size = max(size, abs(velocity[i]))
    chosen = min(max(-net, least), most)
    decided = False
    middle = 0.5 * (least + most)
    if most > least and most - least < np.inf:
        for j in range(elements.shape[0]):
            a, b = elements[j, 0], elements[j, 1]
            held = min(forward[a], backward[a], forward[b], backward[b]) > 0.0
            if held and (velocity[a] + middle) * (velocity[b] + middle) < 0.0:
                decided = True
                break
    if decided:
        chosen = least = most = middle
    for i in range(velocity.shape[0]):
        velocity[i] += chosen
        if abs(velocity[i]) <= NOISE * size:
            velocity[i] = 0.0
    return least - chosen, most - chosen


@lean
def is_wide(least, most, velocity):
    """Check whether an interval of translations is wider than rounding.

    Args:
        least: lower end of the interval [m per unit of the ramp].
        most: upper end of the interval.
        velocity: velocities of the contacts, shape (N,).

    Returns:
        True if its width exceeds the rounding of the velocities.
    """
    size = 0.0
    for i in range(velocity.shape[0]):
        size = max(size, abs(velocity[i]))
    return most - least > CRITICAL * size and most > least
