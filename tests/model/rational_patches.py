"""An answer in rational numbers on patches of ground, for a few contacts: no rounding, so ties are ties.

Between events the sliding contacts are found by trying all sets. Contacts that come to borders where the ground holds
less fall together, at fixed commands. Nothing is shared with the kernels.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction as F

Row = list[F]


class NotUniqueError(Exception):
    """More than one motion, or none, solves the problem of the rates."""


def solve(matrix: Sequence[Row], right: Row) -> Row | None:
    """Solve linear equations; None if they are singular."""
    n = len(right)
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    for column in range(n):
        pivot = next((r for r in range(column, n) if rows[r][column]), None)
        if pivot is None:
            return None
        rows[column], rows[pivot] = rows[pivot], rows[column]
        rows[column] = [value / rows[column][column] for value in rows[column]]
        for r in range(n):
            if r != column and rows[r][column]:
                factor = rows[r][column]
                rows[r] = [a - factor * b for a, b in zip(rows[r], rows[column], strict=True)]
    return [row[n] for row in rows]


@dataclass
class RationalBody:
    """A body at rest on a track; `forward` and `backward` are the friction where the factor of the ground is 1."""

    position: Row
    springs: list[tuple[int, int, F]]
    forward: Row
    backward: Row
    borders: Row
    factors: Row
    """Of the stretches between the borders; one more than borders."""
    x: Row = field(init=False)
    place: list[int] = field(init=False)

    def __post_init__(self) -> None:
        self.n = len(self.position)
        self.x = [F(0)] * self.n
        self.length = [F(0)] * len(self.springs)
        self.place = []
        for p in self.position:
            on = [j for j, border in enumerate(self.borders) if border == p]
            self.place.append(2 * on[0] + 1 if on else 2 * sum(border < p for border in self.borders))
        self.bound = {way: [self.holds(i, way, self.place[i]) for i in range(self.n)] for way in (1, -1)}
        self.falling: set[tuple[int, int]] = set()
        self.jumps = 0

    def holds(self, i: int, way: int, place: int) -> F:
        """The bound of the ground at a place, against sliding in a direction."""
        friction = self.forward if way > 0 else self.backward
        return friction[i] * self.factors[(place + (way > 0)) // 2]

    def pull(self, x: Row, length: Row) -> Row:
        """The forces of the springs."""
        force = [F(0)] * self.n
        for (a, b, stiffness), rest in zip(self.springs, length, strict=True):
            tension = stiffness * (x[b] - x[a] - rest)
            force[a] += tension
            force[b] -= tension
        return force

    def rates(self, change: Row, up: set[int], down: set[int], limit: dict[int, Row]) -> Row:
        """Velocities: contacts at bounds slide, or rest with forces that stay within them."""
        at = sorted(up | down)
        unit = [[F(int(i == j)) for j in range(self.n)] for i in range(self.n)]
        still = self.pull([F(0)] * self.n, change)
        columns = [self.pull(unit[j], [F(0)] * len(change)) for j in range(self.n)]
        found: list[Row] = []
        for size in range(len(at) + 1):
            for moving in itertools.combinations(at, size):
                for ways in itertools.product((1, -1), repeat=size):
                    slides = list(zip(moving, ways, strict=True))
                    if any(i not in (up if way > 0 else down) for i, way in slides):
                        continue
                    right = [way * limit[way][i] - still[i] for i, way in slides]
                    v = solve([[columns[j][i] for j, _ in slides] for i, _ in slides], right)
                    if v is None or any(way * speed <= 0 for (_, way), speed in zip(slides, v, strict=True)):
                        continue
                    all_v = [F(0)] * self.n
                    for (i, _), speed in zip(slides, v, strict=True):
                        all_v[i] = speed
                    force = [
                        still[i] + sum((columns[j][i] * all_v[j] for j in range(self.n)), F(0)) for i in range(self.n)
                    ]
                    fits = all(force[i] <= limit[1][i] for i in up) and all(-force[i] <= limit[-1][i] for i in down)
                    if fits and all_v not in found:
                        found.append(all_v)
        if len(found) != 1:
            raise NotUniqueError
        return found[0]

    def part(self, change: Row, left: F) -> F:
        """Follow a part of a ramp, or of a fall if bounds fall, until contacts fall; returns how much of it is left."""
        limit = {way: [F(0)] * self.n for way in (1, -1)}
        for i, way in self.falling:
            limit[way][i] = (self.holds(i, way, self.place[i]) - self.bound[way][i]) / left
        for _ in range(1000):
            force = self.pull(self.x, self.length)
            up = {i for i in range(self.n) if force[i] == self.bound[1][i]}
            down = {i for i in range(self.n) if -force[i] == self.bound[-1][i]}
            v = self.rates(change, up, down, limit)
            for i, speed in enumerate(v):
                if speed and self.place[i] % 2:
                    way = 1 if speed > 0 else -1
                    self.place[i] += way
                    self.bound[-way][i] = self.holds(i, -way, self.place[i])
            step = left
            later = [value + speed for value, speed in zip(self.x, v, strict=True)]
            rate = self.pull(later, [a + b for a, b in zip(self.length, change, strict=True)])
            for i in range(self.n):
                for way in (1, -1):
                    closing = way * (rate[i] - force[i]) - limit[way][i]
                    slack = self.bound[way][i] - way * force[i]
                    if closing > 0 and slack > 0:
                        step = min(step, slack / closing)
                if v[i] and (border := self.border(i, 1 if v[i] > 0 else -1)) is not None:
                    step = min(step, (border - self.x[i]) / v[i])
            left -= step
            self.x = [value + step * speed for value, speed in zip(self.x, v, strict=True)]
            self.length = [value + step * speed for value, speed in zip(self.length, change, strict=True)]
            for way in (1, -1):
                self.bound[way] = [a + step * b for a, b in zip(self.bound[way], limit[way], strict=True)]
            if self.meet(v, limit) or left == 0:
                return left
        raise AssertionError("too many events")

    def border(self, i: int, way: int) -> F | None:
        """The displacement at the next border of a contact that stands in a patch."""
        j = self.place[i] // 2 - (way < 0)
        return self.borders[j] - self.position[i] if 0 <= j < len(self.borders) else None

    def meet(self, v: Row, limit: dict[int, Row]) -> bool:
        """Let contacts that have reached borders stop, go on or fall; returns whether any falls."""
        falls = False
        for i, speed in enumerate(v):
            way = 1 if speed > 0 else -1
            if not speed or self.place[i] % 2 or self.border(i, way) != self.x[i]:
                continue
            beyond = self.holds(i, way, self.place[i] + 2 * way)
            if beyond < self.bound[way][i]:
                self.place[i] += 2 * way
                self.bound[-way][i] = self.holds(i, -way, self.place[i])
                self.falling.add((i, way))
                self.jumps += 1
                falls = True
            else:
                self.place[i] += way
                self.bound[way][i], limit[way][i] = beyond, F(0)
                self.falling.discard((i, way))
        return falls

    def ramp(self, length: Row) -> None:
        """Follow a straight ramp of the rest lengths, with all jumps on the way."""
        change = [b - a for a, b in zip(self.length, length, strict=True)]
        left = F(1)
        while left:
            left = self.part(change, left)
            while self.falling:
                if self.part([F(0)] * len(change), F(1)) == 0 and all(
                    self.bound[way][i] == self.holds(i, way, self.place[i]) for i, way in self.falling
                ):
                    self.falling.clear()
