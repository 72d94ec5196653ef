"""Which links pictures mark: slack and stalled ones, and those whose elements of hysteresis yield."""

from __future__ import annotations

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.curves import YIELD, Bend
from crawler_model.rounding import EPS

SLACK, STALLED, YIELDING = -1, 1, 2
"""Marks of links; 0 is none. A link yields where all its elements do: each of them pulls with all its force."""


def can_yield(body: Body) -> bool:
    """Determine whether a link has elements of hysteresis of which pictures can tell whether they yield.

    Args:
        body: the body.

    Returns:
        Whether one has; with backlash, states do not tell the force of the elements.
    """
    return body.dimension == 1 and any(_shows(bend) for bend in body.bends)


def can_be_marked(body: Body) -> bool:
    """Determine whether a link can come to be marked.

    Args:
        body: the body.

    Returns:
        Whether one can.
    """
    return bool(body.limits.index.size) or can_yield(body)


def mark_springs(body: Body, elongation: np.ndarray, actuation: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """Mark springs.

    Args:
        body: the body.
        elongation: z of each spring, shape (..., S) [m].
        actuation: L, likewise.
        tension: T, likewise [N].

    Returns:
        Marks, int8, shape (..., S); shape (..., 0) if no spring can be marked.
    """
    springs = {bend.spring: bend for bend in body.bends}
    return _mark(body, body.limits.find_all_states(elongation, actuation), springs, (elongation, actuation, tension))


def mark_joints(body: Body, elongation: np.ndarray, actuation: np.ndarray, tension: np.ndarray) -> np.ndarray:
    """Mark links and segments; a segment is slack or stalled where its elements are on average.

    Args:
        body: the body.
        elongation: z of each link, then of each segment, shape (..., J) [m].
        actuation: sum of L over its springs, likewise.
        tension: mean of T over its springs, likewise [N].

    Returns:
        Marks, int8, shape (..., J); shape (..., 0) if none can be marked.
    """
    place = {spring: joint for joint, spring in enumerate(body.link_springs.tolist())}
    links = {place[bend.spring]: bend for bend in body.bends if bend.spring in place}
    states = body.joint_limits.find_all_states(elongation, actuation)
    return _mark(body, states, links, (elongation, actuation, tension))


def own_tensions(body: Body, elongation: np.ndarray, actuation: np.ndarray) -> np.ndarray:
    """Compute the tension of the actuator of each link that has a passive spring beside it.

    Args:
        body: the body.
        elongation: z of each link, first of all columns, shape (T, J) [m].
        actuation: L, likewise.

    Returns:
        Shape (T, J), NaN for other links and for those with backlash [N]; shape (T, 0) if there is no such link.
    """
    place = {spring: joint for joint, spring in enumerate(body.link_springs.tolist())}
    shown = [bend for bend in body.bends if bend.spring in place and bend.backlash == 0.0 and bend.passive.slopes.any()]
    found = np.full((elongation.shape[0], elongation.shape[1] if shown else 0), np.nan)
    for bend in shown:
        j = place[bend.spring]
        found[:, j] = bend.actuator(elongation[:, j] - actuation[:, j])
    return found


def _shows(bend: Bend) -> bool:
    return bool(bend.sliders) and bend.backlash == 0.0


def _mark(body: Body, states: np.ndarray, bends: dict[int, Bend], numbers: tuple[np.ndarray, ...]) -> np.ndarray:
    """Mark what yields, in addition to what is slack or stalled."""
    if not can_yield(body):
        return states
    elongation, actuation, tension = numbers
    marks = states if states.shape[-1] else np.zeros(elongation.shape, np.int8)
    for j, bend in bends.items():
        if _shows(bend):
            z, length = elongation[..., j], actuation[..., j]
            held = tension[..., j] - bend.tension(z, length)
            near = 64.0 * EPS * (bend.stiffness * (np.abs(z) + np.abs(length)) + np.abs(tension[..., j]))
            yields = np.abs(held) >= sum(slider[YIELD] for slider in bend.sliders) - near
            marks[..., j] = np.where(yields & (marks[..., j] == 0), YIELDING, marks[..., j])
    return marks
