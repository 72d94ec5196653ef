"""Friction of the contacts: mu_plus opposes sliding towards +x, mu_minus towards -x; each may be commanded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .body import frozen, spread
from .errors import CommandError, SceneError


@dataclass(frozen=True, eq=False)
class Friction:
    """Magnitudes of the friction force.

    Attributes:
        forward: mu_plus, shape (N,) [N].
        backward: mu_minus, shape (N,) [N].
    """

    forward: np.ndarray
    backward: np.ndarray


def build_friction(forward: ArrayLike, backward: ArrayLike, contacts: int) -> Friction:
    """Build the friction of all contacts.

    Args:
        forward: mu_plus, one number or shape (N,), >= 0 [N].
        backward: mu_minus, likewise [N].
        contacts: number of contacts N.

    Returns:
        The friction, its arrays read-only.

    Raises:
        SceneError: naming the contact whose friction is negative, or the wrong length.
    """
    sides = {}
    for name, values in (("forward", forward), ("backward", backward)):
        mu = spread(values, contacts, f"friction.{name}", "contact")
        for i in np.flatnonzero(~(mu >= 0.0)):
            raise SceneError(f"friction.{name}: contact {i} has {mu[i]:g} N; friction must be >= 0")
        sides[name] = frozen(mu)
    return Friction(sides["forward"], sides["backward"])


def spread_command(values: np.ndarray, contacts: int) -> tuple[np.ndarray, np.ndarray]:
    """Read a friction command: one value, one per contact (isotropic), or all forward and then all backward.

    Args:
        values: shape (1,), (N,) or (2 N,) [N].
        contacts: number of contacts N.

    Returns:
        mu_plus and mu_minus, each of shape (N,) [N].

    Raises:
        CommandError: when the length is another.
    """
    if values.size == 2 * contacts:
        return values[:contacts], values[contacts:]
    if values.size == contacts:
        return values, values
    if values.size == 1:
        both = np.full(contacts, values[0])
        return both, both
    raise CommandError(
        f"friction command has {values.size} value(s); give 1, {contacts} (one per contact) or "
        f"{2 * contacts} (all forward, then all backward)"
    )
