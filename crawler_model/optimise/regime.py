"""The periodic regime of a candidate: gain, work and travel of a period, and their derivatives."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..crawler.crawler import default_budget
from ..derivative.parameters import Derivatives
from ..derivative.path import TangentPath, Vertices
from ..motion.pieces import COUNT, FROM, HEADER, RAMP, UNTIL, room_for_pieces
from ..motion.state import ACCOUNT_SIZE, OVERSPENT, UNSOLVED, VISITED, WORK
from .unknowns import Cycle

_REPEATS = 1e-10
"""Tensions at the ends of periods that differ by less than this part of the largest are taken to repeat."""
_FIRST_PERIODS, _MOST_PERIODS = 3, 48
_DERIVATIVE_REPEATS = 1e-9


@dataclass(frozen=True)
class Regime:
    """A period of the periodic regime.

    Attributes:
        gain: y gained [m].
        work: of the actuators less the energy stored, which is zero once the tensions repeat [J].
        travel: sum of all changes of rest lengths, each taken positive [m].
        force: mean over the period of the friction of all contacts, or the weight of the body [N].
        peak: largest tension [N]; NaN if it was not requested.
        speed: fastest change of a rest length [m/s].
        settled: whether the tensions repeat.
    """

    gain: float
    work: float
    travel: float
    force: float
    peak: float
    speed: float
    settled: bool


def find_regime(cycle: Cycle, with_peak: bool = False) -> Regime | None:
    """Run a candidate until its tensions repeat, and measure the next period.

    Args:
        cycle: the candidate.
        with_peak: whether to find the largest tension, which is at the end of a linear piece.

    Returns:
        The regime; None if a ramp has too many events to be followed exactly.
    """
    plan = cycle.plan
    body, targets = plan.body, plan.drive.targets
    motion, rest = cycle.rest
    state, scratch = rest.copy(), motion.scratch()
    budget, n, count = default_budget(body), body.contacts, targets.shape[0] - 1
    period = np.vstack((targets[2:], targets[1:2]))
    periods, done, settled = _FIRST_PERIODS, 0, False
    chunk = np.vstack((targets[1:2], np.tile(period, (periods, 1))))
    account = np.zeros(ACCOUNT_SIZE)
    account[VISITED] = math.inf
    while True:
        records = np.empty((chunk.shape[0], 2 * n + body.springs))
        motion.follow(state, scratch, chunk, True, budget, account, records)
        done += periods
        last, before = records[-1, 2 * n :], records[-1 - count, 2 * n :]
        settled = bool(np.abs(last - before).max(initial=0.0) <= _REPEATS * np.abs(last).max(initial=1e-300))
        if settled or done >= _MOST_PERIODS:
            break
        periods = done
        chunk = np.tile(period, (periods, 1))
    account[WORK] = 0.0
    ends = np.empty((count, 2 * n + body.springs))
    begin = records[-1].copy()
    if with_peak:
        peak = _find_peak(motion, state, scratch, period, budget, account, ends, body)
    else:
        motion.follow(state, scratch, period, True, budget, account, ends)
        peak = math.nan
    if account[OVERSPENT] or account[UNSOLVED]:
        return None
    moved = (ends[-1, :n] - begin[:n]) + (ends[-1, n : 2 * n] - begin[n : 2 * n])
    change = np.abs(np.diff(targets[1:, : body.springs], axis=0, append=targets[1:2, : body.springs]))
    lengths = body.joint_sum(change.T).T if body.segments else change
    speed = float((lengths / np.roll(cycle.seconds, -1)[:, None]).max(initial=0.0))
    gain = float(body.share @ moved)
    stored = 0.5 * float(((ends[-1, 2 * n :] ** 2 - begin[2 * n :] ** 2) / body.stiffness).sum())
    return Regime(gain, float(account[WORK]) - stored, float(change.sum()), _force(cycle)[0], peak, speed, settled)


def _find_peak(
    motion: Any,
    state: Any,
    scratch: Any,
    period: np.ndarray,
    budget: int,
    account: np.ndarray,
    ends: np.ndarray,
    body: Any,
) -> float:
    """Follow a period and find the largest tension at the ends of its linear pieces."""
    before, spent = state.copy(), account.copy()
    n, room = body.contacts, 16 * period.shape[0] + 64
    tension, actuation = np.array(state.tension), np.array(state.actuation)
    while True:
        pieces = room_for_pieces(room, n)
        motion.follow(state, scratch, period, True, budget, account, ends, pieces)
        if pieces[0, COUNT] <= room:
            break
        room = int(pieces[0, COUNT])
        for array, old in ((state.contacts, before.contacts), (state.links, before.links)):
            array[:] = old
        state.status[:] = before.status
        account[:] = spent
    met = pieces[1 : 1 + int(pieces[0, COUNT])]
    ramps = met[:, RAMP].astype(np.int64)
    steps = np.diff(np.vstack((actuation, period[:, : body.springs])), axis=0)
    velocity = met[:, HEADER : HEADER + n]
    rate = body.stiffness * (velocity[:, body.ends[:, 1]] - velocity[:, body.ends[:, 0]] - steps[ramps])
    at_starts = np.vstack((tension, ends[:-1, 2 * n :]))
    peak = max(float(np.abs(at_starts).max(initial=0.0)), float(np.abs(ends[:, 2 * n :]).max(initial=0.0)))
    inside = rate * (met[:, UNTIL] - met[:, FROM])[:, None]
    for ramp in np.unique(ramps):
        path = at_starts[ramp] + np.cumsum(inside[ramps == ramp], axis=0)
        peak = max(peak, float(np.abs(path).max(initial=0.0)))
    return peak


def _force(cycle: Cycle) -> tuple[float, np.ndarray | None]:
    """Compute the force of the cost of transport, and the weights of the targets in it; None if it is constant."""
    plan = cycle.plan
    weight = float(plan.ground.weight.sum())
    if weight > 0.0:
        return weight, None
    targets, n, springs = plan.drive.targets[1:], plan.body.contacts, plan.body.springs
    weights = np.zeros(targets.shape)
    weights[:, springs : springs + 2 * n] = 0.5 * cycle.share[:, None]
    return float((weights * targets).sum()), weights


@dataclass(frozen=True)
class RegimeDerivatives:
    """A period of the periodic regime with derivatives.

    Attributes:
        regime: its numbers, without the peak.
        gain: derivatives of the gain, shape (P,).
        work: of the work, shape (P,).
        travel: of the travel, shape (P,).
        force: of the force, shape (P,).
        one_sided: unknowns in which the gain or the work has a one-sided derivative, shape (P,).
        travel_one_sided: unknowns in which the travel has one, where a link stays for a ramp as it is, shape (P,).
        kinks: where: waypoint of the period before which the kink lies, part of the ramp to it, and contact.
        settled: whether tensions and derivatives repeat.
    """

    regime: Regime
    gain: np.ndarray
    work: np.ndarray
    travel: np.ndarray
    force: np.ndarray
    one_sided: np.ndarray
    travel_one_sided: np.ndarray
    kinks: tuple[tuple[int, float, int], ...]
    settled: bool


def differentiate_regime(cycle: Cycle, derivatives: Derivatives) -> RegimeDerivatives:
    """Carry derivatives along a candidate until they repeat.

    Args:
        cycle: the candidate.
        derivatives: of its arrays.

    Returns:
        The last period and its derivatives.

    Raises:
        CommandError: if a ramp has too many events to be followed.
    """
    plan = cycle.plan
    body, targets = plan.body, plan.drive.targets
    path = TangentPath(plan, derivatives)
    share, count = body.share, targets.shape[0] - 1
    path.follow(_vertices(targets, np.array([1]), derivatives))
    order = np.append(np.arange(2, count + 1), 1)
    vertices = _vertices(targets, order, derivatives)
    previous: tuple[np.ndarray, np.ndarray] | None = None
    begin_dx, begin = path.dx, None
    settled = False
    for periods in range(_MOST_PERIODS):
        tension = path.state
        path.one_sided[:] = False
        path.kinks.clear()
        stretch = path.follow(vertices)
        d_gain, d_work = share @ (stretch.dx[-1] - begin_dx), stretch.d_work.sum(axis=0)
        begin_dx, last = stretch.dx[-1], (stretch.x[-1], stretch.rest[-1])
        gain = 0.0 if begin is None else float(share @ ((last[0] - begin[0]) + (last[1] - begin[1])))
        repeats = np.abs(path.state - tension).max(initial=0.0) <= _REPEATS * np.abs(tension).max(initial=1e-300)
        if previous is not None and repeats:
            size = np.abs(d_gain).max(initial=1e-300), np.abs(d_work).max(initial=1e-300)
            settled = bool(
                np.abs(d_gain - previous[0]).max(initial=0.0) <= _DERIVATIVE_REPEATS * size[0]
                and np.abs(d_work - previous[1]).max(initial=0.0) <= _DERIVATIVE_REPEATS * size[1]
            )
            if settled:
                break
        previous, begin = (d_gain, d_work), last
    springs = body.springs
    steps = np.diff(targets[1:, :springs], axis=0, append=targets[1:2, :springs])
    d_steps = np.diff(derivatives.targets[1:, :springs], axis=0, append=derivatives.targets[1:2, :springs])
    d_travel = np.einsum("ks,ksp->p", np.sign(steps), d_steps)
    force, weights = _force(cycle)
    d_force = np.zeros(d_gain.size)
    if weights is not None:
        d_force = np.einsum("kf,kfp->p", weights, derivatives.targets[1:])
    regime = Regime(
        gain, float(stretch.work.sum()), float(np.abs(steps).sum()), force, math.nan, math.nan, bool(repeats)
    )
    first = 1 + periods * count
    kinks = tuple((int(order[ramp - first]) - 1, place, contact) for ramp, place, contact in path.kinks)
    still = (d_steps * (steps == 0.0)[:, :, None] != 0.0).any(axis=(0, 1))
    one_sided = path.one_sided.copy()
    return RegimeDerivatives(regime, d_gain, d_work, d_travel, d_force, one_sided, still, kinks, settled)


def _vertices(targets: np.ndarray, order: np.ndarray, derivatives: Derivatives) -> Vertices:
    count, columns = order.size, len(derivatives.names)
    none = np.zeros((count, columns))
    return Vertices(np.arange(count), order, order, np.zeros(count), none, none, np.ascontiguousarray(targets[order]))
