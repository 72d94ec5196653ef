"""Ground that changes along the track: borders that contacts reach, stand on, cross, or jump over.

Inside a region between two borders a contact has the bounds of that region. On a border its forward bound is that of
the ground ahead, its backward bound that of the ground behind. A sliding contact that reaches a border is an event:

* The bound beyond is harder: the contact stops there until its spring force reaches the new bound.
* The bound beyond is softer: no equilibrium is left at this place, and the contact jumps at fixed commands. Spring
  forces are monotone (the stiffness matrix has no positive off-diagonal entries), so all contacts move one way, and the
  end is the least displacement at which all bounds hold again. The exact motion finds it, as a ramp on which the bound
  goes from the old to the new value. A border met on the way is a further event.

A jump loses energy: what the bound was above its new value, times the displacement of the contact.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol

import numpy as np

from ..body.body import Body
from ..body.ground import Ground
from .line_state import LineState
from .state import (
    ACCOUNT_SIZE,
    ACTUATION,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    DISSIPATION,
    FORWARD,
    GAINED,
    JUMP_LOSS,
    JUMPS,
    LOAD,
    OVERSPENT,
    TENSION,
    VISITED,
    X_REST,
    X,
    add_ramp,
)

_SAME = 4.0 * float(np.finfo(np.float64).eps)
"""Bounds that differ by less than this part of them are the same on both sides of a border."""


@dataclass(frozen=True)
class Jump:
    """A contact that lost its equilibrium on a border.

    Attributes:
        ramp: the ramp on which it happened, counted from 0 since `follow` was called.
        part: the place on that ramp, 0 .. 1 [1].
        contact: the contact.
        border: the place on the track [m].
        distance: how far the contact jumped [m].
        loss: energy lost beside friction, further jumps on the way included [J].
    """

    ramp: int
    part: float
    contact: int
    border: float
    distance: float
    loss: float


class BorderMotion(Protocol):
    """A motion that can stop where a contact reaches a border."""

    @property
    def body(self) -> Body: ...  # noqa: D102
    def start(self, x: np.ndarray, target: np.ndarray) -> LineState:
        """Build the state at rest, see `Motion`."""
        ...

    def scratch(self) -> Any:
        """Allocate the memory of a ramp, see `Motion`."""
        ...

    def follow_to_border(
        self, state: LineState, scratch: Any, target: np.ndarray, budget: int, account: np.ndarray, borders: np.ndarray
    ) -> tuple[float, int]:
        """Follow one ramp up to its end, or to where a contact reaches a border; the part of it, and the contact."""
        ...


@dataclass(eq=False)
class PatchedState(LineState):
    """The state of a body on patches: what is commanded, and the ground under each contact.

    Attributes:
        command: L, mu_plus, mu_minus and load in force, off the patches, shape (S + 3 N,).
        ahead: the region that the forward bound of each contact is of, shape (N,).
        behind: the region that its backward bound is of, shape (N,); other than `ahead` on a border.
        jumps: since `follow` was last called.
    """

    command: np.ndarray = field(default_factory=lambda: np.zeros(0))
    ahead: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    behind: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    jumps: list[Jump] = field(default_factory=list)

    @property
    def friction(self) -> np.ndarray:
        """Friction in force as in a target without loads, off the patches, shape (2 N,) [N]."""
        n = self.ahead.size
        return self.command[-3 * n : -n].copy()

    def copy(self) -> PatchedState:
        """Fork the state.

        Returns:
            Another state of the same numbers, in arrays of its own.
        """
        arrays = (self.contacts, self.links, self.status, self.command, self.ahead, self.behind)
        return PatchedState(*(a.copy() for a in arrays), list(self.jumps))

    def bits(self) -> bytes:
        """Lay all numbers out for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return super().bits() + b"".join(a.tobytes() for a in (self.command, self.ahead, self.behind))
