"""Jumps of a chain in closed form: contacts whose bounds fall at fixed commands, and those that they push or drag.

The bounds of contacts that jump fall together from where they are, each by its excess over what its ground holds. All
contacts move in one direction, and none stops but at a border. So those that slide are at their bounds in this
direction, the others are at rest, and only the former ones near a falling bound move. Between two contacts at rest all
tensions follow from the one behind the first by sums over the falling bounds, and that one from the compliances.
"""

from __future__ import annotations

from ....compiled import lean
from ...borders import (
    COUNT,
    JUMP_BORDER,
    JUMP_CONTACT,
    JUMP_DISTANCE,
    JUMP_LOSS,
    JUMP_OPEN,
    JUMP_PART,
    JUMP_RAMP,
    LOST,
    OF_RAMP,
    gap_ahead,
    is_moving,
    largest,
)
from ...state import (
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    DISSIPATION,
    EVENTS,
    FORWARD,
    TENSION,
    X,
    shift,
)
from ..memory import (
    ROW_BACKWARD,
    ROW_D_BACKWARD,
    ROW_D_FORWARD,
    ROW_FORWARD,
    ROW_GAIN,
    ROW_HIT,
    ROW_LEAVING,
    ROW_MAGNITUDE,
    ROW_MEETING,
    ROW_MOVED,
    ROW_TRIAL,
    ROW_V_BEFORE,
)
from ..rates import settle, slack, update
from .border import meet

# Rows of the scratch floats that a jump uses, all written anew by what uses them otherwise.
_SPEED = ROW_TRIAL
"""Velocity in the direction of the jump, per part of the fall."""
_CLIMB = ROW_GAIN
"""Rate of the tension of each link in this direction, likewise."""
_EXCESS = ROW_FORWARD
"""By how much the bound of each contact still has to fall, 0 if it does not."""
_ROOM = ROW_BACKWARD
"""Distance of the force on a contact at rest from its bound; -1 for contacts that slide."""
_START, _BORDER, _LOSS = ROW_MAGNITUDE, ROW_V_BEFORE, ROW_MEETING
"""Of a contact that jumps: displacement at the border, this border, and the loss so far; -1 of others."""


@lean
def _is_at(contacts, floats, s, j, direction):
    """Find the status of contact j at its bound in a direction."""
    forward = contacts[FORWARD, j] + s * floats[ROW_D_FORWARD, j]
    backward = contacts[BACKWARD, j] + s * floats[ROW_D_BACKWARD, j]
    if forward + backward == 0.0:
        return AT_FORWARD | AT_BACKWARD
    return AT_FORWARD if direction > 0 else AT_BACKWARD


@lean
def _join(contacts, links, status, floats, bytes_, account, patches, s, j, direction):
    """Let contact j count from now on; return whether that is possible."""
    if patches.reached[j] == -direction:  # it is about to jump in the other direction
        return False
    settle(status, floats, bytes_, s, j)
    update(contacts, links, floats, account, s, j, j)
    floats[_SPEED, j] = floats[_EXCESS, j] = 0.0
    floats[_ROOM, j] = floats[_LOSS, j] = -1.0
    if not status[j] & (AT_FORWARD if direction > 0 else AT_BACKWARD):
        above, below = slack(contacts, links, floats, s, j)
        floats[_ROOM, j] = max(above if direction > 0 else below, 0.0)
    return True


@lean
def _find_rates(compliance, floats, first, last):
    """Find the velocities of contacts first..last and the rates of the tensions between them.

    Returns False if nothing holds them: all slide, up to both ends of the chain.
    """
    speed, climb, excess, room = floats[_SPEED], floats[_CLIMB], floats[_EXCESS], floats[_ROOM]
    for j in range(first, last + 1):
        speed[j] = climb[j] = 0.0
    wall = -1  # the contact at rest before those that slide
    start = first
    if room[first] >= 0.0:
        wall = first
        start = first + 1
    while start <= last:
        end = start  # the contact at rest behind those that slide
        fallen = 0.0
        moment = 0.0
        total = compliance[wall] if wall >= 0 else 0.0
        while end <= last and room[end] < 0.0:
            fallen += excess[end]
            if end < last:
                climb[end] = -fallen
                moment += compliance[end] * fallen
                total += compliance[end]
            end += 1
        if fallen > 0.0:
            if wall < 0 and end > last:
                return False
            base = 0.0
            if wall >= 0:
                base = moment / total if end <= last else fallen
                climb[wall] = base
                for j in range(start, min(end, last)):
                    climb[j] += base
                for j in range(start, end):
                    speed[j] = max(speed[j - 1] + compliance[j - 1] * climb[j - 1], 0.0)
            else:
                for j in range(end - 1, start - 1, -1):
                    speed[j] = max(speed[j + 1] - compliance[j] * climb[j], 0.0)
        wall = end
        start = end + 1
    return True


