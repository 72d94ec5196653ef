"""The periodic regime of a candidate: gain, work and travel of a period, and their derivatives."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.body.body import Body
from crawler_model.crawler.budget import default_budget
from crawler_model.motion.account import OVERSPENT, UNSOLVED, WORK, empty_account
from crawler_model.motion.follow import build_motion
from crawler_model.motion.pieces import FROM, HEADER, RAMP, UNTIL, follow_pieces
from crawler_model.run.repeats import determining_tension, tensions_repeat
from crawler_model.scene.assembly import Assembly

from ..derivative.parameters import Derivatives
from ..derivative.tangent_path import TangentPath, Vertices
from .unknowns import Cycle

_REPEATS, _REPEATS_EXACTLY = 1e-8, 1e-10
"""Part of the forces at its weaker contact within which a tension is taken to repeat; for derivatives and peaks the
second number counts."""
_PERIODS = (3, 10, 32, 100, 316)
"""Periods after which candidates are measured, if their tensions repeat; the others are run again, for longer."""
_MOST_PERIODS = _PERIODS[-1]
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
        settled: whether the tensions repeat, in the plane whether little is left of the transient.
        motion: in the plane dx and dy [m], for a body that turns in its own frame and with dyaw [rad]; None on a line.
    """

    gain: float
    work: float
    travel: float
    force: float
    peak: float
    speed: float
    settled: bool
    motion: tuple[float, ...] | None = None


def find_regimes(cycles: Cycle) -> list[Regime | None]:
    """Run candidates until their tensions repeat, and measure the next period.

    Args:
        cycles: M candidates built together.

    Returns:
        Their regimes, with NaN for the peak; None where a ramp has too many events to be followed exactly.
    """
    plan = cycles.plan
    targets, count = plan.drive.targets, plan.drive.targets.shape[0]
    found: list[Regime | None] = [None] * count
    travel, speed, force = _travel(cycles)
    left = np.arange(count)
    for periods in _PERIODS:
        if not left.size:
            break
        run = _run_each if plan.body.bends else _run
        gain, work, settled, lost = run(plan, targets, left, periods)
        for k, m in enumerate(left):
            if not lost[k]:
                found[m] = Regime(
                    float(gain[k]),
                    float(work[k]),
                    float(travel[m]),
                    float(force[m]),
                    math.nan,
                    float(speed[m]),
                    bool(settled[k]),
                )
        left = left[~(settled | lost)]
    return found


