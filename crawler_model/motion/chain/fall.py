"""The fall of a bound of one contact of a chain, at fixed commands, in closed form.

While the bound of contact i falls, it slides with its neighbours up to the nearest contacts, p and q, that are not at
their bounds in this direction. All springs between p and i change their tensions alike, those between i and q do so,
too: a spring with the compliances of either row in series holds i. When p or q reaches its bound, it slides along; no
contact ever stops, since all move one way.
"""

from __future__ import annotations

import numpy as np

from ...compiled import compiled, lean
from ..borders import gap_ahead
from ..state import AT_BACKWARD, AT_FORWARD, BACKWARD, DISSIPATION, EVENTS, FORWARD, TENSION, shift
from .memory import ROW_D_BACKWARD, ROW_D_FORWARD, ROW_GAIN, ROW_LEAVING, ROW_MOVED, ROW_TRIAL
from .rates import settle, slack, update

LEFT_OUT, ENDED, AT_BORDER = range(3)
"""How a fall ended: it is left to `motion.ground.walk`, and nothing has changed; at the end; at a border."""


@lean
def bound_at(contacts, floats, s, i, direction):
    """Compute the bound of a contact in a direction.

    Args:
        contacts: rows of the contacts, as in `follow_events`.
        floats: changes of the bounds.
        s: place on the ramp, 0 .. 1.
        i: the contact.
        direction: 1 for the forward bound, -1 for the backward one.

    Returns:
        The bound [N].
    """
    if direction > 0:
        return contacts[FORWARD, i] + s * floats[ROW_D_FORWARD, i]
    return contacts[BACKWARD, i] + s * floats[ROW_D_BACKWARD, i]


@compiled
def _room(contacts, links, status, floats, bytes_, s, j, direction):
    """Compute how far the force on contact j is from its bound in a direction at s."""
    settle(status, floats, bytes_, s, j)
    if status[j] & (AT_FORWARD if direction > 0 else AT_BACKWARD):
        return 0.0
    above, below = slack(contacts, links, floats, s, j)
    return max(above if direction > 0 else below, 0.0)


@compiled
def fall(compliance, contacts, links, status, floats, bytes_, account, patches, s, i, direction, now):
    """Let the bound of a contact fall from `now` to that of its ground, at fixed commands.

    Args:
        compliance: 1 / k, shape (N - 1,) [m/N].
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place.
        links: rows of the springs, shape (5, N - 1), changed in place.
        status: bounds at which contacts are, changed in place.
        floats: rates, velocities and changes of the bounds, changed in place.
        bytes_: moved links and leaving contacts, changed in place.
        account: account of the ramp, added to.
        patches: the ground.
        s: place on the ramp, 0 .. 1.
        i: the contact.
        direction: 1 for the forward bound, -1 for the backward one.
        now: the bound at which the contact is [N].

    Returns:
        How it ended; the first and the last contact that slid; the bound reached [N]; the loss [J]; and the number of
        linear pieces with motion.
    """
    n = contacts.shape[1]
    joined = floats[ROW_GAIN]  # growth of the tensions on the same side when a link joined
    goal = bound_at(contacts, floats, s, i, direction)
    border, near = gap_ahead(contacts, patches.ground, i, direction)
    first = i + 1
    last = i - 1
    left = right = 0.0  # compliance of the links on either side
    left_room = right_room = 0.0  # growth of their tensions until the contact behind them slides
    left_growth = right_growth = 0.0
    moved = loss = 0.0
    pieces = 0
    ending = LEFT_OUT
    while ending == LEFT_OUT:
        while left_room <= 0.0:
            first -= 1
            if first != i and patches.reached[first] != 0:
                return LEFT_OUT, i, i, now, 0.0, 0
            if first > 0:
                joined[first - 1] = left_growth
                left += compliance[first - 1]
                left_room = _room(contacts, links, status, floats, bytes_, s, first - 1, direction)
            else:
                left = left_room = np.inf
        while right_room <= 0.0:
            last += 1
            if last != i and patches.reached[last] != 0:
                return LEFT_OUT, i, i, now, 0.0, 0
            if last < n - 1:
                joined[last] = right_growth
                right += compliance[last]
                right_room = _room(contacts, links, status, floats, bytes_, s, last + 1, direction)
            else:
                right = right_room = np.inf
        stiffness = 1.0 / left + 1.0 / right
        if stiffness == 0.0:  # nothing holds the body
            return LEFT_OUT, i, i, now, 0.0, 0
        step = (now - goal) / stiffness
        captured = 0
        if left_room * left < step:
            step = left_room * left
            captured = -1
        if right_room * right < step:
            step = right_room * right
            captured = 1
        if (border - moved) - near <= step:
            step = max((border - moved) - near, 0.0)
            captured = 0
            ending = AT_BORDER
        elif captured == 0:
            ending = ENDED
        bound = goal if ending == ENDED else now - stiffness * step
        loss += (0.5 * (now + bound) - goal) * step
        now = bound
        moved += step
        left_growth += step / left
        right_growth += step / right
        left_room = 0.0 if captured < 0 else left_room - step / left
        right_room = 0.0 if captured > 0 else right_room - step / right
        pieces += step > 0.0
    update(contacts, links, floats, account, s, max(first - 1, 0), min(last + 1, n - 1))
    moves = floats[ROW_TRIAL]
    _find_moves(compliance, joined, left_growth, right_growth, first, last, i, moved, moves)
    for j in range(first, last + 1):
        if j != i and moves[j] > 0.0:
            gap, near = gap_ahead(contacts, patches.ground, j, direction)
            if moves[j] >= gap - near:  # another contact reaches a border
                return LEFT_OUT, i, i, now, 0.0, 0

    bit = AT_FORWARD if direction > 0 else AT_BACKWARD
    account[DISSIPATION] += loss
    for j in range(first, last + 1):
        account[DISSIPATION] += moves[j] * (goal if j == i else bound_at(contacts, floats, s, j, direction))
        shift(contacts, direction * moves[j], 1.0, j, s)
        if j != i and status[j] != AT_FORWARD | AT_BACKWARD:
            status[j] = bit
        bytes_[ROW_LEAVING, j] = 0
    for j in range(max(first - 1, 0), min(last, n - 2) + 1):
        gain = left_growth - joined[j] if j < i else joined[j] - right_growth
        links[TENSION, j] += direction * gain
        bytes_[ROW_MOVED, j] |= gain != 0.0
    account[EVENTS] += max(pieces, 1)
    return ending, first, last, now, loss, pieces


@lean
def _find_moves(compliance, joined, left_growth, right_growth, first, last, i, moved, moves):
    """Compute how far contacts first..last move while contact i moves by `moved`."""
    n = moves.shape[0]
    moves[i] = moved
    if first > 0:
        distance = 0.0
        for j in range(first, i):
            distance += compliance[j - 1] * (left_growth - joined[j - 1])
            moves[j] = distance
    else:
        for j in range(i - 1, -1, -1):
            moves[j] = max(moves[j + 1] - compliance[j] * (left_growth - joined[j]), 0.0)
    if last < n - 1:
        distance = 0.0
        for j in range(last, i, -1):
            distance += compliance[j] * (right_growth - joined[j])
            moves[j] = distance
    else:
        for j in range(i + 1, n):
            moves[j] = max(moves[j - 1] - compliance[j - 1] * (right_growth - joined[j - 1]), 0.0)
