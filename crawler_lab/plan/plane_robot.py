"""Bodies that turn, from a measured pose and shape, with derivatives by differences of runs.

The exact derivatives of `crawler_lab/derivative` take 30 times as long for a plan.
"""

from __future__ import annotations

import dataclasses
import functools
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model.body.turning import SIDES, forward_angles, load_of_friction, measure_angles, wrap
from crawler_model.body.turning_tree import TurningTree
from crawler_model.crawler.budget import default_budget
from crawler_model.motion.account import empty_account
from crawler_model.motion.follow import build_motion
from crawler_model.scene.scene import Scene

_STEP = 3e-3
"""Step of differences: part of the range of the drive; and of factors [1]."""
_TOLERANCE = 3e-5
"""Tolerance of paths, relative to half the length of the body [1]."""
_SPREAD, _LOAD = 0.3, 0.03
"""Standard deviations before anything was seen: of the factor of friction [1], and of the load on a point, as a part of
its mean friction [1]."""


@dataclass(frozen=True, eq=False)
class PlaneRobot:
    """A body that turns; its factors are one of all friction, and a load, x and y, on each point.

    Attributes:
        scene: its scene.
        base: the target in force at the start, with loads, shape (J + 6 N,) [m, rad, N].
    """

    scene: Scene
    base: np.ndarray
    frictions = 1
    remembers = 12

    @property
    def before(self) -> np.ndarray:
        """Rest lengths and angles at the start of the scene, shape (J,) [m, rad]."""
        return self.base[: self.scene.body.lengths]

    @property
    def nominal(self) -> np.ndarray:
        """A factor of friction, 1, and an additional load on each point, 0 N, shape (3,)."""
        return np.array([1.0, 0.0, 0.0])

    @functools.cached_property
    def prior(self) -> np.ndarray:
        """See `Robot`, shape (3, 3)."""
        load = _LOAD * float(self.base[self._friction].mean())
        return np.diag([1.0 / _SPREAD, 1.0 / load, 1.0 / load])

    @functools.cached_property
    def scale(self) -> np.ndarray:
        """An error of the yaw counts for the way of a point half the largest distance away, shape (3,) [1, m/rad]."""
        way = self.scene.body.position[:, None] - self.scene.body.position
        return np.array([1.0, 1.0, 0.5 * float(np.hypot(*np.moveaxis(way, -1, 0)).max())])

    @functools.cached_property
    def motion(self) -> Any:
        """The motion of the body, only as accurate as plans need it."""
        motion: Any = build_motion(self.scene)
        return dataclasses.replace(motion, tolerance=max(motion.tolerance, _TOLERANCE * float(self.scale[2])))

    @functools.cached_property
    def scratch(self) -> Any:
        """The memory in which it works."""
        return self.motion.scratch()

    @functools.cached_property
    def steps(self) -> np.ndarray:
        """Steps of the differences of each rest length and angle, shape (J,) [m, rad]."""
        span = np.ptp(self.scene.drive.rows[:, : self.before.size], axis=0)
        return _STEP * np.where(span > 0.0, span, span.max(initial=0.0) or 1.0)

    @functools.cached_property
    def _tree(self) -> TurningTree:
        return TurningTree(self.scene.body)

    @property
    def _friction(self) -> slice:
        first = self.scene.body.lengths
        return slice(first, first + len(SIDES) * self.scene.body.contacts)

    def read(self, positions: np.ndarray) -> np.ndarray:
        """Compute displacements from the positions in joint_states, shape (N, 2) [m]."""
        body, end = self.scene.body, 3 + self.before.size
        free = np.append(positions[2], positions[end:])
        places = self._tree.find_places(body.position[0] + positions[:2], positions[3:end], free)
        return np.asarray(places - body.position)

    def locate(self, x: np.ndarray) -> np.ndarray:
        """Compute net translations and yaws from displacements, shape (..., 3) [m, rad]."""
        body = self.scene.body
        assert body.turning is not None
        yaw = measure_angles(body.position + x, body.turning.heading[None])
        return np.concatenate((np.einsum("n,...nc->...c", body.share, x), yaw), axis=-1)

    def miss(self, place: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Compute by how much places differ from those wanted, shape (..., 3) [m, rad]."""
        found = place - wanted
        found[..., 2] = wrap(found[..., 2])
        return found

    def begin(self, x: np.ndarray, before: np.ndarray, factors: np.ndarray) -> PlaneStart:
        """Place the body at rest at the start of paths, see `Robot`."""
        held = np.concatenate((before, self.base[before.size :]))
        held[self._friction] *= factors[0]
        held[self._friction.stop :].reshape(-1, 2)[:] += factors[1:]
        state, body = self.motion.start(x, held), self.scene.body
        assert body.turning is not None
        angle = forward_angles(body.turning, body.position + x)
        excess = load_of_friction(state.force + state.loads, angle, state.held)
        excess = np.where(np.isfinite(excess), np.maximum(excess, 1.0), 1.0)
        if (excess > 1.0).any():
            proven = held.copy()
            proven[self._friction].reshape(-1, len(SIDES))[:] *= excess[:, None]
            state = self.motion.start(x, proven)
        return PlaneStart(self, x, before, held, state)

    def differentiate_factors(
        self, x: np.ndarray, before: np.ndarray, rows: np.ndarray, factors: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Follow a path with the derivatives of its displacements with respect to the factors, see `Robot`."""
        here = self.begin(x, before, factors).follow(rows)
        steps = _STEP / np.diag(self.prior)
        there = [self.begin(x, before, factors + step).follow(rows) for step in np.diag(steps)]
        return here, np.stack([(each - here) / step for each, step in zip(there, steps, strict=True)], axis=-1)

    def describe(self, factors: np.ndarray) -> str:
        """Describe factors in a line."""
        friction, *load = factors.tolist()
        both = ", ".join(f"{each:.4f}" for each in np.round(load, 4) + 0.0)
        return f"friction {friction:.3f} of the scene's, load {both} N on each point"


@dataclass(frozen=True, eq=False)
class PlaneStart:
    """A body that turns at rest, from which paths begin.

    Attributes:
        robot: the body.
        x: displacement, shape (N, 2) [m].
        before: rest lengths and angles in force, shape (J,) [m, rad].
        held: the target in force from the first ramp on, but for rest lengths and angles, shape (J + 6 N,) [N].
        state: the state of its motion.
    """

    robot: PlaneRobot
    x: np.ndarray
    before: np.ndarray
    held: np.ndarray
    state: Any

    def follow(self, rows: np.ndarray) -> np.ndarray:
        """Follow a path, through the jumps that it may have, see `Start`."""
        return self._follow(self.state.copy(), rows)

    def _follow(self, state: Any, rows: np.ndarray) -> np.ndarray:
        robot, size = self.robot, self.x.size
        targets = np.tile(self.held, (rows.shape[0], 1))
        targets[:, : self.before.size] = rows
        records = np.empty((rows.shape[0], 2 * size + self.before.size))
        budget = default_budget(robot.scene.body)
        robot.motion.follow(state, robot.scratch, targets, True, budget, empty_account(), records)
        return np.asarray((records[:, :size] + records[:, size : 2 * size]).reshape(-1, *self.x.shape))

    def differentiate_places(self, rows: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Follow a path with the derivatives of its places by differences of runs, see `Start`."""
        robot, count = self.robot, rows.shape[0]
        state, states, x = self.state.copy(), [], []
        for k in range(count):
            states.append(state.copy())
            x.append(self._follow(state, rows[k : k + 1])[0])
        here = robot.locate(np.array(x))
        slope = np.zeros((*here.shape, count, moved.size))
        for k in range(count):
            for m, j in enumerate(moved.tolist()):
                changed = rows[k:].copy()
                changed[0, j] += robot.steps[j]
                there = robot.locate(self._follow(states[k].copy(), changed))
                slope[k:, :, k, m] = robot.miss(there, here[k:]) / robot.steps[j]
        return here, slope.reshape(*here.shape, -1)


def build_plane_robot(scene: Scene) -> PlaneRobot:
    """Build the robot of a scene.

    Args:
        scene: a body that turns.

    Returns:
        The robot.
    """
    base = scene.drive.targets[0]
    size = scene.body.lengths + (len(SIDES) + 2) * scene.body.contacts
    return PlaneRobot(scene, np.concatenate((base, np.zeros(size - base.size))))
