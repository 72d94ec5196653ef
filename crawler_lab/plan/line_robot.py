"""Paths of a body on a line from a measured state, with exact derivatives, under friction and loads by factors."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from crawler_model.crawler.budget import default_budget
from crawler_model.errors import CommandError
from crawler_model.motion.account import OVERSPENT, UNSOLVED, empty_account
from crawler_model.motion.follow import build_motion
from crawler_model.scene.scene import Scene

from ..derivative.parameters import Derivatives, collect_pieces
from ..derivative.tangent_path import TangentPath, Vertices

_SPREAD = 0.3
"""Standard deviation of friction factors before anything was seen [1]."""
_ALIKE = 0.1
"""The same of the difference of both: what changes friction one way mostly changes it the other way, too [1]."""
_LOAD = 0.03
"""The same of the load on a contact, as a part of its mean friction [1]; small, so that friction explains what both
would."""


@dataclass(frozen=True, eq=False)
class LineRobot:
    """A body on a line, and what friction factors and loads make of its bounds.

    Attributes:
        scene: its scene.
        base: the target in force at the start, loads left out, shape (S + 2 N,) [m, N].
        slope: loads of the scene, shape (N,) [N].
    """

    scene: Scene
    base: np.ndarray
    slope: np.ndarray
    frictions = 2
    remembers = 40

    @property
    def before(self) -> np.ndarray:
        """Rest lengths at the start of the scene, shape (S,) [m]."""
        return self.base[: self.springs]

    @property
    def scale(self) -> np.ndarray:
        """Lengths count as they are, shape (1,) [1]."""
        return np.ones(1)

    @property
    def contacts(self) -> int:
        """Number of contacts N."""
        return self.scene.body.contacts

    @property
    def springs(self) -> int:
        """Number of springs S, one for each link."""
        return self.scene.body.springs

    @property
    def nominal(self) -> np.ndarray:
        """Factors of forward and backward friction, 1, and additional loads, 0 N, shape (2 + N,)."""
        return np.append([1.0, 1.0], np.zeros(self.contacts))

    @functools.cached_property
    def prior(self) -> np.ndarray:
        """See `Robot`, shape (3 + N, 2 + N)."""
        friction = float(np.abs(self.bounds_by_factors[:, :2]).sum() / (2 * self.contacts))
        spread = np.concatenate(([_SPREAD, _SPREAD], np.full(self.contacts, _LOAD * friction)))
        alike = np.append([1.0, -1.0], np.zeros(self.contacts)) / _ALIKE
        return np.vstack((np.diag(1.0 / spread), alike))

    @functools.cached_property
    def motion(self) -> Any:
        """The motion of the body."""
        return build_motion(self.scene)

    @functools.cached_property
    def scratch(self) -> Any:
        """The memory in which it works."""
        return self.motion.scratch()

    @functools.cached_property
    def joints_by_contacts(self) -> np.ndarray:
        """Derivatives of the positions in joint_states with respect to displacements, shape (1 + J, N)."""
        body, unit = self.scene.body, np.eye(self.contacts)
        return np.vstack((unit[body.isolated[:1]], body.joint_sum(unit[body.ends[:, 1]] - unit[body.ends[:, 0]])))

    @functools.cached_property
    def contacts_by_joints(self) -> np.ndarray:
        """The inverse of it, shape (N, 1 + J)."""
        return np.linalg.pinv(self.joints_by_contacts)

    @functools.cached_property
    def bounds_by_factors(self) -> np.ndarray:
        """Derivatives of the bounds with respect to the factors, shape (2 N, 2 + N)."""
        n = self.contacts
        found = np.zeros((2 * n, 2 + n))
        forward, backward = self.base[self.springs :].reshape(2, n)
        found[:n, 0], found[n:, 1] = forward + self.slope, backward - self.slope
        found[:n, 2:], found[n:, 2:] = -np.eye(n), np.eye(n)
        return found

    def read(self, positions: np.ndarray) -> np.ndarray:
        """Compute displacements from the positions in joint_states, shape (N,) [m]."""
        return self.contacts_by_joints @ positions

    def locate(self, x: np.ndarray) -> np.ndarray:
        """Compute net translations from displacements, shape (..., 1) [m]."""
        return np.asarray(x @ self.scene.body.share)[..., None]

    def miss(self, place: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Compute by how much places differ from those wanted, shape (..., 1) [m]."""
        return place - wanted

    def begin(self, x: np.ndarray, before: np.ndarray, factors: np.ndarray) -> LineStart:
        """Place the body at rest at the start of paths, see `Robot`."""
        held = self.bounds_by_factors @ factors + np.concatenate((-self.slope, self.slope))
        state = self.motion.start(x, np.concatenate((before, held)))
        force = self.scene.body.spring_force(state.tension)
        target = np.concatenate((before, np.maximum(held, np.concatenate((force, -force)))))
        return LineStart(self, x, target, held, self.motion.start(x, target))

    def differentiate_factors(
        self, x: np.ndarray, before: np.ndarray, rows: np.ndarray, factors: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Follow a path with the exact derivatives of its displacements with respect to the factors, see `Robot`."""
        start = self.begin(x, before, factors)
        by = np.zeros((rows.shape[0] + 1, start.target.size, 2 + self.contacts))
        by[:, self.springs :] = self.bounds_by_factors
        by[0, self.springs :][start.target[self.springs :] != start.held] = 0.0
        return start.differentiate(rows, by)

    def describe(self, factors: np.ndarray) -> str:
        """Describe factors in a line."""
        forward, backward, *loads = factors.tolist()
        each = ", ".join(f"{load:.4f}" for load in np.round(loads, 4) + 0.0)
        return f"friction forward {forward:.3f}, backward {backward:.3f} of the scene's, loads {each} N"


@dataclass(frozen=True, eq=False)
class LineStart:
    """A body at rest, from which paths begin.

    Attributes:
        robot: the body.
        x: displacement, shape (N,) [m].
        target: the target in force, shape (S + 2 N,) [m, N].
        held: bounds from the first ramp on, shape (2 N,) [N].
        state: the state of its motion.
    """

    robot: LineRobot
    x: np.ndarray
    target: np.ndarray
    held: np.ndarray
    state: Any

    @property
    def before(self) -> np.ndarray:
        """Rest lengths in force, shape (S,) [m]."""
        return self.target[: self.robot.springs]

    def build_targets(self, rows: np.ndarray) -> np.ndarray:
        """Build targets of rest lengths that are reached one after another.

        Args:
            rows: the lengths, shape (V, S) [m].

        Returns:
            Shape (V, S + 2 N) [m, N].
        """
        return np.hstack((rows, np.tile(self.held, (rows.shape[0], 1))))

    def follow(self, rows: np.ndarray) -> np.ndarray:
        """Follow a path, see `Start`."""
        robot, n, account = self.robot, self.x.size, empty_account()
        records = np.empty((rows.shape[0], 2 * n + self.robot.springs))
        targets, budget = self.build_targets(rows), default_budget(robot.scene.body)
        robot.motion.follow(self.state.copy(), robot.scratch, targets, True, budget, account, records)
        if account[UNSOLVED] + account[OVERSPENT]:
            raise CommandError("a ramp is not followed exactly")
        return records[:, :n] + records[:, n : 2 * n]

    def differentiate_places(self, rows: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Follow a path with the exact derivatives of its places, see `Start`."""
        count = rows.shape[0]
        by = np.zeros((count + 1, self.target.size, count, moved.size))
        by[np.arange(1, count + 1)[:, None], moved, np.arange(count)[:, None], np.arange(moved.size)] = 1.0
        x, dx = self.differentiate(rows, by.reshape(count + 1, self.target.size, -1))
        return self.robot.locate(x), np.einsum("n,knp->kp", self.robot.scene.body.share, dx)[:, None]

    def differentiate(self, rows: np.ndarray, by: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Follow a path with the derivatives of its displacements, exact through stick and slip.

        Args:
            rows: rest lengths that are reached one after another, shape (V, S) [m].
            by: derivatives of the targets, that of the start first, with respect to P unknowns, shape (1 + V, S + 2 N,
                P).

        Returns:
            Displacement after each ramp, shape (V, N) [m], and its derivatives, shape (V, N, P).

        Raises:
            CommandError: if a ramp is not followed exactly.
        """
        body, count, unknowns = self.robot.scene.body, rows.shape[0], by.shape[2]
        nothing, still = np.zeros(unknowns), np.zeros((count + 1, unknowns))
        stiffness, pieces = np.zeros((body.springs, unknowns)), np.zeros((*collect_pieces(body).shape, unknowns))
        start = np.zeros((body.contacts, unknowns))
        derivatives = Derivatives(("",) * unknowns, nothing, stiffness, pieces, by, start, still, nothing)
        targets = np.vstack((self.target, self.build_targets(rows)))
        drive = SimpleNamespace(targets=targets)
        plan: Any = SimpleNamespace(body=body, ground=self.robot.scene.ground, drive=drive, start_displacement=self.x)
        at = np.arange(1, count + 1)
        vertices = Vertices(at, at, at, np.zeros(count), still[1:], still[1:], targets[1:])
        stretch = TangentPath(plan, derivatives).follow_vertices(vertices)
        return stretch.x + stretch.rest, stretch.dx


def build_line_robot(scene: Scene) -> LineRobot:
    """Build the robot of a scene.

    Args:
        scene: a body of contacts and links on a line, without memory, on ground that is the same everywhere.

    Returns:
        The robot.
    """
    first, n = scene.drive.targets[0], scene.body.contacts
    size = scene.body.springs + 2 * n
    return LineRobot(scene, first[:size].copy(), first[size:].copy() if first.size > size else np.zeros(n))
