"""When is the net translation determined, and which translation is chosen when it is not.

The shape of a crawler is always unique. Its translation is unique unless, for some set J of contacts, the
backward friction of J balances the forward friction of the others (condition (*), [G] section 2.2):

    sum_{i in J} mu_minus_i - sum_{i not in J} mu_plus_i = 0.

Then the translation rates v that minimise the dissipation R(chi(w, v)) fill an interval. The rule everywhere in
this package: of that interval take the one whose net translation is nearest to zero. (An interval that only the
cutting of a segment into elements leaves open is none: `choose_translation`.)
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..compiled import compiled

if TYPE_CHECKING:
    from ..body.body import Body
    from ..scene.scene import Scene

CRITICAL = 1e-12
"""Below this relative margin a balance of friction forces counts as exact: 0.1 and 0.3 are not 1/10 and 3/10."""

NOISE = 1e-14
"""A velocity below this part of the largest is rounding."""

_MOST_DECIDED = 30
_FEW_CONTACTS, _FEW_ROWS = 16, 64


def uniqueness_margin(forward: ArrayLike, backward: ArrayLike) -> float | None:
    """Compute how far the friction is from violating condition (*).

        margin = min_J |sum_J mu_minus - sum_{not J} mu_plus| / sum_i (mu_plus_i + mu_minus_i)

    Args:
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The margin in [0, 1/2]; 0 when it is below 1e-12, where it counts as critical, and when there is no
        friction at all; None when it is not decided: unequal contacts, more than 30 of them.

    Source: [G] Lemma on heterogeneous models, with the sign corrected; meet in the middle.
    """
    plus = np.asarray(forward, dtype=np.float64)
    minus = np.asarray(backward, dtype=np.float64)
    weight = plus + minus
    total = float(weight.sum())
    if total == 0.0:
        return 0.0
    goal = float(plus.sum())  # sum_J minus - sum_{not J} plus = sum_J weight - goal
    if np.ptp(weight) == 0.0:
        nearest = min(max(round(goal / weight[0]), 0), weight.size)
        gap = abs(nearest * weight[0] - goal)
    elif weight.size <= _MOST_DECIDED:
        half = weight.size // 2
        some, rest = _subset_sums(weight[:half]), np.sort(_subset_sums(weight[half:]))
        place = np.searchsorted(rest, goal - some)
        above = rest[np.minimum(place, rest.size - 1)]
        below = rest[np.maximum(place - 1, 0)]
        gap = float(min(np.abs(some + above - goal).min(), np.abs(some + below - goal).min()))
    else:
        return None
    margin = gap / total
    return 0.0 if margin < CRITICAL else float(margin)


def _subset_sums(weight: np.ndarray) -> np.ndarray:
    sums = np.zeros(1)
    for value in weight:
        sums = np.concatenate((sums, sums + value))
    return sums


def commanded_margin(scene: Scene) -> float | None:
    """Compute the uniqueness margin of the friction that a scene commands.

    A segment counts as one contact with the friction of its whole length: where parts of it slide both ways the
    translation is determined as soon as both its coefficients are positive ([G] Lemma on homogeneous continuous
    models), so that only segments that slide one way all along can leave it open.

    Args:
        scene: the scene.

    Returns:
        The least over the drive's waypoints, in [0, 1/2]; None when one of them is not decided, or when there are
        more than 64 different ones of more than 16 blocks; where a part of a segment has no friction; in the plane.
    """
    mesh, drive = scene.mesh, scene.commands
    if mesh.dimension == 2:
        return None
    for segment in mesh.segments:
        if min(drive.forward[:, segment.contacts].min(), drive.backward[:, segment.contacts].min()) <= 0.0:
            return None
    sides = [_blocks(mesh, rows) for rows in (drive.forward, drive.backward)]
    rows = np.unique(np.hstack(sides), axis=0)
    n = sides[0].shape[1]
    if n > _FEW_CONTACTS and rows.shape[0] > _FEW_ROWS:
        return None  # each row is a search over subsets: too long to wait for
    margins = [uniqueness_margin(row[:n], row[n:]) for row in rows]
    decided = [m for m in margins if m is not None]
    if 0.0 in decided:
        return 0.0
    return min(decided) if len(decided) == len(margins) else None


def _blocks(mesh: Body, friction: np.ndarray) -> np.ndarray:
    """Sum friction over what can move rigidly: isolated contacts, and whole segments."""
    segments = [friction[:, s.contacts].sum(axis=1, keepdims=True) for s in mesh.segments]
    return np.hstack((friction[:, mesh.isolated], *segments))


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


def translation_interval(velocity: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> tuple[float, float]:
    """Find all c that minimise R(velocity + c): what may be added to the velocities, [G] section 2.2.

    Args:
        velocity: velocities up to a translation, shape (N,) [m per unit of the ramp].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The least and the greatest minimiser; they are equal when the translation is determined. Infinite where
        nothing resists. (`Step.translation_interval` speaks of the net translation itself instead.)

    Raises:
        ValueError: when the shapes differ.
    """
    v, plus, minus = (np.array(a, dtype=np.float64) for a in (velocity, forward, backward))
    if v.ndim != 1 or not v.shape == plus.shape == minus.shape:
        raise ValueError(f"velocity, forward, backward: shapes {v.shape}, {plus.shape}, {minus.shape}; one per contact")
    least, most = _find_translations(v, plus, minus)
    return float(least), float(most)


@compiled
def _find_translations(velocity, forward, backward):
    """Do what `translation_interval` says, unchecked."""
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
    least, most = _find_translations(velocity, forward, backward)
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
