"""Entries of the account of ramps, shared by all bodies.

A target is the end of a ramp: the rest lengths of all springs, then mu_plus of all contacts, then mu_minus of all
contacts, in one row. With loads, mu_plus and mu_minus are the bounds that the loads shift, and the loads follow.
"""

from __future__ import annotations

import numpy as np

from ..compiled import lean

(
    WORK,
    DISSIPATION,
    RESIDUAL,
    VIOLATION,
    COMPLEMENTARITY,
    VISITED,
    EVENTS,
    AMBIGUOUS,
    OVERSPENT,
    GAIN_LEAST,
    GAIN_MOST,
    ROUNDING,
    UNSOLVED,
    LOADS_WORK,
    INTERNAL,
) = range(15)
"""Entries of the account: the first three, the gains, the rounding, LOADS_WORK and INTERNAL are sums, VISITED is a
minimum, the others are maxima or counts. DISSIPATION belongs to the shifted bounds: friction dissipates DISSIPATION +
LOADS_WORK. INTERNAL belongs to springs with hysteresis."""
ACCOUNT_SIZE = 15
_EMPTY = np.zeros(ACCOUNT_SIZE)
_EMPTY[VISITED] = np.inf


def empty_account(count: int | None = None) -> np.ndarray:
    """Create the account of nothing: all entries are 0, but the least stability margin is infinite.

    Args:
        count: number of accounts; None for a single one.

    Returns:
        A new array, shape (15,) or (count, 15).
    """
    return _EMPTY.copy() if count is None else np.tile(_EMPTY, (count, 1))


@lean
def dissipated(account):
    """Compute the energy lost to friction.

    Args:
        account: shape (15,).

    Returns:
        The energy [J].
    """
    return account[DISSIPATION] + account[LOADS_WORK]


SPENT = 5
"""Columns that a row of the records may have at its end, see `record_spent`."""


@lean
def record_spent(account, row):
    """Write what was spent so far to the end of a row of the records.

    It is the energy stored in elements of hysteresis, 0 here, the energy lost in them, the work of the actuators, the
    energy lost to friction and the work of the loads.

    Args:
        account: shape (15,).
        row: at least SPENT entries, output.
    """
    row[-5], row[-4] = 0.0, account[INTERNAL]
    row[-3] = account[WORK]
    row[-2] = dissipated(account)
    row[-1] = account[LOADS_WORK]
