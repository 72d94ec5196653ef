"""One implicit step: the positions in which friction balances the forces, moving straight from where the points are.

Solved by a semismooth Newton method. Points that stick are where they were, to the bit.
"""

from __future__ import annotations

import numpy as np

from ...compiled import inner, lean
from ...rounding import CRITICAL
from .band import solve_band
from .elastic import pull, stiffen
from .frame import assign, friction_of, load_of, norm
from .friction import axis_of, linearise

_MOST_STEPS = 40
_BOLD, _FAR, _SLOW = 15, 0.5, 0.9
"""First steps of a bold search, which may let the largest miss grow up to a limit; and the part of the miss that a
later one may leave."""
_GAIN = 1e-4
"""A cautious search halves a step until the largest miss shrinks, after a whole step by this part at least: a bold one
goes round in circles where a force is about to change to a quarter of its set of far larger friction."""
_FEW_HALVINGS, _MOST_HALVINGS = 8, 20
"""Upper limits of halvings in a bold and in a cautious search."""
_RUNGS, _SOFTER = 12, 0.25
"""Searches with springs where the first one fails, up to one that fails, too, and the stiffness of a spring relative to
the one before."""
_MOST_APPROACHES = 100
"""Upper limit of steps towards a solution that the search does not find."""
_LONGEST = 0.25
"""A point moves by no more than this part of the shortest link in a step."""


@lean
def _join(rows, place, jump, band, right, reach, i, j, block, u, v):
    """Add how the miss of point i, which moves, changes with the position of j, by the change of the force on i.

    Its negative consists of two rows and columns of the block, from u and v on. A point that sticks moves by `jump`,
    which belongs to the right side.
    """
    other = place[j]
    for p in range(2):
        r = 2 * place[i] + p
        by0 = rows[i, 2 + 2 * p]
        by1 = rows[i, 3 + 2 * p]
        change0 = by0 * block[u, v] + by1 * block[u + 1, v]
        change1 = by0 * block[u, v + 1] + by1 * block[u + 1, v + 1]
        if other >= 0:
            at = 2 * reach + r - 2 * other
            band[2 * other, at] -= change0
            band[2 * other + 1, at - 1] -= change1
        else:
            right[r] += change0 * jump[j, 0] + change1 * jump[j, 1]


@lean
def _reach_of(frame, place):
    """Compute the largest distance of two coupled points that move."""
    apart = 0
    for k in range(frame.pairs.shape[0]):
        a = place[frame.pairs[k, 0]]
        b = place[frame.pairs[k, 1]]
        if a >= 0 and b >= 0:
            apart = max(apart, abs(a - b))
    return 2 * apart + 1


@lean
def _assemble(frame, command, x, eta, rows, place, jump, band, right, reach, block):
    """Write the matrix and the right side of a Newton step; `block` is memory, shape (6, 6)."""
    middle = 2 * reach
    for i in range(x.shape[0]):
        if place[i] < 0:
            continue
        for p in range(2):
            r = 2 * place[i] + p
            right[r] = -rows[i, p]
            for q in range(2):
                c = 2 * place[i] + q
                own = rows[i, 2 + 2 * p + q] * frame.grip[i] * (CRITICAL + eta)  # a translation may be free
                band[c, middle + r - c] -= rows[i, 6 + 2 * p + q] + own
    for i in range(x.shape[0]):
        if frame.vector or place[i] < 0 or (rows[i, 10] == 0.0 and rows[i, 11] == 0.0):
            continue
        _, _, by0, by1 = axis_of(frame, x, i)
        for end in range(2):
            sign = 1.0 if end == 1 else -1.0
            j = frame.guide[i, end]
            for p in range(2):
                r = 2 * place[i] + p
                turn = sign * rows[i, 10 + p]
                if place[j] >= 0:
                    c = 2 * place[j]
                    band[c, middle + r - c] += turn * by0
                    band[c + 1, middle + r - c - 1] += turn * by1
                else:
                    right[r] -= turn * (by0 * jump[j, 0] + by1 * jump[j, 1])
    for k in range(0, frame.stiffness.shape[0], 2 if frame.vector else 1):
        count = 2 if frame.points[k, 2] < 0 else 3
        moves = False
        for p in range(count):
            moves = moves or place[frame.points[k, p]] >= 0
        if not moves:
            continue
        stiffen(frame, command, x, k, block)
        for p in range(count):
            i = frame.points[k, p]
            for q in range(count if place[i] >= 0 else 0):
                _join(rows, place, jump, band, right, reach, i, frame.points[k, q], block, 2 * p, 2 * q)


@inner
def find_step(frame, command, x, rows, step, eta):
    """Solve for a step by which the miss of each point that moves becomes zero.

    Args:
        rows: from `linearise`, shape (N, 13).
        step: changed in place: of the points that stick, then of all, shape (N, 2) [m].
        eta: stiffness of springs to an anchor, relative to the grip of each point [1].

    Returns:
        The least relative pivot.
    """
    n = x.shape[0]
    place = np.empty(n, np.int64)
    count = 0
    for i in frame.order:
        place[i] = count if rows[i, 12] > 0.0 else -1
        count += rows[i, 12] > 0.0
    if count == 0:
        return 1.0
    reach = min(_reach_of(frame, place), 2 * count - 1)
    band = np.zeros((2 * count, 3 * reach + 1))
    right = np.empty(2 * count)
    _assemble(frame, command, x, eta, rows, place, step, band, right, reach, np.empty((6, 6)))
    pivot = solve_band(band, reach, right)
    for i in range(n):
        if place[i] >= 0:
            step[i, 0] = right[2 * place[i]]
            step[i, 1] = right[2 * place[i] + 1]
    return pivot