@lean
def _find_next(contacts, floats, patches, first, last, direction):
    """Find the part of the fall up to its next event, and the contact to which it happens, -1 for none.

    The event of a contact at rest is that it slides, of others that they reach a border.
    """
    speed, climb, room = floats[_SPEED], floats[_CLIMB], floats[_ROOM]
    part = 1.0
    contact = -1
    fastest = largest(speed[first : last + 1])
    for j in range(first, last + 1):
        if room[j] >= 0.0:
            rate = climb[j] - (climb[j - 1] if j > first else 0.0)
            if room[j] < part * rate:
                part = room[j] / rate
                contact = j
        elif speed[j] > 0.0 and is_moving(speed[j], fastest):
            gap, near = gap_ahead(contacts, patches.ground, j, direction)
            if gap - near <= part * speed[j]:
                part = max(gap - near, 0.0) / speed[j] if gap + near < speed[j] else 1.0
                contact = j
    return part, contact


@lean
def _advance(contacts, links, status, floats, bytes_, account, jumps, hits, count, s, first, last, direction, part):
    """Follow a part of the fall; return the number of hits."""
    speed, climb, excess, room = floats[_SPEED], floats[_CLIMB], floats[_EXCESS], floats[_ROOM]
    for j in range(first, last + 1):
        rate = climb[j] - (climb[j - 1] if j > first else 0.0)
        if room[j] >= 0.0:
            room[j] = max(room[j] - rate * part, 0.0)
            if rate * part > 0.0 and status[j] != 0:  # it leaves its other bound
                status[j] = 0
                bytes_[ROW_LEAVING, j] = 0
                count = add_hit(bytes_, hits, count, j)
        else:
            distance = speed[j] * part
            bound = contacts[FORWARD, j] + s * floats[ROW_D_FORWARD, j]
            if direction < 0:
                bound = contacts[BACKWARD, j] + s * floats[ROW_D_BACKWARD, j]
            loss = excess[j] * (1.0 - 0.5 * part) * distance
            floats[_LOSS, j] += loss
            jumps[0, LOST] += loss
            account[DISSIPATION] += bound * distance + loss
            if distance > 0.0:
                shift(contacts, direction * distance, 1.0, j, s)
            excess[j] *= 1.0 - part
    for j in range(first, last):
        links[TENSION, j] += direction * climb[j] * part
        bytes_[ROW_MOVED, j] |= climb[j] * part != 0.0
    return count


@lean
def add_hit(bytes_, hits, count, i):
    """Add a contact to those whose blocks have to be solved again, unless it is among them.

    Args:
        bytes_: row ROW_HIT marks them, changed in place.
        hits: the contacts, changed in place.
        count: their number.
        i: the contact.

    Returns:
        Their number.
    """
    if bytes_[ROW_HIT, i] != 0:
        return count
    bytes_[ROW_HIT, i] = 1
    hits[count] = i
    return count + 1


