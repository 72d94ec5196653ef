"""The state of a body in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .elastic import pull, strain
from .frame import Frame, friction_columns
from .friction import measure_margins

_FAR = 1024.0
"""Displacements of more sizes of the body lose digits."""


@dataclass(eq=False)
class PlanarState:
    """The state of a body in the plane.

    Of vector springs, elongations, tensions and changes of the rest length have the shape (S, 2) instead of (S + J,).

    Attributes:
        frame: the body.
        origin: what the body has travelled, in whole multiples of a length, shape (2,) [m].
        x: displacements from there, shape (N, 2) [m].
        gained: displacement gained in the last command, shape (N, 2) [m].
        command: what is in force, as in a target: the commands, with the friction of the regions that points stand on,
            shape (C,).
        asked: the friction that is commanded, as in `command`, shape (F,) [N].
        region: the region of the ground that holds each point, -1 outside all of them, shape (N,), int64.
        behind: of a point on a border the region on its other side, where friction is less; else as `region`.
        turned: the yaw, unwrapped, shape (1,) [rad].
        stability: least stability margin of the last command, shape (1,) [1].
    """

    frame: Frame
    origin: np.ndarray
    x: np.ndarray
    gained: np.ndarray
    command: np.ndarray
    asked: np.ndarray
    region: np.ndarray
    behind: np.ndarray
    turned: np.ndarray
    stability: np.ndarray

    @property
    def displacement(self) -> np.ndarray:
        """Displacement x, shape (N, 2) [m]."""
        return self.origin + self.x

    @property
    def yaw(self) -> float:
        """Direction of the heading, unwrapped [rad]."""
        return float(self.turned[0])

    @property
    def stability_margin(self) -> float:
        """Least stability margin of the last command [1]."""
        return float(self.stability[0])

    @property
    def shape(self) -> np.ndarray:
        """Elongations of the links [m], then changes of the angles of the joints [rad], shape (S + J,)."""
        return self._by_spring(self._strained[1])

    @property
    def tension(self) -> np.ndarray:
        """Tensions of the links [N], then torques of the joints [N m], shape (S + J,)."""
        return self._by_spring(self._strained[0])

    def _by_spring(self, values: np.ndarray) -> np.ndarray:
        return values.reshape(-1, 2) if self.frame.vector else values

    @property
    def _strained(self) -> np.ndarray:
        found = np.empty((2, self.frame.rest.size))
        strain(self.frame, self.command, self.x, found)
        return found

    @property
    def actuation(self) -> np.ndarray:
        """Changes of the rest lengths [m], then of the rest angles [rad], in force, shape (S + J,)."""
        return self._by_spring(self.command[: self.frame.rest.size])

    @property
    def commanded(self) -> np.ndarray:
        """The same, as there is no backlash in the plane."""
        return self.actuation

    @property
    def friction(self) -> np.ndarray:
        """Friction commanded as in a target, point by point, shape (N,) for discs, else (4 N,) or (m N,) [N]."""
        return self.asked[::4] if self._has_discs else self.asked

    @property
    def _has_discs(self) -> bool:
        """Whether friction is the same in all directions."""
        return self.frame.vector and self.frame.directions.size == 0

    @property
    def held(self) -> np.ndarray:
        """Friction in force on the ground under each point, a view of `command`, shape (N, 4) or (N, m) [N]."""
        return self.command[friction_columns(self.frame)].reshape(self.x.shape[0], -1)

    @property
    def bounds(self) -> np.ndarray:
        """The same as `friction`."""
        return self.friction

    @property
    def loads(self) -> np.ndarray:
        """Loads in force, the slope's share included, shape (N, 2) [N]; shape (0, 2) without loads."""
        return self.command[friction_columns(self.frame).stop :].reshape(-1, 2)

    @property
    def force(self) -> np.ndarray:
        """Force of links and joints on each point, shape (N, 2) [N]."""
        force, size = np.empty_like(self.x), np.empty(self.x.shape[0])
        pull(self.frame, self.command, self.x, force, size)
        return force - self.loads if self.loads.size else force

    @property
    def contact_state(self) -> np.ndarray:
        """1 if a point slid in the last command, 0 stuck; int8, shape (N,)."""
        return (np.abs(self.gained).max(axis=1) > 0.0).astype(np.int8)

    def margins(self, force: np.ndarray) -> np.ndarray:
        """Compute the distance, along the force, of the forces from the boundary of the admissible friction forces.

        Args:
            force: of links and joints, shape (N, 2) [N].

        Returns:
            Shape (N,) [N].
        """
        margins = np.empty(self.x.shape[0])
        force = np.array(force + self.loads if self.loads.size else force, order="C")
        measure_margins(self.frame, self.command, self.x, force, margins)
        return margins

    def visited_margin(self, force: np.ndarray) -> float:
        """Compute how close all contacts are to sliding at once.

        Args:
            force: of links and joints, shape (N, 2) [N].

        Returns:
            The margin [1].
        """
        held = self.held[:, :1] if self._has_discs else self.held
        total = float(held.mean(axis=1).sum()) * (1.0 + self.frame.vector)
        return float(np.maximum(self.margins(force), 0.0).sum()) / total if total > 0.0 else 0.0

    def recentre(self, unit: float) -> None:
        """Move the origin to a body that is far from it: forces follow from differences of displacements.

        Args:
            unit: a power of 2 as large as the body [m].
        """
        if max(map(abs, self.x[0].tolist())) > _FAR * unit:
            shift = unit * np.round(self.x.mean(axis=0) / unit)
            self.x -= shift  # exact
            self.origin += shift

    def copy(self) -> PlanarState:
        """Copy the state.

        Returns:
            An independent state with the same numbers.
        """
        fields = dict(vars(self))
        frame = fields.pop("frame")
        return PlanarState(frame, **{name: array.copy() for name, array in fields.items()})

    def bits(self) -> bytes:
        """Return all numbers as bytes, for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return b"".join(array.tobytes() for array in (self.origin, self.x, self.gained, self.command, self.turned))
