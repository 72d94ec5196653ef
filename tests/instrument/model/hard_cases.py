"""The hard cases as data: what is played, on which bodies and by which methods, and what must come out."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene

from .bodies import CHAIN, GRAPH, HYBRID, ON_A_LINE, SEGMENT, Drawn, Driven
from .planar_ramps import Planar, on_a_line, random_line, stiff_error
from .segments import accuracies, random_homogeneous

NOT_UNIQUE = "unique: False"
SPENT = "overspent > 0"

PLANE = "plane"
BOTH = ("exact", "catch_up")
LINE = (CHAIN, GRAPH, PLANE)
"""Bodies of the same contacts and springs: the graph has each spring twice, half as stiff, the plane lies on a line."""


@dataclass(frozen=True)
class Found:
    """What came out: the error against what the case names, and the diagnoses."""

    error: float
    said: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Case:
    """A hard case; `within` bounds the error, `said` are the diagnoses that must be made, and no others."""

    name: str
    play: Callable[[str, str], Found]
    against: str
    within: float
    bodies: tuple[str, ...] = LINE
    methods: tuple[str, ...] = BOTH
    said: frozenset[str] = frozenset()
    verdict: str = "exact answer"

    @property
    def variants(self) -> list[tuple[str, str]]:
        return [(b, m) for b in self.bodies for m in self.methods if not (b == PLANE and m == "exact")]


class Line:
    """A crawler whose contacts lie on a line, in any of the bodies of LINE, driven by the same commands."""

    def __init__(
        self, body: str, method: str, stiffness: Any, forward: Any, backward: Any, start: Any = None, **more: Any
    ) -> None:
        forward = np.atleast_1d(np.asarray(forward, float))
        self.body, n = body, forward.size
        stiffness = np.broadcast_to(np.asarray(stiffness, float), n - 1)
        backward = np.broadcast_to(np.asarray(backward, float), n)
        data: dict[str, Any] = {"name": "hard", **more}
        if body == PLANE:
            pairs = [[i, i + 1] for i in range(n - 1)]
            data |= {"dimension": 2, "tolerance": 1e-7}
            data["body"] = {
                "contacts": [[i, 0] for i in range(n)],
                "links": {"stiffness": stiffness.tolist(), "between": pairs},
            }
            ways = [0.0, np.pi / 2, np.pi, 1.5 * np.pi]
            data["friction"] = {"directions": ways, "value": self._rectangles(forward, backward)}
        else:
            links: dict[str, Any] = {"stiffness": stiffness.tolist()}
            if body == GRAPH:
                links = {"stiffness": np.repeat(stiffness / 2, 2).tolist()}
                links["between"] = [[i, i + 1] for i in range(n - 1) for _ in range(2)]
            data["body"] = {"contacts": list(range(n)), "links": links}
            data["friction"] = {"forward": forward.tolist(), "backward": backward.tolist()}
        if start is not None:
            data["start"] = {"displacement": [[v, 0.0] for v in start] if body == PLANE else list(start)}
        self.crawler = Crawler(Scene.model_validate(data), method)
        self.said: set[str] = set()

    @staticmethod
    def _rectangles(forward: np.ndarray, backward: np.ndarray) -> list[list[float]]:
        return [[f, 1.0, b, 1.0] for f, b in zip(forward.tolist(), backward.tolist(), strict=True)]

    def go(self, actuation: Any, forward: Any = None, backward: Any = None, **more: Any) -> Any:
        row = np.atleast_1d(np.asarray(actuation, float))
        if self.body == PLANE:
            mu = None if forward is None else self._rectangles(np.asarray(forward, float), np.asarray(backward, float))
            step = self.crawler.advance(np.column_stack((row, np.zeros(row.size))), mu)
        else:
            step = self.crawler.advance(np.repeat(row, 2) if self.body == GRAPH else row, forward, backward, **more)
        self.said |= diagnoses(step)
        return step

    @property
    def x(self) -> np.ndarray:
        x = self.crawler.displacement
        return x[:, 0] if self.body == PLANE else x

    def found(self, *errors: Any) -> Found:
        return Found(largest(*errors), frozenset(self.said))


def diagnoses(*steps: Any) -> set[str]:
    """Collect what steps say of themselves."""
    said = {NOT_UNIQUE} if not all(s.unique for s in steps) else set()
    return said | ({SPENT} if any(s.overspent for s in steps) else set())


def largest(*errors: Any) -> float:
    """Return the largest size of all numbers, nan included."""
    return float(np.max([np.abs(np.asarray(e, float)).max(initial=0.0) for e in errors]))


def account_error(crawler: Crawler, step: Any) -> float:
    """Return the largest entry of a ramp's certificate, relative to the forces and energies that it is made of.

    The energy account of a catch-up step does not close: it shows its error, and is left out.
    """
    stored = 0.5 * float((crawler.tension**2 / crawler.body.stiffness).sum())
    energy = abs(step.work) + step.dissipation + stored + 1e-300
    force = float(np.abs(crawler.tension).max() + crawler.friction.max()) + 1e-300
    residual = step.certificate.energy_residual if crawler.method == "exact" else 0.0
    c = step.certificate
    return largest(residual / energy, c.violation / force, c.complementarity / energy)


# -- the friction itself ------------------------------------------------------------------------------------------


def critical(distance: float) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        line = Line(body, method, 1.0, [1.0, 1.0], [1.0 + distance] * 2)
        for length in (4.0, 0.0):
            line.go(length)
        before = line.x
        for length in (4.0, 0.0, 4.0, 0.0):
            line.go(length)
        if NOT_UNIQUE in line.said:  # the shape is determined, the translation is the one nearest to zero
            return line.found(line.x[1] - line.x[0] - 1.0, line.x.mean())
        gain = 2.0 * (4.0 - 2.0 * min(1.0, 1.0 + distance)) * np.sign(distance)
        return line.found(line.x - before - gain)

    return play


def all_slide(body: str, method: str) -> Found:
    """Two equal contacts pushed apart slide both: y may gain anything between -z/2 and z/2."""
    line = Line(body, method, 1.0, [1.0, 1.0], [1.0, 1.0])
    step = line.go(4.0)
    wrong = 0.0 if body == PLANE else np.subtract(step.translation_interval, (-1.5, 1.5))
    return line.found(wrong, line.x - (-1.5, 1.5))


def one_goes(body: str, method: str) -> Found:
    line = Line(body, method, 1.0, [1.0, 2.0], [1.0, 2.0])
    wrong = []
    # the fifth: friction grows as fast as the load, and nothing moves
    for length, mu, x in ((3, 1, -2), (3, 0, -3), (0, 0, 0), (-1, 0, 1), (0, 1, 1), (2, 1, -1)):
        line.go(float(length), [float(mu), 2.0], [float(mu), 2.0])
        wrong.append(line.x - (x, 0.0))
    return line.found(*wrong)


def all_go(body: str, method: str) -> Found:
    line = Line(body, method, 1.0, [1.0, 2.0], [1.0, 2.0])
    wrong = []
    for length, part, z in ((3, 1, 2), (3, 0, 3), (1, 0, 1), (-2, 0, -2), (-2, 1, -2), (0, 1, -1)):
        line.go(float(length), [part, 2.0 * part], [part, 2.0 * part])
        wrong.append(line.x[1] - line.x[0] - z)
    return line.found(*wrong)


def none_one_way(body: str, method: str) -> Found:
    line = Line(body, method, 1.0, [0.0, 0.0], [1.0, 1.0])
    wrong = []
    for period in range(3):
        line.go(1.0)
        line.go(0.0)
        wrong.append(line.x - (period + 1.0))
    return line.found(*wrong)


def none_on_one(body: str, method: str) -> Found:
    line = Line(body, method, 1.0, [0.0, 1.0], [0.0, 1.0])
    wrong = []
    for length in (1.0, 0.0, 7.0, -2.0):
        line.go(length)
        wrong.append(line.x - (-length, 0.0))
    return line.found(*wrong)


def none_at_all(body: str, method: str) -> Found:
    line = Line(body, method, [1.0, 3.0], [0.0] * 3, [0.0] * 3)
    line.go([1.0, -2.0])
    return line.found(np.diff(line.x) - (1.0, -2.0), line.crawler.tension)


def shrinking(body: str, method: str) -> Found:
    line = Line(body, method, 1.0, [1.0, 1.0], [1.0, 1.0], start=[0.0, 1.0])
    line.go(0.25, [1.5, 0.5], [1.5, 0.5])
    return line.found(line.x - (0.0, 0.75))


def growing_from_nothing(body: str, method: str) -> Found:
    line = Line(body, method, 1.0, [0.0, 0.0], [0.0, 0.0])
    line.go(1.0, [0.0, 0.0], [1.0, 1.0])
    return line.found(line.x - (0.0, 1.0))


def gone_while_all_slide(body: str, method: str) -> Found:
    """All friction vanishes along the ramp while both slide, critically: the interval is said, the ramp's end is not."""
    one, many = (Line(body, method, 1.0, [1.0, 1.0], [1.0, 1.0]) for _ in range(2))
    one.go(4.0, [0.0, 0.0], [0.0, 0.0])
    for part in (0.25, 0.5, 0.75, 1.0):
        many.go(4.0 * part, [1.0 - part] * 2, [1.0 - part] * 2)
    return one.found(one.x - (-2.0, 2.0), many.x - (-2.0, 2.0))


