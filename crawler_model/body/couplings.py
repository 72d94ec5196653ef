"""Friction that changes as springs change their lengths, as of a worm that swells in a tube as it shortens."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Coupling:
    """Friction that the elongation of a spring adds to the bounds of a contact: linear between knots, constant beyond.

    Attributes:
        contact: the contact.
        spring: the spring.
        ends: the two contacts that the spring joins, the first of which lies before the second.
        at: elongations of the spring, the knots, strictly increasing, shape (K,) [m].
        added: friction there, forward and backward, at least 0, shape (2, K) [N].
    """

    contact: int
    spring: int
    ends: tuple[int, int]
    at: np.ndarray
    added: np.ndarray

    @property
    def pieces(self) -> np.ndarray:
        """Its straight pieces in order, shape (K + 1, 7).

        From where to where [m]; an elongation on the piece [m], and there the friction forward [N], its slope [N/m],
        the friction backward [N] and its slope [N/m].
        """
        count = self.at.size + 1
        pieces = np.zeros((count, 7))
        pieces[:, 0], pieces[:, 1] = np.append(-np.inf, self.at), np.append(self.at, np.inf)
        near = np.maximum(np.arange(count) - 1, 0)
        pieces[:, 2] = self.at[near]
        pieces[:, 3::2] = self.added.T[near]
        pieces[1:-1, 4::2] = (np.diff(self.added) / np.diff(self.at)).T
        return pieces


def add_friction(couplings: Sequence[Coupling], x: np.ndarray) -> np.ndarray:
    """Compute the friction that elongations add to the bounds of contacts.

    Args:
        couplings: what adds it.
        x: displacement, shape (..., N) [m].

    Returns:
        Friction forward and backward, shape (2, ..., N) [N].
    """
    added = np.zeros((2, *x.shape))
    for coupling in couplings:
        a, b = coupling.ends
        for side, row in enumerate(coupling.added):
            added[side, ..., coupling.contact] += np.interp(x[..., b] - x[..., a], coupling.at, row)
    return added
