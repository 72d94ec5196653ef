"""What a crawler's state consists of, and the account that every ramp adds to: rows of arrays, shared by all bodies.

Forces and lengths are rows of two arrays, one with a column per contact and one with a column per spring, so that a
compiled call costs little. A target is where a ramp goes: the rest lengths of all springs, then mu_plus of all
contacts, then mu_minus of all contacts, in one row.
"""

from __future__ import annotations

from ..compiled import compiled

X, X_REST, FORWARD, BACKWARD, GAINED, RELATIVE = range(6)
"""Rows of the contacts: displacement and what rounding took from it; mu_plus; mu_minus; displacement gained since
`follow` was called; displacement relative to a place that travels with the body, small however far it has gone."""
CONTACT_ROWS = 6

SHAPE, TENSION, ACTUATION, TENSION_REF, ACTUATION_REF = range(5)
"""Rows of the springs: z; T; L; T and L when the spring last moved."""
LINK_ROWS = 5

STIFFNESS, COMPLIANCE = range(2)
"""Rows of a body's elasticity: k and 1 / k of each spring."""

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
"""Entries of the account: the first three, the gains and the rounding are sums, VISITED is a least, the others are
greatest values or counts."""
ACCOUNT_SIZE = 13

_RETURNED = 2.0**-50

AT_FORWARD, AT_BACKWARD = 1, 2
"""Bits of a contact's status: the spring force equals mu_plus, or -mu_minus. Both when there is no friction."""


@compiled
def shift(contacts, velocity, ds, i):
    """Move contact i, keeping what rounding takes (compensated summation). A way back to within rounding gains nothing.

    Args:
        contacts: rows X .. RELATIVE, shape (6, N), changed in place.
        velocity: of contact i [m per unit of the ramp].
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
    """Add the account of one ramp to that of all.

    Args:
        account: shape (13,), changed in place.
        ramp: shape (13,).
    """
    for entry in (WORK, DISSIPATION, RESIDUAL, EVENTS, OVERSPENT, GAIN_LEAST, GAIN_MOST, ROUNDING, UNSOLVED):
        account[entry] += ramp[entry]
    for entry in (VIOLATION, COMPLEMENTARITY, AMBIGUOUS):
        account[entry] = max(account[entry], ramp[entry])
    account[VISITED] = min(account[VISITED], ramp[VISITED])
