"""Trials of faults: fits of the numbers of a suspect together with all parameters, on few rows.

Motion on which a suspect depends is first the measured one, then that of the fit before, so that nothing of the
measurements helps in the end.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from crawler_model.scene.scene import Scene

from ..fit.fit import Fit, fit_from
from ..fit.problem import Problem, Residuals
from ..fit.starts import generate_starts
from ..replica.replica import Replica
from ..replica.start import begin_recordings
from ..replica.stepped import Dynamics, SteppedReplica
from .faults import Changed, Fault, find_stain, is_inside, list_faults
from .seen import Seen, move, see_motion

_DIFFERENCE = 1e-3
"""Step of differences, relative to the size of a number."""
_EVALUATIONS, _FEW, _STARTS, _ROUNDS = 14, 5, 2, 2
_HOPELESS = 0.9
"""Part of the sum of squares above which a fit that is left after few evaluations ends."""
_NOISE, _ENOUGH = 1.1, 0.95
"""Mean square, in units of the noise, and part of the misfit explained, after which no other suspect is tried."""
_SPARSE = 4
"""Each row of so many finer commands is taken where forces are only balanced."""
_PROMISING = 0.8
"""Part of the sum of squares below which motion is replaced by that of the model."""
_BINS, _EVALUATIONS_OF_BINS = 16, 10
"""Parts of the way whose friction is fitted to find a stain."""
_LEAST, _MOST = 0.1, 4.0
"""Factors of friction between which it is found."""
_FITS = 1.5
"""Mean square, in units of the noise, of rows that the model fits."""
_FIRST, _HALVINGS = 0.2, 5
"""Part of a recording that the model must fit to fail later, and steps to find when."""
_LONGEST = 0.1
"""Work of an evaluation that steps through time from which it takes too long [s]."""
Prepare = Callable[[Problem], None]


class Tried(NamedTuple):
    """What a trial leaves.

    Attributes:
        left: mean square of the residuals in units of the noise, with a penalty for each number [1].
        part: what it takes of the mean square beyond noise [1].
        amount: first number of the suspect, in its unit [any].
        what: the suspect, in words.
    """

    left: float
    part: float
    amount: float
    what: str


def rate(base: float, left: float, amount: float, what: str) -> Tried:
    """Compare a trial with the model as it is.

    Args:
        base: mean square without the suspect, in units of the noise [1].
        left: with it [1].
        amount: first number of the suspect, in its unit [any].
        what: the suspect, in words.

    Returns:
        The result.
    """
    return Tried(left, min((base - left) / max(base - 1.0, 0.1 * base), 1.0), amount, what)


def explains(tried: Tried) -> bool:
    """Determine whether a trial leaves only noise.

    Args:
        tried: the trial.

    Returns:
        Whether no other suspect needs to be tried.
    """
    return tried.part > _ENOUGH and tried.left < _NOISE


class FaultProblem(Problem):
    """A problem whose last unknowns are the numbers of a suspect, in units of their largest guess.

    Attributes:
        plain: number of the other unknowns.
    """

    def __init__(self, problem: Problem, replicas: Sequence[Replica], seen: Sequence[Seen]) -> None:
        """Prepare the problem without a suspect.

        Args:
            problem: that was fitted.
            replicas: of the recordings with finer commands.
            seen: what they show.
        """
        rows = [np.ones(one.measured.time.size, np.bool_) for one in seen]
        super().__init__(replicas, rows, problem.space, problem.offset, problem.sensor)
        self.plain, self._bare, self._seen = self.count, self.replicas, tuple(seen)
        self.work = problem.work
        self._fault: Fault | None = None
        self._scale = np.zeros(0)

    def suspect(self, fault: Fault, seen: Sequence[Seen]) -> None:
        """Choose the suspect, and the motion on which it depends.

        Args:
            fault: the suspect.
            seen: what the recordings show.
        """
        scale = np.max(np.abs(fault.guesses), axis=0)
        self._fault, self._seen, self._scale = fault, tuple(seen), np.where(scale > 0.0, scale, 1.0)
        self._last, self.count = None, self.plain + scale.size

    def begin(self, unknowns: np.ndarray, guess: Sequence[float] | np.ndarray) -> np.ndarray:
        """Build a start.

        Args:
            unknowns: of any problem with the same parameters, shape (U,).
            guess: numbers of the suspect.

        Returns:
            Shape (U,).
        """
        return np.append(unknowns[: self.plain], np.array(guess) / self._scale)

    def balance(self, unknowns: np.ndarray, guess: Sequence[float]) -> np.ndarray | None:
        """Build a start from the balance of forces on few of the finer commands.

        Args:
            unknowns: of any problem with the same parameters, shape (U,).
            guess: numbers of the suspect.

        Returns:
            Shape (U,); None where measurements do not determine it.
        """
        self._apply(self.begin(unknowns, guess), False)
        fewer = []
        for replica in self.replicas:
            measured, few = replica.measured, slice(None, None, _SPARSE)
            measured = dataclasses.replace(
                measured, command_time=measured.command_time[few], commands=measured.commands[few]
            )
            fewer.append(replica.showing(measured))
        self.replicas = tuple(fewer)
        found = next(generate_starts(self, np.random.default_rng(0)))
        return None if found[0] != "balance" or found[1] is None else self.begin(found[1], guess)

    def numbers(self, unknowns: np.ndarray) -> np.ndarray:
        """Read the numbers of the suspect.

        Args:
            unknowns: shape (U,).

        Returns:
            In the units of their guesses.
        """
        return np.asarray(unknowns[self.plain :] * self._scale)

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of all unknowns, each of shape (U,)."""
        low, high = super().bounds
        if self._fault is not None:
            low[self.plain :], high[self.plain :] = self._fault.low / self._scale, self._fault.high / self._scale
        return low, high

    def cost(self, unknowns: np.ndarray) -> float:
        """Compute the sum of squares without derivatives.

        Args:
            unknowns: shape (U,).

        Returns:
            The sum; infinite without a motion [1].
        """
        self._apply(unknowns, False)
        now = super()._compute(unknowns)
        return np.inf if now is None else now.cost

    def follow(self, unknowns: np.ndarray) -> list[Seen] | None:
        """Compute what the recordings would show if all were as it is fitted.

        Args:
            unknowns: shape (U,).

        Returns:
            The motion of the model; None if there is none.
        """
        self._apply(unknowns, False)
        values, found = self.space.to_values(unknowns[: self.space.origin.size]), []
        for i, (replica, seen) in enumerate(zip(self.replicas, self._seen, strict=True)):
            at = replica.measured.command_time
            shown = replica.showing(dataclasses.replace(replica.measured, time=at), replica.factors)
            moved = shown.motion_at(values, self.start(unknowns, i))
            if moved is None:
                return None
            found.append(move(seen, replica.body, at, replica.body.position + moved[1]))
        return found

    def _compute(self, unknowns: np.ndarray) -> Residuals | None:
        self._apply(unknowns, True)
        now = super()._compute(unknowns)
        for place in range(self.plain, self.count) if now is not None else ():
            moved = unknowns.copy()
            moved[place] += _DIFFERENCE
            self._apply(moved, False)
            then = super()._compute(moved)
            if now is not None and then is not None:
                now.jacobian[:, place] = (then.fitted - now.fitted) / _DIFFERENCE
        return now

    def _apply(self, unknowns: np.ndarray, derivatives: bool) -> None:
        """Let the replicas follow what the suspect changes."""
        if self._fault is None:
            return
        found: list[Replica] = []
        for replica, seen in zip(self._bare, self._seen, strict=True):
            changed, measured = self._fault.change(seen, *self.numbers(unknowns)), seen.measured
            if changed.commands is not None:
                at = measured.command_time if changed.command_time is None else changed.command_time
                measured = dataclasses.replace(measured, commands=changed.commands, command_time=at)
            if changed.values is not None:
                measured = dataclasses.replace(measured, values=changed.values)
            factors = None if changed.friction is None else replica.spread_friction(changed.friction)
            shown = replica.showing(measured, factors)
            dynamics = changed.dynamics
            found.append(shown if dynamics is None else SteppedReplica.of(shown, dynamics, derivatives))
        self.replicas = tuple(found)


