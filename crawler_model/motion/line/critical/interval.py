"""The interval of the translations of a body whose flat springs leave parts of it free, from ramp to ramp.

While the translation of a part is free, other motions may leave the chosen one, as fast as friction admits, but not
further than the slack of flat springs: several stretches, and several ramps, share one slack. So it lasts from ramp to
ramp of a call how far each contact may lie from where it is. All contacts are there together at the least, or the most.

Where the spring of a contact that lies further back becomes stiff, friction still holds the contact there. Only as the
contact slides forward in the chosen motion does such a spring pull it along in the other ones; the same holds
backwards.
"""

from __future__ import annotations

from ....compiled import inlined, lean
from ...account import GAIN_LEAST, GAIN_MOST
from ..springs.bends import find_lengths, is_flat
from ..springs.parts import member


@lean
def begin_interval(curves, ramp):
    """Begin a call: no contact could be elsewhere."""
    ramp.strays = 0
    if curves is not None:
        for i in range(curves.strays.shape[0]):
            stray = curves.strays[i]
            stray.slower = stray.faster = stray.least = stray.most = stray.kept_least = stray.kept_most = 0.0


@lean
def let_stray(curves, ramp, slower, faster):
    """Note what other translations of the present part would change its velocity by, in the present stretch.

    Args:
        slower: change by the slowest translation that friction admits, < 0 [m].
        faster: change by the fastest one, > 0 [m].
    """
    if curves is None:
        return
    ramp.strays = 1
    for r in range(ramp.first, ramp.last):
        stray = curves.strays[member(curves, r)]
        stray.slower, stray.faster = slower, faster


@inlined
def _find_slack(contacts, spring, curves, ramp, ds):
    """Find how far a spring may shrink and grow without a change of its tension at s or `ds` after it.

    Other motions may have used the slack before the chosen one has none left, and friction then holds them there.
    """
    if not is_flat(spring, curves):
        return 0.0, 0.0
    bend = curves.bends[spring.bend]
    z, length, stretch, change = find_lengths(contacts, spring, bend, ramp)
    u, rate = z - length, stretch - change
    actuator, passive = curves.pieces[bend.actuator], curves.pieces[bend.passive]
    low = min(max(actuator.begin - u, passive.begin - z), 0.0)
    high = max(min(actuator.end - u, passive.end - z), 0.0)
    z, u = z + ds * stretch, u + ds * rate
    low = min(max(actuator.begin - u, passive.begin - z), low)
    return low, max(min(actuator.end - u, passive.end - z), high)


@inlined
def _tie(contacts, spring, curves, ramp, ds):
    """Let the two contacts of a spring stray no further from each other than its slack, but for what is kept.

    Returns:
        Whether that counts.
    """
    a, b = curves.strays[spring.a], curves.strays[spring.b]
    if a.least == b.least and a.most == b.most:
        return False
    low, high = _find_slack(contacts, spring, curves, ramp, ds)
    least, most = min(a.least + low, b.kept_least), max(a.most + high, b.kept_most)
    tied = b.least < least or b.most > most
    b.least, b.most = max(b.least, least), min(b.most, most)
    least, most = min(b.least - high, a.kept_least), max(b.most - low, a.kept_most)
    tied = tied or a.least < least or a.most > most
    a.least, a.most = max(a.least, least), min(a.most, most)
    return tied


@lean
def follow_strays(contacts, springs, curves, ramp, until, lasts):
    """Follow how far contacts may stray while the present stretch lasts, unless it is a part of a fall.

    Args:
        until: where the stretch that begins at s ends.
        lasts: whether it is more than an instant in which several translations are admissible.
    """
    if curves is None or not ramp.strays or ramp.fall.falling:
        return
    ds = until - ramp.s
    for i in range(curves.strays.shape[0]):
        stray, v = curves.strays[i], contacts[i].v
        stray.kept_least = 0.0 if ds * v > 0.0 else stray.least
        stray.kept_most = 0.0 if ds * v < 0.0 else stray.most
        if lasts:
            stray.least += ds * stray.slower
            stray.most += ds * stray.faster
        stray.slower = stray.faster = 0.0
    tied = True
    while tied:
        tied = False
        for j in range(springs.shape[0]):
            tied |= _tie(contacts, springs[j], curves, ramp, ds)


@lean
def add_interval(contacts, curves, ramp, account):
    """Add the interval of the net translation at the end of a call to the account.

    Args:
        account: as for `follow`, changed in place.
    """
    if curves is None or not ramp.strays:
        return
    for i in range(curves.strays.shape[0]):
        account[GAIN_LEAST] += contacts[i].share * curves.strays[i].least
        account[GAIN_MOST] += contacts[i].share * curves.strays[i].most
