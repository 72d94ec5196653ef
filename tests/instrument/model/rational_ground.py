"""Small chains between walls in fractions: at every event, all directions of all contacts are tried."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

Rate = tuple[Fraction, ...]


@dataclass(frozen=True)
class Chain:
    """A chain at rest without tension, all numbers dyadic, and the rest lengths that its drive leads to.

    Attributes:
        at: reference positions [m].
        stiffness: of the links [N/m].
        friction: bounds of each contact, forward and backward [N].
        walls: contact, place [m] and side (1 stops forward, -1 backward) of each wall.
        rows: changes of rest lengths at the ends of ramps [m].
    """

    at: tuple[Fraction, ...]
    stiffness: tuple[Fraction, ...]
    friction: tuple[tuple[Fraction, Fraction], ...]
    walls: tuple[tuple[int, Fraction, int], ...]
    rows: tuple[tuple[Fraction, ...], ...]

    @property
    def data(self) -> dict[str, Any]:
        """The document of the scene."""
        walls = [
            {"at": float(place), "stops": "forward" if side > 0 else "backward", "contacts": [i]}
            for i, place, side in self.walls
        ]
        rows = [[0.0] * len(self.stiffness), *([float(v) for v in row] for row in self.rows)]
        return {
            "name": "rational",
            "body": {
                "contacts": [float(v) for v in self.at],
                "links": {"stiffness": [float(v) for v in self.stiffness]},
            },
            "friction": {
                "forward": [float(plus) for plus, _ in self.friction],
                "backward": [float(minus) for _, minus in self.friction],
            },
            "ground": {"walls": walls},
            "drive": {"times": list(range(len(rows))), "actuation": rows},
        }


def draw_chain(rng: np.random.Generator) -> Chain:
    """Draw a chain of two to four contacts with one to three walls, at which it mostly comes to stand."""

    def dyadic(low: int, high: int) -> Fraction:
        return Fraction(int(rng.integers(low, high)), 8)

    n = int(rng.integers(2, 5))
    at = tuple(Fraction(2 * i) for i in range(n))
    walls: dict[tuple[int, int], Fraction] = {}
    for _ in range(int(rng.integers(1, 4))):
        i, side = int(rng.integers(n)), int(rng.choice([1, -1]))
        walls[i, side] = at[i] + side * dyadic(0, 6)
    return Chain(
        at,
        tuple(dyadic(8, 32) for _ in range(n - 1)),
        tuple((dyadic(2, 9), dyadic(2, 17) + Fraction(2**i, 1024)) for i in range(n)),
        tuple((i, place, side) for (i, side), place in walls.items()),
        tuple(tuple(dyadic(-12, 13) for _ in range(n - 1)) for _ in range(6)),
    )


class Motion:
    """The motion of a chain, exactly."""

    def __init__(self, chain: Chain) -> None:
        self.chain, self.n = chain, len(chain.at)
        self.x = [Fraction(0)] * self.n
        self.length = [Fraction(0)] * (self.n - 1)

    def force(self, i: int) -> Fraction:
        """Compute the spring force on a contact."""

        def tension(j: int) -> Fraction:
            if not 0 <= j < self.n - 1:
                return Fraction(0)
            return self.chain.stiffness[j] * (self.x[j + 1] - self.x[j] - self.length[j])

        return tension(i) - tension(i - 1)

    def _excess(self, i: int, side: int) -> Fraction:
        return side * self.force(i) - self.chain.friction[i][0 if side > 0 else 1]

    def _room(self, i: int, side: int) -> Fraction | None:
        rooms = [s * (place - self.chain.at[i] - self.x[i]) for j, place, s in self.chain.walls if (j, s) == (i, side)]
        return min(rooms, default=None)

    def _rate_of(self, v: Rate, change: Rate, i: int) -> Fraction:
        """Compute the rate of the force on a contact."""
        rate = Fraction(0)
        for j, sign in ((i, 1), (i - 1, -1)):
            if 0 <= j < self.n - 1:
                rate += sign * self.chain.stiffness[j] * (v[j + 1] - v[j] - change[j])
        return rate

    def find_rates(self, change: Rate) -> Rate:
        """Find the velocities that satisfy all conditions; there are no two."""
        may = [[s for s in (1, -1) if self._excess(i, s) == 0 and self._room(i, s) != 0] for i in range(self.n)]
        found: set[Rate] = set()
        for sides in itertools.product(*([0, *each] for each in may)):
            moving = [i for i, side in enumerate(sides) if side]
            zero = (Fraction(0),) * self.n
            unit = [tuple(Fraction(int(j == i)) for j in range(self.n)) for i in range(self.n)]
            rest = (Fraction(0),) * (self.n - 1)
            rows = [
                [*(self._rate_of(unit[j], rest, i) for j in moving), -self._rate_of(zero, change, i)] for i in moving
            ]
            solved = _solve(rows)
            if solved is None:
                continue
            v = list(zero)
            for i, value in zip(moving, solved, strict=True):
                v[i] = value
            rates = tuple(v)
            held = all(s * self._rate_of(rates, change, i) <= 0 for i in range(self.n) if not sides[i] for s in may[i])
            if held and all(sides[i] * v[i] > 0 for i in moving):
                found.add(rates)
        (rates,) = found
        return rates

    def ramp(self, row: Rate) -> None:
        """Follow a ramp of the rest lengths."""
        change, left = tuple(b - a for a, b in zip(self.length, row, strict=True)), Fraction(1)
        while left:
            v, step = self.find_rates(change), left
            for i, s in itertools.product(range(self.n), (1, -1)):
                closing = s * self._rate_of(v, change, i)
                room = self._room(i, s)
                if self._excess(i, s) < 0 < closing and room != 0:
                    step = min(step, -self._excess(i, s) / closing)
                if room is not None and s * v[i] > 0:
                    step = min(step, room / (s * v[i]))
            self.x = [x + step * rate for x, rate in zip(self.x, v, strict=True)]
            self.length = [a + step * b for a, b in zip(self.length, change, strict=True)]
            left -= step

    def pushes(self) -> dict[tuple[int, int], tuple[Fraction, Fraction]]:
        """Compute what each contact at a wall pushes, by contact and side."""
        found = {}
        for i, side in itertools.product(range(self.n), (1, -1)):
            if self._room(i, side) == 0:
                least, most = self._excess(i, side), side * self.force(i) + self.chain.friction[i][1 if side > 0 else 0]
                found[i, side] = max(least, Fraction(0)), max(most, Fraction(0))
        return found


def _solve(rows: list[list[Fraction]]) -> list[Fraction] | None:
    """Solve a system whose right sides are the last column; None if it is singular."""
    n = len(rows)
    for i in range(n):
        pivot = next((r for r in range(i, n) if rows[r][i]), None)
        if pivot is None:
            return None
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for r in range(n):
            if r != i:
                rows[r] = [a - rows[r][i] * b for a, b in zip(rows[r], rows[i], strict=True)]
    return [row[n] for row in rows]
