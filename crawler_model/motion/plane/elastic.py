"""Forces of links and joints, and their derivatives."""

from __future__ import annotations

import math

import numpy as np

from ...compiled import entry, lean
from .frame import load_of, norm, span, unwind

_POINT = 1e-9
"""A link that is shorter than this part of its reference length has no direction."""


@lean
def stretch_link(frame, command, x, s):
    """Compute the state of a link.

    Returns:
        Its tension [N], infinite if it has shrunk to a point, its length [m], and its direction from a to b, two
        components [1].
    """
    e0, e1 = span(frame, x, frame.ends[s, 0], frame.ends[s, 1])
    length = norm(e0, e1)
    if length <= _POINT * frame.rest[s]:
        return np.inf, length, e0, e1
    return frame.stiffness[s] * (length - (frame.rest[s] + command[s])), length, e0 / length, e1 / length


@lean
def turn_joint(frame, command, x, j):
    """Compute the torque of a joint and the derivative of its angle.

    Returns:
        The torque [N m]; the angle, between -pi and pi of its rest value [rad]; and its derivative by the positions of
        a, b, c, six components [rad/m].
    """
    a = frame.joints[j, 0]
    b = frame.joints[j, 1]
    c = frame.joints[j, 2]
    u0, u1 = span(frame, x, a, b)
    v0, v1 = span(frame, x, b, c)
    uu = u0 * u0 + u1 * u1
    vv = v0 * v0 + v1 * v1
    a0 = -u1 / uu
    a1 = u0 / uu
    c0 = -v1 / vv
    c1 = v0 / vv
    k = frame.ends.shape[0] + j
    rest = frame.rest[k] + command[k]
    away = unwind(math.atan2(u0 * v1 - u1 * v0, u0 * v0 + u1 * v1) - rest)
    return frame.stiffness[k] * away, rest + away, (a0, a1, -a0 - c0, -a1 - c1, c0, c1)


@lean
def stretch(frame, command, x, k):
    """Compute the state of a link, of a component of a vector spring, or of a joint.

    Args:
        k: its place in `frame.stiffness`.

    Returns:
        Its tension [N] or torque [N m], and its elongation [m] or change of angle [rad] since the reference shape.
    """
    links = frame.ends.shape[0]
    if frame.vector:
        elongation = x[frame.ends[k // 2, 1], k % 2] - x[frame.ends[k // 2, 0], k % 2]
        return frame.stiffness[k] * (elongation - command[k]), elongation
    if k < links:
        tension, length, _, _ = stretch_link(frame, command, x, k)
        return tension, length - frame.rest[k]
    torque, angle, _ = turn_joint(frame, command, x, k - links)
    return torque, angle - frame.rest[k]


@entry
def pull(frame, command, x, force, size):
    """Compute the force that friction balances on each point: that of links, joints and loads.

    Args:
        force: output, shape (N, 2) [N].
        size: output: magnitude of the terms that are summed, shape (N,) [N]. Of a body that turns it does not depend on
            the view, as it decides when a search ends.
    """
    for i in range(x.shape[0]):
        for c in range(2):
            force[i, c] = load_of(frame, command, i, c)
        size[i] = norm(force[i, 0], force[i, 1])
    for s in range(frame.ends.shape[0]):
        a, b = frame.ends[s]
        if frame.vector:
            for c in range(2):
                tension, _ = stretch(frame, command, x, 2 * s + c)
                force[a, c] += tension
                force[b, c] -= tension
                large = frame.stiffness[2 * s + c] * (abs(x[a, c]) + abs(x[b, c]) + abs(command[2 * s + c]))
                size[a] += large
                size[b] += large
            continue
        tension, length, e0, e1 = stretch_link(frame, command, x, s)
        force[a, 0] += tension * e0
        force[a, 1] += tension * e1
        force[b, 0] -= tension * e0
        force[b, 1] -= tension * e1
        size[a] += frame.stiffness[s] * length
        size[b] += frame.stiffness[s] * length
    for j in range(frame.joints.shape[0]):
        torque, angle, slope = turn_joint(frame, command, x, j)
        for k in range(3):
            i = frame.joints[j, k]
            force[i, 0] -= torque * slope[2 * k]
            force[i, 1] -= torque * slope[2 * k + 1]
            large = frame.stiffness[frame.ends.shape[0] + j] * (1.0 + abs(angle))
            size[i] += large * norm(slope[2 * k], slope[2 * k + 1])


@lean
def energy_of(frame, command, x):
    """Compute the energy of links and joints.

    Returns:
        The energy [J].
    """
    total = 0.0
    for k in range(frame.stiffness.shape[0]):
        tension, _ = stretch(frame, command, x, k)
        total += 0.5 * tension * tension / frame.stiffness[k]
    return total


@lean
def stiffen_link(frame, command, x, s, block):
    """Compute the second derivative of the energy of a link by the position of b; that by a and b is its negative.

    Args:
        block: output, in its first two rows and columns [N/m].
    """
    if frame.vector:
        block[0, 0] = block[1, 1] = frame.stiffness[2 * s]
        block[0, 1] = block[1, 0] = 0.0
        return
    tension, length, e0, e1 = stretch_link(frame, command, x, s)
    across = tension / length
    along = frame.stiffness[s] - across
    block[0, 0] = across + along * e0 * e0
    block[0, 1] = along * e0 * e1
    block[1, 0] = block[0, 1]
    block[1, 1] = across + along * e1 * e1


@lean
def stiffen_joint(frame, command, x, j, block):
    """Compute the second derivative of the energy of a joint by the positions of a, b, c.

    The direction of an arm e has the second derivative (d e' + e d') / |e|^4, up to its sign, with d across e.

    Args:
        block: output, shape (6, 6) [N/m].
    """
    torque, _, slope = turn_joint(frame, command, x, j)
    k = frame.stiffness[frame.ends.shape[0] + j]
    for p in range(6):
        for q in range(6):
            block[p, q] = k * slope[p] * slope[q]
    for arm in range(2):
        a = frame.joints[j, arm]
        e0, e1 = span(frame, x, a, frame.joints[j, arm + 1])
        square = (e0 * e0 + e1 * e1) ** 2
        sign = torque if arm == 1 else -torque  # the angle is the direction of the second arm minus that of the first
        xx = sign * 2.0 * e0 * e1 / square
        xy = sign * (e1 * e1 - e0 * e0) / square
        for p in range(2):
            for q in range(2):
                side = 1.0 if p == q else -1.0
                at, by = 2 * (arm + p), 2 * (arm + q)
                block[at, by] += side * xx
                block[at, by + 1] += side * xy
                block[at + 1, by] += side * xy
                block[at + 1, by + 1] -= side * xx


@entry
def strain(frame, command, x, found):
    """Compute the state of all links and joints.

    Args:
        found: output: tensions [N] and torques [N m]; elongations [m] and changes of angles [rad] since the reference
            shape, shape (2, S + J); of vector springs both components, shape (2, 2 S).
    """
    for k in range(frame.stiffness.shape[0]):
        found[0, k], found[1, k] = stretch(frame, command, x, k)
