"""MuJoCo on a chain: slide joints with friction loss, springs between them as tendons.

MuJoCo has inertia and soft constraints; quasi-static dry friction is the limit of small mass. Mass, damping, the
softness of friction and the integrator are tuned for each step size. MuJoCo's friction cannot differ between forwards
and backwards, and friction that changes with time requires editing the model in every step.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from crawler_model import Scene

from ..cases import QUARTERS, Case
from .entrant import ByQuarters, Entrant, check_time

STEPS = (100, 300, 1_000, 3_000, 10_000)
"""Numbers of steps per period."""


@dataclass(frozen=True)
class Tuning:
    """The parameters that are tuned.

    Attributes:
        mass: mass of each contact relative to stiffness times a squared second [k s^2].
        damping: damping of each joint relative to the critical damping of mass and stiffness.
        softness: time constant of the friction constraint in steps; negative for MuJoCo's default.
        impedance: impedance of the friction constraint, near 1 for a hard one.
        integrator: MuJoCo's name of the integrator.
        noslip: iterations of MuJoCo's NoSlip pass, which reduces the softness of friction.
    """

    mass: float
    damping: float
    softness: float
    impedance: float
    integrator: str
    noslip: int


TUNED: dict[int, Tuning] = {
    100: Tuning(3.2e-4, 0.3, -1.0, 0.999, "Euler", 0),
    300: Tuning(6.4e-5, 0.3, 2.0, 0.9999, "Euler", 0),
    1_000: Tuning(3.2e-6, 0.3, 2.0, 0.5, "Euler", 20),
    3_000: Tuning(4.48e-7, 0.3, 2.0, 0.5, "Euler", 20),
    10_000: Tuning(3.2e-8, 0.3, 2.0, 0.5, "Euler", 20),
}
"""The best tunings found for strategy A."""


class MujocoRun(ByQuarters):
    """A MuJoCo model stepped through the commands."""

    def __init__(self, scene: Scene, steps: int, tuning: Tuning) -> None:
        """Build the model at the scene's start."""
        import mujoco

        mujoco.set_mju_user_warning(lambda text: None)  # an unstable trial shows in its error; no log file is needed
        body, drive = scene.body, scene.drive
        n, s = body.contacts, body.springs
        ends = np.rint(np.arange(1, steps + 1) * (1e9 / steps)).astype(np.int64)
        targets = drive.sample(ends)
        self.actuation, self.friction = targets[:, :s] + 1000.0, targets[:, s : s + n]
        self.per_quarter = steps // 4
        self.model: Any = mujoco.MjModel.from_xml_string(build_document(scene, steps, tuning))
        self.data: Any = mujoco.MjData(self.model)
        self.offset = 1000.0 * np.arange(n)  # makes rest lengths positive, as tendons require
        self.data.qpos[:] = scene.start_displacement + self.offset
        self.model.tendon_lengthspring[:] = (drive.actuation[0] + 1000.0)[:, None]
        self.model.dof_frictionloss[:] = drive.forward[0]
        self.step = mujoco.mj_step

    @property
    def displacement(self) -> np.ndarray:
        """X, shape (N,) [m]."""
        return np.array(self.data.qpos) - self.offset

    def quarter(self, number: int, deadline: float) -> float:
        """Simulate a quarter of a period; see `entrant.Run`."""
        model, data, step = self.model, self.data, self.step
        rest, loss = model.tendon_lengthspring, model.dof_frictionloss
        first = (number % 4) * self.per_quarter
        lengths = np.repeat(self.actuation[first : first + self.per_quarter, :, None], 2, axis=2)
        frictions = self.friction[first : first + self.per_quarter]
        began = time.perf_counter()
        for length, friction in zip(lengths, frictions, strict=True):
            rest[:] = length
            loss[:] = friction
            step(model, data)
        spent = time.perf_counter() - began
        check_time(deadline)
        return spent


