"""One implicit step in the plane as a cone program."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .friction import corners_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array


def solve_with_clarabel(
    laplacian: csr_array, force: np.ndarray, friction: np.ndarray, directions: np.ndarray
) -> np.ndarray:
    """Solve the problem of `project_planar` as a second-order-cone program with an interior-point method.

    Args:
        laplacian: K, shape (n, n) [N/m].
        force: r, the spring forces at v = 0, shape (n, 2) [N].
        friction: mu, shape (n, 1) for isotropic friction, else (n, m) [N].
        directions: unit vectors d_k, shape (m, 2); m = 0 for isotropic friction.

    Returns:
        v, shape (n, 2) [m], to a relative accuracy of about 1e-8, including contacts at rest.
    """
    import clarabel
    from scipy import sparse

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
        corners = corners_of(friction, directions) / newton
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
