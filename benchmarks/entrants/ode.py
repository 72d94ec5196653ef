"""Regularised friction with a solver of stiff equations, the usual approach without a solver for dry friction.

    g_i = mu_i v_i / sqrt(v_i^2 + e^2) + (e mu_i / V^2) v_i,   mu_i = mu_plus for v_i > 0, mu_minus for v_i < 0

without masses, solved for the velocity v_i at every contact; V is the fastest rate of the commands and e = eps V. The
second term, of the size of the error of the first, bounds velocities where a force exceeds mu. LSODA receives the
bandwidth of the Jacobian, three, so that a step costs O(N), and the corners of the commands.
"""

from __future__ import annotations

import time
import warnings
from functools import partial

import numba
import numpy as np

from crawler_model import Scene

from ..cases import Case
from .entrant import ByQuarters, Entrant, OutOfTime, check_time

SMOOTHINGS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
"""eps, the velocity below which friction is smooth, relative to the fastest command."""
_MOST_STEPS = 2_000_000


@numba.njit(cache=True, error_model="numpy")
def _rates(x, t, times, targets, stiffness, small, viscous, v):
    """Compute the velocities of a chain in v."""
    n, s = x.shape[0], stiffness.shape[0]
    phase = t - np.floor(t)
    a = min(max(np.searchsorted(times, phase, side="right") - 1, 0), times.shape[0] - 2)
    part = (phase - times[a]) / (times[a + 1] - times[a])
    before = 0.0
    for i in range(n):
        tension = 0.0
        if i < s:
            length = targets[a, i] + part * (targets[a + 1, i] - targets[a, i])
            tension = stiffness[i] * (x[i + 1] - x[i] - length)
        g = tension - before
        before = tension
        column = s + i if g > 0.0 else s + n + i
        mu = targets[a, column] + part * (targets[a + 1, column] - targets[a, column])
        c = viscous * mu
        size = abs(g)
        w = max(0.0, (size - mu) / c)
        for _ in range(100):  # the law is concave: Newton's method converges from below
            root = np.sqrt(w * w + small * small)
            step = (size - mu * w / root - c * w) / (mu * small * small / root**3 + c)
            w = max(w + step, 0.0)
            if abs(step) <= 1e-14 * w:
                break
        v[i] = w if g > 0.0 else -w


class OdeRun(ByQuarters):
    """A run of LSODA on smooth friction."""

    def __init__(self, scene: Scene, smoothing: float) -> None:
        """Prepare the equations at the scene's start."""
        from scipy.integrate import odeint

        self.solver = odeint
        drive = scene.drive
        s = scene.body.springs
        length = drive.targets[:, :s]
        fastest = float((np.abs(np.diff(length, axis=0)) / np.diff(drive.times)[:, None]).max())
        self.times = np.array(drive.times)
        self.tolerance = 0.1 * smoothing
        self.size = fastest
        constants = (self.times, drive.targets, scene.body.stiffness, smoothing * fastest, smoothing / fastest)
        v = np.empty(scene.body.contacts)

        def rates(x: np.ndarray, t: float) -> np.ndarray:
            _rates(x, t, *constants, v)
            return v

        rates(np.array(scene.start_displacement), 0.0)  # compiles before the timing
        self.rates = rates
        self.displacement = np.array(scene.start_displacement)

    def quarter(self, number: int, deadline: float) -> float:
        """Simulate a quarter of a period, which ends at a corner of the commands; see `entrant.Run`."""
        spent = 0.0
        first, last = 0.25 * (number % 4), 0.25 * (number % 4 + 1)
        corners = self.times[(self.times > first + 1e-9) & (self.times < last - 1e-9)]
        for a, b in zip((first, *corners), (*corners, last), strict=True):
            began = time.perf_counter()
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                path, notes = self.solver(
                    *(self.rates, self.displacement, (a, b)),
                    ml=1,
                    mu=1,
                    rtol=self.tolerance,
                    atol=self.tolerance * self.size,
                    tcrit=(b,),
                    mxstep=20_000,
                    full_output=True,
                )
            spent += time.perf_counter() - began
            if notes["message"] != "Integration successful." or not np.isfinite(path[-1]).all():
                raise OutOfTime
            self.displacement = path[-1]
            self.steps += int(notes["nst"][-1])
            check_time(deadline)
        return spent


def build_ode_peers(case: Case, smoothings: tuple[float, ...]) -> list[Entrant]:
    """Build entrants of smooth friction.

    Returns:
        The entrants.
    """
    return [
        Entrant(
            "smooth friction, LSODA",
            0,
            partial(OdeRun, case.scene, smoothing),
            f"eps {smoothing:g} of the fastest command; right-hand side compiled, Jacobian banded",
            f"eps {smoothing:.0e}".replace("e-0", "e-"),
            10_000,
        )
        for smoothing in smoothings
    ]