# -- sizes --------------------------------------------------------------------------------------------------------


def weak_beside_strong(ratio: float) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        line = Line(body, method, 1.0, [1.0, 1.3, ratio], [1.0, 1.3, ratio])
        line.go([0.5, 0.0])
        held = largest(line.x)
        line.go([3.0, 0.0])  # 2 beyond what the weakest bears
        return line.found(held, line.x - (-2.0, 0.0, 0.0))

    return play


def soft_beside_hard(ratio: float) -> Callable[[str, str], Found]:
    """The middle contact has no friction: two springs in series, which share the stretch by their compliance."""

    def play(body: str, method: str) -> Found:
        line = Line(body, method, [1.0, ratio], [9.0, 0.0, 9.0], [9.0, 0.0, 9.0])
        line.go([1.0, 0.0])
        return line.found(line.x[1] - 1.0 / (1.0 + ratio), line.x[[0, 2]])

    return play


WIDE_CHAINS = json.loads((Path(__file__).parent / "wide_chains.json").read_text(encoding="utf-8"))["cases"]


def follow_wide(case: dict[str, Any]) -> tuple[float, float]:
    """Follow a chain of the rational solutions; the error and what the certificates admit, relative to the motion."""
    n = len(case["forward"][0])
    friction = {"forward": case["forward"][0], "backward": case["backward"][0]}
    body = {"contacts": list(range(n)), "links": {"stiffness": case["stiffness"]}}
    crawler = Crawler(Scene.model_validate({"name": "wide", "body": body, "friction": friction}))
    true = np.array(case["displacement"])
    error = rounding = 0.0
    for row in range(1, len(true)):
        step = crawler.advance(case["actuation"][row], case["forward"][row], case["backward"][row])
        rounding += step.certificate.rounding
        error = max(error, largest(crawler.displacement - true[row]))
    size = largest(true, case["actuation"])
    return error / size, rounding / size


def wide(decades: int) -> Callable[[str, str], Found]:
    """Stiffness over so many decades: how many times the error is what the certificate admits, or 1e-11."""

    def play(body: str, method: str) -> Found:
        of_these = [follow_wide(case) for case in WIDE_CHAINS if case["decades"] == decades]
        return Found(largest([error / max(1e-11, rounding) for error, rounding in of_these]))

    return play


def wild_twice(seed: int) -> Callable[[str, str], Found]:
    """A graph adds up displacements: stiff springs see their rounding. How far from the chain, by its own certificate?"""

    def play(body: str, method: str) -> Found:
        rng = np.random.default_rng(seed)
        stiffness, mu = 10.0 ** rng.uniform(-6, 6, 7), 10.0 ** rng.uniform(-6, 6, 8)
        one, two = (Line(b, method, stiffness, mu, 1.7 * mu) for b in (body, CHAIN))
        worst, admitted = 0.0, 1e-12
        for _ in range(10):
            target = rng.uniform(-1, 1, 7) * mu.max() / stiffness
            step = one.go(target)
            two.go(target)
            worst = max(worst, largest(one.x - two.x) / largest(two.x, target))
            admitted = max(admitted, account_error(one.crawler, step))
        return one.found(worst / admitted)

    return play


