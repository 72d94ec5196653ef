"""The response of a crawler to a command."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..motion import account as entries
from ..motion.jump import Jump
from ..notebook import write_html


@dataclass(frozen=True)
class Certificate:
    """Residuals that certify a ramp: for `exact` the first three are rounding errors, for `catch_up` its error.

    Attributes:
        energy_residual: dE + dissipation + internal_dissipation + jump_loss - work - loads_work [J].
        violation: largest amount by which a spring force exceeds its bound [N].
        complementarity: largest product of |dx_i| and the distance of g_i from the bound of its sliding direction [J].
        rounding: largest displacement error due to rounding that the first three cannot show because soft links store
            almost no energy: for chains whose stiffness spans more than four decades, else 0 [m].
    """

    energy_residual: float
    violation: float
    complementarity: float
    rounding: float = 0.0


@dataclass(eq=False, repr=False, slots=True)
class Step:
    """The account of one or more ramps.

    Attributes:
        velocity: displacement gained, shape (N,), in the plane (N, 2) [m].
        account: the entries behind the properties, in the order defined in `motion.account`, shape (15,).
        jumps: of contacts that crossed a border onto ground that holds less, in order.
    """

    velocity: np.ndarray
    account: np.ndarray
    _share: np.ndarray  # of each contact in the net translation, shape (N,)
    jumps: tuple[Jump, ...] = ()

    @property
    def events(self) -> int:
        """Number of linear pieces of the solution."""
        return int(self.account[entries.EVENTS])

    @property
    def work(self) -> float:
        """Work of the actuators [J]."""
        return float(self.account[entries.WORK])

    @property
    def dissipation(self) -> float:
        """Energy lost to friction [J]."""
        return float(self.account[entries.DISSIPATION] + self.account[entries.LOADS_WORK])

    @property
    def internal_dissipation(self) -> float:
        """Energy lost in springs with hysteresis [J]."""
        return float(self.account[entries.INTERNAL])

    @property
    def loads_work(self) -> float:
        """Work of the loads [J]."""
        return float(self.account[entries.LOADS_WORK])

    @property
    def jump_loss(self) -> float:
        """Energy lost in jumps, not to friction [J]."""
        return math.fsum(jump.loss for jump in self.jumps)

    @property
    def unique(self) -> bool:
        """False if the translation was not determined on some stretch."""
        return bool(self.account[entries.AMBIGUOUS] == 0.0)

    @property
    def translation_interval(self) -> tuple[float, float] | None:
        """Smallest and largest admissible net translation of the ramp [m]; None in the plane."""
        if self.velocity.ndim == 2:
            return None
        gain = float(self._share @ self.velocity)
        return gain + float(self.account[entries.GAIN_LEAST]), gain + float(self.account[entries.GAIN_MOST])

    @property
    def certificate(self) -> Certificate:
        """How well the result satisfies the model."""
        return Certificate(
            *self.account[[entries.RESIDUAL, entries.VIOLATION, entries.COMPLEMENTARITY, entries.ROUNDING]].tolist()
        )

    @property
    def visited_margin(self) -> float:
        """How close all contacts came to sliding at once [1]."""
        return float(self.account[entries.VISITED])

    @property
    def overspent(self) -> int:
        """Number of ramps in which the budget of work was exceeded and a catch-up step completed the ramp."""
        return int(self.account[entries.OVERSPENT])

    @property
    def unsolved(self) -> int:
        """Number of ramps that were not solved: the certificate shows an error that is more than rounding."""
        return int(self.account[entries.UNSOLVED])

    def _shown(self) -> list[str]:
        """List the attributes that describe the step."""
        names = ("events", "work", "dissipation", "velocity", "unique", "translation_interval", "certificate")
        return [*names, "visited_margin", "overspent", "unsolved", *(("jumps",) if self.jumps else ())] + (
            ["internal_dissipation"] if self.account[entries.INTERNAL] else []
        )

    def __repr__(self) -> str:
        """Show the whole account in one line; long arrays are abbreviated."""
        with np.printoptions(threshold=8, edgeitems=2):
            text = ", ".join(f"{name}={getattr(self, name)!r}" for name in self._shown())
        return f"Step({' '.join(text.split())})"

    def _repr_html_(self) -> str:
        """Show the whole account in a notebook."""
        units = {"work": " [J]", "dissipation": " [J]", "velocity": " [m]", "translation_interval": " [m]"}
        return write_html("Step", [(name + units.get(name, ""), getattr(self, name)) for name in self._shown()])
