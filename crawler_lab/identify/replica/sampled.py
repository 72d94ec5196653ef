"""Recordings of scenes without exact derivatives: the model is run, and its derivatives are differences of runs.

This holds in the plane, for bodies that turn, on patches of ground, and for bodies with hysteresis or backlash.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.crawler.crawler import Crawler
from crawler_model.errors import CommandError, SceneError
from crawler_model.scene.scene import Scene

from ...sweep.vary import Variations
from ...sweep.workers import available_cores
from ..measurements import Measurements
from .changes import Change, apply_gain
from .playback import playback
from .replica import Prediction, Replica

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
            unknown_start: has no effect; the start is the scene's.

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
        self.weight = _RUN * (1 + 2 * len(keys))
        self._step = _STEPS[scene.dimension] if scene.body.turning is None else _STEP_OF_TURNING
        self.limits = []  # they are not examined here

    @property
    def work(self) -> float:
        """Time of an evaluation on an ordinary processor, by the ticks of its runs [s]."""
        ticks = self._rows * self.body.contacts * (1 + 2 * self.start_values.size)
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
            The prediction, with a column for each parameter, and the gain. None if no motion exists at the values.
        """
        at = np.rint(np.maximum(self.measured.time - lag, 0.0) * NS).astype(np.int64)
        count = values.size + with_gain
        sizes = np.append(np.maximum(np.abs(values), _SMALLEST * np.abs(self.start_values)), 1.0)
        steps = self._step * np.where(sizes > 0.0, sizes, 1.0)
        moves = [(p, side * steps[p]) for p in range(count) for side in (1.0, -1.0)]

        def run(move: tuple[int, float] | None) -> tuple[np.ndarray, np.ndarray] | None:
            moved, more = values.copy(), 0.0
            if move is not None and move[0] < values.size:
                moved[move[0]] += move[1]
            elif move is not None:
                more = move[1]
            return self._run(moved, gain + more, at)

        with ThreadPoolExecutor(available_cores()) as pool:
            middle, *sides = pool.map(run, [None, *moves])
        if middle is None:
            return None
        x, velocity = middle
        jacobian = np.zeros((x.shape[1], count, x.shape[0]))
        for p in range(count):
            ends = [(move[1], side[0]) for move, side in zip(moves, sides, strict=True) if move[0] == p and side]
            rates = [(then - x) / step for step, then in ends]
            if rates:  # of both sides, or of one alone
                jacobian[:, p] = _combine(rates[0], rates[-1]).T
        return Prediction(x, jacobian, velocity)

    def _run(self, values: np.ndarray, gain: float, at: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
        """Compute what is measured at some times [ns], and its rates, each of shape (T, M); None without a motion."""
        try:
            scene: Any = self.scene_at(values)
        except SceneError:
            return None
        if gain:
            scene = apply_gain(scene, gain)
        start = scene.start_displacement
        x, time = np.empty((1, start.size)), np.zeros(1, np.int64)
        x[0] = start.ravel()
        if at[-1] > 0:
            crawler = Crawler(scene)
            ends, targets, *_ = scene.drive.ramps_between(0, np.unique(at[at > 0]))
            records = np.empty((ends.size, 2 * start.size + crawler.tension.size))
            try:
                crawler.follow(targets, records)
            except CommandError:
                return None
            x, time = np.vstack((x, records[:, : start.size])), np.append(time, ends)
        rate = np.vstack((np.zeros(start.size), np.diff(x, axis=0) / (np.diff(time) / NS)[:, None]))
        matrix, added = self.observation
        rows = np.searchsorted(time, at)
        return x[rows] @ matrix.T + added, rate[rows] @ matrix.T


def _combine(ahead: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """Combine the differences of both sides to derivatives, of one side alone where the other one met a jump."""
    near, far = np.minimum(np.abs(ahead), np.abs(behind)), np.maximum(np.abs(ahead), np.abs(behind))
    usual = float(np.median(far[far > 0.0])) if far.any() else 0.0
    smaller = np.where(np.abs(ahead) <= np.abs(behind), ahead, behind)
    return np.where(far > _JUMP * np.maximum(near, usual), smaller, 0.5 * (ahead + behind))
