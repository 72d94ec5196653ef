"""The path of springs and discs in the plane by another method: ordinary differential equations between events.

A contact i of the sliding set S moves along its spring force, v_i = lambda_i g_i with lambda_i > 0, and keeps
|g_i| = mu_i:

    sum_j in S  K_ij (g_i . g_j) lambda_j = g_i . b_i   for i in S,   b = B' k dL/ds

K is the Laplacian of the springs. A contact enters S when |g_i| reaches mu_i and leaves it when lambda_i reaches 0.
Between these events scipy's DOP853 integrates the positions: no step is implicit, and nothing is shared with our own
method.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from crawler_model import Scene
from crawler_model.body.body import Body

_ACCURACY = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-16, "max_step": 0.05}
_NEAR = 1e-9
"""Relative distance to a bound at which a contact is taken to be at it, and relative rate that is none."""


class Account(NamedTuple):
    """What certifies a path.

    Attributes:
        energy_residual: change of the energy, plus dissipation, minus work [J].
        violation: largest excess of a spring force over friction [N].
        work: sum of the amounts of the work in each quarter [J].
    """

    energy_residual: float
    violation: float
    work: float


def follow_sliding(scene: Scene, quarters: Sequence[np.ndarray]) -> tuple[np.ndarray, Account]:
    """Follow a scene of springs in the plane whose friction is isotropic and constant.

    Args:
        scene: the crawler.
        quarters: targets L and mu of the ramps of each quarter, flattened, shape (ramps, 2 S + N) each.

    Returns:
        x at the end of each quarter, shape (quarters, N, 2) [m], and the account.
    """
    body, springs = scene.body, 2 * scene.body.springs
    x, friction = np.array(scene.start_displacement), scene.drive.targets[0, springs:]
    command = scene.drive.targets[0, :springs].reshape(-1, 2)
    laplacian = np.zeros((body.contacts, body.contacts))
    for (tail, head), stiffness in zip(body.ends, body.stiffness, strict=True):
        laplacian[[tail, head, tail, head], [tail, head, head, tail]] += np.array([1, 1, -1, -1]) * stiffness
    found, residual, violation, work = [], 0.0, 0.0, 0.0
    for targets in quarters:
        before, supplied, lost = _energy(body, x, command), 0.0, 0.0
        for target in targets:
            ramp = _Ramp(body, laplacian, friction, command, target[:springs].reshape(-1, 2))
            x, done, dissipated = ramp.follow(x)
            command, supplied, lost = ramp.end, supplied + done, lost + dissipated
            excess = np.linalg.norm(_force(body, x, command), axis=1) - friction
            violation = max(violation, float(excess.max()))
        residual += _energy(body, x, command) - before + lost - supplied
        work += abs(supplied)
        found.append(x)
    return np.array(found), Account(residual, violation, work)


def _force(body: Body, x: np.ndarray, command: np.ndarray) -> np.ndarray:
    return body.spring_force(body.stiffness[:, None] * (body.elongation(x) - command))


def _energy(body: Body, x: np.ndarray, command: np.ndarray) -> float:
    return float(0.5 * body.stiffness @ ((body.elongation(x) - command) ** 2).sum(axis=1))


class _Ramp(NamedTuple):
    """A ramp of the command in s from 0 to 1."""

    body: Body
    laplacian: np.ndarray
    friction: np.ndarray
    start: np.ndarray
    end: np.ndarray

    def follow(self, x: np.ndarray) -> tuple[np.ndarray, float, float]:
        """Follow the ramp; return the displacements at its end, the work and the dissipation."""
        s, state = 0.0, np.concatenate((x.ravel(), (0.0, 0.0)))
        while s < 1.0:
            sliding = self._choose(self._forces(s, state))
            run = solve_ivp(self._rates(sliding), (s, 1.0), state, events=self._events(sliding), **_ACCURACY)
            s, state = float(run.t[-1]), run.y[:, -1]
        return state[:-2].reshape(x.shape), float(state[-2]), float(state[-1])

    def _forces(self, s: float, state: np.ndarray) -> np.ndarray:
        x = state[:-2].reshape(-1, 2)
        return _force(self.body, x, self.start + s * (self.end - self.start))

    def _solve(self, g: np.ndarray, sliding: np.ndarray) -> np.ndarray:
        """Solve for lambda of every contact, 0 where it sticks."""
        load = _force(self.body, np.zeros_like(g), self.end - self.start)
        factors, own = np.zeros(len(g)), g[sliding]
        matrix = self.laplacian[np.ix_(sliding, sliding)] * (own @ own.T)
        factors[sliding] = np.linalg.solve(matrix, (own * load[sliding]).sum(axis=1))
        return factors

    def _choose(self, g: np.ndarray) -> np.ndarray:
        """Choose the contacts that slide from here on, among those at their bounds."""
        size = np.linalg.norm(g, axis=1)
        bound = np.flatnonzero(size >= (1.0 - _NEAR) * self.friction)
        least = _NEAR * np.abs(self.end - self.start).max()
        for chosen in itertools.chain(*(itertools.combinations(bound, k) for k in range(bound.size + 1))):
            sliding = np.array(chosen, dtype=np.int64)
            factors = self._solve(g, sliding)
            load = _force(self.body, np.zeros_like(g), self.end - self.start)
            growth = (g * (load - self.laplacian @ (factors[:, None] * g))).sum(axis=1) / size.clip(1e-300)
            waiting = np.setdiff1d(bound, sliding)
            moves = (factors * size)[sliding]
            if (moves > least).all() and (growth[waiting] <= least * self.laplacian.max()).all():
                return sliding
        raise ArithmeticError("no set of contacts can slide")

    def _rates(self, sliding: np.ndarray) -> Callable[[float, np.ndarray], np.ndarray]:
        rate = self.end - self.start

        def rates(s: float, state: np.ndarray) -> np.ndarray:
            x = state[:-2].reshape(-1, 2)
            g = self._forces(s, state)
            moves = self._solve(g, sliding)[:, None] * g
            tension = self.body.stiffness[:, None] * (self.body.elongation(x) - self.start - s * rate)
            heat = self.friction @ np.linalg.norm(moves, axis=1)
            return np.concatenate((moves.ravel(), (-(tension * rate).sum(), heat)))

        return rates

    def _events(self, sliding: np.ndarray) -> list[Callable[[float, np.ndarray], float]]:
        """Functions of which one falls through 0 where the set of sliding contacts changes."""

        def start(contact: int) -> Callable[[float, np.ndarray], float]:
            return lambda s, state: float(self.friction[contact] - np.linalg.norm(self._forces(s, state)[contact]))

        def stop(contact: int) -> Callable[[float, np.ndarray], float]:
            return lambda s, state: float(self._solve(self._forces(s, state), sliding)[contact])

        events = [(stop if i in sliding else start)(i) for i in range(self.body.contacts)]
        for event in events:
            event.terminal, event.direction = True, -1.0  # type: ignore[attr-defined]
        return events
