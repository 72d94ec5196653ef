"""The bounds of contacts along a ramp, on any ground, and their places after implicit steps."""

from __future__ import annotations

from ....compiled import inlined, lean
from ..records import AHEAD, BACKWARD, BEHIND, FORWARD
from .borders import ROUNDING, border_of, close_jump, gap_of, open_jump, put_on_border, rest_on_border
from .bounds import set_bounds
from .walls import keep_before_walls


@inlined
def _begin_command(record, target, i, n):
    """Begin the ramp of what is commanded of a contact, which a FOOT holds, or the CONTACT where there is none."""
    record.d_forward = target[i] - record.forward
    record.d_backward = target[n + i] - record.backward
    record.d_load = target[2 * n + i] - record.load if target.shape[0] > 2 * n else 0.0


@inlined
def _finish_command(record, ramp, target, i, n):
    """Set the commanded bounds and load of a contact to their values at the end of what was followed of the ramp."""
    if ramp.s == 1.0:
        record.forward, record.backward = target[i], target[n + i]
        record.load = target[2 * n + i] if target.shape[0] > 2 * n else 0.0
    else:
        record.forward += ramp.s * record.d_forward
        record.backward += ramp.s * record.d_backward
        record.load += ramp.s * record.d_load
    record.d_forward = record.d_backward = record.d_load = 0.0


@inlined
def _changes(record):
    """Determine whether what a FOOT or a CONTACT holds of bounds and load changes along the ramp."""
    return record.d_forward != 0.0 or record.d_backward != 0.0 or record.d_load != 0.0


@inlined
def begin_bounds(c, ground, ramp, target, i, n):
    """Begin the ramp of the bounds and the load of a contact.

    Args:
        target: bounds and, with loads, these, for ground without patches, shape (2 N,) or (3 N,).

    Returns:
        A length that rounds like its position [m].
    """
    if ground is None:
        _begin_command(c, target, i, n)
        return abs(c.x)
    foot, forward, backward = ground.feet[i], c.forward, c.backward
    _begin_command(foot, target, i, n)
    if _changes(foot) or c.fallen != 0:
        set_bounds(c, foot, ground, ramp)
    if c.fallen & FORWARD:
        c.forward, c.d_forward = forward, (c.forward - forward) + c.d_forward
    if c.fallen & BACKWARD:
        c.backward, c.d_backward = backward, (c.backward - backward) + c.d_backward
    return abs(foot.home) + abs(c.x)


@inlined
def finish_bounds(c, ground, ramp, target, i, n):
    """Set the bounds and the load of a contact to their values at the end of what was followed of the ramp.

    Args:
        target: as for `begin_bounds`.
    """
    if ground is None:
        _finish_command(c, ramp, target, i, n)
        return
    foot, s = ground.feet[i], ramp.s
    if ramp.stepping:
        keep_before_walls(c, foot, ground.walls, i)
    if c.v != 0.0 or ramp.stepping:
        rest_on_border(c, ground, ramp, i)
    forward, backward = c.forward + s * c.d_forward, c.backward + s * c.d_backward
    rests = not (_changes(foot) or _changes(c)) and c.fallen == 0 and not ramp.stepping
    _finish_command(foot, ramp, target, i, n)
    if rests:
        return
    set_bounds(c, foot, ground, ramp)
    if ramp.stepping and s == 1.0:  # a step without a solution leaves the rest of a fall to the next ramp
        close_jump(c, ground, ramp, i)
        c.fallen = 0
    if c.fallen & FORWARD:
        c.forward = max(forward, c.forward)
    if c.fallen & BACKWARD:
        c.backward = max(backward, c.backward)
    c.d_forward = c.d_backward = c.d_load = 0.0


@lean
def place_anew(contacts, ground, ramp):
    """Find the places of contacts after a step that has passed over borders; contacts that are not held there fall.

    Returns:
        Whether any falls.
    """
    falls, near = False, ROUNDING * ramp.span
    for i in range(contacts.shape[0]):
        c, foot = contacts[i], ground.feet[i]
        direction = 1 if gap_of(c, foot, ground, AHEAD, c.since) < 0.0 else 0
        direction = -1 if gap_of(c, foot, ground, BEHIND, c.since) < 0.0 else direction
        coming, side = (AHEAD, FORWARD) if direction > 0 else (BEHIND, BACKWARD)
        if direction == 0:
            continue
        border = border_of(foot, ground, coming)
        while gap_of(c, foot, ground, coming, c.since) < -near:
            foot.place += 2 * direction if foot.place % 2 == 0 else direction
        if foot.place % 2 == 0 and gap_of(c, foot, ground, coming, c.since) <= near:
            put_on_border(c, foot, ground, border_of(foot, ground, coming))
        set_bounds(c, foot, ground, ramp)
        c.bounds_met = 0
        excess = c.force - c.forward if direction > 0 else -c.force - c.backward
        if excess > 0.0:
            c.bounds_met = c.fallen = side
            open_jump(c, ground, ramp, i, ground.borders[border])
            if direction > 0:
                c.forward = c.force
            else:
                c.backward = -c.force
            falls = True
    return falls