def try_faults(
    scene: Scene, problem: Problem, fit: Fit, rows: Sequence[np.ndarray], prepare: Prepare, until: float
) -> tuple[list[Tried], bool]:
    """Try all faults.

    Args:
        scene: the scene that was fitted.
        problem: the problem.
        fit: its end.
        rows: indices of the rows that are compared, of each recording with fitted rows.
        prepare: sets the noise of a problem.
        until: work after which no other fault is tried [s].

    Returns:
        What each leaves, and whether all were tried: none is for bodies other than chains without segments, on ground
        that differs from place to place, or with commands of some links only.
    """
    begun = _begin(scene, problem, fit, rows)
    if begun is None:
        return [], False
    trial, seen, plain = begun
    prepare(trial)
    base = fit_from(trial, fit.unknowns, np.zeros(trial.count, np.bool_), tight=True, most=40)
    if base is None:
        return [], False
    onset, ahead = _find_onset(problem, plain, base.unknowns, prepare)
    starts = [base.unknowns, trial.unknowns(problem.space.origin), *([] if ahead is None else [ahead])]
    cheap = all(SteppedReplica.of(one, Dynamics(1.0), True).work < _LONGEST for one in plain)
    found: list[Tried] = []
    size = base.residuals.fitted.size
    for fault, begins in _list_all(trial, seen, onset, cheap, starts):
        if any(map(explains, found)) and not fault.imitates:
            break
        if trial.work.done > until:
            return found, False
        ended = _fit_fault(trial, fault, seen, begins, base.cost)
        if ended is not None:
            numbers = trial.numbers(ended.unknowns)
            left = (ended.cost + numbers.size * np.log(size)) / size
            found.append(rate(base.cost / size, left, float(numbers[0]), fault.what(*numbers)))
    return found, cheap


