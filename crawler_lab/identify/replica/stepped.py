"""Recordings of chains with masses, dampers or viscous friction, stepped through time.

The theta method of Moreau and Jean with theta = 1/2: in each step, the velocities v at its end solve

    m (v - v0) = h (F - K (x + h (v0 + v) / 4) - C (v0 + v) / 2 - s),

where the friction s is at its bound against v, or within its bounds where v = 0. Without masses v0 is 0, and v / 2 the
mean velocity of the step: the midpoint rule.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.compiled import entry

from ..measurements import interpolate_rows
from .changes import Change, apply_gain
from .replica import Prediction, Replica

_STEP = 2e-3
"""Step [s]."""
_DIFFERENCE = 1e-3
"""Step of the differences, relative to values."""
_SWEEPS, _SETTLED = 100, 1e-9
_TERM, _USUAL = 1e-9, 10
"""Time of a term of a step on an ordinary processor [s], and the usual number of sweeps of a step."""


class Dynamics(NamedTuple):
    """What the model lacks.

    Attributes:
        mass: of each contact [kg]; if it is 0, there must be drag or viscosity.
        drag: of dampers along each link [N s/m].
        viscosity: of each contact [N s/m].
    """

    mass: float
    drag: float = 0.0
    viscosity: float = 0.0


class SteppedReplica(Replica):
    """A recording of a chain of linear springs, and its dynamics, differentiated by differences."""

    derivative_error = 1e-4
    dynamics: Dynamics
    derivatives: bool

    @staticmethod
    def of(replica: Replica, dynamics: Dynamics, derivatives: bool) -> SteppedReplica:
        """Add dynamics to a replica.

        Args:
            replica: the recording.
            dynamics: what its model lacks.
            derivatives: whether predictions have derivatives, else zeros.

        Returns:
            A replica of the same recording.
        """
        other = object.__new__(SteppedReplica)
        other.__dict__.update(replica.__dict__)
        other.dynamics, other.derivatives = dynamics, derivatives
        return other

    @property
    def work(self) -> float:
        """Time of an evaluation on an ordinary processor, by the terms of its steps [s]."""
        runs = 1 + (self.start_values.size + self.starts) * self.derivatives
        steps = float(self.measured.time[-1]) / _STEP
        return super().work + _TERM * _USUAL * steps * self.body.contacts**2 * runs

    def predict(
        self,
        values: np.ndarray,
        lag: float = 0.0,
        gain: float = 0.0,
        with_gain: bool = False,
        changes: Sequence[Change] = (),
        start: np.ndarray | None = None,
    ) -> Prediction | None:
        """Follow the recorded commands.

        Args:
            changes: none.

        Returns:
            The prediction, with a column for each parameter, the gain, and each number of the start. None if the values
            are not valid.
        """
        none = np.zeros(0)
        begun = none if start is None else start
        point = np.concatenate((values, [gain] if with_gain else none, begun))
        length = max(float(np.abs(self.measured.commands).max()), 1e-12)
        sizes = np.concatenate((np.abs(values) + (values == 0.0), np.ones(int(with_gain)), np.full(begun.size, length)))
        x = self._step(point, gain, with_gain, start is not None, lag)
        if x is None:
            return None
        jacobian = np.zeros((x.shape[1], point.size, x.shape[0]))
        for p, size in enumerate(_DIFFERENCE * sizes if self.derivatives else ()):
            moved = point.copy()
            moved[p] += size
            then = self._step(moved, gain, with_gain, start is not None, lag)
            if then is not None:
                jacobian[:, p] = ((then - x) / size).T
        matrix, added = self.observation
        velocity = np.gradient(x, self.measured.time, axis=0)
        return Prediction(x @ matrix.T + added, np.tensordot(matrix, jacobian, axes=1), velocity @ matrix.T)

    def _step(self, point: np.ndarray, gain: float, with_gain: bool, starts: bool, lag: float) -> np.ndarray | None:
        """Compute the displacements at the rows of the recording, shape (T, N); None if the values are not valid."""
        count = self.start_values.size
        plan = self._plan(point[:count], with_derivatives=starts)
        plan = self._begin(plan, point[count + with_gain :] if starts else None)
        if plan is None:
            return None
        scene = apply_gain(plan[0], point[count] if with_gain else gain)
        body, at = scene.body, self.measured.time - lag
        steps = int(np.ceil(max(float(at[-1]), _STEP) / _STEP))
        times = np.linspace(0.0, steps * _STEP, steps + 1)
        targets = scene.drive.sample(np.rint(times * NS).astype(np.int64))
        incidence = np.zeros((body.springs, body.contacts))
        incidence[np.arange(body.springs), body.ends[:, 0]] -= 1.0
        incidence[np.arange(body.springs), body.ends[:, 1]] += 1.0
        force = (targets[:, : body.springs] * body.stiffness) @ incidence
        mass, drag, viscosity = self.dynamics
        spring = incidence.T @ (body.stiffness[:, None] * incidence)
        viscous = drag * incidence.T @ incidence + viscosity * np.eye(body.contacts)
        path, speed, right = np.zeros((steps + 1, body.contacts)), *np.zeros((2, body.contacts))
        path[0] = scene.start_displacement
        bounds = np.ascontiguousarray(targets[:, body.springs : body.springs + 2 * body.contacts])
        follow_dynamics(path, speed, right, mass, spring, viscous, force, bounds)
        return interpolate_rows(at, times, path)


@entry
def follow_dynamics(path, v, right, mass, spring, viscous, force, bounds):  # type: ignore[no-untyped-def]
    """Step a body through time.

    Args:
        path: displacements, of which the first is given, shape (K, N) [m].
        v: speeds at the start, then at the end, shape (N,) [m/s]; without a mass twice the mean ones of the last step.
        right: room, shape (N,).
        mass: of each contact, 0 for none [kg].
        spring: stiffness matrix, shape (N, N) [N/m].
        viscous: damping matrix, shape (N, N) [N s/m].
        force: of the commands on the contacts, shape (K, N) [N].
        bounds: friction forward, then backward, shape (K, 2 N) [N].
    """
    n, h = v.size, _STEP
    for k in range(path.shape[0] - 1):
        if mass == 0.0:
            v[:] = 0.0
        for i in range(n):
            total = 0.5 * (force[k, i] + force[k + 1, i])
            for j in range(n):
                total -= spring[i, j] * (path[k, j] + 0.25 * h * v[j]) + 0.5 * viscous[i, j] * v[j]
            right[i] = mass * v[i] + h * total
            path[k + 1, i] = path[k, i] + 0.5 * h * v[i]
        for _sweep in range(_SWEEPS):  # Gauss and Seidel; masses and diagonals dominate
            change = 0.0
            for i in range(n):
                rest = right[i]
                for j in range(n):
                    if j != i:
                        rest -= (0.5 * h * viscous[i, j] + 0.25 * h * h * spring[i, j]) * v[j]
                ahead, behind = rest - h * bounds[k + 1, i], rest + h * bounds[k + 1, n + i]
                new = (max(ahead, 0.0) + min(behind, 0.0)) / (
                    mass + 0.5 * h * viscous[i, i] + 0.25 * h * h * spring[i, i]
                )
                change = max(change, abs(new - v[i]))
                v[i] = new
            if change < _SETTLED:
                break
        for i in range(n):
            path[k + 1, i] += 0.5 * h * v[i]
