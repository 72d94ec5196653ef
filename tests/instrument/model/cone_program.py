"""One implicit step in the plane as a cone program: a judge outside the project's own code."""

from __future__ import annotations

import clarabel
import numpy as np
from scipy import sparse


def laplacian_of(ends: np.ndarray, stiffness: np.ndarray, contacts: int) -> sparse.csr_array:
    """Build the weighted Laplacian of springs.

    Args:
        ends: the contacts of each spring, shape (S, 2).
        stiffness: k, shape (S,) [N/m].
        contacts: number of contacts N.

    Returns:
        K, shape (N, N) [N/m].
    """
    rows = np.repeat(np.arange(len(ends)), 2)
    values = np.tile((-1.0, 1.0), len(ends))
    incidence = sparse.csr_array((values, (rows, np.ravel(ends))), shape=(len(ends), contacts))
    return sparse.csr_array(incidence.T @ sparse.diags_array(stiffness) @ incidence)


def solve_with_clarabel(
    laplacian: sparse.csr_array, force: np.ndarray, friction: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Solve an implicit step of vector springs as a second-order-cone program with an interior-point method.

    Args:
        laplacian: K, shape (n, n) [N/m].
        force: r, the spring forces at v = 0, shape (n, 2) [N].
        friction: mu, shape (n, 1) for isotropic friction, else (n, m) [N].
        directions: unit vectors d_k, shape (m, 2); m = 0 for isotropic friction.

    Returns:
        v, shape (n, 2) [m], to a relative accuracy of about 1e-8, including contacts at rest.
    """
    n, m = force.shape[0], directions.shape[0]
    newton = max(np.abs(force).max(), friction.max())
    scaled = laplacian.diagonal().max()
    metre = newton / scaled
    if newton == 0.0:
        return np.zeros((n, 2))
    own = sparse.kron(laplacian / scaled, sparse.eye_array(2))
    quadratic = sparse.block_diag((own, sparse.csc_array((n, n))))
    linear = np.concatenate((-force.ravel() / newton, np.zeros(n)))  # unknowns v_i, then t_i = R_i(v_i)
    if m == 0:
        linear[2 * n :] = friction[:, 0] / newton
        rows = sparse.lil_array((3 * n, 3 * n))
        for i in range(n):
            rows[3 * i, 2 * n + i] = rows[3 * i + 1, 2 * i] = rows[3 * i + 2, 2 * i + 1] = -1.0
            if friction[i, 0] == 0.0:
                linear[2 * n + i] = 0.0
                rows[3 * i + 1, 2 * i] = rows[3 * i + 2, 2 * i + 1] = 0.0
        cones = [clarabel.SecondOrderConeT(3)] * n
    else:
        linear[2 * n :] = 1.0
        after = np.roll(directions, -1, axis=0)
        edges = np.stack((directions, after), axis=1)[None]
        corners = np.linalg.solve(edges, np.stack((friction, np.roll(friction, -1, axis=1)), axis=2)[..., None])[..., 0]
        corners /= newton
        rows = sparse.lil_array((m * n, 3 * n))
        for i in range(n):
            rows[m * i : m * (i + 1), 2 * i : 2 * i + 2] = corners[i]
            rows[m * i : m * (i + 1), [2 * n + i]] = -np.ones((m, 1))
        cones = [clarabel.NonnegativeConeT(m * n)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-13
    matrix = rows.tocsc()
    answer = clarabel.DefaultSolver(
        sparse.csc_matrix(sparse.triu(quadratic)), linear, matrix, np.zeros(matrix.shape[0]), cones, settings
    )
    return np.asarray(answer.solve().x)[: 2 * n].reshape(n, 2) * metre
