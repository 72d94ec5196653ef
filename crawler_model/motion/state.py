"""Rows of the state arrays and entries of the account of ramps, shared by all bodies.

Forces and lengths are rows of two arrays, one with a column per contact and one with a column per spring, so that a
compiled call has little overhead. A target is the end of a ramp: the rest lengths of all springs, then mu_plus of all
contacts, then mu_minus of all contacts, in one row.
"""

from __future__ import annotations

from ..compiled import compiled

X, X_REST, FORWARD, BACKWARD, GAINED, RELATIVE = range(6)
"""Rows of the contacts: displacement and its rounding rest; mu_plus; mu_minus; displacement gained since `follow` was
called; displacement relative to a point that travels with the body, which stays small over any distance."""
CONTACT_ROWS = 6

SHAPE, TENSION, ACTUATION, TENSION_REF, ACTUATION_REF = range(5)
"""Rows of the springs: z; T; L; T and L when the elongation last changed."""
LINK_ROWS = 5

STIFFNESS, COMPLIANCE = range(2)
"""Rows of the elasticity of a body: k and 1 / k of each spring."""

PLANAR_X, PLANAR_X_REST, PLANAR_GAINED = range(3)
PLANAR_TENSION, PLANAR_ACTUATION = range(2)
"""Rows of the contacts and of the springs in the plane."""

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
) = range(13)
"""Entries of the account: the first three, the gains and the rounding are sums, VISITED is a minimum, the others are
maxima or counts."""
ACCOUNT_SIZE = 13

_RETURNED = 2.0**-50

AT_FORWARD, AT_BACKWARD = 1, 2
"""Bits of a contact's status: the spring force equals mu_plus, or -mu_minus. Both when there is no friction."""


@compiled
def shift(contacts, velocity, ds, i):
    """Move contact i with compensated summation. A gain that cancels to within rounding is set to zero.

    Args:
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        velocity: velocity of contact i [m per unit of the ramp].
        ds: part of the ramp.
        i: the contact.
    """
    gained = contacts[GAINED, i] + velocity * ds
    contacts[GAINED, i] = gained if abs(gained) > _RETURNED * abs(velocity * ds) else 0.0
    step = velocity * ds + contacts[X_REST, i]
    before = contacts[X, i]
    after = before + step
    contacts[X, i] = after
    contacts[X_REST, i] = (before - after) + step


@compiled
def add_ramp(account, ramp):
    """Add the account of one ramp to the total.

    Args:
        account: the total, shape (13,), changed in place.
        ramp: account of the ramp, shape (13,).
    """
    for entry in (WORK, DISSIPATION, RESIDUAL, EVENTS, OVERSPENT, GAIN_LEAST, GAIN_MOST, ROUNDING, UNSOLVED):
        account[entry] += ramp[entry]
    for entry in (VIOLATION, COMPLEMENTARITY, AMBIGUOUS):
        account[entry] = max(account[entry], ramp[entry])
    account[VISITED] = min(account[VISITED], ramp[VISITED])


@compiled
def is_in_force(contacts, links, target):
    """Determine whether a target equals the command in force.

    Args:
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        target: L, mu_plus and mu_minus, shape (S + 2 N,).
    """
    n = contacts.shape[1]
    springs = links.shape[1]
    for s in range(springs):
        if target[s] != links[ACTUATION, s]:
            return False
    for i in range(n):
        if target[springs + i] != contacts[FORWARD, i] or target[springs + n + i] != contacts[BACKWARD, i]:
            return False
    return True


@compiled
def record(contacts, links, row):
    """Write the present displacement, its rounding rest and the tension to a row of the records.

    Args:
        contacts: rows X .. RELATIVE, shape (6, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        row: shape (2 N + S,), output.
    """
    n = contacts.shape[1]
    for i in range(n):
        row[i] = contacts[X, i]
        row[n + i] = contacts[X_REST, i]
    for s in range(links.shape[1]):
        row[2 * n + s] = links[TENSION, s]
