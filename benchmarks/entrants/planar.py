"""Clarabel on the implicit step in the plane, a second-order-cone program; quadratic solvers cannot represent discs.

    minimise  1/2 v' K v - r' v + sum_i mu_i t_i   subject to  |v_i| <= t_i

over the displacements v in a tick, where r are the spring forces under the new command without displacements.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from crawler_model import Scene

from ..cases import Case
from .entrant import Entrant, TickByTick

TOLERANCES = (1e-6, 1e-8)
"""Clarabel's default is 1e-8; with finer ones it reports many ticks as unsolved."""


class ConeRun(TickByTick):
    """Implicit steps by Clarabel: set up once, the linear term updated in place. Friction is isotropic and constant."""

    def __init__(self, scene: Scene, quarters: tuple[np.ndarray, ...], tolerance: float) -> None:
        """Set the solver up at the scene's start."""
        import clarabel

        body = scene.body
        n = body.contacts
        self.body, self.quarters = body, quarters
        friction = scene.drive.targets[0, 2 * body.springs :]
        rows = np.repeat(np.arange(body.springs), 2)
        incidence = sp.csr_matrix(
            (np.tile((-1.0, 1.0), body.springs), (rows, body.ends.ravel())), shape=(body.springs, n)
        )
        laplacian = incidence.T @ sp.diags(body.stiffness) @ incidence
        self.force, stiffness = float(friction.max()), float(laplacian.max())
        self.length = self.force / stiffness
        quadratic = sp.block_diag((sp.kron(laplacian / stiffness, sp.eye(2)), sp.csc_matrix((n, n))))
        order = np.argsort(np.concatenate((np.arange(2 * n) // 2 * 3 + np.arange(2 * n) % 2 + 1, 3 * np.arange(n))))
        cones = -sp.identity(3 * n, format="csc")[order]  # rows t_i, v_i; columns v, then t
        settings = clarabel.DefaultSettings()
        settings.verbose = settings.presolve_enable = settings.chordal_decomposition_enable = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        self.linear = np.concatenate((np.zeros(2 * n), friction / self.force))
        self.good = clarabel.SolverStatus.Solved
        self.solver = clarabel.DefaultSolver(
            *(sp.triu(quadratic).tocsc(), self.linear, cones.tocsc(), np.zeros(3 * n)),
            *([clarabel.SecondOrderConeT(3)] * n, settings),
        )
        self.displacement = np.array(scene.start_displacement)

    def tick(self, target: np.ndarray) -> None:
        """Take one implicit step."""
        body, x = self.body, self.displacement
        command = target[: 2 * body.springs].reshape(-1, 2)
        tension = body.stiffness[:, None] * (body.elongation(x) - command)
        self.linear[: x.size] = -body.spring_force(tension).ravel() / self.force
        self.solver.update(q=self.linear)
        answer = self.solver.solve()
        self.displacement = x + np.array(answer.x)[: x.size].reshape(x.shape) * self.length
        self.solves += 1
        self.failures += answer.status != self.good


def build_cone_peers(case: Case, ticks: tuple[int, ...]) -> list[Entrant]:
    """Build entrants of Clarabel in the plane.

    Returns:
        The entrants.
    """

    def start(tolerance: float, t: int) -> Callable[[], ConeRun]:
        return lambda: ConeRun(case.scene, case.quarters(t, t >= case.waypoints), tolerance)

    detail = "second-order cones, one implicit step per tick, each called from Python"
    return [
        Entrant(f"Clarabel {tolerance:.0e}".replace("e-0", "e-"), t, start(tolerance, t), detail)
        for tolerance in TOLERANCES
        for t in ticks
    ]
