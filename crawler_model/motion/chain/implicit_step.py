"""One implicit step of a chain: the projection of its tensions, and the displacements that lead there.

It is a catch-up step (`ramp`), and the whole of a ramp on which no contact turns round (`long.monotone`).
"""

from __future__ import annotations

from ...compiled import lean
from ...rounding import CRITICAL
from ..state import (
    ACTUATION,
    ACTUATION_REF,
    AMBIGUOUS,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    COMPLEMENTARITY,
    COMPLIANCE,
    DISSIPATION,
    FORWARD,
    GAIN_LEAST,
    GAIN_MOST,
    STIFFNESS,
    TENSION,
    TENSION_REF,
    WORK,
    shift,
)
from ..translation import choose_translation, is_wide
from .memory import (
    ROW_BACKWARD,
    ROW_FORWARD,
    ROW_GAIN,
    ROW_HIT,
    ROW_MOVED,
    ROW_STEP,
    ROW_TENSION,
    ROW_ZEROS,
)
from .projection import chain_velocities, project, shape_gain
from .wide import project_wide


@lean
def project_step(elasticity, links, target, floats, bytes_, stacks, wide):
    """Solve for the tensions and displacements after one implicit step, without changing the state.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        links: rows SHAPE .. ACTUATION_REF, shape (5, N - 1).
        target: L, mu_plus and mu_minus at the end of the step, shape (3 N - 1,) [m, N].
        floats: memory of the ramp, from `memory.scratch`, as the next two. Output: rows ROW_TENSION, ROW_GAIN (of
            elongations) and ROW_STEP (displacements).
        bytes_: output: row ROW_HIT, the bound at which each contact is, 1, 0 or -1.
        stacks: memory for `project`.
        wide: True to use the projection in double-double arithmetic.

    Returns:
        True if nothing fixes the translation.
    """
    springs = links.shape[1]
    forward = target[springs : 2 * springs + 1]
    backward = target[2 * springs + 1 : 3 * springs + 2]
    stiffness, compliance = elasticity[STIFFNESS], elasticity[COMPLIANCE]
    trial, tension, blur = floats[ROW_GAIN], floats[ROW_TENSION], floats[ROW_ZEROS]
    side = bytes_[ROW_HIT]
    for i in range(springs):
        origin = links[TENSION_REF, i] - stiffness[i] * (links[ACTUATION, i] - links[ACTUATION_REF, i])
        if links[TENSION, i] == origin:
            trial[i] = links[TENSION_REF, i] - stiffness[i] * (target[i] - links[ACTUATION_REF, i])
        else:
            trial[i] = links[TENSION, i] - stiffness[i] * (target[i] - links[ACTUATION, i])
    if wide:
        project_wide(trial[:springs], compliance, backward, forward, blur, tension[:springs], side)
    else:
        project(trial[:springs], compliance, backward, forward, blur, tension[:springs], side, stacks)
    for i in range(springs):
        trial[i] = shape_gain(tension[i], trial[i], compliance[i])
    return chain_velocities(trial, side, floats[ROW_STEP], 0, springs)


@lean
def take_step(contacts, links, status, target, floats, bytes_, account):
    """Move contacts and tensions as `project_step` and the choice of a translation have found.

    Args:
        contacts: rows of the contacts, changed in place; the bounds remain those at the start of the step.
        links: row TENSION is changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        target: as for `project_step`.
        floats: rows ROW_TENSION, ROW_GAIN and ROW_STEP.
        bytes_: row ROW_HIT; row ROW_MOVED is changed in place.
        account: account of the ramp, added to, except for the work.

    Returns:
        How many contacts reached a bound.
    """
    n = contacts.shape[1]
    tension, velocity, side = floats[ROW_TENSION], floats[ROW_STEP], bytes_[ROW_HIT]
    dissipation = 0.0
    complementarity = account[COMPLEMENTARITY]
    arrivals = 0
    before = 0.0
    for i in range(n):
        after = 0.0
        if i < n - 1:
            after = tension[i]
            links[TENSION, i] = after
            bytes_[ROW_MOVED, i] |= floats[ROW_GAIN, i] != 0.0
        forward, backward = target[n - 1 + i], target[2 * n - 1 + i]
        v = velocity[i]
        if v != 0.0:
            if v > 0.0:
                dissipation += 0.5 * (contacts[FORWARD, i] + forward) * v
                gap = forward - (after - before)
            else:
                dissipation -= 0.5 * (contacts[BACKWARD, i] + backward) * v
                gap = backward + (after - before)
            complementarity = max(complementarity, abs(v * gap))
            shift(contacts, v, 1.0, i, 0.5)
        if side[i] == 0:
            held = 0
        elif forward + backward == 0.0:
            held = AT_FORWARD | AT_BACKWARD
        else:
            held = AT_FORWARD if side[i] == 1 else AT_BACKWARD
        arrivals += held & ~status[i] != 0
        status[i] = held
        before = after
    account[DISSIPATION] += dissipation
    account[COMPLEMENTARITY] = complementarity
    return arrivals


@lean
def catch_up(elasticity, contacts, links, status, target, floats, bytes_, stacks, account, elements, share, wide):
    """Take one implicit step from the present state to `target`, with the friction of its end.

    Args:
        elasticity: rows STIFFNESS and COMPLIANCE, shape (2, N - 1).
        contacts: rows of the contacts, changed in place; the bounds remain those at the start of the step.
        links: row TENSION is changed in place.
        status: bits AT_FORWARD and AT_BACKWARD, int8, shape (N,), changed in place.
        target: L, mu_plus and mu_minus at the end of the step, shape (3 N - 1,) [m, N].
        floats: memory of the ramp, from `memory.scratch`, as the next two.
        bytes_: statuses within the ramp.
        stacks: memory for `project`.
        account: account of the ramp, added to.
        elements: both contacts of each element of a segment, shape (P, 2).
        share: weight of each contact in the net translation, shape (N,).
        wide: True to use the projection in double-double arithmetic.
    """
    n = contacts.shape[1]
    free_translation = project_step(elasticity, links, target, floats, bytes_, stacks, wide)
    tension, velocity, side = floats[ROW_TENSION], floats[ROW_STEP], bytes_[ROW_HIT]
    work = 0.0
    near = 0.0
    total = 0.0
    before = 0.0
    for i in range(n):
        after = 0.0
        if i < n - 1:
            after = tension[i]
            work -= 0.5 * (links[TENSION, i] + after) * (target[i] - links[ACTUATION, i])
        forward, backward = target[n - 1 + i], target[2 * n - 1 + i]
        if side[i] == 0:
            near += max(min(forward - (after - before), backward + (after - before)), 0.0)
        total += forward + backward
        before = after
    account[WORK] += work
    if free_translation or near <= CRITICAL * total:
        for i in range(n):
            floats[ROW_FORWARD, i] = 0.5 * (contacts[FORWARD, i] + target[n - 1 + i])
            floats[ROW_BACKWARD, i] = 0.5 * (contacts[BACKWARD, i] + target[2 * n - 1 + i])
        least, most = choose_translation(velocity, floats[ROW_FORWARD], floats[ROW_BACKWARD], elements, share)
        if is_wide(least, most, velocity):
            account[AMBIGUOUS] = 1.0
            account[GAIN_LEAST] += least
            account[GAIN_MOST] += most
    take_step(contacts, links, status, target, floats, bytes_, account)
