"""Recordings of scenes without exact derivatives: the model is run, and its derivatives are differences of runs.

This holds in the plane, for bodies that turn, on patches of ground, and for bodies with hysteresis or backlash.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.crawler.crawler import Crawler
from crawler_model.errors import CommandError, SceneError
from crawler_model.run.screw import largest_distance
from crawler_model.scene.scene import Scene

from ...sweep.vary import Variations
from ...sweep.workers import available_cores
from ..measurements import Measurements
from .changes import Change, apply_gain
from .playback import playback
from .replica import Prediction, Replica
from .start import find_moves

_TOLERANCE = 1e-5
"""Of runs in the plane, far below the differences of runs."""
_STEPS = {1: 2.0**-18, 2: 2.0**-14}
"""Step of the differences by the dimension of the body, relative to the value of the parameter [1]. Runs of bodies that
do not turn are exact, or nearly so, and small steps seldom meet a crease or a jump."""
_STEP_OF_TURNING = 2.0**-10
"""Step for bodies that turn, whose runs differ by their tolerance."""
_JUMP = 2.0**8
"""A difference that is so many times the other side's and the usual one is a jump within the step, no derivative."""
_TICK = {1: 1e-6, 2: 1e-5}
"""Time that a run takes on an ordinary processor for each tick and contact, by the dimension of the body [s]."""
_RUN = 3.0
"""How many times as long as one with exact derivatives a run takes at least [1]."""
_SMALLEST = 2.0**-4
"""Values are taken to be of this size at least."""


