"""Judgement of the certificates of ticks: energies and forces that are exact to a fraction of the body's own scale."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from crawler_model import Scene

from .intake.limits import body_length

_FINE = {"exact": 1e-6}
_COARSE = 0.1  # for catch_up the certificate measures the error of its steps, not rounding


@dataclass
class Certificates:
    """The worst certificates of the ticks since they were last judged, and of the whole run.

    Attributes:
        force: the scale of forces [N].
        energy: the scale of energies: the energy to drag the body over its own length [J].
        allowed: the fraction of these scales that counts as exact [1].
        worst: the worst of the run: energy residual [J], violation [N], complementarity [J].
    """

    force: float
    energy: float
    allowed: float
    worst: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    _now: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    _turnover: float = 0.0

    def add_ticks(self, residual: float, violation: float, complementarity: float, turnover: float) -> None:
        """Add ticks: the worst of their certificates, and the energy turned over in all of them."""
        now = self._now
        if not residual <= now[0]:  # not a number counts as worse
            now[0] = residual
        if not violation <= now[1]:
            now[1] = violation
        if not complementarity <= now[2]:
            now[2] = complementarity
        self._turnover += turnover

    def judge(self) -> tuple[bool, str]:
        """Judge the ticks since the last call.

        Returns:
            Whether their numbers are finite, and a description of what is wrong; empty when nothing is.
        """
        (residual, violation, complementarity), energy = self._now, self.energy + self._turnover
        self.worst = [float(np.fmax(a, b)) if b == b else b for a, b in zip(self.worst, self._now, strict=True)]
        self._now, self._turnover = [0.0, 0.0, 0.0], 0.0
        if not np.isfinite(self.worst).all():
            return False, "a tick's certificate is not finite: the commands are beyond what doubles can hold"
        named = [
            ("energy residual", residual, energy, "J of {:.1e} J turned over"),
            ("violation of a bound", violation, self.force, "N of {:.1e} N of friction"),
            ("complementarity", complementarity, energy, "J of {:.1e} J turned over"),
        ]
        # however large the turnover, an energy that could drag the body over its own length is an error
        most = {self.force: self.allowed * self.force, energy: min(self.allowed * energy, self.energy)}
        bad = [f"{name} {value:.1e} {of.format(scale)}" for name, value, scale, of in named if value > most[scale]]
        return True, f"states are inaccurate: {'; '.join(bad)}" if bad else ""


def certificates_of(scene: Scene, method: str) -> Certificates:
    """Compute the scales of a scene's certificates.

    Args:
        scene: the scene that runs.
        method: the method by which its ticks are computed.

    Returns:
        Certificates with no tick added yet.
    """
    body = scene.body
    extent = body_length(body)
    friction = np.abs(scene.columns.target(scene.drive.rows))[:, body.lengths :]
    force = float(friction.max(initial=0.0)) or float(body.stiffness.max(initial=0.0)) * extent
    return Certificates(force, force * extent, _FINE.get(method, _COARSE))
