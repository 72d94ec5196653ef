"""Which translation is chosen, and how near it is to not being determined.

The shape of a crawler is always unique. The translation rates v that minimise the dissipation R(chi(w, v)) may fill an
interval, when friction balances (condition (*), [G] section 2.2). The rule everywhere in this package: of that interval
take the translation nearest to zero. (An interval that only the cutting of a segment into elements leaves open is none:
`choose_translation`.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..compiled import compiled

CRITICAL = 1e-12
"""Below this relative margin a balance of friction forces counts as exact: 0.1 and 0.3 are not 1/10 and 3/10."""
NOISE = 1e-14
"""A velocity below this part of the largest is rounding."""


def visited_margin(force: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> float:
    """Compute how near all contacts are to sliding at once in one state.

        sum_i min(mu_plus_i - g_i, g_i + mu_minus_i) / sum_i (mu_plus_i + mu_minus_i)

    It is never smaller than `uniqueness_margin` of the same contacts' friction (of a segment's contacts, not of the
    segment as one block, which `commanded_margin` judges).

    Args:
        force: spring force g on each contact, shape (N,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The margin [1]; 0 when all contacts are at a bound and when there is no friction at all.
    """
    g, plus, minus = np.broadcast_arrays(*(np.asarray(a, dtype=np.float64) for a in (force, forward, backward)))
    return float(nearness(np.array(g), np.array(plus), np.array(minus)))


@compiled
def nearness(force, forward, backward):
    """Compute the visited margin of a state, unchecked; see `visited_margin`.

    Args:
        force: g of the springs on each contact, shape (N,) [N].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The distances to the nearest bounds, relative to all friction [1]; 0 without friction.
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
        The least and the greatest of them.
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


@compiled
def choose_translation(velocity, forward, backward, elements, share):
    """Add to the velocities one of the admissible translations: the one whose net translation is nearest to zero.

    Where contacts stand for stretches of ground, an interval may be an artefact of cutting the ground: when, in its
    middle, the ends of an element that friction holds slide opposite ways, the continuum has a point between them
    that stands, and so decides. The middle is taken then, and the translation counts as determined.

    Args:
        velocity: velocities up to a translation, shape (N,) [m per unit of the ramp], changed in place.
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].
        elements: both contacts of each element of a segment, shape (P, 2); no rows where there is no segment.
        share: weight of each contact in the net translation, shape (N,); their sum is 1.

    Returns:
        How far the least and the greatest admissible translation lie from the chosen one.
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


@compiled
def is_wide(least, most, velocity):
    """Tell an interval of translations from rounding.

    Args:
        least: its lower end [m per unit of the ramp].
        most: its upper end.
        velocity: of the contacts, shape (N,).

    Returns:
        True when its width is more than rounding of the velocities.
    """
    size = 0.0
    for i in range(velocity.shape[0]):
        size = max(size, abs(velocity[i]))
    return most - least > CRITICAL * size and most > least
