"""Quadratic-programming solvers on the catch-up step, with a common interface.

    minimise  1/2 T' P T + q' T   subject to  lower <= G T <= upper

over the tensions T of all springs, made dimensionless: P = mean(k) / k, q = -(mean(k) / k) T_trial, G T the spring
forces on the contacts and lower, upper = -mu_minus, mu_plus. The multipliers of the bounds *are* the displacements of
the tick: by stationarity the springs lengthen by the differences of the multipliers, and a contact strictly inside its
bounds has multiplier 0 and does not move. So each solver yields x at no extra cost.

A backend is set up once for a crawler and returns a function (q, lower, upper) -> (multipliers, solved). Bounds are
None when they are the same as before. Matrices are sparse if the solver has a sparse version; factorisations are
reused and starts are warm if the solver supports it.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from crawler_model import Scene
from crawler_model.theory.uniqueness import choose_translation

from ..cases import Case
from .entrant import Entrant, TickByTick

Solve = Callable[[np.ndarray, "np.ndarray | None", "np.ndarray | None"], "tuple[np.ndarray, bool]"]


@dataclass(frozen=True, eq=False)
class Problem:
    """The constant parts of the quadratic program; all dimensionless.

    Attributes:
        weight: diagonal of P, shape (S,).
        forces: G, the sum of tensions on each contact, sparse, shape (N, S).
        lower: lower bounds at the start, shape (N,).
        upper: upper bounds at the start, shape (N,).
        tolerance: tolerance of the solver.
        patience: longest time of one solution, for solvers with a time limit [s].
    """

    weight: np.ndarray
    forces: Any
    lower: np.ndarray
    upper: np.ndarray
    tolerance: float
    patience: float

    @property
    def hessian(self) -> Any:
        """P as a sparse matrix."""
        return sp.diags(self.weight).tocsc()


def set_up_osqp(problem: Problem, polishing: bool = False) -> Solve:
    """Set up OSQP: operator splitting, warm-started, step size adapted, factorisation reused.

    Returns:
        The solver.
    """
    import osqp

    solver = osqp.OSQP()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        solver.setup(
            *(problem.hessian, np.zeros(problem.weight.size), problem.forces, problem.lower, problem.upper),
            verbose=False,
            eps_abs=problem.tolerance,
            eps_rel=problem.tolerance,
            max_iter=1_000_000,
            check_termination=10,
            adaptive_rho=True,
            polishing=polishing,
            time_limit=problem.patience,
        )

    def solve(q: np.ndarray, lower: np.ndarray | None, upper: np.ndarray | None) -> tuple[np.ndarray, bool]:
        solver.update(q=q) if lower is None else solver.update(q=q, l=lower, u=upper)
        answer = solver.solve(raise_error=False)
        return answer.y, answer.info.status_val == 1

    return solve


def set_up_clarabel(problem: Problem) -> Solve:
    """Set up Clarabel: interior points; data are updated in place, a warm start is not possible.

    Returns:
        The solver.
    """
    import clarabel

    n = problem.lower.size
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.presolve_enable = False  # so that data can be updated
    settings.time_limit = problem.patience
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = problem.tolerance
    both = sp.vstack((problem.forces, -problem.forces)).tocsc()
    bounds = np.concatenate((problem.upper, -problem.lower))
    cones = [clarabel.NonnegativeConeT(2 * n)]
    solver = clarabel.DefaultSolver(problem.hessian, np.zeros(problem.weight.size), both, bounds, cones, settings)

    def solve(q: np.ndarray, lower: np.ndarray | None, upper: np.ndarray | None) -> tuple[np.ndarray, bool]:
        if lower is None or upper is None:
            solver.update(q=q)
        else:
            solver.update(q=q, b=np.concatenate((upper, -lower)))
        answer = solver.solve()
        z = np.array(answer.z)
        return z[:n] - z[n:], answer.status == clarabel.SolverStatus.Solved

    return solve


def set_up_daqp(problem: Problem) -> Solve:
    """Set up DAQP: a dual active-set method, dense, factorisation and working set reused from tick to tick.

    Returns:
        The solver.
    """
    import daqp

    model = daqp.Model()
    model.setup(
        *(np.diag(problem.weight), np.zeros(problem.weight.size), np.ascontiguousarray(problem.forces.toarray())),
        *(problem.upper.copy(), problem.lower.copy()),
    )
    model.settings = {"primal_tol": problem.tolerance, "dual_tol": problem.tolerance, "iter_limit": 100_000}

    def solve(q: np.ndarray, lower: np.ndarray | None, upper: np.ndarray | None) -> tuple[np.ndarray, bool]:
        model.update(f=q) if lower is None else model.update(f=q, bupper=upper, blower=lower)
        _, _, flag, info = model.solve()
        return info["lam"], flag == 1

    return solve


def set_up_piqp(problem: Problem) -> Solve:
    """Set up PIQP: proximal interior points, sparse; data updated in place, scaling reused.

    Returns:
        The solver.
    """
    import piqp

    solver = piqp.SparseSolver()
    settings = solver.settings
    settings.verbose = False
    settings.eps_abs = settings.eps_rel = problem.tolerance
    settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = problem.tolerance
    settings.check_duality_gap = True
    settings.preconditioner_reuse_on_update = True
    zeros = np.zeros(problem.weight.size)
    solver.setup(problem.hessian, zeros, None, None, problem.forces, problem.lower, problem.upper)

    def solve(q: np.ndarray, lower: np.ndarray | None, upper: np.ndarray | None) -> tuple[np.ndarray, bool]:
        solver.update(c=q) if lower is None else solver.update(c=q, h_l=lower, h_u=upper)
        status = solver.solve()
        return solver.result.z_u - solver.result.z_l, status == piqp.PIQP_SOLVED

    return solve


def set_up_proxqp(problem: Problem) -> Solve:
    """Set up ProxQP: a proximal augmented Lagrangian, sparse, warm-started with the last result.

    Without the check of the duality gap a warm start stops too early, with multipliers that are wrong by up to 1e-4.
    After long ticks a warm start may fail; the tick is then solved again from scratch. The dense version crashes on a
    warm start (proxsuite 0.8.0), so it is not used.

    Returns:
        The solver.
    """
    from proxsuite import proxqp

    s, n = problem.weight.size, problem.lower.size
    solver = proxqp.sparse.QP(s, 0, n)
    settings = solver.settings
    settings.eps_abs, settings.eps_rel, settings.verbose = problem.tolerance, 0.0, False
    settings.check_duality_gap = True
    settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = problem.tolerance, 0.0
    settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
    solver.init(problem.hessian, np.zeros(s), None, None, problem.forces, problem.lower, problem.upper)

    def solve(q: np.ndarray, lower: np.ndarray | None, upper: np.ndarray | None) -> tuple[np.ndarray, bool]:
        solver.update(g=q) if lower is None else solver.update(g=q, l=lower, u=upper)
        solver.solve()
        if solver.results.info.status != proxqp.QPSolverOutput.PROXQP_SOLVED:
            settings.initial_guess = proxqp.InitialGuess.NO_INITIAL_GUESS
            solver.solve()
            settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        return np.array(solver.results.z), solver.results.info.status == proxqp.QPSolverOutput.PROXQP_SOLVED

    return solve


@dataclass(frozen=True)
class Backend:
    """A solver.

    Attributes:
        module: module that must be installed.
        set_up: function that sets it up.
        tolerances: tolerances to which it solves.
        largest: largest number of contacts for which it is run.
        detail: remarks on how it is run.
    """

    module: str
    set_up: Callable[[Problem], Solve]
    tolerances: tuple[float, ...]
    largest: int
    detail: str


BACKENDS: dict[str, Backend] = {
    "OSQP": Backend("osqp", set_up_osqp, (1e-3, 1e-6, 1e-9), 1_000_000, "sparse, warm start, factorisation reused"),
    "OSQP polished": Backend(
        *("osqp", functools.partial(set_up_osqp, polishing=True), (1e-6,), 1_000_000),
        "tolerance 1e-6, then polished; sparse, warm start, factorisation reused except for polishing",
    ),
    "Clarabel": Backend("clarabel", set_up_clarabel, (1e-9, 1e-12), 1_000_000, "sparse, data updated, no warm start"),
    "DAQP": Backend("daqp", set_up_daqp, (1e-9,), 1_000, "dense, factorisation and working set reused"),
    "PIQP": Backend("piqp", set_up_piqp, (1e-9, 1e-12), 1_000_000, "sparse, data updated, no warm start"),
    "ProxQP": Backend("proxsuite", set_up_proxqp, (1e-9,), 1_000, "sparse, warm start, duality gap checked"),
}


class QpRun(TickByTick):
    """Catch-up steps by a quadratic program. The state is only x: tensions and displacements agree."""

    def __init__(self, scene: Scene, quarters: tuple[np.ndarray, ...], backend: Backend, tolerance: float) -> None:
        """Set the solver up at the scene's start."""
        body, drive = scene.body, scene.drive
        n, s = body.contacts, body.springs
        self.tail, self.head = body.ends.T.copy()
        self.is_chain, self.elements, self.share = body.is_chain, body.element_ends, body.share
        self.counts = (s, s + n)
        self.displacement = np.array(scene.start_displacement)
        self.force = float(drive.targets[:, s:].max())
        self.length = self.force / float(body.stiffness.mean())
        self.commanded = bool(np.ptp(drive.targets[:, s:], axis=0).any())
        self.forward, self.backward = drive.forward[0], drive.backward[0]
        # if friction changes at the end of a tick, or contacts represent elements of a segment, the multipliers do not
        # determine the translation while the whole body slides: it is then chosen as in our own step
        self.chooses = self.commanded or self.elements.size > 0
        columns = np.arange(s)
        forces = sp.csc_matrix(
            (np.repeat([1.0, -1.0], s), (np.concatenate((self.tail, self.head)), np.tile(columns, 2))), shape=(n, s)
        )
        bounds = -self.backward / self.force, self.forward / self.force
        weight = body.stiffness.mean() / body.stiffness
        self.solve = backend.set_up(Problem(weight, forces, *bounds, tolerance, patience=2.0))
        self.quarters = quarters

    def tick(self, target: np.ndarray) -> None:
        """Take one catch-up step."""
        s, half = self.counts
        x = self.displacement
        shape = x[1:] - x[:-1] if self.is_chain else x[self.head] - x[self.tail]
        q = (target[:s] - shape) / self.length
        forward, backward = target[s:half], target[half:]
        if self.commanded:
            y, solved = self.solve(q, -backward / self.force, forward / self.force)
        else:
            y, solved = self.solve(q, None, None)
        moved = y * self.length
        if self.chooses:
            mean = 0.5 * (forward + self.forward), 0.5 * (backward + self.backward)
            choose_translation(moved, *mean, self.elements, self.share)
            self.forward, self.backward = forward, backward
        self.displacement = x + moved
        self.solves += 1
        self.failures += not solved


def build_qp_peers(case: Case, ticks: tuple[int, ...]) -> list[Entrant]:
    """Build entrants of all solvers.

    Returns:
        The entrants, also if not installed.
    """

    def start(backend: Backend, tolerance: float, t: int) -> Callable[[], QpRun]:
        return lambda: QpRun(case.scene, case.quarters(t, t >= case.waypoints), backend, tolerance)

    note = "; called from Python for each tick"
    return [
        Entrant(
            f"{name} {tolerance:.0e}".replace("e-0", "e-") if len(backend.tolerances) > 1 else name,
            t,
            start(backend, tolerance, t),
            backend.detail + note,
            largest=backend.largest,
            implicit=True,
        )
        for name, backend in BACKENDS.items()
        for tolerance in backend.tolerances
        for t in ticks
    ]
