"""Backlash: the slack between the commands and the actuators of a body on a line.

The rest length L of a spring with backlash b is the play of its commanded length C: it stays as it is while it differs
from C by less than b/2, and is led along at that distance otherwise. Along a straight ramp it begins to move at most
once, where the slack is crossed:

    L(s) = min(max(L(0), C(s) - b/2), C(s) + b/2)

Source: M. A. Krasnosel'skii and A. V. Pokrovskii, Systems with Hysteresis, Springer 1989, section 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .curves import Bend

_NEAR = 1e-13
"""Part of a ramp within which actuators begin to move together, or with the ramp."""


@dataclass(frozen=True, eq=False)
class Backlash:
    """The slacks of B actuators.

    Attributes:
        springs: their springs, shape (B,).
        reach: half of the backlash of each, shape (B,) [m].
        ahead: how far each is ahead of its command at the start of a scene, shape (B,) [m].
    """

    springs: np.ndarray
    reach: np.ndarray
    ahead: np.ndarray

    def lead(self, lengths: np.ndarray, commanded: np.ndarray) -> np.ndarray:
        """Lead actuators to commands that are reached in a straight line.

        Args:
            lengths: L before, shape (B,) [m].
            commanded: C, shape (B,) [m].

        Returns:
            L, shape (B,) [m].
        """
        return np.minimum(np.maximum(lengths, commanded - self.reach), commanded + self.reach)

    def lead_along(self, lengths: np.ndarray, commanded: np.ndarray) -> np.ndarray:
        """Lead actuators to one command after another.

        Args:
            lengths: L before, shape (B,) [m].
            commanded: C of all springs, shape (V, S) [m].

        Returns:
            L of all springs, for the others as commanded, shape (V, S) [m].
        """
        led = np.array(commanded)
        for row in led:
            row[self.springs] = lengths = self.lead(lengths, row[self.springs])
        return led

    def divide(
        self, lengths: np.ndarray, before: np.ndarray, targets: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Divide ramps where actuators begin to move.

        Args:
            lengths: L at their start, shape (B,) [m].
            before: the command in force, as in `Columns.target`, shape (F,).
            targets: the ends of the ramps as commanded, shape (V, F).

        Returns:
            The ends of all parts with the lengths L, shape (W, F); the ramp of each part, and the place on it at which
            the part ends, 0 .. 1, each of shape (W,).
        """
        at = self.springs
        begins = np.vstack((before, targets[:-1]))
        change = targets - begins
        held = np.vstack((lengths, self.lead_along(lengths, targets[:-1])[:, at]))
        turn = change[:, at]
        moves = (np.abs(targets[:, at] - held) > self.reach) & (turn != 0.0)
        slack = held + np.sign(turn) * self.reach - begins[:, at]
        places = np.divide(slack, turn, out=np.ones(turn.shape), where=moves)
        places[places <= _NEAR], places[places >= 1.0 - _NEAR] = 0.0, 1.0
        ends = np.ones((turn.shape[0], at.size + 2))
        ends[:, 0], ends[:, 1:-1] = 0.0, np.sort(places, axis=1)
        ramp, part = np.nonzero(ends[:, 1:] - ends[:, :-1] > _NEAR)
        place = ends[ramp, part + 1]
        rows = begins[ramp] + place[:, None] * change[ramp]
        rows[place == 1.0] = targets
        rows[:, at] = self.lead(held[ramp], rows[:, at])
        return rows, ramp, place


def build_backlash(bends: Sequence[Bend]) -> Backlash | None:
    """Build the backlash of the actuators of a body.

    Args:
        bends: its springs that are not linear, or have backlash.

    Returns:
        The backlash; None if no actuator has backlash.
    """
    table = np.array([(bend.spring, 0.5 * bend.backlash, bend.ahead) for bend in bends if bend.backlash > 0.0])
    return Backlash(table[:, 0].astype(np.int64), table[:, 1], table[:, 2]) if table.size else None
