"""Which contacts of a block slide, and the rates in it, by principal pivoting.

The rates in a block solve a complementarity problem: a contact at its forward bound either slides forward, its force
moving along the bound, or rests with a force that rises no faster than the bound. An implicit step is the same problem
for the whole body with forces instead of rates. The search exchanges all contacts that violate their condition; where
that does not reduce their number, only the last one (Murty's rule), which ends for every body that something holds.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inlined, lean
from ...rounding import EPS, NOISE
from .clusters import wake_turning
from .ground.couplings import couplings_of, exchange_pieces, is_coupled, keep_limits
from .ground.gradual import force_of, holds, is_gradual, stiffness_of
from .ground.unstable import is_stable, search_sides, turns_unstable
from .mesh import solve_mesh
from .path import limit_of, solve_path
from .project import project

ROUNDING = 32.0 * EPS
"""A force beyond its limit by less than this part of the terms that it is a sum of is at its limit."""


@inlined
def _count_resting(ramp, block, count):
    """Count the contacts at rest of a block that no others hold, and find the last of them; 2 if some do."""
    if ramp.search.anchored:
        return 2, -1
    resting, last = 0, -1
    for j in range(count):
        if block[j].side == 0:
            resting, last = resting + 1, j
    return resting, last


@inlined
def _balance(block, count, row):
    """Find the force on the only contact at rest: forces of springs sum to zero, however they are rounded."""
    force = size = 0.0
    for j in range(count):
        if j != row:
            force -= block[j].force
            size += abs(block[j].force) + block[j].blur
    block[row].force, block[row].scale = force, size


@lean
def _find_brake(ramp, block, count, last_only):
    """Find the contact that stops where all would slide and nothing would hold the body, and whether friction balances.

    Forces of springs sum to zero. If the limits at which the contacts slide do not, the body would fly off, and one of
    those that slide the other way stops: the slowest or, by Murty's rule, the last. If they do, the translation is
    free, and any contact may stand for the reference of the velocities.
    """
    excess = size = 0.0
    for j in range(count):
        e = block[j]
        excess -= limit_of(e)
        size += abs(limit_of(e)) + e.blur
    balances = abs(excess) <= 64.0 * EPS * size
    brake, slowest = -1, np.inf
    for j in range(count):
        e = block[j]
        if (balances or e.side * excess < 0.0) and (last_only or abs(e.v) < slowest):
            brake, slowest = j, abs(e.v)
    if brake < 0:
        ramp.search.loose = (1 + block[0].contact) * (1 if excess > 0.0 else -1)
    return brake, balances


@lean
def _stop_one(block, ground, count):
    """Stop one contact where all slide on ground that holds less and less, which does not hold their translation.

    Of the contacts that slide against the sum of all forces, it is the one whose direction the others leave first.
    """
    stiffness = balance = 0.0
    ahead = behind = -1
    for j in range(count):
        e = block[j]
        stiffness += stiffness_of(e, ground)
        balance += force_of(e, ground)
        if e.side > 0 and (ahead < 0 or e.v < block[ahead].v):
            ahead = j
        if e.side < 0 and (behind < 0 or e.v > block[behind].v):
            behind = j
    if stiffness < 0.0 and ahead >= 0 and behind >= 0:
        balance -= 0.5 * stiffness * (block[ahead].v + block[behind].v)
        block[ahead if balance > 0.0 else behind].side = 0


@lean
def _center(block, count):
    """Choose a free translation: the one nearest to no net velocity at which all contacts slide as their sides demand.

    If there is none, it is the one without net velocity, the limit of a body that weak springs tie to the ground.
    """
    mean = most = 0.0
    least, highest = -np.inf, np.inf
    for j in range(count):
        e = block[j]
        mean += e.v / count
        if e.side > 0:
            least = max(least, -e.v)
        else:
            highest = min(highest, -e.v)
    translation = min(max(-mean, least), highest) if least <= highest else -mean
    for j in range(count):
        block[j].v += translation
        most = max(most, abs(block[j].v))
    for j in range(count):
        if abs(block[j].v) <= 10.0 * NOISE * most:
            block[j].v = 0.0


@inlined
def _side_of(e):
    """Find the side that a contact must have: 0 if it slides against its bound, 1 or -1 if it rests beyond a limit."""
    if e.cluster >= 0:  # else it would have woken
        return e.side
    if e.side != 0:
        return 0 if e.v * e.side < 0.0 else e.side
    close = ROUNDING * (e.scale + e.blur)
    if e.force > e.upper + close:
        return 1
    return -1 if e.force < e.lower - close else 0


@inlined
def meets_conditions(block, count):
    """Determine whether all contacts of a block have the sides that they must have.

    Returns:
        Whether they have.
    """
    met = True
    for j in range(count):
        met &= _side_of(block[j]) == block[j].side
    return met


@inlined
def _exchange(block, count, last_only):
    """Count the contacts that violate their condition, and change the sides of all of them, or of the last one."""
    found, last, change = 0, -1, 0
    for j in range(count):
        side = _side_of(block[j])
        if side != block[j].side:
            found += 1
            last, change = j, side
            if not last_only:
                block[j].side = side
    if found > 0 and last_only:
        block[last].side = change
    return found


@lean
def _refer(contacts, springs, model, couplings, ramp, count):
    """Find the limits of a block all of whose contacts slide: elongations do not depend on its translation."""
    if couplings is None:
        return
    side = model.block[0].side
    model.block[0].side = 0
    solve_mesh(contacts, springs, model, model.matrix, ramp, count)
    model.block[0].side = side


@inlined
def _is_loose(ramp, block, curves, count):
    """Determine whether nothing holds a block, and its limits do not either: `loose` is then set."""
    if curves is None or ramp.search.anchored:
        return False
    most = least = size = 0.0
    for j in range(count):
        e = block[j]
        if e.upper < np.inf:
            size += abs(e.upper) + e.blur
        if e.lower > -np.inf:
            size += abs(e.lower) + e.blur
        most += e.upper
        least += e.lower
    near = 64.0 * EPS * size
    if most >= -near and least <= near:
        return False
    ramp.search.loose = (1 + block[0].contact) * (1 if most < -near else -1)
    return True


@inlined
def find_sides(contacts, springs, model, ramp, count):
    """Find which contacts of the block slide, and the rates in it.

    With K the stiffness of the springs, c the rates that commands give the forces, and u and -l the rates of the
    bounds, the rates v of the displacements and r = c - K v of the forces solve

        r_i = u_i,  v_i >= 0   or   r_i = l_i,  v_i <= 0   or   l_i <= r_i <= u_i,  v_i = 0,

    where the limits that a contact is not at are infinite.

    Args:
        model: a `Model`, whose block is changed in place.
        ramp: the RAMP; `undetermined` is set if all slide, nothing holds them and friction balances.

    Returns:
        False if no sides were found, or no equilibrium is left; or if clusters woke, and the block must be found anew.
    """
    block = model.block
    best, waited, last_only = count + 1, 0, False
    follows_path = ramp.search.path > 0 and not is_gradual(model.ground)
    hurries = ramp.search.hurries != 0 and ramp.search.path == 0  # the search begins elsewhere if it takes long
    patience = ramp.search.patience if hurries else ramp.search.patience + count
    projects_after = 0 if ramp.stepping else ramp.search.projects_after
    keep_limits(couplings_of(model.ground), block, count)
    # ground that holds less and less may leave no solution, or several
    if not is_stable(contacts, springs, model, model.ground, ramp, count):
        if turns_unstable(contacts, springs, model, model.ground, ramp, count):
            return False
        found = search_sides(contacts, springs, model, model.ground, ramp, count)
        if found >= 0:
            return found > 0
    for turn in range(50 + 10 * count):
        ramp.effort += count
        # a long path starts from its projection, which is solved in linear time
        if turn == projects_after and follows_path:
            if _is_loose(ramp, block, model.curves, count):
                return False
            project(model, ramp, count)
        # where all slide, K is singular: one contact is kept at rest as the reference of the velocities
        brake, balances, side = -1, False, 0
        resting, last = _count_resting(ramp, block, count)
        if resting == 0 and not holds(block, model.ground, count):
            _refer(contacts, springs, model, couplings_of(model.ground), ramp, count)
            brake, balances = _find_brake(ramp, block, count, last_only)
            if brake < 0:
                return False
            side = block[brake].side
            block[brake].side = 0
        elif resting == 0 and last_only:
            _stop_one(block, model.ground, count)
        # velocities of those that slide, forces on those that rest
        if follows_path:
            solve_path(block, count)
        elif not solve_mesh(contacts, springs, model, model.matrix, ramp, count):
            break
        if resting == 1:
            _balance(block, count, last)
        if balances:  # the reference slides, too, and the translation is free
            block[brake].side = side
            _center(block, count)
            block[brake].force = limit_of(block[brake])
        # all that violate their condition change sides, or only the last one while their number does not fall
        found = _exchange(block, count, last_only)
        found += exchange_pieces(couplings_of(model.ground), True)
        if found == 0:
            if wake_turning(contacts, springs, block, model.clusters, ramp, count):
                return False
            ramp.search.undetermined |= balances
            return True
        last_only = False
        if found < best:
            best, waited = found, 0
        elif waited < patience:
            waited += 1
        elif hurries:
            return False
        else:
            last_only = True
    if ramp.stepping or not is_coupled(couplings_of(model.ground)):
        return False
    return search_sides(contacts, springs, model, model.ground, ramp, count) > 0
