"""Conditions under which the net translation is unique, and the choice if it is not.

The shape of a crawler is always unique. Its translation is unique unless, for some set J of contacts, the
backward friction of J balances the forward friction of the others (condition (*), [G] section 2.2):

    sum_{i in J} mu_minus_i - sum_{i not in J} mu_plus_i = 0.

With loads f the bounds mu_plus - f and mu_minus + f take the place of mu_plus and mu_minus in all of this file, and the
condition reads sum_{i in J} mu_minus_i + sum_i f_i = sum_{i not in J} mu_plus_i: only the sum of the loads counts. If
J is empty or contains all contacts, it means that the body is about to run away.

Then the translation rates v that minimise the dissipation R(chi(w, v)) fill an interval. Everywhere in this package
the rate whose net translation is nearest to zero is then chosen. (An interval that exists only because a segment is
divided into elements does not count; see `choose_translation`.)
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from ..body.body import Body
from ..body.drive import Drive
from ..rounding import CRITICAL, NOISE

UNDETERMINED = "friction does not determine the motion; of several translations the one nearest to zero is taken"
"""What every report tells of a run that is not unique: also of a point that slides along a border of the ground."""
_MOST_DECIDED = 30
_FEW_CONTACTS, _FEW_ROWS = 16, 64


class Undecided(Enum):
    """Why a uniqueness margin is not computed; the value is the text for people."""

    PLANE = "condition (*) is one on a line, and the body moves in the plane"
    FLAT_SPRINGS = "a link without a passive spring can go slack or stall, and may leave a part of the body to itself"
    BARE_SEGMENT = "a part of a segment has no friction in either direction"
    UNEQUAL_CONTACTS = f"more than {_MOST_DECIDED} contacts have unequal friction"
    MANY_COMMANDS = (
        f"more than {_FEW_ROWS} different frictions are commanded of more than {_FEW_CONTACTS} contacts or segments"
    )


def uniqueness_margin(forward: ArrayLike, backward: ArrayLike) -> float | None:
    """Compute the distance of the friction from violating condition (*).

        margin = min_J |sum_J mu_minus - sum_{not J} mu_plus| / sum_i (mu_plus_i + mu_minus_i)

    Args:
        forward: mu_plus, with loads mu_plus - f, shape (N,) [N].
        backward: mu_minus, with loads mu_minus + f, shape (N,) [N].

    Returns:
        The margin in [0, 1/2]; 0 if it is below 1e-12, which counts as critical, or if there is no friction; None if it
        is undecided, for more than 30 unequal contacts.

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


def commanded_margin(body: Body, drive: Drive) -> float | Undecided:
    """Compute the uniqueness margin of the friction commanded by a drive.

    A segment counts as one contact with the friction of its whole length: if parts of it slide in both directions, the
    translation is determined as soon as the sum of its coefficients is positive everywhere ([G] Lemma on homogeneous
    continuous models asks for both; its proof uses the sum). Only segments that slide in one direction as a whole can
    leave it undetermined.

    Args:
        body: the body.
        drive: its drive.

    Returns:
        The minimum over the waypoints, in [0, 1/2], or why it is not computed.
    """
    if body.dimension == 2:
        return Undecided.PLANE
    if body.has_flat_springs:
        return Undecided.FLAT_SPRINGS
    for segment in body.segments:
        if (drive.forward + drive.backward)[:, segment.contacts].min() <= 0.0:
            return Undecided.BARE_SEGMENT
    sides = [_blocks(body, rows) for rows in (drive.forward, drive.backward)]
    rows = np.unique(np.hstack(sides), axis=0)
    n = sides[0].shape[1]
    if n > _FEW_CONTACTS and rows.shape[0] > _FEW_ROWS:
        return Undecided.MANY_COMMANDS  # each row is a search over subsets, which would take too long
    margins = [uniqueness_margin(row[:n], row[n:]) for row in rows]
    decided = [m for m in margins if m is not None]
    if 0.0 in decided:
        return 0.0
    return min(decided) if len(decided) == len(margins) else Undecided.UNEQUAL_CONTACTS


