"""Where a segment lies in the arrays of a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Segment:
    """Position of a segment in the arrays of a body.

    Attributes:
        name: name in the scene.
        first: index of its first contact.
        elements: number of elements; its contacts are first .. first + elements.
        first_spring: spring of its first element; the springs of the other elements follow.
        length: length of the segment [m].
        shown: number of contacts that are listed; None for all.
    """

    name: str
    first: int
    elements: int
    first_spring: int
    length: float
    shown: int | None = None

    @property
    def element(self) -> float:
        """Length of an element [m]."""
        return self.length / self.elements

    @property
    def last(self) -> int:
        """Index of the last contact."""
        return self.first + self.elements

    @property
    def cells(self) -> np.ndarray:
        """Length of the segment that each of its contacts represents, shape (elements + 1,) [m]."""
        cells = np.full(self.elements + 1, self.length / self.elements)
        cells[[0, -1]] *= 0.5
        return cells

    @property
    def contacts(self) -> slice:
        """Slice of its contacts."""
        return slice(self.first, self.last + 1)

    @property
    def springs(self) -> slice:
        """Slice of its springs."""
        return slice(self.first_spring, self.first_spring + self.elements)