def _run_each(
    plan: Assembly, targets: np.ndarray, lanes: np.ndarray, periods: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Run candidates with bent springs one by one, as `_run`."""
    found = []
    for m in lanes:
        body = dataclasses.replace(plan.body, stiffness=plan.body.stiffness[m])
        motion: Any = build_motion(dataclasses.replace(plan, body=body))
        scratch, budget, n = motion.scratch(), default_budget(body), body.contacts
        state = motion.start(plan.start_displacement[m], targets[m, 0])
        account = empty_account()
        period = np.ascontiguousarray(np.vstack((targets[m, 2:], targets[m, 1:2])))
        transient = np.vstack((targets[m, 1:2], np.tile(period, (periods, 1))))
        motion.follow(
            state, scratch, transient, True, budget, account, np.empty((len(transient), 2 * n + body.springs))
        )
        tension, begin = determining_tension(body, state), state.copy()
        work, energy = account[WORK], body.energy(state.tension, state.displacement, state.actuation)
        records = np.empty((len(period), 2 * n + body.springs))
        motion.follow(state, scratch, period, True, budget, account, records)
        stored = body.energy(state.tension, state.displacement, state.actuation) - energy
        moved = (state.contacts["x"] - begin.contacts["x"]) + (state.contacts["residue"] - begin.contacts["residue"])
        repeats = tensions_repeat(body, period, determining_tension(body, state), tension, _REPEATS)
        lost = account[OVERSPENT] + account[UNSOLVED] > 0.0
        found.append((moved @ body.share, account[WORK] - work - stored, bool(repeats), lost))
    gain, work, settled, lost = zip(*found, strict=True)
    return np.array(gain), np.array(work), np.array(settled), np.array(lost)


def _run(
    plan: Assembly, targets: np.ndarray, lanes: np.ndarray, periods: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Run candidates for some periods and one more: its gain and work, whether it settled, whether it was lost."""
    body = dataclasses.replace(plan.body, stiffness=np.ascontiguousarray(plan.body.stiffness[lanes]))
    targets = targets[lanes]
    motion: Any = build_motion(dataclasses.replace(plan, body=body))
    state = motion.start(np.ascontiguousarray(plan.start_displacement[lanes]), targets[:, 0])
    count, n = targets.shape[1] - 1, body.contacts
    rows = np.concatenate(([1], np.tile(np.append(np.arange(2, count + 1), 1), periods + 1)))
    legs = np.array([0, rows.size - count, rows.size])
    accounts = empty_account(lanes.size)
    spent = np.empty((lanes.size, 2, 2))
    records = np.empty((lanes.size, rows.size, 2 * n + body.springs))
    motion.follow_many(state, motion.scratch(), targets, rows, legs, default_budget(body), accounts, spent, records)
    end, begin = records[:, -1], records[:, -1 - count]
    tension, before = end[:, 2 * n :], begin[:, 2 * n :]
    settled = tensions_repeat(body, targets, tension, before, _REPEATS)
    gain = ((end[:, :n] - begin[:, :n]) + (end[:, n : 2 * n] - begin[:, n : 2 * n])) @ body.share
    stored = 0.5 * ((tension**2 - before**2) / body.stiffness).sum(axis=1)
    lost = (accounts[:, OVERSPENT] + accounts[:, UNSOLVED]) > 0.0
    return gain, spent[:, 1, 0] - spent[:, 0, 0] - stored, settled, lost


def _travel(cycles: Cycle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute the travel, the fastest change of a rest length, and the force of candidates."""
    plan = cycles.plan
    body, n = plan.body, plan.body.contacts
    lengths = plan.drive.targets[:, 1:, : body.springs]
    change = np.abs(np.diff(lengths, axis=1, append=lengths[:, :1]))
    joints = np.moveaxis(body.joint_sum(np.moveaxis(change, -1, 0)), 0, -1)
    speed = (joints / np.roll(cycles.seconds, -1)[:, None]).max(axis=(1, 2), initial=0.0)
    weight = plan.ground.weight.sum(axis=-1)
    friction = plan.drive.targets[:, 1:, body.springs : body.springs + 2 * n].sum(axis=2)
    force = np.where(weight > 0.0, weight, 0.5 * friction @ cycles.share)
    return change.sum(axis=(1, 2)), speed, force


def find_peak(cycle: Cycle) -> float:
    """Find the largest tension in a period, which is at the end of a linear piece.

    Returns:
        The tension [N], of the period after the last one of a run as long as the longest.
    """
    plan = cycle.plan
    body, targets, n = plan.body, plan.drive.targets, plan.body.contacts
    motion: Any = build_motion(plan)
    scratch, budget = motion.scratch(), default_budget(body)
    state = motion.start(plan.start_displacement, targets[0])
    account = empty_account()
    period = np.ascontiguousarray(np.vstack((targets[2:], targets[1:2])))
    ends = np.empty((period.shape[0], 2 * n + body.springs))
    motion.follow(state, scratch, targets[1:2].copy(), True, budget, account, ends[:1])
    last = np.full(body.springs, math.inf)
    for _ in range(_MOST_PERIODS):
        tension = determining_tension(body, state)
        if tensions_repeat(body, period, tension, last, _REPEATS_EXACTLY):
            break
        last = tension
        motion.follow(state, scratch, period, True, budget, account, ends)
    begin = state.copy()
    met = follow_pieces(motion, state, scratch, period, budget, account, ends)
    ramps = met[:, RAMP].astype(np.int64)
    steps = np.diff(np.vstack((begin.actuation, period[:, : body.springs])), axis=0)
    velocity = met[:, HEADER : HEADER + n]
    if body.bends:
        return _find_peak_of_bends(body, begin, met, period, ends)
    rate = body.stiffness * (velocity[:, body.ends[:, 1]] - velocity[:, body.ends[:, 0]] - steps[ramps])
    starts = np.vstack((begin.tension, ends[:, 2 * n :]))
    inside = rate * (met[:, UNTIL] - met[:, FROM])[:, None]
    paths = [starts[ramp] + np.cumsum(inside[ramps == ramp], axis=0) for ramp in np.unique(ramps)]
    return max(float(np.abs(path).max(initial=0.0)) for path in (starts, *paths))


def _find_peak_of_bends(body: Body, begin: Any, met: np.ndarray, period: np.ndarray, ends: np.ndarray) -> float:
    """Find the largest tension at the ends of the pieces of a period, from the lengths of the springs."""
    n, ramps = body.contacts, met[:, RAMP].astype(np.int64)
    starts = np.vstack((begin.contacts["x"] + begin.contacts["residue"], ends[:, :n] + ends[:, n : 2 * n]))
    lengths = np.vstack((begin.actuation, period[:, : body.springs]))
    tension = [body.tension(body.elongation(starts), lengths)]
    for ramp in np.unique(ramps):
        of_ramp = met[ramps == ramp]
        moved = np.cumsum(of_ramp[:, HEADER : HEADER + n] * (of_ramp[:, UNTIL] - of_ramp[:, FROM])[:, None], axis=0)
        command = lengths[ramp] + of_ramp[:, UNTIL, None] * (lengths[ramp + 1] - lengths[ramp])
        tension.append(body.tension(body.elongation(starts[ramp] + moved), command))
    return max(float(np.abs(part).max(initial=0.0)) for part in tension)


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
    """

    regime: Regime
    gain: np.ndarray
    work: np.ndarray
    travel: np.ndarray
    force: np.ndarray
    one_sided: np.ndarray
    travel_one_sided: np.ndarray
    kinks: tuple[tuple[int, float, int], ...]


def differentiate_regime(cycle: Cycle, derivatives: Derivatives) -> RegimeDerivatives:
    """Carry derivatives along a candidate until they repeat.

    Args:
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
    path.follow_vertices(_vertices(targets, np.array([1]), derivatives))
    order = np.append(np.arange(2, count + 1), 1)
    vertices = _vertices(targets, order, derivatives)
    previous: tuple[np.ndarray, np.ndarray] | None = None
    begin_dx, begin = path.dx, None
    settled = False
    periods = -1
    while periods < _MOST_PERIODS and not settled:
        periods += 1
        tension = path.state
        path.one_sided[:] = False
        path.kinks.clear()
        stretch = path.follow_vertices(vertices)
        d_gain, d_work = share @ (stretch.dx[-1] - begin_dx), stretch.d_work.sum(axis=0)
        begin_dx, last = stretch.dx[-1], (stretch.x[-1], stretch.rest[-1])
        gain = 0.0 if begin is None else float(share @ ((last[0] - begin[0]) + (last[1] - begin[1])))
        repeats = tensions_repeat(body, targets[1:], path.state, tension, _REPEATS_EXACTLY)
        if previous is not None and repeats:
            size = np.abs(d_gain).max(initial=1e-300), np.abs(d_work).max(initial=1e-300)
            settled = bool(
                np.abs(d_gain - previous[0]).max(initial=0.0) <= _DERIVATIVE_REPEATS * size[0]
                and np.abs(d_work - previous[1]).max(initial=0.0) <= _DERIVATIVE_REPEATS * size[1]
            )
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
    return RegimeDerivatives(regime, d_gain, d_work, d_travel, d_force, path.one_sided.copy(), still, kinks)


def _vertices(targets: np.ndarray, order: np.ndarray, derivatives: Derivatives) -> Vertices:
    count, columns = order.size, len(derivatives.names)
    none = np.zeros((count, columns))
    return Vertices(np.arange(count), order, order, np.zeros(count), none, none, np.ascontiguousarray(targets[order]))
