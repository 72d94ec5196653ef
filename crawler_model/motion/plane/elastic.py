"""Forces of links and joints, and their derivatives."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import entry, lean
from ..account import LOADS_WORK, WORK, dissipated
from .frame import friction_of, load_of, norm, span, unwind

BALANCED, _CLOSELY, _ROUNDING = 0.01, 1e-3, 1e-12
"""The energies of a part of a ramp balance to this part of them, more closely where a body moves on that cannot be
followed, and to this part of the stored energy."""
_POINT = 1e-9
"""A link that is shorter than this part of its reference length has no direction."""


@lean
def stretch(frame, command, x, k):
    """Compute the state of a spring.

    Returns:
        Its tension [N] or torque [N m], infinite if a link has shrunk to a point; its length [m], or its angle between
        -pi and pi of its rest value [rad], of a vector spring the elongation [m]; and the derivative of that by the
        positions of its points, six components [1] or [rad/m].
    """
    a = frame.points[k, 0]
    b = frame.points[k, 1]
    c = frame.points[k, 2]
    rest = frame.rest[k] + command[k]
    if frame.vector:
        along = k % 2
        elongation = x[b, along] - x[a, along]
        e0 = 1.0 - along
        e1 = 1.0 * along
        return frame.stiffness[k] * (elongation - rest), elongation, (-e0, -e1, e0, e1, 0.0, 0.0)
    u0, u1 = span(frame, x, a, b)
    if c < 0:
        length = norm(u0, u1)
        if length <= _POINT * frame.rest[k]:
            return np.inf, length, (-u0, -u1, u0, u1, 0.0, 0.0)
        u0 /= length
        u1 /= length
        return frame.stiffness[k] * (length - rest), length, (-u0, -u1, u0, u1, 0.0, 0.0)
    v0, v1 = span(frame, x, b, c)
    uu = u0 * u0 + u1 * u1
    vv = v0 * v0 + v1 * v1
    a0 = -u1 / uu
    a1 = u0 / uu
    c0 = -v1 / vv
    c1 = v0 / vv
    away = unwind(math.atan2(u0 * v1 - u1 * v0, u0 * v0 + u1 * v1) - rest)
    return frame.stiffness[k] * away, rest + away, (a0, a1, -a0 - c0, -a1 - c1, c0, c1)


@entry
def pull(frame, command, x, force, size):
    """Compute the force that friction balances on each point: the force of links, joints and loads.

    Args:
        force: output, shape (N, 2) [N].
        size: output: magnitude of the terms that are summed, shape (N,) [N]. Of a body that turns it does not depend on
            the view, as it decides when a search ends.
    """
    for i in range(x.shape[0]):
        for c in range(2):
            force[i, c] = load_of(frame, command, i, c)
        size[i] = norm(force[i, 0], force[i, 1])
    for k in range(frame.stiffness.shape[0]):
        tension, length, slope = stretch(frame, command, x, k)
        if frame.vector:
            a = frame.points[k, 0]
            b = frame.points[k, 1]
            force[a, k % 2] += tension
            force[b, k % 2] -= tension
            large = frame.stiffness[k] * (abs(x[a, k % 2]) + abs(x[b, k % 2]) + abs(command[k]))
            size[a] += large
            size[b] += large
            continue
        joint = frame.points[k, 2] >= 0
        large = frame.stiffness[k] * (1.0 + abs(length) if joint else length)
        for p in range(3):
            i = frame.points[k, p]
            if i >= 0:
                force[i, 0] -= tension * slope[2 * p]
                force[i, 1] -= tension * slope[2 * p + 1]
                size[i] += large * (norm(slope[2 * p], slope[2 * p + 1]) if joint else 1.0)


@lean
def energy_of(frame, command, x):
    """Compute the energy of links and joints.

    Returns:
        The energy [J].
    """
    total = 0.0
    for k in range(frame.stiffness.shape[0]):
        tension, _, _ = stretch(frame, command, x, k)
        total += 0.5 * tension * tension / frame.stiffness[k]
    return total


@lean
def is_balanced(frame, command, x, spent, residual, allowed, fraction):
    """Determine whether a residual of energies is an error.

    Args:
        spent: all energies that were spent, stored or gained [J].
        residual: of these [J].
        allowed: error of the displacements [m].
        fraction: error of the energies as a part of them [1].

    Returns:
        Whether it is; otherwise the body has jumped.
    """
    most = 0.0
    for i in range(x.shape[0]):
        most = max(most, friction_of(frame, command, i)[2])
    return abs(residual) <= fraction * spent + allowed * most + _ROUNDING * energy_of(frame, command, x)


@entry
def balances(frame, command, x, account, loss, allowed):
    """Determine whether the energies of a part of a ramp balance closely.

    Args:
        account: of only that part.
        loss: what is not stored, dissipated or done by loads [J].
        allowed: error of the displacements [m].

    Returns:
        Whether they do; otherwise the body has jumped.
    """
    spent = dissipated(account) + abs(account[WORK]) + abs(account[LOADS_WORK])
    return is_balanced(frame, command, x, spent, max(loss, 0.0), allowed, _CLOSELY)


@lean
def stiffen(frame, command, x, k, block):
    """Compute the second derivative of the energy of a link or joint by the positions of its points.

    The direction of an arm e has the second derivative (d e' + e d') / |e|^4, up to its sign, with d across e.

    Args:
        k: the spring; for a vector spring, the spring of its x component.
        block: output, shape (6, 6) [N/m].
    """
    stiffness = frame.stiffness[k]
    if frame.points[k, 2] < 0:
        for p in range(4):
            for q in range(4):
                block[p, q] = 0.0
    if frame.vector:
        _add_arm(block, 0, stiffness, 0.0, frame.stiffness[k + 1])
        return
    force, length, slope = stretch(frame, command, x, k)
    if frame.points[k, 2] < 0:
        across = force / length
        along = stiffness - across
        e0 = slope[2]
        e1 = slope[3]
        _add_arm(block, 0, across + along * e0 * e0, along * e0 * e1, across + along * e1 * e1)
        return
    for p in range(6):
        for q in range(6):
            block[p, q] = stiffness * slope[p] * slope[q]
    for arm in range(2):
        e0, e1 = span(frame, x, frame.points[k, arm], frame.points[k, arm + 1])
        square = (e0 * e0 + e1 * e1) ** 2
        sign = force if arm == 1 else -force  # the angle is the direction of the second arm minus the first's
        xx = sign * 2.0 * e0 * e1 / square
        _add_arm(block, arm, xx, sign * (e1 * e1 - e0 * e0) / square, -xx)


@lean
def _add_arm(block, arm, xx, xy, yy):
    """Add the second derivative by the vector from one point to the next."""
    for p in range(2):
        for q in range(2):
            side = 1.0 if p == q else -1.0
            at, by = 2 * (arm + p), 2 * (arm + q)
            block[at, by] += side * xx
            block[at, by + 1] += side * xy
            block[at + 1, by] += side * xy
            block[at + 1, by + 1] += side * yy


@entry
def strain(frame, command, x, found):
    """Compute the state of all springs.

    Args:
        found: output: tensions [N] and torques [N m]; elongations [m] and changes of angles [rad] since the reference
            shape, shape (2, K).
    """
    for k in range(frame.stiffness.shape[0]):
        found[0, k], length, _ = stretch(frame, command, x, k)
        found[1, k] = length - frame.rest[k]