@lean
def _shorten(frame, step):
    """Limit a step to the part that leaves each link its direction."""
    if frame.vector:
        return 1.0
    longest = 0.0
    for i in range(step.shape[0]):
        longest = max(longest, norm(step[i, 0], step[i, 1]))
    most = _LONGEST * frame.shortest
    return 1.0 if longest <= most else most / longest


@lean
def _hold(frame, eta, anchor, x, force, size):
    """Add the forces of springs that hold each point at an anchor."""
    if eta > 0.0:
        for i in range(x.shape[0]):
            for c in range(2):
                force[i, c] -= eta * frame.grip[i] * (x[i, c] - anchor[i, c])
            size[i] += eta * frame.grip[i] * norm(x[i, 0], x[i, 1])


@inner
def _search(frame, command, base, anchor, x, force, eta, bold):
    """Search the solution of an implicit step from a guess, with springs to an anchor; else as `solve_stage`.

    `eta` is their stiffness as in `solve_stage`.
    """
    n = x.shape[0]
    size = np.empty(n)
    rows = np.empty((n, 13))
    step = np.empty((n, 2))
    trial = np.empty((n, 2))
    frame.effort[0] += n
    pull(frame, command, x, force, size)
    _hold(frame, eta, anchor, x, force, size)
    worst, miss = linearise(frame, command, x, base, force, size, rows)
    pivot = 1.0
    for turn in range(_MOST_STEPS):
        if worst <= 1.0:
            for i in range(n):
                if rows[i, 12] == 0.0:
                    x[i, 0] = base[i, 0]
                    x[i, 1] = base[i, 1]
            return True, pivot > CRITICAL
        for i in range(n):
            for c in range(2):
                step[i, c] = base[i, c] - x[i, c]
        if frame.effort[0] > frame.effort[1]:
            return False, True
        pivot = find_step(frame, command, x, rows, step, eta)
        if not pivot > 0.0:
            return False, False
        fraction = _shorten(frame, step)
        for _ in range(_FEW_HALVINGS if bold else _MOST_HALVINGS):
            for i in range(n):
                for c in range(2):
                    trial[i, c] = x[i, c] + fraction * step[i, c] if fraction < 1.0 or rows[i, 12] > 0.0 else base[i, c]
            frame.effort[0] += n
            pull(frame, command, trial, force, size)
            _hold(frame, eta, anchor, trial, force, size)
            worst, after = linearise(frame, command, trial, base, force, size, rows)
            enough = _SLOW if bold else 1.0 - _GAIN * fraction
            if after <= enough * miss or (bold and after <= _FAR and turn < _BOLD):
                break
            fraction *= 0.5
        else:
            return False, True
        assign(x, trial)
        miss = after
    return False, True


@inner
def solve_stage(frame, command, base, x, force, eta):
    """Solve an implicit step.

    Where a bold search fails, a cautious one follows; where that fails, springs hold each point where it was, and
    become softer from one search to the next. Steps of vector springs are rather made shorter, which takes less time.

    Args:
        command: the command at the end of the step.
        x: changed in place: a guess of the displacements at its end, then these, shape (N, 2) [m].
        force: output: the force that friction balances, shape (N, 2) [N].
        eta: stiffness of springs that hold each point where it was, relative to its grip, 0 for none [1].

    Returns:
        Whether it is solved to rounding, and whether its matrix is regular.
    """
    guess = x if frame.vector else x.copy()
    solved, regular = _search(frame, command, base, base, x, force, eta, True)
    if solved or frame.vector:
        return solved, regular
    assign(x, guess)
    solved, regular = _search(frame, command, base, base, x, force, eta, False)
    if solved or eta > 0.0:
        return solved, regular
    assign(x, base)
    for rung in range(_RUNGS + 1):
        more = _SOFTER**rung if rung < _RUNGS else 0.0
        solved, regular = _search(frame, command, base, base, x, force, more, False)
        if not solved:
            break
    return solved, regular


@lean
def _can_hold(frame, command):
    """Return whether friction can hold the sum of the loads: it lies in the sum of the sets of friction forces."""
    total0 = 0.0
    total1 = 0.0
    held = 0.0
    for i in range(frame.position.shape[0]):
        total0 += load_of(frame, command, i, 0)
        total1 += load_of(frame, command, i, 1)
        held += friction_of(frame, command, i)[2]
    for k in range(frame.directions.shape[0]):
        along = 0.0
        for i in range(frame.position.shape[0]):
            along += command[friction_of(frame, command, i)[0] + k]
        if total0 * frame.directions[k, 0] + total1 * frame.directions[k, 1] > along:
            return False
    return frame.directions.shape[0] > 0 or norm(total0, total1) <= held


@inner
def approach(frame, command, base, x, force):
    """Solve an implicit step of vector springs from anywhere, by the proximal point method.

    Springs hold each contact where the last search ended. Energy and friction are convex, so each of these steps leads
    nearer to the solution, until a search without springs succeeds. It may take a hundred searches.

    Args:
        command: the command at the end of the step.
        x: output: the displacements at its end, shape (N, 2) [m].
        force: output: the force that friction balances, shape (N, 2) [N].

    Returns:
        Whether it is solved to rounding.
    """
    if not _can_hold(frame, command):
        return False
    anchor = base.copy()
    more = 1.0
    for _ in range(_MOST_APPROACHES):
        assign(x, anchor)
        if not _search(frame, command, base, anchor, x, force, more, True)[0]:
            more *= 4.0
            continue
        assign(anchor, x)
        more *= _SOFTER
        if _search(frame, command, base, base, x, force, 0.0, True)[0]:
            return True
    return False
