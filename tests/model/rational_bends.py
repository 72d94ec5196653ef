"""An answer in rational numbers for bent springs, for a few contacts: no rounding, so ties are ties.

Between events the rates are found by trying all modes: every contact at a bound sticks or slides, every curve at a knot
goes on to one of its sides. Nothing is shared with the kernels.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from fractions import Fraction as F

from .rational_patches import NotUniqueError, solve

Row = list[F]


@dataclass
class RationalCurve:
    """A continuous, piecewise linear tension: knots, tensions there, and the slopes beyond them."""

    at: Row
    value: Row
    first: F
    last: F

    def slope(self, length: F, side: int) -> F:
        """The slope at a length, at a knot on the side 1 above or -1 below."""
        k = sum(a < length or (a == length and side > 0) for a in self.at)
        if k == 0:
            return self.first
        if k == len(self.at):
            return self.last
        return (self.value[k] - self.value[k - 1]) / (self.at[k] - self.at[k - 1])

    def __call__(self, length: F) -> F:
        """The tension."""
        if length <= self.at[0]:
            return self.value[0] + self.first * (length - self.at[0])
        k = sum(a < length for a in self.at)
        return self.value[k - 1] + self.slope(length, -1) * (length - self.at[k - 1])

    def reach(self, length: F, rate: F) -> F | None:
        """How long a length takes to the next knot; None without one."""
        ahead = [(a - length) / rate for a in self.at if (a - length) * rate > 0]
        return min(ahead, default=None)


@dataclass
class RationalLink:
    """A link between contacts a and b."""

    a: int
    b: int
    actuator: RationalCurve
    passive: RationalCurve


@dataclass
class RationalBentBody:
    """A body at rest whose links have curves."""

    n: int
    links: list[RationalLink]
    forward: Row
    backward: Row
    x: Row = field(init=False)
    length: Row = field(init=False)

    def __post_init__(self) -> None:
        self.x = [F(0)] * self.n
        self.length = [F(0)] * len(self.links)
        self.events = self.jumps = 0

    def tensions(self) -> Row:
        """The tension of each link."""
        found = []
        for link, rest in zip(self.links, self.length, strict=True):
            z = self.x[link.b] - self.x[link.a]
            found.append(link.actuator(z - rest) + link.passive(z))
        return found

    def forces(self) -> Row:
        """The force of the links on each contact."""
        force = [F(0)] * self.n
        for link, tension in zip(self.links, self.tensions(), strict=True):
            force[link.a] += tension
            force[link.b] -= tension
        return force

    def at_knots(self) -> list[tuple[int, str]]:
        """The curves that are at knots."""
        found = []
        for j, (link, rest) in enumerate(zip(self.links, self.length, strict=True)):
            z = self.x[link.b] - self.x[link.a]
            found += [(j, "actuator")] * (z - rest in link.actuator.at)
            found += [(j, "passive")] * (z in link.passive.at)
        return found

    def rates(self, change: Row, up: set[int], down: set[int], d_forward: Row, d_backward: Row) -> Row:
        """The velocities of the contacts."""
        at, knots = sorted(up | down), self.at_knots()
        found: list[Row] = []
        for sides in itertools.product((1, -1), repeat=len(knots)):
            side = dict(zip(knots, sides, strict=True))
            slopes = []
            for j, (link, rest) in enumerate(zip(self.links, self.length, strict=True)):
                z = self.x[link.b] - self.x[link.a]
                actuator = link.actuator.slope(z - rest, side.get((j, "actuator"), 1))
                slopes.append((actuator, link.passive.slope(z, side.get((j, "passive"), 1))))
            for moving in itertools.product((False, True), repeat=len(at)):
                some = [i for i, m in zip(at, moving, strict=True) if m]
                v = self._try(some, at, change, slopes, up, d_forward, d_backward)
                if v is not None and v not in found and self._fits(v, change, side):
                    found.append(v)
        if len(found) != 1:
            raise NotUniqueError(len(found))
        return found[0]

    def _pulls(self, v: Row, change: Row, slopes: Sequence[tuple[F, F]]) -> Row:
        rate = [F(0)] * self.n
        for link, rest, (actuator, passive) in zip(self.links, change, slopes, strict=True):
            stretch = v[link.b] - v[link.a]
            tension = actuator * (stretch - rest) + passive * stretch
            rate[link.a] += tension
            rate[link.b] -= tension
        return rate

    def _try(self, moving, at, change, slopes, up, d_forward, d_backward) -> Row | None:
        zero = self._pulls([F(0)] * self.n, change, slopes)
        columns = [self._pulls([F(i == j) for i in range(self.n)], [F(0)] * len(change), slopes) for j in moving]
        limit = [d_forward[i] if i in up else -d_backward[i] for i in range(self.n)]
        matrix = [[column[i] for column in columns] for i in moving]
        right = [limit[i] - zero[i] for i in moving]
        part = solve(matrix, right) if moving else []
        if part is None:
            if solvable(matrix, right):
                raise NotUniqueError(2)
            return None
        v = [F(0)] * self.n
        for i, velocity in zip(moving, part, strict=True):
            if velocity * (1 if i in up else -1) < 0:
                return None
            v[i] = velocity
        rate = self._pulls(v, change, slopes)
        for i in at:
            beyond = rate[i] > d_forward[i] if i in up else rate[i] < -d_backward[i]
            if i not in moving and beyond:
                return None
        return v

    def _fits(self, v: Row, change: Row, side: dict[tuple[int, str], int]) -> bool:
        for (j, name), way in side.items():
            stretch = v[self.links[j].b] - v[self.links[j].a]
            if (stretch - (change[j] if name == "actuator" else 0)) * way < 0:
                return False
        return True

    def follow(self, length: Row, forward: Row, backward: Row) -> None:
        """Follow a ramp to other commands."""
        s = F(0)
        change = [a - b for a, b in zip(length, self.length, strict=True)]
        d_forward = [a - b for a, b in zip(forward, self.forward, strict=True)]
        d_backward = [a - b for a, b in zip(backward, self.backward, strict=True)]
        while s < 1:
            force = self.forces()
            for i in range(self.n):
                assert -self.backward[i] <= force[i] <= self.forward[i]
            up = {i for i in range(self.n) if force[i] == self.forward[i]}
            down = {i for i in range(self.n) if force[i] == -self.backward[i]}
            try:
                v = self.rates(change, up, down, d_forward, d_backward)
            except NotUniqueError as error:
                if error.args == (0,) and (self._slide(up, 1, d_forward) or self._slide(down, -1, d_backward)):
                    continue
                raise
            step = self._step(v, change, force, d_forward, d_backward, 1 - s)
            s += step
            self.events += 1
            self.x = [a + step * b for a, b in zip(self.x, v, strict=True)]
            self.length = [a + step * b for a, b in zip(self.length, change, strict=True)]
            self.forward = [a + step * b for a, b in zip(self.forward, d_forward, strict=True)]
            self.backward = [a + step * b for a, b in zip(self.backward, d_backward, strict=True)]

    def _slide(self, at: set[int], way: int, d_bound: Row) -> bool:
        """Slide contacts that only flat links hold, and these no longer, to a knot; returns whether there are any."""
        for count in range(1, len(at) + 1):
            for part in itertools.combinations(sorted(at), count):
                if sum(d_bound[i] for i in part) >= 0:
                    continue
                waits = []
                for link, rest in zip(self.links, self.length, strict=True):
                    if (link.a in part) == (link.b in part):
                        continue
                    z, side = self.x[link.b] - self.x[link.a], way if link.b in part else -way
                    if link.actuator.slope(z - rest, side) or link.passive.slope(z, side):
                        break
                    waits += [link.actuator.reach(z - rest, F(side)), link.passive.reach(z, F(side))]
                else:
                    reached = [wait for wait in waits if wait is not None]
                    if reached:
                        self.jumps += 1
                        self.x = [x + way * min(reached) * (i in part) for i, x in enumerate(self.x)]
                        return True
        return False

    def _step(self, v: Row, change: Row, force: Row, d_forward: Row, d_backward: Row, rest: F) -> F:
        slopes, waits = [], [rest]
        for link, length, moved in zip(self.links, self.length, change, strict=True):
            z, stretch = self.x[link.b] - self.x[link.a], v[link.b] - v[link.a]
            u, rate = z - length, stretch - moved
            actuator = link.actuator.slope(u, 1 if rate > 0 else -1)
            slopes.append((actuator, link.passive.slope(z, 1 if stretch > 0 else -1)))
            waits += [link.actuator.reach(u, rate)] if rate else []
            waits += [link.passive.reach(z, stretch)] if stretch else []
        rates = self._pulls(v, change, slopes)
        for i in range(self.n):
            closing = rates[i] - d_forward[i]
            waits += [(self.forward[i] - force[i]) / closing] if closing > 0 and force[i] < self.forward[i] else []
            closing = -rates[i] - d_backward[i]
            waits += [(self.backward[i] + force[i]) / closing] if closing > 0 and force[i] > -self.backward[i] else []
        return min(wait for wait in waits if wait is not None)


def solvable(matrix: Sequence[Row], right: Row) -> bool:
    """Whether singular equations have solutions."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    n, rank = len(right), 0
    for column in range(n):
        pivot = next((r for r in range(rank, n) if rows[r][column]), None)
        if pivot is None:
            continue
        rows[rank], rows[pivot] = rows[pivot], rows[rank]
        for r in range(n):
            if r != rank and rows[r][column]:
                factor = rows[r][column] / rows[rank][column]
                rows[r] = [a - factor * b for a, b in zip(rows[r], rows[rank], strict=True)]
        rank += 1
    return all(row[n] == 0 for row in rows[rank:])
