"""The state of a body on patches of ground."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..line_state import LineState
from ..state import LINK_ROWS, LOADED_ROWS


@dataclass(eq=False)
class GroundState(LineState):
    """The state of a body on patches of ground, the command in force and the places of the contacts.

    The rows FORWARD, BACKWARD and LOAD hold the bounds and loads that the command has on the ground at each place.

    Attributes:
        command: the target in force, for ground without patches, shape (S + 2 N,), with loads (S + 3 N,).
        place: as in `Track`, int64, shape (N,).
        memory: the bytes of all these arrays, one piece, which every tick keeps in case that it is refused.
        ground: from `Track.find_ground`, for these places; None until it is needed.
    """

    command: np.ndarray
    place: np.ndarray
    memory: np.ndarray
    ground: np.ndarray | None = None

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
        return _divide(self.memory.copy(), self.status.size, self.links.shape[1], self.command.size)

    def restore(self, memory: np.ndarray) -> None:
        """Return to former numbers.

        Args:
            memory: a copy of `memory`.
        """
        self.memory[:] = memory
        self.ground = None

    def bits(self) -> bytes:
        """Return all numbers as bytes, for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return self.memory.tobytes()


def build_ground_state(state: LineState, place: np.ndarray, command: np.ndarray) -> GroundState:
    """Build the state of a body on patches of ground.

    Args:
        state: at these places, with loads.
        place: as in `Track`, shape (N,).
        command: the target in force, for ground without patches.

    Returns:
        The state.
    """
    parts = (state.contacts, state.links, np.array(command), place, state.status)
    memory = np.concatenate([np.frombuffer(part.tobytes(), np.uint8) for part in parts])
    return _divide(memory, state.status.size, state.links.shape[1], command.size)


def _divide(memory: np.ndarray, n: int, springs: int, command: int) -> GroundState:
    """Divide a piece of memory into the arrays of a state."""
    ends = np.cumsum([8 * LOADED_ROWS * n, 8 * LINK_ROWS * springs, 8 * command, 8 * n])
    contacts, links, target, place, status = np.split(memory, ends)
    return GroundState(
        contacts.view(np.float64).reshape(LOADED_ROWS, n),
        links.view(np.float64).reshape(LINK_ROWS, springs),
        status.view(np.int8),
        target.view(np.float64),
        place.view(np.int64),
        memory,
    )
