"""Chains whose links have elements of hysteresis, followed from event to event in fractions: every sign is tried."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction as F
from itertools import product

Numbers = Sequence[F]


class NotUniqueError(Exception):
    """Several rates solve the problem, or none of them is found."""


class HystereticChain:
    """A chain at rest at 0; each link has a stiffness and elements (stiffness, yield)."""

    def __init__(
        self, stiffness: Numbers, elements: Sequence[Sequence[tuple[F, F]]], forward: Numbers, backward: Numbers
    ):
        self.k, self.elements, self.bounds = stiffness, elements, {1: forward, -1: backward}
        self.n, self.links = len(forward), range(len(stiffness))
        self.x, self.length = [F(0)] * self.n, [F(0)] * len(stiffness)
        self.force = [[F(0)] * len(each) for each in elements]
        self.lost = F(0)

    def tension(self) -> list[F]:
        return [self.k[j] * (self.x[j + 1] - self.x[j] - self.length[j]) + sum(self.force[j]) for j in self.links]

    def pull(self, tension: Numbers) -> list[F]:
        padded = [F(0), *tension, F(0)]
        return [padded[i + 1] - padded[i] for i in range(self.n)]

    def _yields(self, j: int, e: int, way: int) -> bool:
        return self.force[j][e] == way * self.elements[j][e][1]

    def _rates(self, change: Numbers) -> list[F]:
        """The velocities that solve the problem at this instant."""
        pull, found = self.pull(self.tension()), []
        sides = [[0, *(s for s in (1, -1) if s * pull[i] == self.bounds[s][i])] for i in range(self.n)]
        ways = [
            [1, -1] if any(self._yields(j, e, w) for e in range(len(self.elements[j])) for w in (1, -1)) else [1]
            for j in self.links
        ]
        for side, way in product(product(*sides), product(*ways)):
            slope = [
                self.k[j]
                + sum(
                    s
                    for e, (s, _) in enumerate(self.elements[j])
                    if not self._yields(j, e, way[j]) or len(ways[j]) == 1
                )
                for j in self.links
            ]
            moving = [i for i in range(self.n) if side[i]]

            def rates_of(v: Numbers, slope: Numbers = slope) -> list[F]:
                return self.pull([slope[j] * (v[j + 1] - v[j]) - self.k[j] * change[j] for j in self.links])

            still = rates_of([F(0)] * self.n)
            units = [rates_of([F(i == m) for i in range(self.n)]) for m in moving]
            matrix = [[unit[i] - still[i] for unit in units] for i in moving]
            solved = solve(matrix, [-still[i] for i in moving])
            if solved is None:
                continue
            v = [F(0)] * self.n
            for i, value in zip(moving, solved, strict=True):
                v[i] = value
            rate = rates_of(v)
            slides = all(v[i] * side[i] > 0 for i in moving)
            rests = all(s * rate[i] <= 0 for i in range(self.n) if not side[i] for s in sides[i] if s)
            turns = all((v[j + 1] - v[j]) * way[j] >= 0 for j in self.links if len(ways[j]) > 1)
            if slides and rests and turns and v not in found:
                found.append(v)
        if len(found) != 1:
            raise NotUniqueError
        return found[0]

    def ramp(self, target: Numbers) -> None:
        """Follow a ramp to rest lengths."""
        change, left = [t - now for t, now in zip(target, self.length, strict=True)], F(1)
        while left > 0:
            v = self._rates(change)
            grows = [v[j + 1] - v[j] for j in self.links]
            step, before = left, self.pull(self.tension())
            rates = []
            for j in self.links:
                rates.append(-self.k[j] * change[j] + self.k[j] * grows[j])
                way = 1 if grows[j] > 0 else -1
                for e, (s, y) in enumerate(self.elements[j]):
                    if grows[j] and self.force[j][e] != way * y:
                        step = min(step, (y - way * self.force[j][e]) / (s * abs(grows[j])))
                        rates[j] += s * grows[j]
            for i, rate in enumerate(self.pull(rates)):
                for s in (1, -1):
                    if s * rate > 0 and s * before[i] < self.bounds[s][i]:
                        step = min(step, (self.bounds[s][i] - s * before[i]) / (s * rate))
            for j in self.links:
                for e, (s, y) in enumerate(self.elements[j]):
                    free = self.force[j][e] + s * grows[j] * step
                    self.force[j][e] = max(min(free, y), -y)
                    self.lost += y * abs(free - self.force[j][e]) / s
            self.x = [x + step * u for x, u in zip(self.x, v, strict=True)]
            self.length = [a + step * b for a, b in zip(self.length, change, strict=True)]
            left -= step


def solve(matrix: list[list[F]], right: list[F]) -> list[F] | None:
    """Solve a small linear system by Gauss-Jordan elimination; None if it is singular."""
    rows, n = [[*row, b] for row, b in zip(matrix, right, strict=True)], len(right)
    for i in range(n):
        pivot = next((r for r in range(i, n) if rows[r][i] != 0), None)
        if pivot is None:
            return None
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [value / rows[i][i] for value in rows[i]]
        for r in range(n):
            if r != i:
                rows[r] = [a - rows[r][i] * b for a, b in zip(rows[r], rows[i], strict=True)]
    return [row[n] for row in rows]