def jump(size: float) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        line = Line(body, method, 1.0, [0.1, 0.1], [0.3, 0.3])
        line.go(size)
        wrong = [line.x - (0.0, size - 0.1)]
        line.go(-size)
        return line.found(*[w / size for w in (*wrong, line.x - (2.0 * size - 0.2, size - 0.1))])

    return play


def jump_of_five(body: str, method: str) -> Found:
    line = Line(body, method, 1.0, [0.1] * 5, [0.3] * 5)
    target = np.array([1e6, -1e6, 1e6, -1e6])
    step = line.go(target)
    # every tension is of the domain, at most all friction; the rest is shape
    excess = np.maximum(np.abs(np.diff(line.x) - target) - 1.5, 0.0)
    return line.found(excess, step.certificate.violation)


# -- ties ---------------------------------------------------------------------------------------------------------


def pairs(n: int) -> Callable[[str, str], Found]:
    """Links pull in pairs on equal contacts, mirror-symmetrically where N is even."""

    def play(body: str, method: str) -> Found:
        line = Line(body, method, 1.0, [1.0] * n, [1.5] * n)
        wrong = []
        for length in (5.0, -3.0, 0.0):
            step = line.go(length * (-1.0) ** np.arange(n - 1))
            wrong.append(account_error(line.crawler, step))
        return line.found(*wrong)

    return play


def net(n: int, between: Iterable[tuple[int, int]], method: str, mu: Any = 1.0, stiffness: Any = 1.0) -> Crawler:
    """Build a graph of springs; friction equal both ways, or a pair of them."""
    forward, backward = mu if isinstance(mu, tuple) else (mu, mu)
    body = {"contacts": list(range(n)), "links": {"stiffness": stiffness, "between": [list(p) for p in between]}}
    friction = {"forward": np.asarray(forward).tolist(), "backward": np.asarray(backward).tolist()}
    return Crawler(Scene.model_validate({"name": "hard", "body": body, "friction": friction}), method)


def complete(n: int) -> list[tuple[int, int]]:
    return [(i, j) for i in range(n) for j in range(i + 1, n)]


