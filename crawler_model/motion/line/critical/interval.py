"""The interval of the translations of a body whose flat springs leave parts of it free, from ramp to ramp.

While the translation of a part is free, other motions may leave the chosen one, as fast as friction admits, but not
further than the slack of flat springs: several stretches, and several ramps, share one slack. So it lasts from ramp to
ramp of a call how far each contact may lie from where it is. All contacts are there together at the least, or the most.

Where the spring of a contact that lies further back becomes stiff, friction still holds the contact there. Only as the
contact slides forward in the chosen motion does such a spring pull it along in the other ones; the same holds
backwards.

Contacts go on straight between events, so how far one may stray is followed only to where its own velocity, or its
part, changes. On ground it is followed at each event: bounds may change with every one, and falls rest the commands.
"""

from __future__ import annotations

from ....compiled import inlined, lean
from ....rounding import SHORTEST_STRETCH
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
            stray.behind = -1


@lean
def begin_strays(curves):
    """Begin a ramp: no translation is chosen."""
    if curves is None:
        return
    for i in range(curves.strays.shape[0]):
        stray = curves.strays[i]
        stray.slower = stray.faster = 0.0
        stray.since = stray.begun = 0.0
        stray.chosen = 0


@lean
def let_stray(curves, ramp, slower, faster):
    """Note what other translations of the present part would change its velocity by, from s on.

    In a fall, the commands rest, and it does not count.

    Args:
        slower: change by the slowest translation that friction admits, < 0 [m].
        faster: change by the fastest one, > 0 [m].
    """
    if curves is None or ramp.fall.falling:
        return
    if not ramp.strays:
        ramp.strays = 1
        for i in range(curves.strays.shape[0]):
            curves.strays[i].since = curves.strays[i].begun = ramp.s
    for r in range(ramp.first, ramp.last):
        stray = curves.strays[member(curves, r)]
        stray.slower, stray.faster = slower, faster


@inlined
def _find_slack(contacts, spring, curves, ramp, begin, end):
    """Find how far a spring may shrink and grow without a change of its tension at one of two places on the ramp.

    Other motions may have used the slack before the chosen one has none left, and friction then holds them there.
    """
    if not is_flat(spring, curves):
        return 0.0, 0.0
    bend = curves.bends[spring.bend]
    z, length, stretch, change = find_lengths(contacts, spring, bend, ramp)
    u, rate = z - length, stretch - change
    actuator, passive = curves.pieces[bend.actuator], curves.pieces[bend.passive]
    before, after = begin - ramp.s, end - ramp.s
    low = min(max(actuator.begin - (u + before * rate), passive.begin - (z + before * stretch)), 0.0)
    high = max(min(actuator.end - (u + before * rate), passive.end - (z + before * stretch)), 0.0)
    z, u = z + after * stretch, u + after * rate
    low = min(max(actuator.begin - u, passive.begin - z), low)
    return low, max(min(actuator.end - u, passive.end - z), high)


@inlined
def _tie(contacts, spring, curves, ramp):
    """Let the two contacts of a spring stray no further from each other than its slack, but for what is kept.

    It counts while both have gone on straight, and the spring was on one piece.

    Returns:
        Whether that changes anything at a, and at b.
    """
    a, b = curves.strays[spring.a], curves.strays[spring.b]
    if a.least == b.least and a.most == b.most:
        return False, False
    begin = max(a.begun, b.begun)
    if spring.bend >= 0:
        begin = max(begin, curves.bends[spring.bend].begun)
    if not begin < a.since:
        return False, False
    low, high = _find_slack(contacts, spring, curves, ramp, begin, a.since)
    least, most = min(a.least + low, b.kept_least), max(a.most + high, b.kept_most)
    behind = b.least < least or b.most > most
    b.least, b.most = max(b.least, least), min(b.most, most)
    least, most = min(b.least - high, a.kept_least), max(b.most - low, a.kept_most)
    before = a.least < least or a.most > most
    a.least, a.most = max(a.least, least), min(a.most, most)
    return before, behind


@inlined
def _advance_stray(c, stray, ramp, s):
    """Advance how far a contact may stray to a place on the ramp, up to which it has gone on straight."""
    ds = s - stray.since
    if not ds > 0.0:
        return
    stray.begun, stray.since = stray.since, s
    stray.kept_least = 0.0 if c.v > 0.0 else stray.least
    stray.kept_most = 0.0 if c.v < 0.0 else stray.most
    if (stray.slower < 0.0 or stray.faster > 0.0) and ds * (1.0 - ramp.done) > SHORTEST_STRETCH:
        ramp.account.ambiguous = 1.0
        stray.least += ds * stray.slower
        stray.most += ds * stray.faster


@lean
def follow_strays(contacts, springs, model, curves, ramp, i):
    """Follow how far a contact may stray up to s, where its velocity may change, and all whose limits that changes.

    Those that are joined to a contact whose limits have changed wait in a queue.
    """
    if curves is None or not ramp.strays:
        return
    strays = curves.strays
    last = strays[i].behind = i
    while True:
        stray, changed = strays[i], False
        _advance_stray(contacts[i], stray, ramp, ramp.s)
        for k in range(contacts[i].first, contacts[i].last):
            spring, other = springs[model.ends[k].spring], model.ends[k].other
            _advance_stray(contacts[other], strays[other], ramp, ramp.s)
            at_a, at_b = _tie(contacts, spring, curves, ramp)
            changed |= at_a if spring.a == i else at_b
            if (at_b if spring.a == i else at_a) and strays[other].behind < 0:
                last = strays[last].behind = strays[other].behind = other
        following = stray.behind
        if changed and i == last:
            continue
        if changed:
            last = strays[last].behind = stray.behind = i
        else:
            stray.behind = -1
            if following == i:
                return
        i = following


@lean
def follow_strays_of_block(contacts, springs, model, curves, ramp, count):
    """Follow how far the contacts of a solved block may stray up to s, where their velocities change."""
    if curves is None or not ramp.strays:
        return
    for j in range(count):
        if model.block[j].cluster < 0:
            follow_strays(contacts, springs, model, curves, ramp, model.block[j].contact)
    for j in range(count):
        if model.block[j].cluster < 0:
            curves.strays[model.block[j].contact].begun = ramp.s


@lean
def follow_all_strays(contacts, springs, curves, ramp, until):
    """Follow how far all contacts may stray up to a place on the ramp, unless that is a part of a fall.

    Args:
        until: the place, s or where the stretch that begins at s ends.
    """
    if curves is None or not ramp.strays or ramp.fall.falling:
        return
    for i in range(curves.strays.shape[0]):
        _advance_stray(contacts[i], curves.strays[i], ramp, until)
    tied = True
    while tied:
        tied = False
        for j in range(springs.shape[0]):
            at_a, at_b = _tie(contacts, springs[j], curves, ramp)
            tied |= at_a | at_b


@inlined
def forget_strays(curves):
    """Let no translation be open any more."""
    for i in range(curves.strays.shape[0]):
        curves.strays[i].slower = curves.strays[i].faster = 0.0


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
