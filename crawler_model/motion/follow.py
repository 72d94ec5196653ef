"""The contract of all motions, and the choice of the motion of a body.

The implementations are `line` for bodies on a line and `plane` for the plane.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ..body.plan import Plan
from .jump import Jump


class State(Protocol):
    """The state of a moving body."""

    @property
    def displacement(self) -> np.ndarray:
        """Displacement x, shape (N,), in the plane (N, 2) [m]."""

    @property
    def gained(self) -> np.ndarray:
        """Displacement gained in the last command, same shape [m]."""

    @property
    def shape(self) -> np.ndarray:
        """Elongations z, shape (S,), in the plane (S, 2) [m]."""

    @property
    def tension(self) -> np.ndarray:
        """Tensions T, same shape [N]."""

    @property
    def actuation(self) -> np.ndarray:
        """Rest-length changes L in force, same shape [m]."""

    @property
    def commanded(self) -> np.ndarray:
        """Those commanded, from which L differs within the backlash of actuators, same shape [m]."""

    @property
    def friction(self) -> np.ndarray:
        """Friction in force, as in a target, shape (F,) [N]."""

    @property
    def bounds(self) -> np.ndarray:
        """Bounds of the spring forces as in a target: friction shifted by the loads, shape (F,) [N]."""

    @property
    def loads(self) -> np.ndarray:
        """Loads in force, the slope's share included, shape (N,), in the plane (N, 2) [N]; empty without loads."""

    @property
    def contact_state(self) -> np.ndarray:
        """1 if a contact slid forward (in the plane: slid) in the last command, -1 backward, 0 stuck, shape (N,)."""

    def margins(self, force: np.ndarray) -> np.ndarray:
        """Compute the distance of the spring forces from their nearest bounds.

        Args:
            force: g, shape (N,), in the plane (N, 2) [N].

        Returns:
            Shape (N,) [N].
        """

    def visited_margin(self, force: np.ndarray) -> float:
        """Compute how close all contacts are to sliding at once.

        Args:
            force: g, shape (N,), in the plane (N, 2) [N].

        Returns:
            The margin [1].
        """

    def copy(self) -> State:
        """Copy the state."""

    def bits(self) -> bytes:
        """Return all numbers as bytes, for comparison."""


class Motion(Protocol):
    """How one kind of body follows its commands."""

    @property
    def methods(self) -> tuple[str, ...]:
        """The available methods, best first."""

    @property
    def samples_margin(self) -> bool:
        """Whether even an exact ramp samples its visited margin only at its ends."""

    def start(self, x: np.ndarray, target: np.ndarray) -> Any:
        """Build the state at rest.

        Args:
            x: displacement, shape (N,), in the plane (N, 2) [m].
            target: the command in force, shape (S + 2 N,).

        Returns:
            The state. Contacts within rounding of a bound are taken to be at that bound.
        """

    def scratch(self) -> Any:
        """Allocate the working memory of `follow` for one crawler."""

    def follow(
        self,
        state: Any,
        scratch: Any,
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
    ) -> tuple[Jump, ...] | None:
        """Follow straight ramps to each of the targets in turn.

        Args:
            state: changed in place.
            scratch: memory from `scratch`.
            targets: rows as in `Columns.target`, shape (V, S + 2 N).
            exact: True to follow every event, False for one catch-up step per ramp (in the plane, refined steps).
            budget: upper limit of work in one ramp, as for `Crawler`.
            account: entries as in `motion.account`, shape (15,), added to.
            records: output: displacement, its rest and tension after each ramp, shape (V, 2 N + S), or no rows. With
                SPENT further columns also what `motion.account.record_spent` writes.

        Returns:
            The jumps on patches of ground; None where the ground is the same everywhere.

        Raises:
            CommandError: if the body reaches ground on which nothing holds it; the state does not change.
        """


def build_motion(plan: Plan) -> Motion:
    """Build the motion of a body.

    Args:
        plan: the body and its commands.

    Returns:
        The motion; only its kernels are loaded.
    """
    if plan.body.dimension == 2:
        from .plane.motion import build_plane_motion

        return build_plane_motion(plan)
    from .line.motion import LineMotion

    return LineMotion(plan.body, plan.ground.track)
