"""Ramps on patches of ground: their bounds, and places after implicit steps."""

from __future__ import annotations

from ....compiled import lean
from ..records import AHEAD, BACKWARD, BEHIND, FORWARD
from .borders import border_of, close_jump, gap_of, open_jump, rest_on_border, set_bounds


@lean
def begin_on_ground(contacts, ground, ramp, target, springs):
    """Begin the ramp of bounds and loads on patches of ground.

    Args:
        contacts: CONTACT, shape (N,), changed in place.
        target: L, bounds and, with loads, these, for ground without patches, shape (S + 2 N,) or (S + 3 N,).
        springs: number of springs S.

    Returns:
        Whether bounds or loads change, or a contact has yet to fall.
    """
    n = contacts.shape[0]
    loaded = target.shape[0] > springs + 2 * n
    changed = False
    ramp.span = 0.0
    for i in range(n):
        c, foot = contacts[i], ground.feet[i]
        foot.d_forward = target[springs + i] - foot.forward
        foot.d_backward = target[springs + n + i] - foot.backward
        foot.d_load = target[springs + 2 * n + i] - foot.load if loaded else 0.0
        forward, backward = c.forward, c.backward
        set_bounds(c, foot, ground, ramp)
        if c.fallen & FORWARD:
            c.forward, c.d_forward = forward, (c.forward - forward) + c.d_forward
        if c.fallen & BACKWARD:
            c.backward, c.d_backward = backward, (c.backward - backward) + c.d_backward
        changed = changed or c.d_forward != 0.0 or c.d_backward != 0.0 or c.d_load != 0.0 or c.fallen != 0
        ramp.span = max(ramp.span, abs(foot.home) + abs(c.x))
    return changed


@lean
def finish_on_ground(c, ground, ramp, target, i):
    """Set what is commanded of a contact, and its bounds and load, to those at the end of what was followed of a ramp.

    Args:
        c: CONTACT i, advanced to s.
        target: bounds and, with loads, these, for ground without patches, shape (2 N,) or (3 N,).
    """
    foot, s, n = ground.feet[i], ramp.s, ground.feet.shape[0]
    rest_on_border(c, ground, ramp, i)
    forward, backward = c.forward + s * c.d_forward, c.backward + s * c.d_backward
    if s == 1.0:
        foot.forward, foot.backward = target[i], target[n + i]
        if target.shape[0] > 2 * n:
            foot.load = target[2 * n + i]
    else:
        foot.forward += s * foot.d_forward
        foot.backward += s * foot.d_backward
        foot.load += s * foot.d_load
    foot.d_forward = foot.d_backward = foot.d_load = 0.0
    set_bounds(c, foot, ground, ramp)
    if ramp.stepping:
        close_jump(c, ground, ramp, i)
        c.fallen = 0
    if c.fallen & FORWARD:
        c.forward = max(forward, c.forward)
    if c.fallen & BACKWARD:
        c.backward = max(backward, c.backward)
    c.d_forward = c.d_backward = c.d_load = 0.0


@lean
def place_anew(contacts, ground, ramp):
    """Find the places of contacts after a step that has passed over borders; those that are not held there fall.

    Args:
        contacts: CONTACT, shape (N,), at the end of the step, changed in place.

    Returns:
        Whether any falls.
    """
    falls = False
    for i in range(contacts.shape[0]):
        c, foot = contacts[i], ground.feet[i]
        direction = 1 if gap_of(c, foot, ground, AHEAD, c.since) < 0.0 else 0
        direction = -1 if gap_of(c, foot, ground, BEHIND, c.since) < 0.0 else direction
        coming, side = (AHEAD, FORWARD) if direction > 0 else (BEHIND, BACKWARD)
        if direction == 0:
            continue
        border = border_of(foot, ground, coming)
        while gap_of(c, foot, ground, coming, c.since) < 0.0:
            foot.place += 2 * direction if foot.place % 2 == 0 else direction
        set_bounds(c, foot, ground, ramp)
        c.at = 0
        excess = c.force - c.forward if direction > 0 else -c.force - c.backward
        if excess > 0.0:
            c.at = c.fallen = side
            open_jump(c, ground, ramp, i, border)
            if direction > 0:
                c.forward = c.force
            else:
                c.backward = -c.force
            falls = True
    return falls
