"""Advance a contact or a spring along its straight line from where it was last advanced."""

from __future__ import annotations

from ...compiled import inlined

_RETURNED = 2.0**-50
"""A gain that is left of a larger one of opposite sign, below this part of it, is rounding."""


@inlined
def place_of(record, ramp):
    """Find where on its line a contact or a spring is now.

    Args:
        record: a CONTACT or a SPRING.

    Returns:
        The place on the ramp, or on the present fall if it takes part in that.
    """
    return ramp.fall.rests if ramp.fall.falling and record.since >= 0.0 else ramp.s


@inlined
def move(c, distance):
    """Move a contact, and keep what rounding leaves out of its displacement.

    Args:
        distance: towards +x positive [m].
    """
    gained = c.gained + distance
    c.gained = gained if abs(gained) > _RETURNED * abs(distance) else 0.0
    step = distance + c.residue
    before = c.x
    c.x = before + step
    c.residue = (before - c.x) + step


@inlined
def advance(c, ramp, s):
    """Advance a contact to s, and account for the friction and the load on its way."""
    begin, c.since = c.since, s
    ds = s - begin
    if not ds > 0.0:
        return
    c.force += c.force_rate * ds
    if c.v == 0.0:
        return
    middle = 0.5 * (begin + s)
    distance = c.v * ds
    if c.fallen != 0 and begin < 0.0:  # in a fall: by how much its bound exceeds the ground's
        excess = c.spare + middle * ((c.d_forward if c.v > 0.0 else c.d_backward) - c.d_under)
        c.lost += (excess if c.v > 0.0 else -excess) * distance
    if c.v > 0.0:
        ramp.account.dissipation += (c.forward + middle * c.d_forward) * distance
    else:
        ramp.account.dissipation -= (c.backward + middle * c.d_backward) * distance
    ramp.account.loads_work += (c.load + middle * c.d_load) * distance
    move(c, distance)


@inlined
def _work_on(spring, curves, s, change, ds):
    """Compute the work of the actuator while the tension changes up to s; in a bent spring, its own tension counts."""
    if curves is None or spring.bend < 0:
        return (spring.tension + 0.5 * change) * spring.d_length * ds
    bend = curves.bends[spring.bend]
    length = spring.length + (s - 0.5 * ds) * bend.command
    return (bend.share * (spring.tension + 0.5 * change) + bend.back * length + bend.offset) * bend.command * ds


@inlined
def advance_spring(spring, curves, ramp, s):
    """Advance the tension of a spring to s, and account for the work of its actuator."""
    ds = s - spring.since
    spring.since = s
    if ds > 0.0:
        change = spring.rate * ds
        if s > 0.0:  # in a fall, commands rest
            ramp.account.work -= _work_on(spring, curves, s, change, ds)
        spring.tension += change
