"""Rows of the state arrays and entries of the account of ramps, shared by all bodies.

Forces and lengths are rows of two arrays, one with a column per contact and one with a column per spring, so that a
compiled call has little overhead. A target is the end of a ramp: the rest lengths of all springs, then mu_plus of all
contacts, then mu_minus of all contacts, in one row. With loads, mu_plus and mu_minus are the bounds that the loads
shift, and the loads follow.
"""

from __future__ import annotations

from ..compiled import lean

X, X_REST, FORWARD, BACKWARD, GAINED, RELATIVE = range(6)
"""Rows of the contacts: displacement and its rounding rest; mu_plus; mu_minus; displacement gained since `follow` was
called; displacement relative to a point that travels with the body, which stays small over any distance."""
CONTACT_ROWS = 6
LOAD, LOAD_CHANGE, LOAD_WORK = range(6, 9)
"""Further rows of the contacts where there are loads: f, its change along the ramp, and its work on the ramp so far.
The rows FORWARD and BACKWARD are then the bounds mu_plus - f and mu_minus + f."""
LOADED_ROWS = 9

SHAPE, TENSION, ACTUATION, TENSION_REF, ACTUATION_REF = range(5)
"""Rows of the springs: z; T; L; T and L when the elongation last changed."""
LINK_ROWS = 5

STIFFNESS, COMPLIANCE = range(2)
"""Rows of the elasticity of a body: k and 1 / k of each spring."""

PLANAR_X, PLANAR_X_REST, PLANAR_GAINED, PLANAR_LOAD = range(4)
PLANAR_TENSION, PLANAR_ACTUATION = range(2)
"""Rows of the contacts, the last one only where there are loads, and of the springs in the plane."""

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
) = range(14)
"""Entries of the account: the first three, the gains, the rounding and LOADS_WORK are sums, VISITED is a minimum, the
others are maxima or counts. DISSIPATION is that of the shifted bounds: friction dissipates DISSIPATION + LOADS_WORK."""
ACCOUNT_SIZE = 14


@lean
def dissipated(account):
    """Compute the energy lost to friction.

    Args:
        account: shape (14,).

    Returns:
        The energy [J].
    """
    return account[DISSIPATION] + account[LOADS_WORK]


_RETURNED = 2.0**-50

AT_FORWARD, AT_BACKWARD = 1, 2
"""Bits of a contact's status: the spring force equals mu_plus, or -mu_minus. Both when there is no friction."""


@lean
def shift(contacts, velocity, ds, i, middle):
    """Move contact i with compensated summation. A gain that cancels to within rounding is set to zero.

    Args:
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        velocity: velocity of contact i [m per unit of the ramp].
        ds: part of the ramp.
        i: the contact.
        middle: of this part of the ramp, 0 .. 1.
    """
    if contacts.shape[0] > CONTACT_ROWS:
        contacts[LOAD_WORK, i] += (contacts[LOAD, i] + middle * contacts[LOAD_CHANGE, i]) * velocity * ds
    gained = contacts[GAINED, i] + velocity * ds
    contacts[GAINED, i] = gained if abs(gained) > _RETURNED * abs(velocity * ds) else 0.0
    step = velocity * ds + contacts[X_REST, i]
    before = contacts[X, i]
    after = before + step
    contacts[X, i] = after
    contacts[X_REST, i] = (before - after) + step


@lean
def begin_loads(contacts, target):
    """Compute at the start of a ramp how the loads change along it.

    Args:
        contacts: rows X .. LOAD_WORK, shape (9, N), changed in place; without loads nothing is done.
        target: L, bounds and loads at the end of the ramp, shape (S + 3 N,).
    """
    if contacts.shape[0] > CONTACT_ROWS:
        n = contacts.shape[1]
        first = target.shape[0] - n
        for i in range(n):
            contacts[LOAD_CHANGE, i] = target[first + i] - contacts[LOAD, i]
            contacts[LOAD_WORK, i] = 0.0


@lean
def advance_loads(contacts, part):
    """Move the loads to a place on a ramp, so that the rest can be followed as a ramp of its own.

    Args:
        contacts: as for `begin_loads`.
        part: the place, 0 .. 1.
    """
    if contacts.shape[0] > CONTACT_ROWS:
        for i in range(contacts.shape[1]):
            contacts[LOAD, i] += part * contacts[LOAD_CHANGE, i]
            contacts[LOAD_CHANGE, i] *= 1.0 - part


@lean
def end_loads(contacts, target, account):
    """Set the loads to those at the end of a ramp, and add their work to the account.

    Args:
        contacts: as for `begin_loads`.
        target: as for `begin_loads`.
        account: shape (14,), changed in place.
    """
    if contacts.shape[0] > CONTACT_ROWS:
        n = contacts.shape[1]
        first = target.shape[0] - n
        for i in range(n):
            account[LOADS_WORK] += contacts[LOAD_WORK, i]
            contacts[LOAD, i] = target[first + i]


@lean
def add_ramp(account, ramp):
    """Add the account of one ramp to the total.

    Args:
        account: the total, shape (14,), changed in place.
        ramp: account of the ramp, shape (14,).
    """
    for entry in (
        WORK,
        DISSIPATION,
        RESIDUAL,
        EVENTS,
        OVERSPENT,
        GAIN_LEAST,
        GAIN_MOST,
        ROUNDING,
        UNSOLVED,
        LOADS_WORK,
    ):
        account[entry] += ramp[entry]
    for entry in (VIOLATION, COMPLEMENTARITY, AMBIGUOUS):
        account[entry] = max(account[entry], ramp[entry])
    account[VISITED] = min(account[VISITED], ramp[VISITED])


@lean
def is_in_force(contacts, links, target):
    """Determine whether a target equals the command in force.

    Args:
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        target: L and bounds, with loads then these, shape (S + 2 N,) or (S + 3 N,).

    Returns:
        True if a ramp to the target would change nothing.
    """
    n = contacts.shape[1]
    springs = links.shape[1]
    for s in range(springs):
        if target[s] != links[ACTUATION, s]:
            return False
    for i in range(n):
        if target[springs + i] != contacts[FORWARD, i] or target[springs + n + i] != contacts[BACKWARD, i]:
            return False
        if contacts.shape[0] > CONTACT_ROWS and target[springs + 2 * n + i] != contacts[LOAD, i]:
            return False
    return True


SPENT = 3
"""Columns that a row of the records may have at its end, see `record_spent`."""


@lean
def record_spent(account, row):
    """Write the work, the energy lost to friction and the work of the loads so far to the end of a row of the records.

    Args:
        account: shape (14,).
        row: at least SPENT entries, output.
    """
    row[-3] = account[WORK]
    row[-2] = dissipated(account)
    row[-1] = account[LOADS_WORK]


@lean
def record(contacts, links, account, row):
    """Write the present displacement, its rounding rest and the tension to a row of the records.

    Args:
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        account: shape (14,).
        row: shape (2 N + S,), or with SPENT further columns for what `record_spent` writes, output.
    """
    n = contacts.shape[1]
    for i in range(n):
        row[i] = contacts[X, i]
        row[n + i] = contacts[X_REST, i]
    for s in range(links.shape[1]):
        row[2 * n + s] = links[TENSION, s]
    if row.shape[0] > 2 * n + links.shape[1]:
        record_spent(account, row)
