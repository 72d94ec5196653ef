"""The state of a body on a line, a chain or any other graph of springs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..body.body import Body
from ..rounding import EPS
from .state import (
    ACTUATION,
    ACTUATION_REF,
    AT_BACKWARD,
    AT_FORWARD,
    BACKWARD,
    CONTACT_ROWS,
    FORWARD,
    GAINED,
    LINK_ROWS,
    LOAD,
    LOADED_ROWS,
    RELATIVE,
    SHAPE,
    TENSION,
    TENSION_REF,
    X,
)
from .translation import visited_margin


@dataclass(eq=False)
class LineState:
    """Rows of the contacts and of the springs, and the bounds that contacts are at.

    Attributes:
        contacts: rows X .. RELATIVE, shape (6, N); with loads X .. LOAD_WORK, shape (9, N).
        links: rows SHAPE .. ACTUATION_REF, shape (5, S).
        status: bits AT_FORWARD and AT_BACKWARD, shape (N,).
    """

    contacts: np.ndarray
    links: np.ndarray
    status: np.ndarray

    @property
    def displacement(self) -> np.ndarray:
        """Displacement x, shape (N,) [m]."""
        return self.contacts[X]

    @property
    def gained(self) -> np.ndarray:
        """Displacement gained in the last command, shape (N,) [m]."""
        return self.contacts[GAINED]

    @property
    def shape(self) -> np.ndarray:
        """Elongations z, shape (S,) [m]."""
        return self.links[SHAPE]

    @property
    def tension(self) -> np.ndarray:
        """Tensions T, shape (S,) [N]."""
        return self.links[TENSION]

    @property
    def actuation(self) -> np.ndarray:
        """Rest-length changes L in force, shape (S,) [m]."""
        return self.links[ACTUATION]

    @property
    def friction(self) -> np.ndarray:
        """Friction in force, forward then backward, shape (2 N,) [N]."""
        if self.loads.size == 0:
            return self.contacts[[FORWARD, BACKWARD]].ravel()
        return np.concatenate((self.contacts[FORWARD] + self.loads, self.contacts[BACKWARD] - self.loads))

    @property
    def bounds(self) -> np.ndarray:
        """Bounds of the spring forces as in a target: friction shifted by the loads, shape (2 N,) [N]."""
        return self.contacts[[FORWARD, BACKWARD]].ravel()

    @property
    def loads(self) -> np.ndarray:
        """Loads in force, the slope's share included, shape (N,) [N]; shape (0,) without loads."""
        return self.contacts[LOAD : LOAD + 1].ravel()

    @property
    def contact_state(self) -> np.ndarray:
        """1 if a contact slid forward in the last command, -1 backward, 0 stuck; int8, shape (N,)."""
        return np.sign(self.gained).astype(np.int8)

    def margins(self, force: np.ndarray) -> np.ndarray:
        """Compute the distance of the spring forces from their nearest bounds.

        Args:
            force: g, shape (N,) [N].

        Returns:
            Shape (N,) [N].
        """
        return np.minimum(self.contacts[FORWARD] - force, force + self.contacts[BACKWARD])

    def visited_margin(self, force: np.ndarray) -> float:
        """Compute how close all contacts are to sliding at once.

        Args:
            force: g, shape (N,) [N].

        Returns:
            The margin [1].
        """
        return visited_margin(force, self.contacts[FORWARD], self.contacts[BACKWARD])

    def copy(self) -> LineState:
        """Copy the state.

        Returns:
            An independent state with the same numbers.
        """
        return LineState(self.contacts.copy(), self.links.copy(), self.status.copy())

    def bits(self) -> bytes:
        """Return all numbers as bytes, for comparison.

        Returns:
            The bytes of all arrays, one after another.
        """
        return b"".join(a.tobytes() for a in (self.contacts, self.links, self.status))


def build_line_state(body: Body, x: np.ndarray, target: np.ndarray) -> LineState:
    """Build the state of a body at rest on a line.

    Args:
        body: the body.
        x: displacement, shape (..., N) [m].
        target: the command in force, shape (..., S + 2 N).

    Returns:
        The state; of variations its arrays have a leading axis. Contacts within rounding of a bound are taken to be at
        that bound.
    """
    n = body.contacts
    lengths, forward, backward, loads = np.split(target, body.springs + n * np.arange(3), axis=-1)
    contacts = np.zeros((*x.shape[:-1], LOADED_ROWS if loads.size else CONTACT_ROWS, n))
    links = np.zeros((*x.shape[:-1], LINK_ROWS, body.springs))
    contacts[..., X, :] = contacts[..., RELATIVE, :] = x
    contacts[..., FORWARD, :], contacts[..., BACKWARD, :] = forward, backward
    if loads.size:
        contacts[..., LOAD, :] = loads
    links[..., ACTUATION, :] = links[..., ACTUATION_REF, :] = lengths
    links[..., SHAPE, :] = body.elongation(x)
    tension = body.stiffness * (links[..., SHAPE, :] - lengths)
    links[..., TENSION, :] = links[..., TENSION_REF, :] = tension
    return LineState(contacts, links, _status_at_rest(body, tension, forward, backward))


def _status_at_rest(body: Body, tension: np.ndarray, forward: np.ndarray, backward: np.ndarray) -> np.ndarray:
    """Find the bounds that contacts are at within rounding; both bounds only without friction."""
    g = body.spring_force(tension)
    friction = forward + backward
    near = 32.0 * EPS * (body.force_size(tension) + friction)
    above, below = forward - g, g + backward
    none = friction == 0.0
    at_forward = none | ((above <= near) & (above <= below))
    at_backward = none | ((below <= near) & (below < above))
    return (AT_FORWARD * at_forward + AT_BACKWARD * at_backward).astype(np.int8)