def complete_graph(n: int, k: float = 1.0) -> Callable[[str, str], Found]:
    """All pairs pushed apart alike: each contact is tied by n k to the mean, which stays."""

    def play(body: str, method: str) -> Found:
        crawler = net(n, complete(n), method, stiffness=k)
        wrong, said = [], set()
        load = 2.0 * np.arange(n) - n + 1
        for length in (0.5, 1.0, 3.0):
            said |= diagnoses(crawler.advance([length] * (n * (n - 1) // 2)))
            x = np.sign(load) * np.maximum(k * length * np.abs(load) - 1.0, 0.0) / (k * n)
            wrong.append(crawler.displacement - x)
        return Found(largest(*wrong), frozenset(said))

    return play


def star(n: int) -> Callable[[str, str], Found]:
    """The hub holds, all the others arrive at their bounds at once."""

    def play(body: str, method: str) -> Found:
        mu = np.array([2.0 * n] + [1.0] * (n - 1))
        crawler = net(n, [(0, i) for i in range(1, n)], method, mu)
        wrong, said = [], set()
        for length, x in ((0.5, 0.0), (1.0, 0.0), (3.0, 2.0), (-1.0, 0.0), (0.0, 0.0)):
            said |= diagnoses(crawler.advance([length] * (n - 1)))
            wrong.append(crawler.displacement - np.array([0.0] + [x] * (n - 1)))
        return Found(largest(*wrong), frozenset(said))

    return play


def ring(n: int) -> Callable[[str, str], Found]:
    """A ring of equal springs, the long one driven as the others together: the mirror image is the body itself."""

    def play(body: str, method: str) -> Found:
        crawler = net(n, [*((i, i + 1) for i in range(n - 1)), (0, n - 1)], method)
        wrong, said = [], set()
        for length in (2.0, -1.0, 0.5):
            said |= diagnoses(crawler.advance([*[length] * (n - 1), length * (n - 1)]))
            x = crawler.displacement
            wrong.append((x + x[::-1]) / np.abs(x).max())
        return Found(largest(*wrong), frozenset(said))

    return play


# -- stiff graphs -------------------------------------------------------------------------------------------------

RING = [(0, 1), (1, 2), (2, 3), (0, 3)]


def stiff_ring(stiffness: float, off: float = 0.0, size: float = 1.0) -> Callable[[str, str], Found]:
    """All four slide in the second ramp: equal friction leaves y open between two ends, other friction picks one."""

    def play(body: str, method: str) -> Found:
        crawler = net(4, RING, method, [1.0, 1.0, 1.0, 1.0 + off], stiffness / size)
        crawler.advance(np.array([0.3, -0.2, 0.7, 0.1]) * size)
        step = crawler.advance(np.array([0.9, 0.4, -0.3, 0.2]) * size)
        ends = np.array([-0.1125 + 0.25 / stiffness, 0.3375 - 0.75 / stiffness])
        interval = np.array(step.translation_interval) / size
        wrong = interval - (ends if off == 0.0 else ends[1 if off > 0.0 else 0])
        return Found(largest(wrong) if method == "exact" else 0.0, frozenset(diagnoses(step)))

    return play


def as_when_soft(stiffness: float, seed: int) -> Callable[[str, str], Found]:
    """A graph of stiff springs goes as the soft one that is driven so much further, far beyond its friction."""

    def play(body: str, method: str) -> Found:
        rng = np.random.default_rng(seed)
        n, between = [(4, complete(4)), (6, ladder(6)), (5, complete(5)[:7])][seed % 3]
        rows = rng.integers(-16, 17, (4, len(between))) / 4.0
        mu = np.ones(n) if n % 2 == 0 else np.array([2.0, *[1.0] * (n - 1)])
        soft, stiff = (net(n, between, method, mu, k) for k in (1.0, stiffness))
        wrong, said = [], set()
        for row in rows:
            one, other = soft.advance(row * stiffness), stiff.advance(row)
            said |= diagnoses(one) ^ diagnoses(other)  # nothing, if both say the same
            interval = np.array(one.translation_interval) / stiffness - other.translation_interval
            wrong.append(np.maximum(np.abs(interval) - 1e-6, 0.0))  # instants, 1e-6 of a ramp, do not count
            wrong.append(soft.displacement / stiffness - stiff.displacement)
        return Found(largest(*wrong), frozenset(said))

    return play


def trunk_and_foot(elements: int, method: str, joined: bool) -> Crawler:
    """Build a segment that bears as much friction as its foot; joined, the foot also pulls at the far end."""
    part = {"name": "trunk", "from": 0, "to": 1, "stiffness": 10.0, "elements": elements}
    part["friction"] = {"forward": 1.0, "backward": 1.0}
    links = {"stiffness": [10.0, 1e-3], "between": [["trunk.to", 0], ["trunk.from", 0]]}
    if not joined:
        links = {"stiffness": 10.0, "between": [["trunk.to", 0]]}
    body = {"contacts": [2], "segments": [part], "links": links}
    return Crawler(Scene.model_validate({"name": "hard", "body": body, "friction": {"isotropic": 1.0}}), method)


def critical_foot(elements: int, joined: bool) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        crawler = trunk_and_foot(elements, method, joined)
        rest = [0.0] * joined
        crawler.advance([1.0, *rest, 0.0])
        start = crawler.net_translation
        said = set()
        for length in (0.0, 1.0, 0.0, 1.0):
            step = crawler.advance([length, *rest, 0.0])
            said |= diagnoses(step)
            if step.unique:
                said.add("unique")
        return Found(abs(crawler.net_translation - start), frozenset(said))

    return play


def met_at_the_end(body: str, method: str) -> Found:
    """Bounds are met exactly at the ends of ramps, in numbers that are not exact in binary: nobody moves."""
    wrong, said = [], set()
    for k, mu in ((1.0, 0.3), (0.7, 0.21), (3.0, 0.1), (1e5, 0.3), (1.1, 1e-3), (7e-4, 0.9)):
        for parts in (1, 3, 7, 10):
            line = Line(body, method, k, [mu, 2.0 * mu, mu], [mu, 2.0 * mu, mu])
            for way in (1.0, -1.0, 1.0):
                for part in range(1, parts + 1):
                    line.go(way * part * (mu / k) / parts * np.array([1.0, -1.0]))
                    wrong += [line.crawler.contact_state, line.crawler.gained]
                for part in range(parts - 1, -1, -1):
                    line.go(way * part * (mu / k) / parts * np.array([1.0, -1.0]))
                    wrong += [line.crawler.contact_state, line.crawler.gained]
            said |= line.said
    return Found(largest(*wrong), frozenset(said))


# -- many contacts ------------------------------------------------------------------------------------------------


def tent(crawler: Crawler, actuation: np.ndarray) -> np.ndarray:
    """Stretch a body at rest by the same force in each spring: contacts slide from both ends inwards, exactly so."""
    k = crawler.body.stiffness
    from_left = np.cumsum(crawler.backward)[:-1]
    from_right = np.cumsum(crawler.forward[::-1])[-2::-1]
    other = np.minimum(k * actuation, from_right)
    z = actuation - np.minimum(from_left, other) / k
    x = np.concatenate(([0.0], np.cumsum(z)))
    return x - x[int(np.argmax(from_left > other)) if (from_left > other).any() else -1]


def stretched(n: int) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        if body == SEGMENT:
            part = {"name": "s", "from": 0, "to": 1, "stiffness": 1.0, "elements": n}
            part["friction"] = {"forward": 0.1, "backward": 0.3}
            crawler = Crawler(Scene.model_validate({"name": "hard", "body": {"segments": [part]}}), method)
            step = crawler.advance([0.02 if n <= 10_000 else 0.001])
        elif body == HYBRID:
            parts = [
                {"name": name, "from": a, "to": a + 1, "stiffness": 1.0, "elements": n // 2}
                | {"friction": {"forward": 0.1, "backward": 0.3}}
                for name, a in (("a", 0), ("b", 3))
            ]
            links = {"stiffness": [1.0, 2.0], "between": [["a.to", 0], [0, "b.from"]]}
            data = {"name": "hard", "body": {"contacts": [2], "segments": parts, "links": links}}
            crawler = Crawler(
                Scene.model_validate(data | {"friction": {"forward": 0.05, "backward": 0.07}}),
                method,
            )
            step = crawler.advance([0.02, 0.01, 0.02, 0.02])
        else:
            line = Line(body, method, 1.0, [0.1] * n, [0.3] * n)
            step = line.go(np.full(n - 1, 5.0))
            if body == GRAPH:
                return line.found((line.x - _chain_tent(n).x) / 5.0)
            crawler = line.crawler
        x = tent(crawler, crawler.actuation)
        return Found(largest(crawler.displacement - x) / max(np.abs(x).max(), 1e-300), frozenset(diagnoses(step)))

    return play


def _chain_tent(n: int) -> Line:
    line = Line(CHAIN, "exact", 1.0, [0.1] * n, [0.3] * n)
    line.go(np.full(n - 1, 5.0))
    return line


def alternating(n: int) -> Callable[[str, str], Found]:
    """The load alternates in sign and grows along the body; one ramp against three, or the step's own certificate."""

    def play(body: str, method: str) -> Found:
        i = np.arange(n - 1)
        load = 1e-3 * (-1.0) ** i * i
        one, many = (Line(body, method, 1.0, [0.1] * n, [0.3] * n) for _ in range(2))
        step = one.go(load)
        wrong = [account_error(one.crawler, step)]
        if method == "exact":
            for part in (0.3, 0.7, 1.0):
                many.go(part * load)
            wrong.append((many.x - one.x) / np.abs(load).max())
        return one.found(*wrong)

    return play


def ladder(n: int) -> list[tuple[int, int]]:
    return [(i, i + 2) for i in range(n - 2)] + [(i, i + 1) for i in range(0, n - 1, 2)]


def grid(side: int) -> list[tuple[int, int]]:
    at = [(r, c) for r in range(side) for c in range(side)]
    right = [(r * side + c, r * side + c + 1) for r, c in at if c < side - 1]
    return right + [(r * side + c, (r + 1) * side + c) for r, c in at if r < side - 1]


def chords(n: int) -> list[tuple[int, int]]:
    return [(i, i + 1) for i in range(n - 1)] + [(0, n - 1)] + [(i, i + n // 2) for i in range(0, n // 2, 3)]


NETS = {"ring with chords": (300, chords(300)), "ladder": (400, ladder(400)), "grid": (225, grid(15))}


def large_net(name: str) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        n, between = NETS[name]
        rng = np.random.default_rng(n)
        mu = tuple(np.exp(rng.uniform(-2, 1, (2, n))))
        one, many = (net(n, between, method, mu, rng.uniform(1, 3)) for _ in range(2))
        many = one.copy()
        said, wrong, before = set(), [], np.zeros(len(between))
        for _ in range(3):
            load = rng.uniform(-3, 3, len(between))
            step = one.advance(load)
            said |= diagnoses(step)
            wrong.append(account_error(one, step))
            if method == "exact":
                for part in (0.2, 0.6, 1.0):
                    many.advance(before + part * (load - before) if part < 1.0 else load)
                wrong.append(many.displacement - one.displacement)
            before = load
        return Found(largest(*wrong), frozenset(said))

    return play


def steep(n: int) -> Callable[[str, str], Found]:
    """The load alternates and grows faster than the body: all breakpoints of the projection pass its zero, again and again.

    Beyond the budget of work the ramp is finished by a catch-up step; forces must be in bounds, commands in force.
    """

    def play(body: str, method: str) -> Found:
        i = np.arange(n - 1)
        load = (-1.0) ** i * i**1.5
        line = Line(body, method, 1.0, [1.0] * n, [1.0] * n)
        step = line.go(load)
        return line.found(step.certificate.violation, line.crawler.actuation - load)

    return play


# -- time ---------------------------------------------------------------------------------------------------------


def small_and_large_ticks(body: str, method: str) -> Found:
    """A thousand ticks of 1e-9 of a period, then the rest in one: the path, and so the end, equals one ramp's."""
    one, many = (Line(body, method, [1.0, 2.0], [0.2, 0.3, 0.4], [0.5, 0.1, 0.3]) for _ in range(2))
    for end in (np.array([2.0, -1.0]), np.array([0.0, 0.5])):
        before = many.crawler.actuation[:: 2 if body == GRAPH else 1] * 1.0
        one.go(end)
        for tick in range(1, 1001):
            many.go(before + tick * 1e-9 * (end - before))
        many.go(end)
    return one.found(many.x - one.x)


def no_drift(periods: int) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        if body == GRAPH:
            crawler = net(3, [(0, 1), (1, 2), (0, 2)], method, (np.ones(3), np.full(3, 3.0)))
            ends = [[5.0, 2.0, 1.0], [0.0, 0.0, 0.0]]
        else:
            crawler = Line(body, method, 1.0, [1.0, 1.0], [2.0, 2.0]).crawler
            ends = [[5.0], [0.0]]
        block = periods // 100
        targets = np.tile(np.vstack([crawler.target(end) for end in ends]), (block, 1))
        crawler.follow(targets[:20])  # the transient
        start, said = crawler.displacement, set()
        gains = []
        for _ in range(100):
            before = crawler.displacement
            said |= diagnoses(crawler.follow(targets))
            gains.append((crawler.displacement - before) / block)
        gain = 1.5 if body == GRAPH else 3.0
        whole = (crawler.displacement - start) / (100 * block)
        return Found(largest(np.array(gains) - gain, whole - gain), frozenset(said))

    return play


# -- symmetries ---------------------------------------------------------------------------------------------------


def run(driven: Driven, method: str, parts: int = 1) -> tuple[np.ndarray, set[str], list[Any]]:
    states, steps = driven.run(method, parts)
    return states, diagnoses(*steps), steps


EVERY = ON_A_LINE


def units(length: float, force: float) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        wrong, said = [], set()
        for seed in range(3):
            here, some, steps = run(Drawn(body, seed).driven(), method)
            there, more, others = run(Drawn(body, seed).driven(length, force), method)
            wrong.append((there / length - here) / np.abs(here).max())
            wrong += [b.work / (length * force) - a.work for a, b in zip(steps, others, strict=True)]
            said |= some | more
        return Found(largest(*wrong), frozenset(said))

    return play


def mirror(body: str, method: str) -> Found:
    wrong, said = [], set()
    for seed in range(5):
        here, some, _ = run(Drawn(body, seed).driven(), method)
        there, more, _ = run(Drawn(body, seed).driven(mirrored=True), method)
        wrong.append((there[:, ::-1] + here) / np.abs(here).max())
        said |= some | more
    return Found(largest(*wrong), frozenset(said))


def splitting(parts: int) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        wrong, said = [], set()
        for seed in range(5):
            here, some, _ = run(Drawn(body, seed).driven(), method)
            there, more, _ = run(Drawn(body, seed).driven(), method, parts)
            wrong.append((there - here) / np.abs(here).max())
            said |= some | more
        return Found(largest(*wrong), frozenset(said))

    return play


def twice(body: str, method: str) -> Found:
    one, two = (run(Drawn(body, 1).driven(), method, 3)[0] for _ in range(2))
    return Found(0.0 if one.tobytes() == two.tobytes() else 1.0)


def spent(body: str, method: str) -> Found:
    driven = Drawn(body, 2).driven()
    crawler = Crawler(driven.scene, method, budget=0)
    step = crawler.advance(driven.rows[0][0])
    target = crawler.target(driven.rows[0][0])
    left = crawler.actuation - target[: crawler.actuation.size]
    return Found(largest(left, step.certificate.violation), frozenset(diagnoses(step)))


# -- the tolerance of the plane ------------------------------------------------------------------------------------


def roles(tolerance: float) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        steady = [1, 0.75, 1.5]
        errors = [
            on_a_line(*ramp, tolerance, angle, corners)
            for angle in (0.0, 1.0)
            for corners in (0, 6)
            for ramp in (([2], [1, 2], [([4], [1, 0.5])]), ([0.5, 2], steady, [([-3, -1.75], steady)]))
        ]
        return Found(largest(errors))

    return play


def line_in_the_plane(tolerance: float, corners: int) -> Callable[[str, str], Found]:
    return lambda body, method: Found(largest([random_line(seed, tolerance, corners) for seed in range(1000, 1040)]))


def two_dimensions(tolerance: float, directional: bool) -> Callable[[str, str], Found]:
    def play(body: str, method: str) -> Found:
        return Found(largest([Planar(seed, directional).error(tolerance) for seed in range(1000, 1003)]))

    return play


def stiff_springs(tolerance: float, loaded: bool) -> Callable[[str, str], Found]:
    return lambda body, method: Found(largest([stiff_error(seed, loaded, tolerance) for seed in range(1000, 1040)]))


# -- patches of ground ---------------------------------------------------------------------------------------------

SIZES = (1.0, 0.1, 1.0 / 3.0)
"""Lengths and forces: in the first one all numbers are exact in binary, in the others rounding decides ties."""


def patched(body: str, size: float, forward: Any, backward: Any, *patches: tuple[float, float, float]) -> Line:
    """Build contacts at 0, 1, ... on springs of 1 N/m, with patches (border, other border, factor on friction)."""
    ground = {"patches": [dict(zip(("from", "to", "friction"), patch, strict=True)) for patch in patches]}
    sides = (size * np.asarray(side) for side in (forward, backward))
    return Line(body, "exact", 1.0, *sides, ground=ground)


HITS = {
    0.5: ((0.25, 0.0), (0.5, 0.375), (0.75, 0.625), (1.0, 0.875), (-0.25, 0.25), (-1.0, 0.0)),
    2.0: ((0.25, 0.0), (0.5, 0.25), (0.75, 0.25), (1.0, 0.5), (-1.5, 0.5), (-1.75, -0.75)),
}
"""By the factor on friction behind a border: rest lengths, and where the front contact is then."""


def border_hit_exactly(factor: float) -> Callable[[str, str], Found]:
    """Ramps that end where the front contact reaches a border, forward and backward, or a bound on it."""

    def play(body: str, method: str) -> Found:
        wrong, said = [], set()
        for size in SIZES:
            line = patched(body, size, [9.0, 0.25], [9.0, 1.0], (1.0 + 0.25 * size, 3.0, factor))
            for length, slid in HITS[factor]:
                line.go(length * size)
                wrong.append(line.x / size - (0.0, slid))
            said |= line.said
        return Found(largest(*wrong), frozenset(said))

    return play


def two_borders_at_once(left: float, right: float) -> Callable[[str, str], Found]:
    """Both outer contacts reach borders together, whatever each finds there."""

    def play(body: str, method: str) -> Found:
        wrong, said = [], set()
        for size in SIZES:
            patches = (-3.0, -0.25 * size, left), (2.0 + 0.25 * size, 5.0, right)
            line = patched(body, size, [0.25, 9.0, 0.25], [0.25, 9.0, 0.25], *patches)
            for length in (0.375, 0.5, 2.0):
                line.go([length * size, length * size])
                slid = [max(0.25, length - 0.25 * f) if length >= 0.5 else length - 0.25 for f in (left, right)]
                wrong.append(line.x / size - (-slid[0], 0.0, slid[1]))
            said |= line.said
        return Found(largest(*wrong), frozenset(said))

    return play


def arrives_as_another_would_leave(body: str, method: str) -> Found:
    """Contact 1 stops at a border at the instant at which the last contact, on a border, reaches its backward bound.

    The last contact does not move, so that it remains on its border, where the ground ahead is softer. That it reaches its
    bound before by no more than rounding makes no difference.
    """
    wrong, said = [], set()
    for size, early in itertools.product(SIZES, (0.0, 7.5e-15)):
        for parts in (1, 2, 3, 7):
            patches = (1.0 - 9.0 * size, 1.0 - 0.5 * size, 40.0), (2.0, 9.0, 0.5)
            line = patched(body, size, [9.0, 0.25, 0.5], [9.0, 0.25, 0.5 - early], *patches)
            for part in np.arange(1, parts + 1) / parts:
                line.go([-2.0 * part * size, 0.0])
            wrong.append(line.x / size - (0.0, -0.5, 0.0))
            line.go([-2.0 * size, 0.9 * size])
            wrong.append(line.x / size - (0.0, -0.5, 0.15))
            said |= line.said
    return Found(largest(*wrong), frozenset(said))


def jump_across_three(body: str, method: str) -> Found:
    wrong, said = [], set()
    for size in SIZES:
        cuts = [1.0 + part * size for part in (0.25, 0.35, 0.55, 2.0)]
        patches = [(a, b, f) for a, b, f in zip(cuts[:-1], cuts[1:], (0.5, 0.25, 0.125), strict=True)]
        line = patched(body, size, [9.0, 0.4], [9.0, 1.0], *patches)
        for length, slid in ((0.5, 0.1), (0.65, 0.6), (0.7, 0.65)):
            step = line.go(length * size)
            wrong.append(line.x / size - (0.0, slid))
            if length == 0.65:  # what the spring gives up less what friction takes on each patch
                loss = 0.5 * (0.4**2 - 0.05**2) - 0.2 * 0.1 - 0.1 * 0.2 - 0.05 * 0.05
                wrong += [len(step.jumps) - 3.0, step.jump_loss / size**2 - loss]
        said |= line.said
    return Found(largest(*wrong), frozenset(said))


def rests_on_a_border(periods: int) -> Callable[[str, str], Found]:
    """The force on the front contact goes from bound to bound of its border, exactly, and never moves it."""

    def play(body: str, method: str) -> Found:
        line = patched(body, 1.0, [9.0, 0.25], [9.0, 1.0], (1.25, 3.0, 2.0))
        line.go(0.5)
        crawler = line.crawler
        springs = crawler.actuation.size
        period = [crawler.target(np.full(springs, length)) for length in (0.75, -0.75)]
        step = crawler.follow(np.tile(period, (periods, 1)))
        line.said |= diagnoses(step)
        line.go(1.25)  # the contact leaves at three quarters of this ramp, which is exact in binary
        return line.found(crawler.gained[1] - 0.5, line.x - (0.0, 0.75), step.velocity, step.dissipation)

    return play


def load_at_the_limit(body: str, method: str) -> Found:
    """A load on one contact grows to what both can hold together, and ice takes the body to that limit."""
    wrong, said = [], set()
    for size in SIZES:
        line = Line(body, method, 1.0, [0.25 * size] * 2, [size] * 2, loads=0.0)
        for load, slid in ((0.25, 0.0), (0.5, 0.25), (0.0, 0.25), (0.5, 0.25)):
            line.go(0.0, loads=[load * size, 0.0])
            wrong.append(line.x / size - (slid, 0.0))
        said |= line.said
        if method == "exact":
            ice = {"patches": [{"from": 1.0 + 0.25 * size, "to": 3.0, "friction": 0.5}]}
            more: dict[str, Any] = {"loads": [0.375 * size, 0.0], "ground": ice, "start": [0.125 * size, 0.0]}
            line = Line(body, method, 1.0, [0.25 * size] * 2, [size] * 2, **more)
            line.go(0.375 * size)
            wrong.append(line.x / size - (0.125, 0.375))
            said |= line.said
    return Found(largest(*wrong), frozenset(said))


# -- the accuracy of segments ----------------------------------------------------------------------------------------


def unequal_sides(forward: float, backward: float, accuracy: float) -> Callable[[str, str], Found]:
    """Strain a short, stiff segment that stands next to its end, one way round and the other."""

    def play(body: str, method: str) -> Found:
        sides = (forward, backward), (backward, forward)
        return Found(largest([accuracies(0.037, 5e3, *mu, 1e-3, accuracy, method) for mu in sides]))

    return play


def random_unequal(body: str, method: str) -> Found:
    return Found(largest([accuracies(*random_homogeneous(seed), method) for seed in range(1000, 1012)]))


UNDECIDED = frozenset({NOT_UNIQUE})


def _cases() -> list[Case]:
    cases = [Case("Friction at the critical ratio", critical(0.0), "shape; rule for y", 1e-9, said=UNDECIDED)]
    for exponent in range(-15, -2):
        for sign in (-1, 1):
            name = f"Friction off the critical ratio by {sign:+d}e{exponent}"
            said = UNDECIDED if exponent <= -12 else frozenset()
            against = "shape; rule for y" if said else "closed form"
            cases.append(Case(name, critical(sign * 10.0**exponent), against, 1e-9, said=said))
    cases += [
        Case("All contacts slide at once", all_slide, "closed form, interval of y", 1e-9, said=UNDECIDED),
        Case("All friction vanishes while all slide", gone_while_all_slide, "symmetry", 1e-9, said=UNDECIDED),
        Case("Friction of one contact vanishes and returns", one_goes, "closed form", 1e-9),
        Case("All friction vanishes and returns", all_go, "closed form of the shape", 1e-9, said=UNDECIDED),
        Case("No friction forwards", none_one_way, "closed form, rule for y", 1e-9, said=UNDECIDED),
        Case("No friction on one contact", none_on_one, "closed form", 1e-9),
        Case("No friction at all", none_at_all, "closed form of the shape", 1e-9, said=UNDECIDED),
        Case("Friction shrinks faster than the load", shrinking, "closed form", 1e-9),
        Case(
            "Backward friction grows from nothing",
            growing_from_nothing,
            "closed form, rule for y",
            1e-9,
            said=UNDECIDED,
        ),
    ]
    cases.append(Case("A jump of a hundred stasis domains", jump(100.0), "closed form, relative", 1e-11))
    for ratio in (1e6, 1e9, 1e12):
        cases.append(Case(f"Friction ratio {ratio:.0e}", weak_beside_strong(ratio), "closed form", 1e-9))
        for r in (ratio, 1.0 / ratio):
            cases.append(
                Case(f"Stiffness ratio {r:.0e}", soft_beside_hard(r), "closed form", 1e-9, bodies=(CHAIN, GRAPH))
            )
        name = f"A jump of {ratio:.0e} stasis domains"
        cases.append(Case(name, jump(ratio), "closed form, relative", 1e-11, bodies=(CHAIN, GRAPH)))
    for decades in (6, 8, 12):
        name = f"Stiffness over {decades} decades, {sum(c['decades'] == decades for c in WIDE_CHAINS)} bodies"
        against, shown = "rational arithmetic, by the certificate", "exact answer, or the certificate shows its error"
        cases.append(Case(name, wide(decades), against, 30.0, (CHAIN,), ("exact",), verdict=shown))
    for seed in range(5):
        name = f"Stiffness and friction over twelve decades, body {seed}"
        against = "the chain, by the certificate"
        shown = "the certificate shows its error"
        cases.append(Case(f"{name}, as a graph", wild_twice(seed), against, 10.0, bodies=(GRAPH,), verdict=shown))
    cases.append(Case("A jump beyond the stasis domain of five contacts", jump_of_five, "bounds", 1e-8, (CHAIN, GRAPH)))
    for n in (2, 3, 10, 100, 1000):
        bodies = (CHAIN, GRAPH) if n <= 100 else (CHAIN,)
        cases.append(Case(f"{n} equal contacts arrive in pairs", pairs(n), "certificate", 1e-11, bodies=bodies))
    for n in (3, 9, 25):
        cases.append(Case(f"Complete graph of {n}", complete_graph(n), "closed form", 1e-12, bodies=(GRAPH,)))
    for n in (3, 50, 300):
        cases.append(Case(f"Star of {n}", star(n), "closed form", 1e-12, bodies=(GRAPH,)))
    for n in (5, 51, 301):
        cases.append(Case(f"Ring of {n} equal springs", ring(n), "symmetry", 1e-12, bodies=(GRAPH,)))
    for exponent in (1, 4, 5, 8):
        k = 10.0**exponent
        within = 1e-12
        against = "closed form, interval of y"
        cases.append(Case(f"A critical ring, k = {k:.0e}", stiff_ring(k), against, within, (GRAPH,), said=UNDECIDED))
        name = f"A critical ring, k = {k:.0e}, lengths by 1e{4 - exponent}"
        small = stiff_ring(1e4, size=1e4 / k)
        cases.append(Case(name, small, against, within, (GRAPH,), said=UNDECIDED))
        for off in (-1e-3, -1e-9, 1e-9, 1e-6):
            name = f"A ring off the critical ratio by {off:+.0e}, k = {k:.0e}"
            cases.append(Case(name, stiff_ring(k, off), "closed form", abs(off) + 1e-12, (GRAPH,)))
        for seed in range(3):
            name = f"Critical graph {seed}, k = {k:.0e}"
            cases.append(Case(name, as_when_soft(k, seed), "the soft one, scaled", 1e-12, (GRAPH,)))
        for n in (4, 10):
            name = f"Complete graph of {n}, k = {k:.0e}"
            against = "closed form, rule for y"
            cases.append(Case(name, complete_graph(n, k), against, 1e-12, (GRAPH,), said=UNDECIDED))
    for n in (1, 4, 10, 100, 300):
        for joined in (False, True):
            name = f"Trunk of {n} elements and foot, critical" + (", in a ring" if joined else "")
            cases.append(Case(name, critical_foot(n, joined), "rule for y", 1e-14, (HYBRID,), said=UNDECIDED))
    cases.append(Case("Bounds met exactly at the ends of ramps", met_at_the_end, "rest", 0.0, (CHAIN, GRAPH)))
    for n in (2, 3, 10, 100, 1000, 100_000, 1_000_000):
        bodies = (CHAIN,) if n > 300 else (CHAIN, GRAPH)
        cases.append(Case(f"{n} contacts stretched", stretched(n), "closed form, relative", 1e-9, bodies=bodies))
    for n in (4, 100, 10_000, 100_000):
        bodies = (SEGMENT, HYBRID) if n <= 10_000 else (SEGMENT,)
        cases.append(Case(f"{n} elements stretched", stretched(n), "closed form, relative", 1e-9, bodies=bodies))
    for n in (100, 1000, 100_000):
        bodies = (CHAIN, GRAPH) if n <= 100 else (CHAIN,)
        name = f"A load that alternates and grows over {n} contacts"
        cases.append(Case(name, alternating(n), "three ramps; certificate", 1e-9, bodies=bodies))
    for n in (1000, 100_000):
        name = f"A load that alternates and grows with the power 1.5 over {n} contacts"
        cases.append(Case(name, steep(n), "commands in force, bounds", 1e-9, (CHAIN,), ("catch_up",)))
    for name in NETS:
        against = "three ramps; certificate"
        cases.append(Case(f"A {name} of {NETS[name][0]} contacts", large_net(name), against, 1e-10, bodies=(GRAPH,)))
    cases += [
        Case("Ticks of 1e-9 of a period", small_and_large_ticks, "one ramp", 1e-12, (CHAIN, GRAPH), ("exact",)),
        Case("1e6 periods of two contacts", no_drift(1_000_000), "closed form, per period", 0.0, (CHAIN,)),
        Case("1e5 periods of a triangle of springs", no_drift(100_000), "closed form, per period", 1e-13, (GRAPH,)),
        Case("The mirror image", mirror, "symmetry", 1e-11, EVERY),
        Case("The same input twice", twice, "all bits", 0.0, EVERY),
        Case("A budget of no work", spent, "commands in force, bounds", 1e-12, EVERY, ("exact",), frozenset({SPENT})),
    ]
    kept: dict[str, Any] = {"bodies": (CHAIN, GRAPH), "methods": ("exact",)}
    for factor, ground in ((0.5, "softer"), (2.0, "harder")):
        name = f"A border hit exactly, {ground} ground behind it"
        cases.append(Case(name, border_hit_exactly(factor), "closed form", 1e-12, **kept))
    for left, right in ((0.5, 0.5), (2.0, 2.0), (2.0, 0.5)):
        name = f"Two borders at once, factors {left:g} and {right:g} on friction"
        cases.append(Case(name, two_borders_at_once(left, right), "closed form", 1e-12, **kept))
    name = "A contact stops at a border as another one would leave its own"
    cases += [
        Case(name, arrives_as_another_would_leave, "closed form", 1e-12, **kept),
        Case("A jump across three patches", jump_across_three, "closed form", 1e-12, **kept),
        Case("1e5 periods of rest on a border", rests_on_a_border(100_000), "rest", 0.0, **kept),
        Case("A load at the limit", load_at_the_limit, "closed form", 1e-12, (CHAIN, GRAPH)),
    ]
    for parts in (2, 10, 1000):
        cases.append(Case(f"A ramp split in {parts}", splitting(parts), "one ramp", 1e-10, EVERY, ("exact",)))
    for length, force in ((1e-9, 1e9), (1e9, 1e-9), (1e-9, 1e-9), (1e9, 1e9), (1e-3, 7.0)):
        name = f"Lengths by {length:g}, forces by {force:g}"
        cases.append(Case(name, units(length, force), "scaling law", 1e-10, EVERY))
    kept = {"bodies": (PLANE,), "methods": ("catch_up",), "verdict": "within the tolerance"}
    for tolerance in (1e-2, 1e-4, 1e-6, 1e-7):
        line, path, on = "the line, in tolerances", "event by event, in tolerances", f"tolerance {tolerance:g}"
        cases.append(Case(f"Contacts exchange roles on a ramp, {on}", roles(tolerance), line, 1.0, **kept))
        for kind, corners in (("discs", 0), ("polygons", 6)):
            play = line_in_the_plane(tolerance, corners)
            cases.append(Case(f"Random ramps on a line, {kind}, {on}", play, line, 1.0, **kept))
            play = two_dimensions(tolerance, corners > 0)
            cases.append(Case(f"Random ramps in the plane, {kind}, {on}", play, path, 1.0, **kept))
    for tolerance in (1e-4, 1e-6, 1e-7):
        for loaded in (False, True):
            name = f"Stiff springs in the plane{', loads' if loaded else ''}, tolerance {tolerance:g}"
            play, finer = stiff_springs(tolerance, loaded), "a hundredth of the tolerance, in tolerances"
            cases.append(Case(name, play, finer, 1.0 / 3.0, **kept))
    kept = {"bodies": (SEGMENT,), "verdict": "within the accuracy"}
    against = "closed form, in accuracies"
    for accuracy in (1e-1, 1e-2, 1e-3, 3e-4):
        for forward, backward in ((0.013, 9.7), (0.13, 9.7), (0.0013, 9.7), (3.1, 9.7)):
            name = f"A segment with friction {forward:g} and {backward:g} N/m, accuracy {accuracy:g}"
            cases.append(Case(name, unequal_sides(forward, backward, accuracy), against, 1.0, **kept))
    name = "Random segments with friction up to a thousand times stronger one way"
    cases.append(Case(name, random_unequal, against, 1.0, **kept))
    return cases


CASES = _cases()