def _blocks(body: Body, friction: np.ndarray) -> np.ndarray:
    """Sum friction over the blocks that can move rigidly: isolated contacts and whole runs of segments that touch."""
    return np.hstack([friction[:, block].sum(axis=1, keepdims=True) for block in find_blocks(body)])


def find_blocks(body: Body) -> list[np.ndarray]:
    """Find the contacts that can only move as one if none of them slides another way.

    Args:
        body: the body.

    Returns:
        The indices of each isolated contact, then of each run of segments that touch, which includes the isolated
        contacts at their ends.
    """
    runs: list[list[int]] = []
    for segment in sorted(body.segments, key=lambda each: each.first):
        if runs and segment.first == runs[-1][1]:
            runs[-1][1] = segment.last
        else:
            runs.append([segment.first, segment.last])
    alone = [i for i in body.isolated.tolist() if not any(first <= i <= last for first, last in runs)]
    return [*(np.array([i]) for i in alone), *(np.arange(first, last + 1) for first, last in runs)]


def translation_interval(velocity: ArrayLike, forward: ArrayLike, backward: ArrayLike) -> tuple[float, float]:
    """Find the interval of all c that minimise R(velocity + c), [G] section 2.2.

    The slope of R grows with c by the bounds of each contact that the translation brings to rest. A slope within
    rounding of zero counts as zero.

    Args:
        velocity: velocities up to a translation, shape (N,) [m per unit of the ramp].
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].

    Returns:
        The smallest and the largest minimiser, equal if the translation is determined; infinite without friction.
        (`Step.translation_interval` holds the net translation itself instead.)

    Raises:
        ValueError: if the shapes differ.
    """
    v, plus, minus = (np.array(a, dtype=np.float64) for a in (velocity, forward, backward))
    if v.ndim != 1 or not v.shape == plus.shape == minus.shape:
        raise ValueError(f"velocity, forward, backward: shapes {v.shape}, {plus.shape}, {minus.shape}; one per contact")
    order = np.argsort(-v, kind="stable")
    near = CRITICAL * float((plus + minus).sum())
    slope = np.cumsum((plus + minus)[order]) - minus.sum()  # above each translation that stops a contact
    stops = np.concatenate(([-np.inf], -v[order], [np.inf]))
    slopes = np.concatenate(([-minus.sum()], slope))
    return float(stops[int((slopes < -near).sum())]), float(stops[int((slopes <= near).sum())])


def choose_translation(
    velocity: np.ndarray, forward: np.ndarray, backward: np.ndarray, elements: np.ndarray, share: np.ndarray
) -> tuple[float, float]:
    """Add to the velocities the admissible translation whose net translation is nearest to zero.

    Where contacts represent lengths of ground, an interval may be an artefact of the discretisation: if at its
    midpoint the two ends of an element with friction slide in opposite directions, the continuum has a point at rest
    between them, which determines the translation. The midpoint is then chosen, and the translation counts as unique.
    (The kernels of `motion.line` have the same rule, `_shift`.)

    Args:
        velocity: velocities up to a translation, shape (N,) [m per unit of the ramp], changed in place.
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].
        elements: both contacts of each element of a segment, shape (P, 2); no rows without segments.
        share: weight of each contact in the net translation, shape (N,); their sum is 1.

    Returns:
        Distances of the smallest and the largest admissible translation from the chosen one.
    """
    least, most = translation_interval(velocity, forward, backward)
    size = float(np.abs(velocity).max(initial=0.0))
    chosen, middle = min(max(-float(share @ velocity), least), most), 0.5 * (least + most)
    if least < most and np.isfinite(middle):
        held = (np.asarray(forward) + backward)[elements].min(axis=1) > 0.0
        if (held & ((velocity[elements] + middle).prod(axis=1) < 0.0)).any():
            chosen = least = most = middle
    velocity += chosen
    velocity[np.abs(velocity) <= NOISE * size] = 0.0
    return least - chosen, most - chosen
