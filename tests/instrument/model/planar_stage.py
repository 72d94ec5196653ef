"""Bodies of vector springs in the plane for tests of their engine: one implicit step, and ramps from rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from crawler_model.body.body import Body
from crawler_model.compiled import compiled
from crawler_model.motion.account import ACCOUNT_SIZE, VISITED
from crawler_model.motion.plane.frame import Frame, build_frame
from crawler_model.motion.plane.implicit_step import approach, solve_stage
from crawler_model.motion.plane.motion import PlaneMotion
from crawler_model.motion.plane.translation import choose_translation

from .cone_program import laplacian_of

DISC = np.zeros((0, 2))
CROSS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def body_of(ends, stiffness, n):
    """Build a body of vector springs between n contacts."""
    none, each = np.zeros(0, np.int64), np.ones(n)
    return Body(
        np.zeros((n, 2)),
        np.array(ends, np.int64).reshape(-1, 2),
        np.array(stiffness, float),
        each / n,
        each,
        none,
        none,
        (),
    )


def frame_of(ends, stiffness, n, directions=DISC) -> Frame:
    """Build the arrays of a body of vector springs between n contacts."""
    return build_frame(body_of(ends, stiffness, n), directions)


def command_of(directions, lengths, friction, loads=()):
    """Build a command of the kernels; friction has the shape (n, 1) for discs, else (n, m)."""
    friction = np.repeat(friction, 1 if len(directions) else 4, axis=1)
    return np.concatenate([np.ravel(part).astype(float) for part in (lengths, friction, loads)])


@compiled
def _solve(frame, command, base, v, force):
    solved, _ = solve_stage(frame, command, base, v, force, 0.0)
    solved = solved or approach(frame, command, base, v, force)
    return solved, choose_translation(frame, command, base, v, force)


class Step(NamedTuple):
    """An implicit step: springs, the force r at v = 0, and friction, shape (n, 1) for discs, else (n, m)."""

    ends: np.ndarray
    stiffness: np.ndarray
    force: np.ndarray
    friction: np.ndarray
    directions: np.ndarray = DISC

    @property
    def laplacian(self) -> csr_array:
        """K, shape (n, n)."""
        return laplacian_of(self.ends, self.stiffness, len(self.force))

    def search(self, guess=0.0):
        """Solve the step; return whether it was solved, v, and whether v is unique."""
        n = len(self.force)
        frame = frame_of(self.ends, self.stiffness, n, self.directions)
        command = command_of(self.directions, np.zeros((len(self.ends), 2)), self.friction, self.force)
        base, force, v = np.zeros((n, 2)), np.empty((n, 2)), np.full((n, 2), float(guess))
        solved, unique = _solve(frame, command, base, v, force)
        return solved, v, unique

    def solve(self, guess=0.0):
        """Solve the step to rounding; return v and whether it is unique."""
        solved, v, unique = self.search(guess)
        assert solved
        assert self.miss(v) <= 1e-13
        return v, unique

    def miss(self, v):
        """Compute how far f = r - K v is from the point of C_i nearest to f_i + K_ii v_i, relative to the terms of f."""
        laplacian = self.laplacian
        own = laplacian.diagonal()[:, None]
        force = self.force - laplacian @ v
        size = np.hypot(*self.force.T) + abs(laplacian) @ np.hypot(*v.T) + self.friction.max(1)
        return (np.hypot(*(force - self._nearest(force + own * v)).T) / np.where(size > 0.0, size, 1.0)).max()

    def _nearest(self, force):
        if not len(self.directions):
            strength = np.hypot(*force.T)[:, None]
            return force * np.minimum(1.0, self.friction / np.where(strength > 0.0, strength, 1.0))
        corner = self.corners()
        along = np.roll(corner, -1, 1) - corner
        square = (along**2).sum(2)
        part = ((force[:, None] - corner) * along).sum(2) / np.where(square > 0.0, square, 1.0)
        on_edge = corner + np.clip(part, 0.0, 1.0)[..., None] * along
        found = on_edge[np.arange(len(force)), ((on_edge - force[:, None]) ** 2).sum(2).argmin(1)]
        return np.where((force @ self.directions.T <= self.friction).all(1)[:, None], force, found)

    def corners(self):
        """Compute the corners of the polygons, shape (n, m, 2)."""
        pairs = np.stack((self.directions, np.roll(self.directions, -1, 0)), 1)
        edges = np.stack((self.friction, np.roll(self.friction, -1, 1)), 2)
        return np.linalg.solve(pairs, edges[..., None])[..., 0]

    def resistance(self, v):
        """Compute the friction against v, summed over the contacts."""
        if not len(self.directions):
            return float((self.friction[:, 0] * np.hypot(*v.T)).sum())
        return float((self.corners() * v[:, None]).sum(2).max(1).sum())

    def cost(self, v):
        """Compute what v minimises."""
        return 0.5 * np.sum(v * (self.laplacian @ v)) - np.sum(self.force * v) + self.resistance(v)


class Rig:
    """A body that begins at rest with L = 0, and follows ramps."""

    def __init__(self, friction, directions=DISC, ends=((0, 1), (1, 2), (2, 0)), stiffness=(1.0, 1.3, 0.8), place=0.0):
        self.base_friction = np.array(friction, float)
        self.ends, self.stiffness = np.array(ends), np.array(stiffness)
        n = len(self.base_friction)
        self.body = body_of(ends, stiffness, n)
        self.frame = build_frame(self.body, directions)
        at_rest = np.concatenate((np.zeros(2 * len(ends)), self.base_friction.ravel()))
        self.state = PlaneMotion(self.body, self.frame, 0.0).start(np.full((n, 2), place), at_rest)
        self.account = np.zeros(ACCOUNT_SIZE)

    def follow(self, lengths, tolerance=1e-6, friction=None):
        """Follow ramps to rest lengths, shape (V, S, 2), and to friction; return the records, the displacements first."""
        lengths = np.asarray(lengths, float)
        friction = self.base_friction if friction is None else np.array(friction, float)
        targets = np.hstack((lengths.reshape(len(lengths), -1), np.tile(friction.ravel(), (len(lengths), 1))))
        records = np.zeros((len(targets), 2 * self.state.x.size + self.frame.rest.size))
        self.account[:] = 0.0
        self.account[VISITED] = np.inf
        motion = PlaneMotion(self.body, self.frame, tolerance)
        assert not motion.follow(self.state, motion.scratch(), targets, False, 1_000_000_000, self.account, records)
        return records
