"""The body: contacts on a line, joined by springs whose rest lengths are commanded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from .errors import SceneError


@dataclass(frozen=True, eq=False)
class Body:
    """A chain of contacts.

    Attributes:
        position: reference positions xi, strictly increasing, shape (N,) [m].
        stiffness: k of the link between contacts i and i + 1, shape (N - 1,) [N/m].
    """

    position: np.ndarray
    stiffness: np.ndarray

    @property
    def contacts(self) -> int:
        """Number of contacts N."""
        return int(self.position.size)

    @property
    def links(self) -> int:
        """Number of links."""
        return int(self.stiffness.size)


def build_body(contacts: ArrayLike, stiffness: ArrayLike, between: list[tuple[int, int]] | None = None) -> Body:
    """Build a chain from what a scene says of it.

    Args:
        contacts: reference positions, shape (N,), N >= 2, strictly increasing [m].
        stiffness: one number, or one per link, > 0 [N/m].
        between: the pairs of contacts that links join; None for the chain of neighbours.

    Returns:
        The body, its arrays read-only.

    Raises:
        SceneError: naming the contact or link that does not fit.
    """
    position = np.array(contacts, dtype=np.float64)
    if position.size < 2:
        raise SceneError(f"body.contacts: {position.size} contact(s); a crawler needs at least 2")
    for i in np.flatnonzero(np.diff(position) <= 0.0):
        raise SceneError(
            f"body.contacts: contact {i + 1} at {position[i + 1]:g} m does not lie beyond contact {i} at "
            f"{position[i]:g} m; positions must be strictly increasing"
        )
    links = position.size - 1
    if between is not None:
        check_chain(between, position.size)
    k = spread(stiffness, links, "body.links.stiffness", "link")
    for i in np.flatnonzero(~(k > 0.0)):
        raise SceneError(f"body.links.stiffness: link {i} has {k[i]:g} N/m; it must be > 0")
    return Body(frozen(position), frozen(k))


def check_chain(between: list[tuple[int, int]], contacts: int) -> None:
    """Check that the links join each contact to the next, in order.

    Args:
        between: pairs of contacts.
        contacts: number of contacts N.

    Raises:
        SceneError: naming the first link that does not.
    """
    for i, (a, b) in enumerate(between):
        if (a, b) != (i, i + 1) or i >= contacts - 1:
            raise SceneError(
                f"body.links.between: link {i} joins contacts {a} and {b}; only the chain of neighbours "
                "[[0, 1], [1, 2], ...] is available, in that order (leave `between` out for it)"
            )
    if len(between) != contacts - 1:
        raise SceneError(
            f"body.links.between: {len(between)} link(s) for {contacts} contacts; the chain has {contacts - 1}"
        )


def spread(values: ArrayLike, size: int, field: str, item: str) -> np.ndarray:
    """Spread one number over all entries, or check that there is one per entry.

    Args:
        values: one number or `size` of them.
        size: how many entries there are.
        field: where the values come from, for the error.
        item: what one entry belongs to, for the error.

    Returns:
        A new array of shape (size,).

    Raises:
        SceneError: when there is neither one number nor one per entry.
    """
    given = np.asarray(values, dtype=np.float64)
    if given.ndim == 0:
        return np.full(size, float(given))
    if given.shape != (size,):
        raise SceneError(f"{field}: {given.size} value(s) for {size} {item}(s); give one number or {size}")
    return given.copy()


def frozen(array: ArrayLike) -> np.ndarray:
    """Copy an array of floats and forbid writing to the copy.

    Args:
        array: any shape.

    Returns:
        A read-only float64 copy.
    """
    copy = np.array(array, dtype=np.float64)
    copy.flags.writeable = False
    return copy
