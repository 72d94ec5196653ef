"""The state of a body on patches of ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..line_state import LineState


@dataclass(eq=False)
class GroundState(LineState):
    """The state of a body on a line, the command in force and the places of the contacts.

    The rows FORWARD, BACKWARD and LOAD hold the bounds and loads that the command has on the ground at each place.

    Attributes:
        place: as in `Track`, int64, shape (N,).
        command: the target in force, for ground without patches, shape (S + 2 N,), with loads (S + 3 N,).
    """

    place: np.ndarray
    command: np.ndarray

    @property
    def friction(self) -> np.ndarray:
        """Friction commanded, before the ground multiplies it, forward then backward, shape (2 N,) [N]."""
        loads = self.loads
        return self.bounds + np.concatenate((loads, -loads)) if loads.size else self.bounds

    @property
    def bounds(self) -> np.ndarray:
        """Bounds as in a target, for ground without patches, shape (2 N,) [N]."""
        springs = self.links.shape[1]
        return self.command[springs : springs + 2 * self.status.size].copy()

    @property
    def loads(self) -> np.ndarray:
        """Loads commanded, with the share of the track's slope, shape (N,) [N]; shape (0,) without loads."""
        return self.command[self.links.shape[1] + 2 * self.status.size :].copy()

    def copy(self) -> GroundState:
        """Copy the state.

        Returns:
            An independent state with the same numbers.
        """
        arrays = (self.contacts, self.links, self.status, self.place, self.command)
        return GroundState(*(array.copy() for array in arrays))

    def restore(self, other: GroundState) -> None:
        """Take over the numbers of another state of the same body.

        Args:
            other: the other state.
        """
        for name in ("contacts", "links", "status", "place", "command"):
            getattr(self, name)[:] = getattr(other, name)

    def bits(self) -> bytes:
        """Return all numbers as bytes, for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return super().bits() + self.place.tobytes() + self.command.tobytes()