def are_faults_possible(scene: Scene) -> bool:
    """Determine whether a scene is of the kind whose faults are tried.

    Args:
        scene: the scene.

    Returns:
        Whether it is a chain with exact derivatives, without segments, on even ground.
    """
    body = scene.body
    even = scene.has_exact_derivatives and scene.ground.track is None
    return bool(even and not body.segments and scene.columns.links == body.springs)


def _begin(
    scene: Scene, problem: Problem, fit: Fit, rows: Sequence[np.ndarray]
) -> tuple[FaultProblem, list[Seen], list[Replica]] | None:
    """Build the problem with finer commands, what its recordings show, and their plain replicas."""
    keys = list(problem.space.names)
    if not are_faults_possible(scene):
        return None
    fitted = [i for i, one in enumerate(problem.rows) if one.any()]
    seen = [see_motion(problem, fit, i, kept) for i, kept in zip(fitted, rows, strict=True)]
    known = [one for one in seen if one is not None]
    if len(known) < len(seen):
        return None
    begun, unknown = begin_recordings(scene, keys, [one.measured for one in known])
    replicas = [Replica(begun, one.measured, keys, "identify", unknown) for one in known]
    plain = []
    for i, one in zip(fitted, known, strict=True):
        own = problem.replicas[i].measured
        plain.append(
            problem.replicas[i].showing(dataclasses.replace(own, time=one.measured.time, values=one.measured.values))
        )
    return FaultProblem(problem, replicas, known), known, plain