def build_document(scene: Scene, steps: int, tuning: Tuning) -> str:
    """Write the chain in MuJoCo's XML: joints `c0`, `c1`, ... and tendons `l0`, `l1`, ... .

    Returns:
        The document; friction and rest lengths are 1 and are set in the model.
    """
    stiffness = scene.body.stiffness
    mass = tuning.mass * float(stiffness.mean())
    damping = float(tuning.damping * 2.0 * np.sqrt(mass * float(stiffness.mean())))
    soft = f'solreffriction="{tuning.softness / steps!r} 1"' if tuning.softness > 0.0 else ""
    hard = f'solimpfriction="{tuning.impedance} {tuning.impedance} 0.001 0.5 2"'
    joint = f'type="slide" axis="1 0 0" frictionloss="1" damping="{damping!r}" {soft} {hard}'
    bodies = "".join(
        f'<body><joint name="c{i}" {joint}/><geom size="0.01" mass="{mass!r}" contype="0" conaffinity="0"/></body>'
        for i in range(scene.body.contacts)
    )
    tendons = "".join(
        f'<fixed name="l{i}" stiffness="{k!r}" springlength="1"><joint joint="c{i}" coef="-1"/>'
        f'<joint joint="c{i + 1}" coef="1"/></fixed>'
        for i, k in enumerate(stiffness.tolist())
    )
    return (
        f'<mujoco><option gravity="0 0 0" timestep="{1.0 / steps!r}" integrator="{tuning.integrator}" '
        'iterations="50" tolerance="1e-12" '
        f'noslip_iterations="{tuning.noslip}" noslip_tolerance="1e-12"/>'
        '<compiler boundmass="1e-15" boundinertia="1e-15"/>'
        f"<worldbody>{bodies}</worldbody><tendon>{tendons}</tendon></mujoco>"
    )


def tunings() -> Iterator[Tuning]:
    """List the tunings of the scan.

    Yields:
        The tunings.
    """
    masses = 10.0 ** np.arange(-3.0, -8.1, -0.5)
    for mass, damping, softness, noslip in itertools.product(masses, (0.0, 0.1, 0.3, 1.0), (-1.0, 2.0), (0, 20)):
        yield Tuning(float(f"{mass:.2g}"), damping, softness, 0.9999, "Euler", noslip)


def tune(case: Case, steps: int, seconds: float) -> tuple[Tuning, int]:
    """Find the tuning with the least error at a number of steps per period.

    Returns:
        The best tuning, and the number of tunings tried.
    """
    deadline = time.perf_counter() + seconds
    tried, best, least = 0, next(tunings()), np.inf

    def attempt(tuning: Tuning) -> None:
        nonlocal tried, best, least
        error = _error(case, steps, tuning)
        tried += 1
        if error < least:
            best, least = tuning, error

    for tuning in (*([TUNED[steps]] if steps in TUNED else []), *tunings()):
        attempt(tuning)
        if time.perf_counter() > deadline:
            break
    attempt(replace(best, integrator="implicitfast"))
    for impedance in (0.5, 0.9, 0.99, 0.999, 0.99999):
        attempt(replace(best, impedance=impedance))
    for factor in (0.5, 0.7, 1.4, 2.0):
        attempt(replace(best, mass=best.mass * factor))
    return best, tried


def _error(case: Case, steps: int, tuning: Tuning) -> float:
    run = MujocoRun(case.scene, steps, tuning)
    found = []
    for number in range(QUARTERS):
        run.quarter(number, np.inf)
        found.append(run.displacement)
    error = case.reference.error(np.array(found))
    return error if np.isfinite(error) else np.inf


def why_not(case: Case) -> str | None:
    """Explain why MuJoCo cannot simulate a crawler.

    Returns:
        The reason; None if it can.
    """
    body, drive = case.scene.body, case.scene.drive
    if body.dimension == 2:
        return "friction in the plane is a disc; MuJoCo's friction loss acts on each axis by itself"
    if (drive.forward != drive.backward).any():
        return "friction differs between forwards and backwards; MuJoCo's friction loss is equal in both directions"
    if not body.is_chain:
        return "the MuJoCo model is built only for chains"
    return None


def build_mujoco_peers(case: Case, scan: bool) -> list[Entrant]:
    """Build entrants of MuJoCo.

    Returns:
        The entrants.
    """
    entrants = []
    for steps in STEPS:
        tuning, tried = tune(case, steps, 15.0) if scan else (TUNED[steps], 0)
        found = f"best of {tried} tunings" if tried else "as tuned before"
        words = ", ".join(f"{name} {value}" for name, value in vars(tuning).items())
        entrants.append(
            Entrant(
                "MuJoCo, tuned",
                steps,
                partial(MujocoRun, case.scene, steps, tuning),
                f"{found}: {words}; the model edited and stepped from Python in each step",
            )
        )
    return entrants
