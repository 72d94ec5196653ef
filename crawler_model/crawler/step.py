"""What a crawler answers to a command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..motion.state import (
    AMBIGUOUS,
    COMPLEMENTARITY,
    DISSIPATION,
    EVENTS,
    GAIN_LEAST,
    GAIN_MOST,
    LOADS_WORK,
    OVERSPENT,
    RESIDUAL,
    ROUNDING,
    UNSOLVED,
    VIOLATION,
    VISITED,
    WORK,
)


@dataclass(frozen=True)
class Certificate:
    """Numbers that certify a ramp; the first three are rounding for `exact`, and the error of `catch_up`.

    Attributes:
        energy_residual: dE + dissipation - work [J].
        violation: largest excess of a spring force over its bound [N].
        complementarity: largest |dx_i| times the distance of g_i from the bound it should be at [J].
        rounding: how far rounding may have moved a contact where the first three cannot show it, because soft links
            store next to no energy: on chains whose stiffness spans more than four decades, else 0 [m].
    """

    energy_residual: float
    violation: float
    complementarity: float
    rounding: float = 0.0


class Step:
    """What happened on the way to a command.

    Attributes:
        velocity: displacement gained, per ramp, shape (N,), in the plane (N, 2) [m].
        account: the numbers behind the properties, in the order of `state`'s entries, shape (14,).
    """

    __slots__ = ("_share", "account", "velocity")

    def __init__(self, velocity: np.ndarray, account: np.ndarray, share: np.ndarray) -> None:
        """Keep what the kernel returned; everything else is read from it when asked for.

        Args:
            velocity: displacement gained, shape (N,), in the plane (N, 2) [m].
            account: shape (14,).
            share: weight of each contact in the net translation, shape (N,).
        """
        self.velocity = velocity
        self.account = account
        self._share = share

    @property
    def events(self) -> int:
        """Linear pieces of the solution."""
        return int(self.account[EVENTS])

    @property
    def work(self) -> float:
        """Work of the actuators [J]."""
        return float(self.account[WORK])

    @property
    def dissipation(self) -> float:
        """Energy lost to friction [J]."""
        return float(self.account[DISSIPATION] + self.account[LOADS_WORK])

    @property
    def loads_work(self) -> float:
        """Work of the loads [J]."""
        return float(self.account[LOADS_WORK])

    @property
    def unique(self) -> bool:
        """False when on some stretch the translation was not determined."""
        return bool(self.account[AMBIGUOUS] == 0.0)

    @property
    def translation_interval(self) -> tuple[float, float] | None:
        """Least and greatest net translation that the ramp could have gained [m]; None in the plane."""
        if self.velocity.ndim == 2:
            return None
        gain = float(self._share @ self.velocity)
        return gain + float(self.account[GAIN_LEAST]), gain + float(self.account[GAIN_MOST])

    @property
    def certificate(self) -> Certificate:
        """How well the answer solves the model."""
        return Certificate(*self.account[[RESIDUAL, VIOLATION, COMPLEMENTARITY, ROUNDING]].tolist())

    @property
    def visited_margin(self) -> float:
        """How near all contacts came to sliding at once [1]."""
        return float(self.account[VISITED])

    @property
    def overspent(self) -> int:
        """Ramps in which the budget of work was spent and a catch-up step did the rest."""
        return int(self.account[OVERSPENT])

    @property
    def unsolved(self) -> int:
        """Ramps in which the active set of a graph gave up; the certificate shows what the rest of them is worth."""
        return int(self.account[UNSOLVED])

    def __repr__(self) -> str:
        """Show the whole account."""
        names = ("events", "work", "dissipation", "velocity", "unique", "translation_interval", "certificate")
        shown = (*names, "visited_margin", "overspent", "unsolved")
        return f"Step({', '.join(f'{name}={getattr(self, name)!r}' for name in shown)})"
