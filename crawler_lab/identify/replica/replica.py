"""The motion of a scene under recorded commands, with exact derivatives with respect to its parameters.

Where all arrays of the scene are affine in the parameters, they are differentiated once and extrapolated; otherwise the
scene is assembled anew at every value.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.columns import Columns
from crawler_model.body.curves import BEGIN, END
from crawler_model.body.drive import NS, Drive
from crawler_model.errors import SceneError
from crawler_model.scene.scene import Scene

from ...derivative.parameters import Derivatives, differentiate_arrays
from ...sweep.keys import is_friction, key_steps, with_loads
from ...sweep.vary import Variations, vary
from ..measurements import MeasurementError, Measurements, observation
from .changes import Change, apply_changes
from .follow import begin_path, follow_times
from .knots import describe, find_distances
from .playback import replay_scene
from .start import find_moves, walk_in

_MOST_NUMBERS = 200_000_000
_AFFINE = 1e-12
_EVALUATION, _NUMBER = 4e-3, 5e-8
"""Time of an evaluation, and of each number of it, on an ordinary processor [s]."""
_EXCESS = 1e-9
"""Part of all forces by which one may be beyond its bound at the start."""
_CALLER = "identify"


@dataclass(frozen=True)
class Prediction:
    """What the model predicts for a recording.

    Attributes:
        values: shape (T, M) [m].
        jacobian: their derivatives with respect to the parameters, the gain and changes, shape (M, P + ..., T).
        velocity: their rates of change, shape (T, M) [m/s].
    """

    values: np.ndarray
    jacobian: np.ndarray
    velocity: np.ndarray


@dataclass(frozen=True)
class Slack:
    """Distances of forces from their bounds, and of bent springs from their knots.

    Attributes:
        time: shape (V,) [s].
        distance: of the force on each contact from its forward, then its backward bound [N]; of each bent spring from
            the next knots, see `knots` [m]; shape (V, C).
        derivative: of these bounds and knots with respect to the parameters, shape (V, C, P).
        events: what did not happen where a distance is positive, shape (C,).
    """

    time: np.ndarray
    distance: np.ndarray
    derivative: np.ndarray
    events: tuple[str, ...]


class Replica:
    """A recording, and the model that repeats it.

    Attributes:
        derivative_error: part by which derivatives may be wrong [1]; 0 for exact ones.
        start_values: the values of the parameters in the scene, shape (P,).
        weight: time that an evaluation takes, relative to that where all arrays of the scene are affine in the
            parameters and derivatives exact [1]; infinity where it takes long at any size.
        is_affine: whether all arrays of the scene are affine in the parameters, and springs are linear.
        limits: the parameters that move a limit, a stop or another knot of a spring.
        starts: number of unknown numbers of the start, see `start`; 0 if it is known.
        factors: by which the model's own values in the rows of recorded commands are multiplied, shape (K, C) [1]; None
            for 1.
    """

    derivative_error = 0.0
    is_affine = False
    _planned: tuple[bytes, tuple[Scene, Derivatives] | None] = b"", None
    starts = 0
    factors: np.ndarray | None = None

    def __init__(
        self,
        scene: Scene,
        measured: Measurements,
        keys: Sequence[str],
        caller: str = "identify",
        unknown_start: bool = False,
    ) -> None:
        """Prepare the model.

        Args:
            caller: name of the function, for error messages.
            unknown_start: whether the start of the scene, which is relaxed, is only a guess.

        Raises:
            SceneError: if a key is unknown or has no effect.
            MeasurementError: if the derivatives of the recording take too much memory.
        """
        self._prepare(scene, measured, keys, caller)
        numbers = (measured.time.size + measured.command_time.size) * self._base.body.contacts * len(keys)
        if numbers > _MOST_NUMBERS:
            raise MeasurementError(
                f"{measured.name}: {numbers:.1e} derivatives; at most {_MOST_NUMBERS:.0e}: keep fewer rows"
            )
        self._local = differentiate_arrays(self._base, self._keys, _CALLER)
        self.start_values = self._local.values
        self.limits: list[int] = np.flatnonzero(self._local.pieces[:, (BEGIN, END)].any(axis=(0, 1))).tolist()
        if self._is_recorded and not self._base.body.bends:
            far = self.start_values * 1.37 + 0.011 * (self.start_values == 0.0)
            with contextlib.suppress(SceneError):
                self.is_affine = _agree(self._local, differentiate_arrays(self._scene_at(far), self._keys, _CALLER))
        self.weight = 1.0 if self.is_affine else np.inf
        self._moves = find_moves(self._base) if unknown_start else None
        self.starts = 0 if self._moves is None else self._base.body.springs

    def _prepare(self, scene: Scene, measured: Measurements, keys: Sequence[str], caller: str) -> None:
        """Check the keys against the scene that plays the recording."""
        self.measured = measured
        self._keys = tuple(keys)
        self._base = replay_scene(with_loads(scene, keys), measured)
        for key in keys:
            if self._is_recorded and key.startswith("drive."):
                raise SceneError(f"{caller}: {key}: no effect, as the commands of {measured.name} replace the drive")
            changed = _columns_changed_by(key, self._base.columns)
            if changed and changed <= set(measured.command_names):
                raise SceneError(f"{caller}: {key}: no effect, as {measured.name} has commands of all that it changes")
        try:
            vary(self._base, {key: [0.0] for key in keys}, grid=False)  # checks the keys
        except SceneError as error:
            raise SceneError(str(error).replace("vary: ", f"{caller}: ").replace("; vary ", "; fit ")) from None
        self.observation = observation(self._base.body, measured.channels)

    def showing(self, measured: Measurements, factors: np.ndarray | None = None) -> Replica:
        """Build the replica of fewer rows of the recording, or of other commands.

        Args:
            measured: these rows, with all commands that matter for them.
            factors: by which the model's own values in the rows of commands are multiplied, shape (K, C) [1].

        Returns:
            A replica with the same model.
        """
        other = copy.copy(self)
        other.measured, other.factors, other._planned = measured, factors, (b"", None)
        return other

    @property
    def work(self) -> float:
        """Time of an evaluation on an ordinary processor, by the numbers that are computed [s]."""
        return _EVALUATION + _NUMBER * self._rows * self.body.contacts * (1 + self.start_values.size + self.starts)

    @property
    def _rows(self) -> int:
        return self.measured.time.size + max(self.measured.command_time.size, self._base.drive.times.size)

    @property
    def body(self) -> Body:
        """The body at the values of the scene."""
        return self._base.body

    def spread_friction(self, factors: np.ndarray) -> np.ndarray:
        """Spread factors of friction over the columns of commands.

        Args:
            factors: of each contact, both ways, shape (K, N) [1].

        Returns:
            Factors for `showing`, shape (K, C).
        """
        columns = self._base.columns
        found = np.ones((factors.shape[0], columns.count))
        found[:, columns.lengths : columns.lengths + columns.frictions] = np.tile(factors, 2)
        return found

    def motion_at(self, values: np.ndarray, start: np.ndarray | None = None) -> tuple[Scene, np.ndarray] | None:
        """Build the scene at some values, and its motion at the rows of the recording.

        Returns:
            The scene with the recorded drive and its start, and the displacement, shape (T, N) [m]; None if there is no
            motion.
        """
        plan = self._begin(self._plan(values), start)
        if plan is None:
            return None
        found = follow_times(*plan, self.measured.time, self._is_recorded)
        return None if found is None else (plan[0], found[0])

    def _scene_at(self, values: np.ndarray) -> Scene:
        columns = {key: np.array([value]) for key, value in zip(self._keys, values, strict=True)}
        return Variations(self._base, columns, (1,))[0]

    @property
    def _is_recorded(self) -> bool:
        return self.measured.command_names != ()

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
            changes: changes of the model whose first-order effects are computed, too.

        Returns:
            The prediction, with a column for each parameter, the gain, each change, and each number of the start. None
            if the values are not valid or the motion has too many events.
        """
        plan = self._plan(values)
        if plan is None:
            return None
        begun = self._begin(apply_changes(*plan, gain, with_gain, changes), start)
        found = None if begun is None else follow_times(*begun, self.measured.time - lag, self._is_recorded)
        if found is None:
            return None
        x, dx, velocity = found
        matrix, added = self.observation
        return Prediction(
            x @ matrix.T + added,
            dx if np.array_equal(matrix, np.eye(*matrix.shape)) else np.tensordot(matrix, dx, axes=1),
            velocity @ matrix.T,
        )

    def guess_start(self, offset: str) -> np.ndarray:
        """Guess the numbers of an unknown start.

        Args:
            offset: of the positions, as for `identify`.

        Returns:
            Those of relaxed springs, shape (S,) [m].
        """
        return np.zeros(self.starts)

    def balance(self, values: np.ndarray, time: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, ...] | None:
        """Compute forces and their bounds at given positions.

        Returns:
            The force of the springs on each contact, its forward and its backward bound, each of shape (T, N) [N]. None
            if the values are not valid.
        """
        plan = self._plan(values, with_derivatives=False)
        return None if plan is None else _find_balance(plan[0], time, x)

    def balance_slopes(
        self, values: np.ndarray, time: np.ndarray, x: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Differentiate forces and their bounds at given positions where all arrays are affine and have no factors.

        Returns:
            Derivatives of the forces with respect to the parameters, shape (T, N, P); of both bounds, shape (2, N, P);
            and of the forces with respect to each position, shape (N, N).
        """
        plan = self._plan(values)
        assert plan is not None
        scene, derivatives = plan
        body, springs, n = scene.body, scene.body.springs, scene.body.contacts
        lengths = scene.drive.sample(np.rint(np.maximum(time, 0.0) * NS).astype(np.int64))[:, :springs]
        stretch = body.elongation(x) - lengths
        columns = [body.spring_force(stretch * column) for column in derivatives.stiffness.T]
        d_force = np.stack(columns, axis=-1) if columns else np.zeros((*x.shape, 0))
        bounds = derivatives.targets[0, springs : springs + 2 * n].reshape(2, n, -1)
        return d_force, bounds, body.spring_force(body.stiffness * body.elongation(np.eye(n))).T

    def displacement_at_start(self, values: np.ndarray, start: np.ndarray | None = None) -> np.ndarray | None:
        """Compute the displacement at the start of the recording, of the scene where `start` is left out.

        Returns:
            Shape (N,) [m]; None if the values are not valid.
        """
        plan = self._begin(self._plan(values, with_derivatives=start is not None), start)
        return None if plan is None else plan[0].start_displacement

    def force_at_start(self, values: np.ndarray, start: np.ndarray) -> np.ndarray | None:
        """Compute the force of the springs on each contact at the start.

        Returns:
            Shape (N,) [N]; None if the values are not valid.
        """
        plan = self._begin(self._plan(values), start)
        if plan is None:
            return None
        return _find_balance(plan[0], np.zeros(1), plan[0].start_displacement[None])[0][0]

    def stretch(self, values: np.ndarray, x: np.ndarray) -> np.ndarray | None:
        """Compute the numbers of the start that belong to a displacement at the first command.

        Args:
            x: shape (N,) [m].

        Returns:
            Shape (S,) [m]; None if the values are not valid.
        """
        plan = self._plan(values, with_derivatives=False)
        if plan is None:
            return None
        body = plan[0].body
        relaxed = body.elongation(plan[0].start_displacement)
        return np.asarray(body.elongation(x) - relaxed)

    def slack(self, values: np.ndarray, start: np.ndarray | None = None) -> Slack | None:
        """Compute how far each force stayed from its bounds, and each bent spring from its knots.

        Returns:
            The distances at all rows of the recording and its commands; None if the values are not valid.
        """
        plan = self._begin(self._plan(values), start)
        if plan is None:
            return None
        scene, derivatives = plan
        body, measured = scene.body, self.measured
        times = np.concatenate((measured.time, measured.command_time[measured.command_time <= measured.time[-1]]))
        ticks = np.unique(np.rint(times[times > 0.0] * NS).astype(np.int64))
        path, vertices = begin_path(scene, derivatives, ticks, self._is_recorded)
        stretch = path.follow_vertices(vertices)
        springs, n = body.springs, body.contacts
        x = np.vstack((scene.start_displacement, stretch.x + stretch.rest))
        before = np.append(0, vertices.before)
        time = np.append(0, vertices.time_ns) / NS
        force, forward, backward = _find_balance(scene, time, x)
        ways, d_ways = find_distances(scene, derivatives, time, x)
        names = [body.name_of(i) for i in range(n)] * 2
        return Slack(
            time,
            np.hstack((forward - force, backward + force, ways)),
            np.hstack((derivatives.targets[before, springs : springs + 2 * n], d_ways))[..., : len(self._keys)],
            (*(f"{name} did not slide" for name in names), *describe(body)),
        )

    def ways(self, values: np.ndarray, time: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Compute how far bent springs are from their knots at given positions.

        Returns:
            As `knots.find_distances`; None if the values are not valid.
        """
        plan = self._plan(values)
        return None if plan is None else find_distances(*plan, time, x)

    def _begin(
        self, plan: tuple[Scene, Derivatives] | None, start: np.ndarray | None
    ) -> tuple[Scene, Derivatives] | None:
        """Let a plan begin with the numbers of an unknown start; None stays None, and so does a start that is known."""
        if plan is None or start is None or self._moves is None:
            return plan
        return walk_in(*plan, start, self._moves)

    def _plan(self, values: np.ndarray, with_derivatives: bool = True) -> tuple[Scene, Derivatives] | None:
        """Build the arrays at some values, and their derivatives there or elsewhere; None if they are not valid."""
        key = values.tobytes()
        if self._planned[0] != key:
            found = self._build_plan(values, with_derivatives or self.is_affine)
            if not with_derivatives and not self.is_affine:
                return found
            self._planned = key, found
        return self._planned[1]

    def _build_plan(self, values: np.ndarray, with_derivatives: bool) -> tuple[Scene, Derivatives] | None:
        local, base = self._local, self._base
        if not self.is_affine and not np.array_equal(values, local.values):
            try:
                base = self._scene_at(values)
                local = dataclasses.replace(local, values=values)
                if with_derivatives:
                    local = differentiate_arrays(base, self._keys, _CALLER)
            except SceneError:
                return None
        step = values - local.values
        body = dataclasses.replace(base.body, stiffness=base.body.stiffness + local.stiffness @ step)
        start = base.start_displacement + local.start @ step
        drive, local = self._drive(base, local, step, with_derivatives)
        if (body.stiffness <= 0.0).any() or not _is_admissible(body, drive, start):
            return None
        changed: Any = dataclasses.replace(base, body=body, drive=drive, start_displacement=start)
        return changed, local

    def _drive(
        self, base: Scene, local: Derivatives, step: np.ndarray, with_derivatives: bool
    ) -> tuple[Drive, Derivatives]:
        """Build the recorded commands with what the scene determines of them, and their derivatives."""
        if not self._is_recorded:
            return base.drive, local  # the step is zero
        columns, springs, n = base.columns, base.body.springs, base.body.contacts
        raw, d_raw = base.drive.targets[0] + local.targets[0] @ step, local.targets[0].copy()
        slope, d_slope = columns.slope_load, np.zeros((0, step.size))
        if slope is not None:
            fixed = np.array([key.startswith("loads") for key in self._keys])
            d_slope = np.where(fixed, 0.0, d_raw[-n:])
            slope = slope + d_slope @ step
            for part, load in ((raw, raw[-n:].copy()), (d_raw, d_raw[-n:].copy())):
                part[springs : springs + n] += load
                part[springs + n : springs + 2 * n] -= load
            raw[-n:] -= slope
            d_raw[-n:] -= d_slope
        row, d_row = columns.gather(raw), columns.gather(d_raw)
        commanded = [columns.names.index(name) for name in self.measured.command_names]
        factors = np.ones((1, row.size)) if self.factors is None else self.factors
        rows = np.tile(row, (self.measured.command_time.size, 1)) * factors
        rows[:, commanded] = self.measured.commands
        d_row[commanded] = 0.0
        d_target = np.ascontiguousarray(columns.spread(d_row.T * factors[:, None]).transpose(0, 2, 1))
        if slope is not None:
            d_target[:, -n:] += d_slope
            d_target[:, springs : springs + n] -= d_target[:, -n:]
            d_target[:, springs + n : springs + 2 * n] += d_target[:, -n:]
        drive = Drive(self.measured.command_time, None, rows, dataclasses.replace(columns, slope_load=slope))
        if not with_derivatives:
            return drive, local
        count = rows.shape[0]
        # the same for all rows, and not copied; else writable, or kernels would be compiled again
        targets = np.broadcast_to(d_target, (count, *d_target.shape[1:])) if self.factors is None else d_target
        none = np.broadcast_to(0.0, (count, step.size))
        return drive, dataclasses.replace(local, targets=targets, times=none, period=np.zeros(step.size))


def _is_admissible(body: Body, drive: Drive, start: np.ndarray) -> bool:
    """Determine whether the start is in equilibrium, no friction is negative, and friction holds all loads."""
    columns, target, n = drive.columns, drive.targets[0], body.contacts
    frictions = slice(columns.lengths, columns.lengths + columns.frictions)
    if (drive.rows[:, frictions] < 0.0).any():
        return False
    if columns.slope_load is not None and columns.lacks_equilibrium(drive.targets).any():
        return False
    force = body.spring_force(body.tension(body.elongation(start), target[: body.springs]))
    forward, backward = target[body.springs :][:n], target[body.springs + n :][:n]
    size = _EXCESS * (np.abs(force).max() + np.abs(forward).max() + np.abs(backward).max())
    return bool((force <= forward + size).all() and (force >= -backward - size).all())


def _find_balance(scene: Scene, time: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute forces and their forward and backward bounds at given times and positions, each of shape (T, N) [N]."""
    body, n = scene.body, scene.body.contacts
    targets = scene.drive.sample(np.rint(np.maximum(time, 0.0) * NS).astype(np.int64))
    lengths, forward, backward, _ = np.split(targets, body.springs + n * np.arange(3), axis=1)
    return body.spring_force(body.tension(body.elongation(x), lengths)), forward, backward


def _columns_changed_by(key: str, columns: Columns) -> set[str]:
    """List the columns of friction or loads that a key of these changes, or more of them; empty for other keys."""
    steps, loads = key_steps(key), columns.lengths + columns.frictions
    if steps[0] == "loads":
        return set(columns.names[loads:])
    if not is_friction(steps):
        return set()
    frictions = set(columns.names[columns.lengths : loads])
    return {name for name in frictions if name.rpartition("/")[2] in steps} or frictions


def _agree(one: Derivatives, other: Derivatives) -> bool:
    """Determine whether derivatives at two places are the same, so that the arrays are affine."""
    for name in ("stiffness", "targets", "start", "times", "period"):
        a, b = getattr(one, name), getattr(other, name)
        if np.abs(a - b).max(initial=0.0) > _AFFINE * (1.0 + np.abs(a).max(initial=0.0)):
            return False
    return True
