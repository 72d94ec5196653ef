"""How near all contacts of a chain are to sliding at once, at a place on a ramp."""

from __future__ import annotations

from ...compiled import lean
from ...rounding import CRITICAL, EPS
from ..state import VISITED
from .rates import slack


@lean
def _visited(contacts, links, floats, side, whole, s):
    """Compute at s the sum of the distances of all contacts from their nearest bounds, and the sum of all bounds."""
    near = 0.0
    for i in range(contacts.shape[1]):
        if side[i] == 0:
            above, below = slack(contacts, links, floats, s, i)
            near += abs(min(above, below))
    return near, max(whole[0] + s * (whole[1] - whole[0]), 0.0)


@lean
def visit(contacts, links, floats, side, account, whole, s):
    """Update the visited margin at s.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: elongations and tensions at their last change.
        floats: rates, and the places since which they hold.
        side: the bound that each contact is at, 1, 0 or -1, int8, shape (N,).
        account: account of the ramp, changed in place.
        whole: sums of all bounds at the start and at the end of the ramp [N].
        s: place on the ramp, 0 .. 1.

    Returns:
        The sum of the distances of all contacts from their nearest bounds [N].
    """
    near, total = _visited(contacts, links, floats, side, whole, s)
    account[VISITED] = min(account[VISITED], near / total if total > 0.0 else 0.0)
    return near


@lean
def is_near_criticality(contacts, links, floats, side, account, whole, s):
    """Update the visited margin, and determine whether all contacts stay at their bounds up to the end of the ramp.

    A distance from the nearest bound is concave in s and never negative: if it vanishes at two later instants, it
    vanishes from here on. The ends of the ramp are not used, as friction may vanish there.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        links: elongations and tensions at their last change.
        floats: rates, and the places since which they hold.
        side: the bound that each contact is at, 1, 0 or -1, int8, shape (N,).
        account: account of the ramp, changed in place.
        whole: sums of all bounds at the start and at the end of the ramp [N].
        s: place on the ramp, 0 .. 1.

    Returns:
        True if they do, and the translation is therefore free.
    """
    near = visit(contacts, links, floats, side, account, whole, s)
    both = whole[0] + whole[1]
    if both == 0.0:
        return True
    if near > CRITICAL * both:
        return False
    some, total_some = _visited(contacts, links, floats, side, whole, s + (1.0 - s) / 3.0)
    more, total_more = _visited(contacts, links, floats, side, whole, s + (1.0 - s) / 1.5)
    close = 8.0 * EPS * both
    return some <= CRITICAL * total_some + close and more <= CRITICAL * total_more + close
