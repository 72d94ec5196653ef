"""An answer in rational numbers for any springs on any ground, for a few contacts: no rounding, so ties are ties.

Between events the rates are found by trying all modes: every contact at a bound sticks or slides, every curve at a knot
goes on to one of its sides. Contacts that come to borders where the ground holds less fall together, at fixed commands.
Nothing is shared with the kernels.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
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
class RationalGround:
    """Stretches of ground between borders: a factor on friction, and a force on each contact along the ground."""

    borders: Row
    factors: Row
    """One more than borders."""
    loads: list[Row]
    """For each stretch, one a contact; towards +x positive."""


@dataclass
class RationalBentBody:
    """A body at rest whose links have curves; `forward` and `backward` are its bounds, at first the commanded ones."""

    n: int
    links: list[RationalLink]
    forward: Row
    backward: Row
    position: Row = field(default_factory=list)
    ground: RationalGround | None = None
    x: Row = field(init=False)
    length: Row = field(init=False)

    def __post_init__(self) -> None:
        self.x = [F(0)] * self.n
        self.length = [F(0)] * len(self.links)
        self.events = self.jumps = self.slides = 0
        self.falling: set[tuple[int, int]] = set()
        if self.ground is None:
            self.ground, self.position = RationalGround([], [F(1)], [[F(0)] * self.n]), [F(0)] * self.n
        self.place = []
        for p in self.position:
            on = [j for j, border in enumerate(self.ground.borders) if border == p]
            self.place.append(2 * on[0] + 1 if on else 2 * sum(border < p for border in self.ground.borders))
        self.commanded = {1: self.forward, -1: self.backward}
        self.bound = {way: [self.holds(i, way, self.place[i]) for i in range(self.n)] for way in (1, -1)}

    def holds(self, i: int, way: int, place: int) -> F:
        """The bound of the ground at a place, against sliding in a direction."""
        stretch = (place + (way > 0)) // 2
        return self.commanded[way][i] * self.ground.factors[stretch] - way * self.ground.loads[stretch][i]

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
        """Follow a ramp to other commands, with all jumps on the way."""
        change = [a - b for a, b in zip(length, self.length, strict=True)]
        friction = {1: forward, -1: backward}
        d = {way: [a - b for a, b in zip(friction[way], self.commanded[way], strict=True)] for way in (1, -1)}
        still = {way: [F(0)] * self.n for way in (1, -1)}
        left = F(1)
        while left:
            left = self._part(change, d, left)
            while self.falling:
                if self._part([F(0)] * len(change), still, F(1)) == 0 and all(
                    self.bound[way][i] == self.holds(i, way, self.place[i]) for i, way in self.falling
                ):
                    self.falling.clear()
        up, down = self._at_bounds()
        if any(self._loose(up, 1)) or any(self._loose(down, -1)):  # flat links are as strong as friction now
            raise NotUniqueError(2)

    def _at_bounds(self) -> tuple[set[int], set[int]]:
        """The contacts at forward bounds, and at backward bounds."""
        force = self.forces()
        for i in range(self.n):
            assert -self.bound[-1][i] <= force[i] <= self.bound[1][i]
        up = {i for i in range(self.n) if force[i] == self.bound[1][i]}
        return up, {i for i in range(self.n) if force[i] == -self.bound[-1][i]}

    def _part(self, change: Row, d: dict[int, Row], left: F) -> F:
        """Follow a part of a ramp, or of a fall if bounds fall, until contacts fall; returns how much of it is left."""
        while left:
            up, down = self._at_bounds()
            limit = self._limits(d, left)
            try:
                v = self.rates(change, up, down, limit[1], limit[-1])
            except NotUniqueError as error:
                if error.args != (0,):
                    raise
                v = self._slide(up, 1, limit[1]) or self._slide(down, -1, limit[-1])
                if not v:
                    raise
                if self._meet(v):
                    return left
                continue
            self._leave(v)
            limit = self._limits(d, left)
            step = self._step(v, change, limit, left)
            left -= step
            self.events += 1
            self.x = [a + step * b for a, b in zip(self.x, v, strict=True)]
            self.length = [a + step * b for a, b in zip(self.length, change, strict=True)]
            for way in (1, -1):
                self.bound[way] = [a + step * b for a, b in zip(self.bound[way], limit[way], strict=True)]
                self.commanded[way] = [a + step * b for a, b in zip(self.commanded[way], d[way], strict=True)]
            if self._meet(v):
                return left
        return left

    def _limits(self, d: dict[int, Row], left: F) -> dict[int, Row]:
        """The rates of the bounds."""
        limit = {}
        for way in (1, -1):
            factors = [self.ground.factors[(place + (way > 0)) // 2] for place in self.place]
            limit[way] = [a * b for a, b in zip(factors, d[way], strict=True)]
        for i, way in self.falling:
            limit[way][i] = (self.holds(i, way, self.place[i]) - self.bound[way][i]) / left
        return limit

    def _leave(self, v: Row) -> None:
        """Let contacts that slide leave the borders that they are on."""
        for i, speed in enumerate(v):
            if speed and self.place[i] % 2:
                way = 1 if speed > 0 else -1
                self.place[i] += way
                self.bound[-way][i] = self.holds(i, -way, self.place[i])

    def _border(self, i: int, way: int) -> F | None:
        """The displacement at the next border of a contact that stands in a patch."""
        j = self.place[i] // 2 - (way < 0)
        borders = self.ground.borders
        return borders[j] - self.position[i] if 0 <= j < len(borders) else None

    def _meet(self, v: Row) -> bool:
        """Let contacts that have reached borders stop, go on or fall; returns whether any falls."""
        falls = False
        for i, speed in enumerate(v):
            way = 1 if speed > 0 else -1
            if not speed or self.place[i] % 2 or self._border(i, way) != self.x[i]:
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
                self.bound[way][i] = beyond
                self.falling.discard((i, way))
        return falls

    def _loose(self, at: set[int], way: int) -> Iterator[tuple[tuple[int, ...], Row]]:
        """Find the sets of contacts at bounds that only flat links hold, and how far these reach."""
        for count in range(1, len(at) + 1):
            for part in itertools.combinations(sorted(at), count):
                waits = []
                for link, rest in zip(self.links, self.length, strict=True):
                    if (link.a in part) == (link.b in part):
                        continue
                    z, side = self.x[link.b] - self.x[link.a], way if link.b in part else -way
                    if link.actuator.slope(z - rest, side) or link.passive.slope(z, side):
                        break
                    waits += [link.actuator.reach(z - rest, F(side)), link.passive.reach(z, F(side))]
                else:
                    yield part, [wait for wait in waits if wait is not None]

    def _slide(self, at: set[int], way: int, d_bound: Row) -> Row | None:
        """Slide contacts that only flat links hold, and these no longer, to a knot or border; returns directions."""
        for part, waits in self._loose(at, way):
            if sum(d_bound[i] for i in part) >= 0:
                continue
            v = [F(way) * (i in part) for i in range(self.n)]
            self._leave(v)
            borders = [(self._border(i, way), self.x[i]) for i in part]
            waits += [abs(border - x) for border, x in borders if border is not None]
            if waits:
                self.slides += 1
                self.x = [x + min(waits) * speed for x, speed in zip(self.x, v, strict=True)]
                return v
        return None

    def _step(self, v: Row, change: Row, limit: dict[int, Row], rest: F) -> F:
        force, slopes, waits = self.forces(), [], [rest]
        for link, length, moved in zip(self.links, self.length, change, strict=True):
            z, stretch = self.x[link.b] - self.x[link.a], v[link.b] - v[link.a]
            u, rate = z - length, stretch - moved
            actuator = link.actuator.slope(u, 1 if rate > 0 else -1)
            slopes.append((actuator, link.passive.slope(z, 1 if stretch > 0 else -1)))
            waits += [link.actuator.reach(u, rate)] if rate else []
            waits += [link.passive.reach(z, stretch)] if stretch else []
        rates = self._pulls(v, change, slopes)
        for i in range(self.n):
            for way in (1, -1):
                closing, slack = way * rates[i] - limit[way][i], self.bound[way][i] - way * force[i]
                waits += [slack / closing] if closing > 0 and slack > 0 else []
            if v[i] and (border := self._border(i, 1 if v[i] > 0 else -1)) is not None:
                waits.append((border - self.x[i]) / v[i])
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
