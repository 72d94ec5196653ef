"""An independent way to follow ramps in the plane: no implicit steps, but rates from non-negative least squares.

Forces at the boundary of a friction set give normals; the rates of sliding along them are a problem of least squares
that scipy solves. With polygons they are constant between events, on discs they are integrated by DOP853, which also
locates starts and stops.
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import nnls

CLOSE = 1e-10


def least_speeds(matrix, goal, rise):
    """Minimise |matrix speed - goal|^2 + 2 rise . speed over speed >= 0."""
    shift = np.linalg.lstsq(matrix.T, rise, rcond=None)[0]
    if np.abs(matrix.T @ shift - rise).max() <= 1e-9 * np.abs(rise).max():
        return nnls(matrix, goal - shift)[0]
    # some speeds together stretch no link, so only the growth of the bounds decides on them: try every active set
    for count in range(len(rise) + 1):
        for moving in map(list, itertools.combinations(range(len(rise)), count)):
            speed = np.zeros(len(rise))
            part = matrix[:, moving]
            speed[moving] = np.linalg.lstsq(part.T @ part, part.T @ goal - rise[moving], rcond=None)[0]
            slope = matrix.T @ (matrix @ speed - goal) + rise
            small = 1e-9 * (np.abs(matrix.T @ goal).max() + np.abs(rise).max())
            if (speed >= 0.0).all() and (slope >= -small).all() and (np.abs(slope[moving]) <= small).all():
                return speed
    raise RuntimeError("no active set")


class Reference:
    """A body at rest at L = 0; friction of shape (n, 1) on discs, (n, m) with directions."""

    def __init__(self, ends, stiffness, friction, directions=None):
        self.friction, self.directions = np.array(friction, float), directions
        self.incidence = np.zeros((len(ends), len(self.friction)))
        self.incidence[np.arange(len(ends)), [a for a, _ in ends]] = -1.0
        self.incidence[np.arange(len(ends)), [b for _, b in ends]] = 1.0
        self.stiffness = np.array(stiffness, float)[:, None]
        self.x, self.length = np.zeros((len(self.friction), 2)), np.zeros((len(ends), 2))
        self.load = np.zeros_like(self.x)

    def force(self, x, length, load=0.0):
        return self.incidence.T @ (self.stiffness * (length - self.incidence @ x)) + load

    def rates(self, force, friction, growth, longer, heavier, scale):
        """Velocities: v = sum lambda d, lambda = argmin |sqrt(k) (B v - L')|^2 + 2 (growth - f' . d) . lambda."""
        if self.directions is None:
            at = np.flatnonzero(np.hypot(*force.T) >= friction[:, 0] - CLOSE * scale)
            normals, whose, rise = force[at] / np.hypot(*force[at].T)[:, None], at, growth[at, 0]
        else:
            whose, k = np.nonzero(force @ self.directions.T >= friction - CLOSE * scale)
            normals, rise = self.directions[k], growth[whose, k]
        velocity = np.zeros_like(force)
        if len(whose):
            root = np.sqrt(self.stiffness)
            pull = root[:, :, None] * self.incidence[:, whose, None] * normals
            matrix = pull.transpose(0, 2, 1).reshape(-1, len(whose))
            speed = least_speeds(matrix, (root * longer).ravel(), rise - (heavier[whose] * normals).sum(1))
            speed[speed < 1e-11 * speed.max(initial=0.0)] = 0.0  # rounding
            np.add.at(velocity, whose, speed[:, None] * normals)
        return velocity

    def ramp(self, length, friction=None, load=None):
        """Go in a straight line to rest lengths (S, 2), friction and loads (n, 2); return the displacements."""
        start, begun, loaded = self.length, self.friction, self.load
        heavier = (loaded if load is None else np.asarray(load, float)) - loaded
        longer = np.asarray(length, float) - start
        growth = (begun if friction is None else np.asarray(friction, float).reshape(begun.shape)) - begun
        scale = np.abs(self.stiffness * longer).max() + begun.max() + np.abs(heavier).max()
        at = 0.0
        for _ in range(1000):
            force = self.force(self.x, start + at * longer, loaded + at * heavier)
            velocity = self.rates(force, begun + at * growth, growth, longer, heavier, scale)
            if self.directions is None:
                at = self._bend(at, start, longer, begun, growth, loaded, heavier, velocity)
            else:
                at = self._go(at, force, longer, heavier, begun + at * growth, growth, velocity, scale)
            if at >= 1.0:
                self.length, self.friction, self.load = start + longer, begun + growth, loaded + heavier
                return self.x.copy()
        raise RuntimeError("too many events")

    def _go(self, at, force, longer, heavier, friction, growth, velocity, scale):
        """Straight on to the next event."""
        gap = friction - force @ self.directions.T
        closing = self.force(velocity, longer, heavier) @ self.directions.T - growth
        ahead = (gap > CLOSE * scale) & (closing > 0.0)
        step = min((gap[ahead] / closing[ahead]).min(initial=np.inf), 1.0 - at)
        self.x = self.x + step * velocity
        return at + step if at + step < 1.0 - 1e-14 else 1.0

    def _bend(self, at, start, longer, begun, growth, loaded, heavier, velocity):
        """Integrate while the same contacts slide."""
        slides = np.flatnonzero(velocity.any(axis=1))
        rests = np.setdiff1d(np.arange(len(velocity)), slides)
        laplacian = self.incidence.T @ (self.stiffness * self.incidence)
        push = self.force(np.zeros_like(velocity), longer, heavier)

        def speeds(t, x):
            force = self.force(x.reshape(-1, 2), start + t * longer, loaded + t * heavier)[slides]
            normals = force / np.hypot(*force.T)[:, None]
            matrix = laplacian[np.ix_(slides, slides)] * (normals @ normals.T)
            return np.linalg.solve(matrix, (push[slides] * normals).sum(1) - growth[slides, 0]), normals

        def rate(t, x):
            v = np.zeros_like(velocity)
            if len(slides):
                speed, normals = speeds(t, x)
                v[slides] = speed[:, None] * normals
            return v.ravel()

        def event(which, contact):
            def value(t, x):
                if which == "stops":
                    return speeds(t, x)[0][contact]
                force = self.force(x.reshape(-1, 2), start + t * longer, loaded + t * heavier)[contact]
                return begun[contact, 0] + t * growth[contact, 0] - np.hypot(*force)

            value.terminal, value.direction = True, -1.0
            return value

        events = [event("starts", i) for i in rests] + [event("stops", i) for i in range(len(slides))]
        limits = {"rtol": 1e-11, "atol": 1e-13, "max_step": (1.0 - at) / 20.0}
        found = solve_ivp(rate, (at, 1.0), self.x.ravel(), method="DOP853", events=events, **limits)
        if found.status < 0:
            raise RuntimeError(found.message)
        self.x = found.y[:, -1].reshape(-1, 2)
        return float(found.t[-1])