class SampledReplica(Replica):
    """A recording, and the model that repeats it, differentiated by central differences."""

    derivative_error = 1e-3

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
        """
        self._prepare(scene, measured, keys, caller)
        self._base = playback(scene, measured)
        if scene.dimension == 2:
            tolerance = min(scene.tolerance or _TOLERANCE, _TOLERANCE)
            self._base = Scene.model_validate(self._base.document() | {"tolerance": tolerance})
        varied = Variations(self._base, {key: np.zeros(1) for key in keys}, (1,))
        self.start_values = np.array([varied.origin(key) for key in keys])
        self._moves = find_moves(self._base) if unknown_start else None
        self.starts = 0 if self._moves is None else self._base.body.springs + 1
        self.weight = _RUN * (1 + 2 * (len(keys) + self.starts))
        self._step = _STEPS[scene.dimension] if scene.body.turning is None else _STEP_OF_TURNING
        self.limits = []  # they are not examined here

    @property
    def work(self) -> float:
        """Time of an evaluation on an ordinary processor, by the ticks of its runs [s]."""
        ticks = self._rows * self.body.contacts * (1 + 2 * (self.start_values.size + self.starts))
        return _TICK[self.body.dimension] * ticks

    def _plan(self, values: np.ndarray, with_derivatives: bool = True) -> None:
        """Build nothing: neither how far forces stay from their bounds nor changes of the model are examined here."""

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
            The prediction, with a column for each parameter, the gain, and each number of the start. None if no motion
            exists at the values.
        """
        at = np.rint(np.maximum(self.measured.time - lag, 0.0) * NS).astype(np.int64)
        none, first = np.zeros(0), values.size + with_gain
        point = np.concatenate((values, [gain] if with_gain else none, none if start is None else start))
        sizes = np.ones(point.size)
        sizes[: values.size] = np.maximum(np.abs(values), _SMALLEST * np.abs(self.start_values))
        sizes[first:] = largest_distance(self.body)
        steps = self._step * np.where(sizes > 0.0, sizes, 1.0)
        moves = [(p, side * steps[p]) for p in range(point.size) for side in (1.0, -1.0)]

        def run(move: tuple[int, float] | None) -> tuple[np.ndarray, np.ndarray] | None:
            moved = point.copy()
            if move is not None:
                moved[move[0]] += move[1]
            begun = None if start is None else moved[first:]
            return self._run(moved[: values.size], moved[values.size] if with_gain else gain, at, begun)

        with ThreadPoolExecutor(available_cores()) as pool:
            middle, *sides = pool.map(run, [None, *moves])
        if middle is None:
            return None
        x, velocity = middle
        jacobian = np.zeros((x.shape[1], point.size, x.shape[0]))
        for p in range(point.size):
            ends = [(move[1], side[0]) for move, side in zip(moves, sides, strict=True) if move[0] == p and side]
            rates = [(then - x) / step for step, then in ends]
            if rates:  # of both sides, or of one alone
                jacobian[:, p] = _combine(rates[0], rates[-1]).T
        return Prediction(x, jacobian, velocity)

    def guess_start(self, offset: str) -> np.ndarray:
        """Guess how far rest lengths are from the first command at an unknown start, and where the body stands.

        Args:
            offset: of the positions, as for `identify`. If channels have none of their own, the first row tells the
                start, unless values are missing; of a frame only the differences of positions count.

        Returns:
            Shape (S + 1,) [m]; 0 for relaxed springs where the scene starts.
        """
        found, (matrix, added) = np.zeros(self.starts), self.observation
        if self._moves is None or offset == "each":
            return found
        moved = self.measured.values[0] - added - matrix @ self._base.start_displacement
        if not np.isfinite(moved).all():
            return found
        each = np.linalg.lstsq(np.column_stack((matrix @ self._moves, matrix.sum(axis=1))), moved)
        if each[2] == self.starts:
            found[:] = each[0]
            found[-1] *= offset == "none"
        return found

    def displacement_at_start(self, values: np.ndarray, start: np.ndarray | None = None) -> np.ndarray | None:
        """Compute the displacement at the start of the recording, of the scene where `start` is left out.

        Returns:
            Shape (N,), in the plane (N, 2) [m]; None if the values are not valid.
        """
        scene = self._begun_at(values, 0.0, start)
        return None if scene is None else scene.start_displacement

    def _run(
        self, values: np.ndarray, gain: float, at: np.ndarray, start: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray] | None:
        """Compute what is measured at some times [ns], and its rates, each of shape (T, M); None without a motion."""
        scene = self._begun_at(values, gain, start)
        if scene is None:
            return None
        begin = scene.start_displacement
        x, time = np.empty((1, begin.size)), np.zeros(1, np.int64)
        x[0] = begin.ravel()
        if at[-1] > 0:
            crawler = Crawler(scene)
            ends, targets, *_ = scene.drive.ramps_between(0, np.unique(at[at > 0]))
            records = np.empty((ends.size, 2 * begin.size + crawler.tension.size))
            try:
                crawler.follow(targets, records)
            except CommandError:
                return None
            x, time = np.vstack((x, records[:, : begin.size])), np.append(time, ends)
        rate = np.vstack((np.zeros(begin.size), np.diff(x, axis=0) / (np.diff(time) / NS)[:, None]))
        matrix, added = self.observation
        rows = np.searchsorted(time, at)
        return x[rows] @ matrix.T + added, rate[rows] @ matrix.T

    def _begun_at(self, values: np.ndarray, gain: float, start: np.ndarray | None) -> Any:
        """Build the scene with its start; None if there is none at these values."""
        try:
            scene: Any = self._scene_at(values)
        except SceneError:
            return None
        if gain:
            scene = apply_gain(scene, gain)
        return scene if start is None else self._walk_in(scene, start)

    def _walk_in(self, scene: Any, start: np.ndarray) -> Any:
        """Let a body whose springs are relaxed somewhere, not beyond a wall, walk to the first command.

        Returns:
            The scene with this start; None if the motion has too many events.
        """
        body, walls, first = scene.body, scene.ground.track.walls, scene.drive.targets[0]
        far, begin = self._moves @ start[:-1] + start[-1], first.copy()
        if walls is not None:
            ahead, behind = walls.find_rooms(body.position, scene.start_displacement + far)
            far += np.minimum(ahead, 0.0) - np.minimum(behind, 0.0)
        x = scene.start_displacement + far
        begin[: body.springs] += body.elongation(far)
        crawler = Crawler(scene).placed(x, begin)
        try:
            crawler.follow(first[None])
        except CommandError:
            return None
        return dataclasses.replace(scene, start_displacement=crawler.displacement)


def _combine(ahead: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """Combine the differences of both sides to derivatives, of one side alone where the other one met a jump."""
    near, far = np.minimum(np.abs(ahead), np.abs(behind)), np.maximum(np.abs(ahead), np.abs(behind))
    usual = float(np.median(far[far > 0.0])) if far.any() else 0.0
    smaller = np.where(np.abs(ahead) <= np.abs(behind), ahead, behind)
    return np.where(far > _JUMP * np.maximum(near, usual), smaller, 0.5 * (ahead + behind))
