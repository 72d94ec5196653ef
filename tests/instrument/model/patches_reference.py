"""A slow, independent answer on patches of ground: small implicit steps that are halved until nothing happens inside.

Contacts are displaced one at a time until all bounds hold (the forces of springs are monotone, so this ends); at a
border a contact stands, goes on or slips according to the ground ahead. Nothing is shared with the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST = 2.0**-46
"""Steps are not halved below this part of a ramp."""


@dataclass
class Reference:
    """A body on a track: K = B^T k B, bounds by stretch of ground, and where each contact is."""

    position: np.ndarray
    ends: np.ndarray
    stiffness: np.ndarray
    borders: np.ndarray
    forward: np.ndarray
    """Of each stretch and contact, slope included, shape (M + 1, N)."""
    backward: np.ndarray
    x: np.ndarray

    def __post_init__(self) -> None:
        n, s = self.position.size, self.stiffness.size
        incidence = np.zeros((s, n))
        incidence[np.arange(s), self.ends[:, 0]] = -1.0
        incidence[np.arange(s), self.ends[:, 1]] = 1.0
        self.pull = incidence.T * self.stiffness
        self.matrix = self.pull @ incidence
        self.length = np.zeros(s)
        self.place = np.array([2 * np.searchsorted(self.borders, p) for p in self.position + self.x])
        self.losses: list[float] = []

    def bound(self, way: int) -> np.ndarray:
        """Bounds against sliding in a direction, at the place of each contact."""
        table = self.forward if way > 0 else self.backward
        return table[(self.place + (way > 0)) // 2, np.arange(self.x.size)]

    def force(self, x: np.ndarray) -> np.ndarray:
        return self.pull @ self.length - self.matrix @ x

    def border(self, i: int, way: int) -> float:
        """Displacement at which contact i reaches its next border."""
        ends = np.concatenate(([-np.inf], self.borders, [np.inf]))
        place = self.place[i]
        return float(ends[place // 2 + 1] if way > 0 else ends[(place + 1) // 2]) - float(self.position[i])

    def relax(self, x: np.ndarray, forward: np.ndarray, backward: np.ndarray) -> np.ndarray:
        """Minimise the energy plus friction from x: soft thresholds in turn, then the sliding contacts at once."""
        start, x = x, x.copy()
        diagonal = np.diag(self.matrix)
        for sweep in range(20_000):
            before = x.copy()
            for i in range(x.size):
                if diagonal[i] == 0.0:
                    continue
                free = x[i] + (self.force(x)[i]) / diagonal[i]
                up, down = free - forward[i] / diagonal[i], free + backward[i] / diagonal[i]
                x[i] = max(up, start[i]) if up > start[i] else min(down, start[i])
            if sweep % 8 == 7 and np.abs(x - before).max() < 1e-6:
                exact = self.polished(start, x, forward, backward)
                if exact is not None:
                    return exact
        raise AssertionError("the reference did not converge")

    def polished(
        self, start: np.ndarray, x: np.ndarray, forward: np.ndarray, backward: np.ndarray
    ) -> np.ndarray | None:
        side = np.sign(x - start)
        slides = np.flatnonzero(side)
        exact = start.copy()
        if slides.size:
            if slides.size == x.size:
                return None
            want = np.where(side > 0.0, forward, -backward)[slides]
            matrix = self.matrix[np.ix_(slides, slides)]
            exact[slides] += np.linalg.solve(matrix, self.force(start)[slides] - want)
        g = self.force(exact)
        good = (np.sign(exact - start)[slides] == side[slides]).all()
        return exact if good and (g <= forward + 1e-13).all() and (g >= -backward - 1e-13).all() else None

    def ramp(self, length: np.ndarray) -> None:
        """Follow a straight ramp of the rest lengths."""
        begin, at, step = self.length.copy(), 0.0, 1.0
        while at < 1.0:
            step = min(step, 1.0 - at)
            x = self.implicit(self.x, begin + (at + step) * (length - begin))
            moved = x - self.x
            leaving = np.flatnonzero((self.place % 2 == 1) & (moved != 0.0))
            if leaving.size and (step <= LEAST or self.is_straight(x, begin, at, step, length)):
                self.place[leaving] += np.sign(moved[leaving]).astype(int)
                continue
            met = [i for i in np.flatnonzero(moved) if self.met(int(i), x[i], moved[i])]
            if step > LEAST and (met or leaving.size or not self.is_straight(x, begin, at, step, length)):
                step *= 0.5
                continue
            self.length = begin + (at + step) * (length - begin)
            self.x = x
            for i in met:
                way = 1 if moved[i] > 0.0 else -1
                self.x[i] = self.border(i, way)
                self.place[i] += way
                self.slip(way)
            at += step
            step *= 2.0
        self.length = length.copy()

    def implicit(self, x: np.ndarray, length: np.ndarray) -> np.ndarray:
        before, self.length = self.length, length
        found = self.relax(x, self.bound(1), self.bound(-1))
        self.length = before
        return found

    def met(self, i: int, x: float, moved: float) -> bool:
        border = self.border(i, 1 if moved > 0.0 else -1)
        return x >= border if moved > 0.0 else x <= border

    def is_straight(self, x: np.ndarray, begin: np.ndarray, at: float, step: float, length: np.ndarray) -> bool:
        """Check that two unequal parts of a step lead along the same line as the whole."""
        part = self.implicit(self.x, begin + (at + 0.37 * step) * (length - begin))
        rest = self.implicit(part, begin + (at + step) * (length - begin))
        return bool(max(np.abs(rest - x).max(), np.abs(part - self.x - 0.37 * (x - self.x)).max()) < 1e-13)

    def slip(self, way: int) -> None:
        """Move contacts in one direction, one after another and never further than they must, until all bounds hold."""
        energy, friction, start = self.energy(), 0.0, self.x.copy()
        for _ in range(100_000):
            excess = way * self.force(self.x) - self.bound(way)
            i = int(np.argmax(excess))
            if excess[i] <= 2e-15:
                break
            if self.place[i] % 2 == 1:
                self.place[i] += way
                continue
            bound = self.bound(way)[i]
            to = self.x[i] + way * excess[i] / self.matrix[i, i]
            border = self.border(i, way)
            if way * (to - border) >= 0.0:
                to = border
                self.place[i] += way
            friction += bound * abs(to - self.x[i])
            self.x[i] = to
        if np.abs(self.x - start).max() > 1e-9:
            self.losses.append(energy - self.energy() - friction)

    def energy(self) -> float:
        tension = self.stiffness * (np.diff(self.x[self.ends], axis=1)[:, 0] - self.length)
        return float((0.5 * tension**2 / self.stiffness).sum())
