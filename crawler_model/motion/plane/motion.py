"""The motion of a body in the plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...body.body import Body
from ...body.plan import Plan
from ...body.planar_loads import split_target
from ..state import (
    PLANAR_ACTUATION,
    PLANAR_GAINED,
    PLANAR_LOAD,
    PLANAR_TENSION,
    PLANAR_X,
    VISITED,
)
from .follow import follow
from .springs import Springs, build_springs

DEFAULT_TOLERANCE = 1e-4
"""Default error of a planar ramp, relative to its change of length."""
_MOST_STEPS = 1 << 16
"""Upper limit of implicit steps in a planar ramp, about a second; equal steps then complete it, which is reported."""
_SHARE = 0.25
"""Part of the tolerance available to the substeps of a ramp, as later substeps may amplify errors of earlier ones."""


@dataclass(eq=False)
class PlanarState:
    """The state of a body in the plane.

    Attributes:
        contacts: rows X, X_REST and GAINED, shape (3, N, 2); with loads LOAD, too, shape (4, N, 2).
        links: rows TENSION and ACTUATION, shape (2, S, 2).
        mu: friction of each contact, per direction if anisotropic, shape (N, max(m, 1)) [N].
        stiffness: k of each spring, shape (S,) [N/m].
        directions: unit vectors, shape (m, 2).
    """

    contacts: np.ndarray
    links: np.ndarray
    mu: np.ndarray
    stiffness: np.ndarray
    directions: np.ndarray

    @property
    def displacement(self) -> np.ndarray:
        """Displacement x, shape (N, 2) [m]."""
        return self.contacts[PLANAR_X]

    @property
    def gained(self) -> np.ndarray:
        """Displacement gained in the last command, shape (N, 2) [m]."""
        return self.contacts[PLANAR_GAINED]

    @property
    def shape(self) -> np.ndarray:
        """Elongations z, shape (S, 2) [m]."""
        return self.tension / self.stiffness[:, None] + self.actuation

    @property
    def tension(self) -> np.ndarray:
        """Tensions T, shape (S, 2) [N]."""
        return self.links[PLANAR_TENSION]

    @property
    def actuation(self) -> np.ndarray:
        """Rest-length changes L in force, shape (S, 2) [m]."""
        return self.links[PLANAR_ACTUATION]

    @property
    def friction(self) -> np.ndarray:
        """Friction in force as in a target, contact by contact, shape (N max(m, 1),) [N]."""
        return self.mu.ravel()

    @property
    def bounds(self) -> np.ndarray:
        """The same as `friction`."""
        return self.mu.ravel()

    @property
    def loads(self) -> np.ndarray:
        """Loads in force, the slope's share included, shape (N, 2) [N]; shape (0, 2) without loads."""
        return self.contacts[PLANAR_LOAD:].reshape(-1, 2)

    @property
    def contact_state(self) -> np.ndarray:
        """1 if a contact slid in the last command, 0 stuck; int8, shape (N,)."""
        return (np.abs(self.gained).max(axis=1) > 0.0).astype(np.int8)

    def margins(self, force: np.ndarray) -> np.ndarray:
        """Compute the distance of spring force plus load from the boundary of the admissible friction forces.

        Args:
            force: g, shape (N, 2) [N].

        Returns:
            Shape (N,) [N].
        """
        if self.loads.size:
            force = force + self.loads
        if self.directions.size == 0:
            return self.mu[:, 0] - np.linalg.norm(force, axis=1)
        return (self.mu - force @ self.directions.T).min(axis=1)

    def visited_margin(self, force: np.ndarray) -> float:
        """Compute how close all contacts are to sliding at once.

        Args:
            force: g, shape (N, 2) [N].

        Returns:
            The margin [1].
        """
        total = 2.0 * float(self.mu.mean(axis=1).sum())
        return float(np.maximum(self.margins(force), 0.0).sum()) / total if total > 0.0 else 0.0

    def copy(self) -> PlanarState:
        """Copy the state.

        Returns:
            An independent state with the same numbers.
        """
        return PlanarState(self.contacts.copy(), self.links.copy(), self.mu.copy(), self.stiffness, self.directions)

    def bits(self) -> bytes:
        """Return all numbers as bytes, for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return b"".join(a.tobytes() for a in (self.contacts, self.links, self.mu))


@dataclass(frozen=True, eq=False)
class PlaneMotion:
    """A body in the plane followed by implicit steps, refined to a tolerance.

    Attributes:
        body: the body.
        springs: its springs, with K.
        directions: unit vectors of the friction directions, shape (m, 2); m = 0 for isotropic friction.
        tolerance: largest error of a ramp [m].
    """

    methods: ClassVar[tuple[str, ...]] = ("catch_up",)
    samples_margin: ClassVar[bool] = True
    body: Body
    springs: Springs
    directions: np.ndarray
    tolerance: float

    def start(self, x: np.ndarray, target: np.ndarray) -> PlanarState:
        """Build the state at rest, see `Motion`."""
        body = self.body
        lengths, friction, loads = split_target(body, self.directions, target)
        contacts = np.zeros((4 if loads.size else 3, body.contacts, 2))
        contacts[PLANAR_X] = x
        if loads.size:
            contacts[PLANAR_LOAD] = loads
        links = np.zeros((2, body.springs, 2))
        links[PLANAR_ACTUATION] = lengths
        links[PLANAR_TENSION] = body.stiffness[:, None] * (body.elongation(x) - links[PLANAR_ACTUATION])
        return PlanarState(contacts, links, friction.copy(), body.stiffness, self.directions)

    def scratch(self) -> None:
        """Allocate nothing, see `Motion`."""
        return

    def follow(
        self,
        state: PlanarState,
        scratch: None,
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
    ) -> None:
        """Follow straight ramps to each of the targets in turn, see `Motion`; `exact` and `budget` have no effect."""
        follow(
            self.springs,
            self.directions,
            state.contacts,
            state.links,
            state.mu,
            targets,
            self.tolerance,
            _MOST_STEPS,
            account,
            records,
        )
        if account[VISITED] == np.inf:  # no command changed
            account[VISITED] = state.visited_margin(self.body.spring_force(state.tension))


def build_plane_motion(plan: Plan) -> PlaneMotion:
    """Build the motion of a plan; its tolerance is relative to the changes of length that its drive commands.

    Args:
        plan: the body, its drive and its tolerance.

    Returns:
        The motion.
    """
    body = plan.body
    size = float(np.abs(np.ptp(plan.drive.targets[:, : 2 * body.springs], axis=0)).max(initial=0.0))
    size = size or float(np.abs(np.ptp(body.position, axis=0)).max())
    springs = build_springs(body.ends, body.stiffness, body.contacts)
    return PlaneMotion(body, springs, plan.directions, _SHARE * (plan.tolerance or DEFAULT_TOLERANCE) * size)