@lean
def _begin_jump(contacts, floats, borders, place, i, direction, excess):
    """Note that contact i jumps at the border ahead of `place`."""
    floats[_EXCESS, i] = excess
    floats[_ROOM, i] = -1.0
    floats[_START, i] = contacts[X, i]
    floats[_BORDER, i] = borders[(place + direction) // 2]
    floats[_LOSS, i] = 0.0


@lean
def _end_jump(contacts, floats, jumps, s, i, is_open):
    """Write the jump of contact i; if it is open, with the displacement at the border in place of the distance."""
    jumps[0, COUNT] += 1.0
    row = int(jumps[0, COUNT])
    jumps[row, JUMP_RAMP] = jumps[0, OF_RAMP]
    jumps[row, JUMP_PART] = s
    jumps[row, JUMP_CONTACT] = i
    jumps[row, JUMP_BORDER] = floats[_BORDER, i]
    jumps[row, JUMP_DISTANCE] = floats[_START, i] if is_open else contacts[X, i] - floats[_START, i]
    jumps[row, JUMP_LOSS] = floats[_LOSS, i]
    jumps[row, JUMP_OPEN] = is_open


@lean
def _hold(contacts, floats, s, i, direction):
    """Add what is still to fall to the bound of contact i, which then does not fall."""
    if floats[_EXCESS, i] == 0.0:
        return
    if direction > 0:
        contacts[FORWARD, i] += s * floats[ROW_D_FORWARD, i] + floats[_EXCESS, i]
        floats[ROW_D_FORWARD, i] = 0.0
    else:
        contacts[BACKWARD, i] += s * floats[ROW_D_BACKWARD, i] + floats[_EXCESS, i]
        floats[ROW_D_BACKWARD, i] = 0.0
    floats[_EXCESS, i] = 0.0


@lean
def _mark(contacts, floats, patches, first, last, event, direction):
    """Mark the contacts that have reached a border, one of them or more; return whether they arrive there."""
    patches.reached[event] = direction
    arriving = patches.place[event] % 2 == 0
    fastest = largest(floats[_SPEED, first : last + 1])
    for j in range(first, last + 1):
        if floats[_ROOM, j] < 0.0 and floats[_SPEED, j] > 0.0 and is_moving(floats[_SPEED, j], fastest):
            gap, near = gap_ahead(contacts, patches.ground, j, direction)
            if gap <= 2.0 * near:
                patches.reached[j] = direction
                arriving |= patches.place[j] % 2 == 0
    return arriving


@lean
def _reach(contacts, status, floats, patches, commands, target, s, j, direction):
    """Let contact j stand on the border that it has reached, leave it, pass it or jump there."""
    if floats[_LOSS, j] >= 0.0:
        _end_jump(contacts, floats, patches.jumps, s, j, 0)
        floats[_LOSS, j] = -1.0
    _hold(contacts, floats, s, j, direction)
    patches.reached[j] = 0
    place = patches.place[j]
    excess, room = meet(contacts, status, floats, patches, commands, target, s, j, direction)
    if excess > 0.0:
        status[j] = AT_FORWARD if direction > 0 else AT_BACKWARD  # even without friction, until the fall has ended
        _begin_jump(contacts, floats, patches.stretches.borders, place, j, direction, excess)
    elif room > 0.0:
        floats[_ROOM, j] = room


@lean
def jump(
    compliance,
    contacts,
    links,
    status,
    floats,
    bytes_,
    account,
    hits,
    count,
    patches,
    commands,
    target,
    s,
    i,
    direction,
):
    """Let a contact that has reached a border jump, with all that its jump sets off.

    Args:
        compliance: 1 / k, shape (N - 1,) [m/N].
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place.
        links: rows of the springs, shape (5, N - 1), changed in place.
        status: bounds at which contacts are, changed in place.
        floats: rates, velocities and changes of the bounds, changed in place.
        bytes_: moved links, leaving contacts and hits, changed in place.
        account: account of the ramp, added to.
        hits: the contacts whose blocks have to be solved again, changed in place.
        count: their number.
        patches: the ground, changed in place.
        commands: the targets at the start and at the end of the ramp, for ground without patches.
        target: the target at its end for the places of the contacts, shape (4 N - 1,), changed in place.
        s: place on the ramp, 0 .. 1.
        i: the contact, at the border, which it passes.
        direction: 1 forward, -1 backward.

    Returns:
        The number of hits; and whether the jump has ended. If not, the rest of it is left to `motion.ground.walk`.
    """
    n = contacts.shape[1]
    jumps = patches.jumps
    bit = AT_FORWARD if direction > 0 else AT_BACKWARD
    first = last = i
    falling = 0
    pieces = 0
    event = i
    ended = _join(contacts, links, status, floats, bytes_, account, patches, s, i, direction)
    while ended:
        if event >= 0 and floats[_ROOM, event] >= 0.0:  # it slides
            floats[_ROOM, event] = -1.0
            status[event] = bit
        elif event >= 0:
            arriving = _mark(contacts, floats, patches, first, last, event, direction)
            for j in range(first, last + 1):
                if patches.reached[j] != 0 and (patches.place[j] % 2 == 0 or not arriving):
                    ended &= jumps[0, COUNT] + falling + 2 < jumps.shape[0]  # else there is no room for more jumps
                    if ended:
                        falling -= floats[_LOSS, j] >= 0.0
                        _reach(contacts, status, floats, patches, commands, target, s, j, direction)
                        falling += floats[_LOSS, j] >= 0.0
                        if floats[_ROOM, j] > 0.0:
                            count = add_hit(bytes_, hits, count, j)
                elif patches.reached[j] != 0:
                    patches.reached[j] = 0  # whether it leaves its border depends on the others
        while ended and first > 0 and floats[_ROOM, first] < 0.0:
            ended = _join(contacts, links, status, floats, bytes_, account, patches, s, first - 1, direction)
            first -= ended
        while ended and last < n - 1 and floats[_ROOM, last] < 0.0:
            ended = _join(contacts, links, status, floats, bytes_, account, patches, s, last + 1, direction)
            last += ended
        if falling == 0 or not ended:
            break
        ended = _find_rates(compliance, floats, first, last)
        if not ended:
            break
        part, event = _find_next(contacts, floats, patches, first, last, direction)
        pieces += part * largest(floats[_SPEED, first : last + 1]) > 0.0
        count = _advance(
            contacts, links, status, floats, bytes_, account, jumps, hits, count, s, first, last, direction, part
        )
        if event < 0:
            break
    for j in range(first, last + 1):
        if floats[_ROOM, j] < 0.0:
            bytes_[ROW_LEAVING, j] = 0
            if floats[_LOSS, j] >= 0.0:
                _end_jump(contacts, floats, jumps, s, j, 0 if ended else direction)
            _hold(contacts, floats, s, j, direction)
            status[j] = _is_at(contacts, floats, s, j, direction)
    account[EVENTS] += pieces
    return count, ended
