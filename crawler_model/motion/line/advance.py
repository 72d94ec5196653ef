"""Advance a contact or a spring along its straight line from where it was last advanced."""

from __future__ import annotations

from ...compiled import lean
from ..state import DISSIPATION, LOADS_WORK, WORK

_RETURNED = 2.0**-50
"""A gain that is left of a larger one of opposite sign, below this part of it, is rounding."""


@lean
def move(c, distance):
    """Move a contact, and keep what rounding leaves out of its displacement.

    Args:
        c: a CONTACT.
        distance: towards +x positive [m].
    """
    gained = c.gained + distance
    c.gained = gained if abs(gained) > _RETURNED * abs(distance) else 0.0
    step = distance + c.rest
    before = c.x
    c.x = before + step
    c.rest = (before - c.x) + step


@lean
def advance(c, account, s):
    """Advance a contact to s, and account for the friction and the load on its way.

    Args:
        c: a CONTACT.
        account: of the ramp, added to, shape (14,).
        s: place on the ramp.
    """
    begin, c.since = c.since, s
    ds = s - begin
    if not ds > 0.0:
        return
    c.force += c.force_rate * ds
    if c.v == 0.0:
        return
    middle = 0.5 * (begin + s)
    distance = c.v * ds
    if c.fallen != 0:
        fall = c.d_forward if c.v > 0.0 else -c.d_backward
        c.lost -= (1.0 - middle) * fall * distance
    if c.v > 0.0:
        account[DISSIPATION] += (c.forward + middle * c.d_forward) * distance
    else:
        account[DISSIPATION] -= (c.backward + middle * c.d_backward) * distance
    account[LOADS_WORK] += (c.load + middle * c.d_load) * distance
    move(c, distance)


@lean
def advance_spring(spring, account, s):
    """Advance the tension of a spring to s, and account for the work of its actuator.

    Args:
        spring: a SPRING.
        account: of the ramp, added to, shape (14,).
        s: place on the ramp.
    """
    ds = s - spring.since
    spring.since = s
    if ds > 0.0:
        change = spring.rate * ds
        account[WORK] -= (spring.tension + 0.5 * change) * spring.d_length * ds
        spring.tension += change