def _list_all(
    trial: FaultProblem, seen: Sequence[Seen], onset: float | None, cheap: bool, starts: list[np.ndarray]
) -> Iterator[tuple[Fault, list[np.ndarray]]]:
    """List the faults with starts of their fits."""
    *most, last = list_faults(seen, onset, cheap)
    yield from ((fault, starts) for fault in most)
    low, high = min(float(one.place.min()) for one in seen), max(float(one.place.max()) for one in seen)
    edges = np.linspace(low, high, _BINS + 1)
    profile = Fault(
        str,
        lambda s, *more: Changed(
            friction=1.0 + sum(m * is_inside(s, *at) for m, *at in zip(more, edges[:-1], edges[1:], strict=True))
        ),
        [[1.0] * _BINS],
        [_LEAST - 1.0] * _BINS,
        [_MOST - 1.0] * _BINS,
    )
    trial.suspect(profile, seen)
    begin = trial.begin(starts[-1] if onset is not None else starts[0], np.zeros(_BINS))
    found = fit_from(trial, begin, np.zeros(trial.count, np.bool_), tight=False, most=_EVALUATIONS_OF_BINS)
    if found is not None:
        factors = 1.0 + trial.numbers(found.unknowns)
        weight = np.linalg.norm(found.residuals.jacobian[:, -_BINS:], axis=0)
        yield find_stain(edges, factors, weight), [found.unknowns[: trial.plain], *starts]
    yield last, starts


def _fit_fault(
    trial: FaultProblem, fault: Fault, seen: Sequence[Seen], begins: Sequence[np.ndarray], base: float
) -> Fit | None:
    """Fit the numbers of a suspect and all parameters from the best starts; None if no motion exists there."""
    trial.suspect(fault, seen)
    held = np.zeros(trial.count, np.bool_)
    starts = [trial.begin(one, guess) for guess in fault.guesses for one in begins]
    if fault.balanced:
        starts += [one for guess in fault.guesses if (one := trial.balance(begins[0], guess)) is not None]
    order = sorted((cost, k) for k, one in enumerate(starts) if np.isfinite(cost := trial.cost(one)))
    ends = [fit_from(trial, starts[k], held, tight=False, most=_FEW) for _, k in order[:_STARTS]]
    best = min((one for one in ends if one is not None), key=lambda one: one.cost, default=None)
    if best is None or best.cost > _HOPELESS * base:
        return best
    best = fit_from(trial, best.unknowns, held, tight=False, most=_EVALUATIONS - _FEW)
    for _ in range(_ROUNDS if fault.moves else 0):
        own = trial.follow(best.unknowns) if best is not None and best.cost < _PROMISING * base else None
        if best is None or own is None:
            break
        trial.suspect(fault, own)
        best = fit_from(trial, best.unknowns, held, tight=False, most=_EVALUATIONS)
    return best


def _find_onset(
    problem: Problem, replicas: Sequence[Replica], unknowns: np.ndarray, prepare: Prepare
) -> tuple[float | None, np.ndarray | None]:
    """Find until when the model fits, and the unknowns of that part; None if it does not fit the first part [s]."""

    def attempt(until: float) -> Fit | None:
        rows = [replica.measured.time <= until for replica in replicas]
        part = Problem(replicas, rows, problem.space, problem.offset, problem.sensor)
        part.work = problem.work
        prepare(part)
        balanced = next(generate_starts(part, np.random.default_rng(0)))[1]
        begins = [unknowns, part.unknowns(problem.space.origin), *([] if balanced is None else [balanced])]
        costs = sorted((now.cost, k) for k, one in enumerate(begins) if (now := part.compute(one)) is not None)
        for _, k in costs[:_STARTS]:
            found = fit_from(part, begins[k], np.zeros(part.count, np.bool_), tight=False, most=_EVALUATIONS)
            if found is not None and found.cost < _FITS * found.residuals.fitted.size:
                return found
        return None

    high = max(float(replica.measured.time[-1]) for replica in replicas)
    low = _FIRST * high
    best = attempt(low)
    for _ in range(_HALVINGS if best is not None else 0):
        middle = 0.5 * (low + high)
        found = attempt(middle)
        low, high, best = (low, middle, best) if found is None else (middle, high, found)
    return (None, None) if best is None else (low, best.unknowns)
