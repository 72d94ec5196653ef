"""The one door to all bodies: what every kind of motion can do, and which kind a body moves by.

Behind it are `chain` for chains, `graph` for any other springs on a line and `plane` for the plane.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ..body.plan import Plan


class State(Protocol):
    """What changes while a body moves."""

    @property
    def displacement(self) -> np.ndarray:
        """X, shape (N,), in the plane (N, 2) [m]."""
        ...

    @property
    def gained(self) -> np.ndarray:
        """Displacement gained on the last command, likewise."""
        ...

    @property
    def shape(self) -> np.ndarray:
        """Z, shape (S,), in the plane (S, 2) [m]."""
        ...

    @property
    def tension(self) -> np.ndarray:
        """T, likewise [N]."""
        ...

    @property
    def actuation(self) -> np.ndarray:
        """L in force, likewise [m]."""
        ...

    @property
    def friction(self) -> np.ndarray:
        """In force, as in a target, shape (F,) [N]."""
        ...

    @property
    def bounds(self) -> np.ndarray:
        """Bounds of the spring forces as in a target: friction shifted by the loads, shape (F,) [N]."""
        ...

    @property
    def loads(self) -> np.ndarray:
        """Loads in force, the slope's share included, shape (N,) [N]; shape (0,) without loads."""
        ...

    @property
    def contact_state(self) -> np.ndarray:
        """1 where a contact slid forward (in the plane: slid) on the last command, -1 backward, 0 stuck, shape (N,)."""
        ...

    def margins(self, force: np.ndarray) -> np.ndarray:
        """Compute the distance of the spring forces from their nearest bounds.

        Args:
            force: g, shape (N,), in the plane (N, 2) [N].

        Returns:
            Shape (N,) [N].
        """
        ...

    def visited_margin(self, force: np.ndarray) -> float:
        """Compute how near all contacts are to sliding at once.

        Args:
            force: g, shape (N,), in the plane (N, 2) [N].

        Returns:
            The margin [1].
        """
        ...

    def copy(self) -> State:
        """Fork the state."""
        ...

    def bits(self) -> bytes:
        """Lay all numbers out for comparison."""
        ...


class Motion(Protocol):
    """How one kind of body follows its commands."""

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods that it knows, the best one first."""
        ...

    @property
    def samples_margin(self) -> bool:
        """Whether a ramp sees its visited margin at its ends only, even if it is exact."""
        ...

    def start(self, x: np.ndarray, target: np.ndarray) -> Any:
        """Build the state at rest.

        Args:
            x: displacement, shape (N,), in the plane (N, 2) [m].
            target: the command in force, shape (S + 2 N,).

        Returns:
            The state. Contacts at a bound, but for rounding, are taken to be there.
        """
        ...

    def scratch(self) -> Any:
        """Allocate the memory that `follow` works in, for one crawler."""
        ...

    def follow(
        self,
        state: Any,
        scratch: Any,
        targets: np.ndarray,
        exact: bool,
        budget: int,
        account: np.ndarray,
        records: np.ndarray,
    ) -> None:
        """Follow straight ramps to each of the targets in turn.

        Args:
            state: changed in place.
            scratch: from `scratch`.
            targets: rows as in `Columns.target`, shape (V, S + 2 N).
            exact: True to follow every event, False for one catch-up step a ramp (in the plane, refined steps).
            budget: most work in one ramp, as for `Crawler`.
            account: shape (14,), added to.
            records: displacement, its rest and tension after each ramp, shape (V, 2 N + S), or no rows for none.
        """
        ...


def build_motion(plan: Plan) -> Motion:
    """Choose how a body moves.

    Args:
        plan: the body and its commands.

    Returns:
        The motion of a chain, a graph of springs, or a body in the plane; only its own kernels are loaded.
    """
    if plan.body.dimension == 2:
        from .plane.motion import build_plane_motion

        return build_plane_motion(plan)
    if plan.body.is_chain:
        from .chain.motion import ChainMotion

        return ChainMotion(plan.body)
    from .graph.motion import GraphMotion, build_network_of

    return GraphMotion(plan.body, build_network_of(plan.body))
