"""The state of a body on patches of ground."""

from __future__ import annotations

import numpy as np

from ..line_state import LineState
from ..state import GAINED, LINK_ROWS, LOADED_ROWS


class GroundState(LineState):
    """The state of a body on patches of ground, the command in force and the places of the contacts.

    The rows FORWARD, BACKWARD and LOAD hold what the ground at each place makes of the command. All numbers lie in one
    piece of memory, so that every tick can keep them for the case that it is refused.

    Attributes:
        command: the target in force, for ground without patches, shape (S + 2 N,), with loads (S + 3 N,).
        place: as in `Track`, int64, shape (N,).
        gained_row: the row GAINED of the contacts, shape (N,) [m].
        ground: from `Track.find_ground`, for these places; None until it is needed.
    """

    def __init__(self, memory: np.ndarray, contacts: int, springs: int, command: int) -> None:
        """Divide a piece of memory.

        Args:
            memory: all numbers, uint8.
            contacts: number of contacts N.
            springs: number of springs S.
            command: size of a target for ground without patches.
        """
        self._memory, self._sizes = memory, (contacts, springs, command)
        n, s = contacts, springs
        ends = np.cumsum([8 * LOADED_ROWS * n, 8 * LINK_ROWS * s, 8 * command, 8 * n, n])
        parts = np.split(memory, ends[:-1])
        super().__init__(
            parts[0].view(np.float64).reshape(LOADED_ROWS, n),
            parts[1].view(np.float64).reshape(LINK_ROWS, s),
            parts[4].view(np.int8),
        )
        self.command, self.place = parts[2].view(np.float64), parts[3].view(np.int64)
        self.gained_row = self.contacts[GAINED]
        self.ground: np.ndarray | None = None

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
        return GroundState(self.keep(), *self._sizes)

    def keep(self) -> np.ndarray:
        """Copy all numbers.

        Returns:
            The numbers, for `restore`.
        """
        return self._memory.copy()

    def restore(self, kept: np.ndarray) -> None:
        """Return to kept numbers.

        Args:
            kept: from `keep`.
        """
        self._memory[:] = kept
        self.ground = None

    def bits(self) -> bytes:
        """Return all numbers as bytes, for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return self._memory.tobytes()


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
    return GroundState(memory, state.status.size, state.links.shape[1], command.size)
