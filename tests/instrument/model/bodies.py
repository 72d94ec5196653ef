"""Random bodies of every kind with random drives, as numbers that can be scaled and mirrored."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st

from crawler_model import Crawler, Scene
from crawler_model.body.curves import through

from .bent_bodies import draw_link

CHAIN, GRAPH, SEGMENT, HYBRID = "chain", "graph", "segment", "hybrid"
DISCS, POLYGONS = "plane, discs", "plane, polygons"
ON_A_LINE, IN_THE_PLANE = (CHAIN, GRAPH, SEGMENT, HYBRID), (DISCS, POLYGONS)
SWELLS = "with_elongation"
CHAMBERS = "chambers"
"""Three segments that touch."""
BENT = tuple(f"bent {kind}" for kind in ON_A_LINE)
"""With springs of every kind, and loads."""
HYSTERETIC = (f"hysteretic {CHAIN}",)
"""With springs that remember."""
LOOSE = tuple(f"loose {kind}" for kind in (CHAIN, HYBRID))
"""With backlash."""
ON_PATCHES = tuple(f"{kind} on patches" for kind in (*ON_A_LINE, "bent chain", "bent hybrid"))
ON_GRADUAL_GROUND = tuple(f"{kind} on gradual ground" for kind in (CHAIN, GRAPH))
"""With friction and, unless some contacts have none, slopes that change along the track."""
BENT_WHERE_BOUNDS_CHANGE = ("bent chain on gradual ground", "hysteretic swelling chain")
"""With bent springs, on ground that changes gradually or with friction that changes with elongations."""
SWELLING = tuple(f"swelling {kind}" for kind in ON_A_LINE)
"""With friction that changes with elongations, by slopes below the stiffness, so that there is one solution."""
BETWEEN_WALLS = tuple(f"{kind} between walls" for kind in (*ON_A_LINE, "chain on patches"))
TOLERANCE = 1e-6
"""Of planar bodies, relative to their extent."""

Row = tuple[np.ndarray, np.ndarray | None, np.ndarray | None]
"""Actuation [m], friction against sliding forward and backward [N]; in the plane the second is all friction."""


@dataclass(frozen=True)
class Driven:
    """The document of a scene and the commands that its drive ramps to, one a second, from rest at L = 0."""

    data: dict[str, Any]
    rows: tuple[Row, ...]

    @property
    def scene(self) -> Scene:
        return Scene.model_validate(self.data)

    @property
    def extent(self) -> float:
        """By which errors are divided: of the body, or of what is commanded of it, whichever is larger [m]."""
        position = self.scene.body.position
        commanded = max(float(np.abs(actuation).max()) for actuation, _, _ in self.rows)
        return max(float(np.abs(np.ptp(position, axis=0)).max()), commanded)

    def moved(self, by: float) -> Driven:
        """Return the same body on a line, and the same ground, elsewhere."""
        body = self.data["body"]
        segments = [_moved(segment, by) for segment in body["segments"]]
        data = self.data | {"body": body | {"contacts": [x + by for x in body["contacts"]], "segments": segments}}
        if "ground" in data:
            data["ground"] = {
                key: _moved(part, by) if isinstance(part, dict) else [_moved(each, by) for each in part]
                for key, part in data["ground"].items()
            }
        return Driven(data, self.rows)

    def renumbered(self, seed: int) -> tuple[Driven, np.ndarray]:
        """Return the same body with its links, and in the plane its contacts, in another order; and the order of the
        contacts."""
        rng, body = np.random.default_rng(seed), self.data["body"]
        links, count = body["links"], len(body["contacts"])
        each = links if isinstance(links, list) else links["between"]
        order = rng.permutation(count) if self.scene.body.dimension == 2 else np.arange(count)
        ways, new = rng.permutation(len(each)), np.argsort(order)

        def sort(row: Any, by: np.ndarray) -> np.ndarray:
            return np.concatenate((np.asarray(row)[by], np.asarray(row)[by.size :]))

        if isinstance(links, list):  # on a line, where contacts keep their numbers
            links = [links[k] for k in ways]
        else:
            between = [[int(new[end]) if isinstance(end, int) else end for end in each[k]] for k in ways]
            links = links | {"stiffness": sort(links["stiffness"], ways).tolist(), "between": between}
        drive = self.data["drive"] | {
            "actuation": [sort(row, ways).tolist() for row in self.data["drive"]["actuation"]]
        }
        if "friction" in drive:
            sides = drive["friction"].items()
            drive["friction"] = {side: [sort(row, order).tolist() for row in rows] for side, rows in sides}
        sides = self.data["friction"].items()
        swelling = [
            entry | ({"link": int(np.argsort(ways)[entry["link"]])} if "link" in entry else {})
            for entry in self.data["friction"].get(SWELLS, [])
        ]
        sides = [(side, row) for side, row in sides if side != SWELLS]
        data = {
            "body": body | {"contacts": [body["contacts"][k] for k in order], "links": links},
            "friction": {side: row if side == "directions" else sort(row, order).tolist() for side, row in sides},
            "drive": drive,
        }
        data["friction"] |= {SWELLS: swelling} if swelling else {}
        held = [(sort(a, ways), *(None if f is None else sort(f, order) for f in rest)) for a, *rest in self.rows]
        return Driven(self.data | data, tuple(held)), order

    def run(self, method: str, parts: int = 1) -> tuple[np.ndarray, list[Any]]:
        """Follow every ramp in so many equal parts: the displacement at the end of each, and all steps."""
        crawler = Crawler(self.scene, method)
        states, steps = [], []
        before = crawler.scene.drive.targets[0]
        for row in self.rows:
            target = crawler.target(*row)
            for part in np.arange(1, parts + 1) / parts:
                steps.append(crawler.follow((before + part * (target - before) if part < 1.0 else target)[None]))
            states.append(crawler.displacement)
            before = target
        return np.array(states), steps


def _moved(part: dict[str, Any], by: float) -> dict[str, Any]:
    places = {key: part[key] for key in ("from", "to", "at") if key in part}
    return part | {key: [x + by for x in at] if isinstance(at, list) else at + by for key, at in places.items()}


@dataclass(frozen=True)
class Drawn:
    """What a random body follows from.

    Attributes:
        kind: of body.
        seed: of all numbers.
        commanded: whether friction is commanded, too.
        ties: whether numbers are whole, so that contacts reach bounds together and frictions balance.
        bare: whether some contacts have no friction.
    """

    kind: str
    seed: int
    commanded: bool = False
    ties: bool = False
    bare: bool = False

    def driven(self, length: float = 1.0, force: float = 1.0, mirrored: bool = False) -> Driven:
        """Build it with lengths and forces scaled, or as its mirror image; in the plane, turned by half a turn."""
        rng = np.random.default_rng(self.seed)
        if self.kind in IN_THE_PLANE:
            return _in_the_plane(self, rng, length, force, mirrored)
        ground = self.kind.removesuffix(" between walls")
        bare = ground.removesuffix(" on patches").removesuffix(" on gradual ground").removeprefix("bent ")
        bare = bare.removeprefix("hysteretic ").removeprefix("loose ").removeprefix("swelling ")
        plain = dataclasses.replace(self, kind=bare, commanded=self.commanded)
        driven = _on_a_line(plain, rng, length, force, mirrored)
        if "swelling " in self.kind:
            driven = _with_elongation(self, driven, length, force, mirrored)
        if "bent " in self.kind:
            driven = _with_bent_springs(self, driven, length, force, mirrored)
        if "hysteretic " in self.kind:
            driven = _with_hysteresis(self, driven, length, force)
        if "loose " in self.kind:
            driven = _with_backlash(self, driven, length)
        if ground in ON_PATCHES:
            driven = _on_patches(plain, driven, length, force, mirrored)
        if ground.endswith(" on gradual ground"):
            driven = _on_gradual_ground(plain, driven, length, force, mirrored)
        if self.kind in BETWEEN_WALLS:
            driven = _between_walls(plain, driven, length, mirrored)
        return driven


@st.composite
def drawn(draw: st.DrawFn, kind: str) -> Drawn:
    """Any random body of a kind; ties and missing friction on a line only, where the answer is exact.

    Bodies with bent springs have friction everywhere, as a part of them between flat springs may else have none for an
    instant, where its margin vanishes: ticks show that or not. They have ties without segments only: where many
    elements yield at once, ramps may not be unique without being reported so.
    """
    bent, joined = "bent" in kind, "segment" in kind or "hybrid" in kind
    options = [draw(st.booleans()) and kind != POLYGONS]
    options += [draw(st.booleans()) and kind not in IN_THE_PLANE and not (bent and joined)]
    options += [draw(st.booleans()) and kind not in IN_THE_PLANE and not bent]
    return Drawn(kind, draw(st.integers(0, 2**32 - 1)), *options)


def _parts_on_a_line(kind: str, rng: np.random.Generator) -> tuple[int, list[tuple[Any, Any]], int]:
    """Return the number of contacts, what links join, and the number of segments."""
    if kind == SEGMENT:
        return 0, [], 1
    if kind == CHAMBERS:
        return 0, [], 3
    if kind == HYBRID:
        return 3, [(0, 1), (1, 2), (2, "s0.from"), ("s0.to", "s1.from"), (0, "s1.to")], 2
    if kind == GRAPH:
        return 7, [(int(rng.integers(0, i)), i) for i in range(1, 7)] + [(0, 5), (2, 6)], 0
    return 7, [(i, i + 1) for i in range(6)], 0


def _on_a_line(drawn: Drawn, rng: np.random.Generator, length: float, force: float, mirrored: bool) -> Driven:
    n, between, segments = _parts_on_a_line(drawn.kind, rng)
    spread = np.exp(rng.uniform(-2, 0, (2, segments)))
    stiffness = np.exp(rng.uniform(-1, 1, len(between)))
    mu = np.exp(rng.uniform(-2, 0, (2, n)))
    rows = [np.append(rng.uniform(-2, 2, len(between)), rng.uniform(-1, 1, segments)) for _ in range(5)]
    factors = rng.uniform(0.2, 2.0, (5, 2, n + segments))
    if drawn.ties:
        stiffness[:] = 1.0
        mu, spread = rng.integers(1, 5, mu.shape) / 4.0, rng.integers(1, 5, spread.shape) / 8.0
        rows = [np.round(row) for row in rows]
        factors = rng.integers(1, 5, factors.shape) / 2.0
    if drawn.bare:
        mu = mu * (rng.random(mu.shape) < 0.7)
    between = _reflected(between, n) if mirrored else between
    parts, pitch, elements = [], *((1.0, 7) if drawn.kind == CHAMBERS else (2.0, 20))
    for k in range(segments):
        ends = (-11.0 - pitch * k, -10.0 - pitch * k) if mirrored else (10.0 + pitch * k, 11.0 + pitch * k)
        parts.append({"name": f"s{k}", "from": ends[0] * length, "to": ends[1] * length, "elements": elements})
    friction = np.hstack((mu * force, spread * force / length))
    commands = [friction * (f if drawn.commanded else 1.0) for f in factors]
    if mirrored:  # contacts in reverse order, segments in their own
        order = np.append(np.arange(n)[::-1], np.arange(n, n + segments)).astype(int)
        friction, commands = friction[::-1, order], [c[::-1, order] for c in commands]
    for k, part in enumerate(parts):
        sides = dict(zip(("forward", "backward"), friction[:, n + k].tolist(), strict=True))
        part |= {"stiffness": 2.0 * force, "friction": sides}
    contacts = np.arange(n) * length
    body: dict[str, Any] = {"contacts": (-contacts[::-1] if mirrored else contacts).tolist(), "segments": parts}
    if between:
        body["links"] = {"stiffness": (stiffness * force / length).tolist(), "between": [list(p) for p in between]}
    data: dict[str, Any] = {"name": "random", "body": body}
    if n:
        data["friction"] = dict(zip(("forward", "backward"), friction[:, :n].tolist(), strict=True))
    unit = np.append(np.full(len(between), length), np.ones(segments))
    actuation = [unit * row for row in rows]
    drive = {"times": list(range(6)), "actuation": [[0.0] * unit.size, *(a.tolist() for a in actuation)]}
    if drawn.commanded:
        each = np.array([friction, *commands])
        drive["friction"] = {"forward": each[:, 0].tolist(), "backward": each[:, 1].tolist()}
    held = zip(actuation, commands, strict=True)
    return Driven(data | {"drive": drive}, tuple((a, *(c if drawn.commanded else (None, None))) for a, c in held))


def _scaled(part: dict[str, Any], length: float, force: float) -> dict[str, Any]:
    """Scale a link; its curves are first moved so that they go through 0."""
    unit = dict.fromkeys(("elongation", "shortest", "longest"), length)
    unit |= {"stiffness": force / length, "tension": force, "least": force, "most": force}
    scaled: dict[str, Any] = {}
    for key, value in part.items():
        if key == "curve":
            curve = through(value["elongation"], value["tension"])
            at = np.union1d(value["elongation"], [0.0])
            value = {"elongation": at, "tension": curve(at) - curve(0.0)}
        scaled[key] = (
            _scaled(value, length, force) if isinstance(value, dict) else (unit[key] * np.array(value)).tolist()
        )
    return scaled


def _with_bent_springs(drawn: Drawn, driven: Driven, length: float, force: float, mirrored: bool) -> Driven:
    """Replace its springs by some of every kind, with loads where friction surely holds them."""
    rng = np.random.default_rng([drawn.seed, 2])
    body = driven.data["body"]

    def draw(length: float) -> dict[str, Any]:
        spread = np.exp(rng.uniform(-0.5, 0.5, 2)) if not drawn.ties else np.ones(2)
        part, _ = draw_link(rng, 0, 1)
        del part["between"]
        return _scaled(part, length * float(spread[0]), force * float(spread[1]))

    segments = [{key: value for key, value in part.items() if key != "stiffness"} for part in body["segments"]]
    body = body | {"segments": [segment | draw(1.0) for segment in segments]}
    if "links" in body:
        body["links"] = [{"between": pair} | draw(length) for pair in body["links"]["between"]]
    data = driven.data | {"body": body}
    if not (drawn.commanded or drawn.bare or drawn.kind in ON_PATCHES):
        isolated, unit = (
            len(body["contacts"]),
            np.repeat([force, force / length], (len(body["contacts"]), len(segments))),
        )
        loads = rng.integers(-1, 2, unit.size) / 16.0 * unit
        if mirrored:
            loads = -np.append(loads[:isolated][::-1], loads[isolated:])
        data["loads"] = loads.tolist()
    return Driven(data, driven.rows)


def _with_hysteresis(drawn: Drawn, driven: Driven, length: float, force: float) -> Driven:
    """Put up to two elements of hysteresis in parallel with each of its springs."""
    rng = np.random.default_rng([drawn.seed, 3])
    body = driven.data["body"]

    def draw(stiffness: float) -> dict[str, Any]:
        numbers = rng.integers(1, 5, (2, 2)) / 4.0 if drawn.ties else np.exp(rng.uniform(-1.5, 0.5, (2, 2)))
        numbers *= (stiffness, 0.5 * force)
        elements = [dict(zip(("stiffness", "yield"), each, strict=True)) for each in numbers.tolist()]
        return {"stiffness": stiffness, "hysteresis": elements[: int(rng.integers(0, 3))]}

    body = body | {"segments": [part | draw(part["stiffness"]) for part in body["segments"]]}
    if "links" in body:
        links = zip(body["links"]["between"], body["links"]["stiffness"], strict=True)
        body["links"] = [{"between": pair} | draw(stiffness) for pair, stiffness in links]
    return Driven(driven.data | {"body": body}, driven.rows)


def _with_backlash(drawn: Drawn, driven: Driven, length: float) -> Driven:
    """Put backlash between the commands and most of its actuators."""
    rng = np.random.default_rng([drawn.seed, 4])
    body = driven.data["body"]

    def draw(length: float) -> float:
        return length * (float(rng.integers(0, 5)) / 4.0 if drawn.ties else max(float(rng.uniform(-0.2, 1.0)), 0.0))

    body = body | {"segments": [part | {"backlash": draw(0.5)} for part in body["segments"]]}
    links = zip(body["links"]["between"], body["links"]["stiffness"], strict=True)
    body["links"] = [{"between": pair, "stiffness": k, "backlash": draw(length)} for pair, k in links]
    return Driven(driven.data | {"body": body}, driven.rows)


def _with_elongation(drawn: Drawn, driven: Driven, length: float, force: float, mirrored: bool) -> Driven:
    """Let most links change the friction of their contacts, and segments their own."""
    rng = np.random.default_rng([drawn.seed, 6])
    body, entries = driven.data["body"], []
    links = body.get("links", {"stiffness": [], "between": []})

    def draw(key: str, unit: float, slope: float) -> dict[str, Any]:
        at = np.sort(rng.uniform(-1.5, 1.5, 3)) if not drawn.ties else np.sort(rng.choice(13, 3, False) - 6.0) / 4.0
        slopes = rng.uniform(-0.9, 0.9, (2, 2)) if not drawn.ties else rng.integers(-3, 4, (2, 2)) / 4.0
        rows = np.concatenate((np.zeros((2, 1)), np.cumsum(slopes * np.diff(at), axis=1)), axis=1)
        rows = slope * unit * (rows - rows.min(axis=1, keepdims=True))
        sides = dict(zip(("forward", "backward"), (rows[::-1] if mirrored else rows).tolist(), strict=True))
        return {key: (at * unit).tolist()} | sides

    for k, (pair, stiffness) in enumerate(zip(links["between"], links["stiffness"], strict=True)):
        ends = [i for i in (pair[::-1] if mirrored else pair) if isinstance(i, int)]
        if rng.random() < 0.7 and ends:
            part = draw("elongation", length, stiffness)
            entries.append({"link": k, "contacts": ends[: int(rng.integers(1, 3))]} | part)
    for part in body["segments"]:
        entries.append({"segment": part["name"]} | draw("strain", 1.0, part["stiffness"] / length))
    return Driven(driven.data | {"friction": driven.data.get("friction", {}) | {SWELLS: entries}}, driven.rows)


def _on_patches(drawn: Drawn, driven: Driven, length: float, force: float, mirrored: bool) -> Driven:
    """Lay two patches below a body, with slopes where friction surely holds its weight."""
    rng = np.random.default_rng([drawn.seed, 1])
    first, last = {CHAIN: (-1.0, 7.0), GRAPH: (-1.0, 7.0), SEGMENT: (9.5, 11.5), HYBRID: (-1.0, 14.0)}[drawn.kind]
    cuts = np.sort(rng.uniform(first, last, 4))
    factors, slopes = np.exp(rng.uniform(-1.5, 0.7, (2, 2))), rng.uniform(-8.0, 8.0, 2)
    if drawn.ties:
        cuts = np.sort(rng.choice(np.arange(first, last, 0.25), 4, replace=False))
        cuts += (
            0.0625 / 3.0 if drawn.commanded or drawn.bare else 0.0
        )  # a contact that turns exactly on a border may jump or not
        factors = rng.integers(1, 5, (2, 2)) / 2.0
    if drawn.bare:
        factors = factors * (rng.random((2, 2)) < 0.8)
    sloping = not (drawn.commanded or drawn.bare)
    patches: list[dict[str, Any]] = []
    for j in range(2):
        ends, sides = cuts[2 * j : 2 * j + 2] * length, factors[j]
        if mirrored:
            ends, sides = -ends[::-1], sides[::-1]
        patch = dict(zip(("from", "to", "forward", "backward"), (*ends.tolist(), *sides.tolist()), strict=True))
        patches.append(patch | ({"slope": float(-slopes[j] if mirrored else slopes[j])} if sloping else {}))
    data = driven.data | {"ground": {"patches": patches[::-1] if mirrored else patches}}
    if sloping:
        isolated, segments = len(data["body"]["contacts"]), len(data["body"]["segments"])
        weights = [0.05 * force] * isolated + [0.05 * force / length] * segments
        data["body"] = data["body"] | {"weights": weights}
    return Driven(data, driven.rows)


def _on_gradual_ground(drawn: Drawn, driven: Driven, length: float, force: float, mirrored: bool) -> Driven:
    """Lay ground below a body whose factors and slopes are linear between four places, with friction that holds it."""
    rng = np.random.default_rng([drawn.seed, 4])
    first, last = {SEGMENT: (9.5, 11.5), HYBRID: (-1.0, 14.0)}.get(drawn.kind, (-1.0, 7.0))
    at, factors = np.sort(rng.uniform(first, last, 4)), np.exp(rng.uniform(-1.0, 0.5, (2, 4)))
    slopes = rng.uniform(-8.0, 8.0, 4)
    if drawn.ties:
        at = np.sort(rng.choice(np.arange(first, last, 0.25), 4, replace=False)) + 0.0625 / 3.0
        factors = rng.integers(2, 5, factors.shape) / 2.0
    if mirrored:
        at, factors, slopes = -at[::-1], factors[::-1, ::-1], -slopes[::-1]
    sides = dict(zip(("forward", "backward"), factors.tolist(), strict=True))
    profile = {"at": (at * length).tolist(), "friction": sides}
    data = driven.data
    if not drawn.bare and "loads" not in data:
        isolated, segments = len(data["body"]["contacts"]), len(data["body"]["segments"])
        weights = [0.05 * force] * isolated + [0.05 * force / length] * segments
        data = data | {"body": data["body"] | {"weights": weights}}
        profile["slope"] = slopes.tolist()
    return Driven(data | {"ground": {"profile": profile}}, driven.rows)


def _between_walls(drawn: Drawn, driven: Driven, length: float, mirrored: bool) -> Driven:
    """Put a wall at each end of a body, and between other contacts two that stop one of them."""
    rng = np.random.default_rng([drawn.seed, 3])
    data, n = driven.data, len(driven.data["body"]["contacts"])
    ends = {SEGMENT: (10.0, 11.0), HYBRID: (0.0, 13.0)}.get(drawn.kind, (0.0, 6.0))
    away = rng.uniform(0.1, 0.8, 4)
    if drawn.ties:
        away = rng.integers(1, 4, 4) / 4.0 + (0.0625 / 3.0 if drawn.commanded or drawn.bare else 0.0)
    walls = [("backward", ends[0] - away[0], None), ("forward", ends[1] + away[1], None)]
    if n:
        i = int(rng.integers(n))
        walls += [("backward", i - away[2], i), ("forward", i + away[3], i)]
    found = []
    for stops, at, i in walls:
        if mirrored:
            stops, at, i = {"backward": "forward", "forward": "backward"}[stops], -at, None if i is None else n - 1 - i
        found.append({"at": float(at * length), "stops": stops} | ({} if i is None else {"contacts": [i]}))
    return Driven(data | {"ground": data.get("ground", {}) | {"walls": found}}, driven.rows)


def _reflected(between: list[tuple[Any, Any]], contacts: int) -> list[tuple[Any, Any]]:
    turned = {"from": "to", "to": "from"}

    def other(end: Any) -> Any:
        return contacts - 1 - end if isinstance(end, int) else f"{end[:2]}.{turned[end[3:]]}"

    return [(other(b), other(a)) for a, b in between]


def _in_the_plane(drawn: Drawn, rng: np.random.Generator, length: float, force: float, mirrored: bool) -> Driven:
    n, sign = 4, -1.0 if mirrored else 1.0
    between = [[0, 1], [1, 2], [2, 3], [0, 3]]
    stiffness = np.exp(rng.uniform(-1, 1, 4)) * force / length
    contacts = rng.normal(size=(n, 2)) * length * sign
    actuation = rng.uniform(-2, 2, (5, 4, 2)) * length * sign
    mu = np.exp(rng.uniform(-2, 0, n)) * force
    commands = mu * rng.uniform(0.2, 2.0, (5, n))
    friction: dict[str, Any] = {"isotropic": mu.tolist()}
    if drawn.kind == POLYGONS:
        angles = (rng.uniform(0.0, 1.0) + 2.0 * np.pi * np.arange(5) / 5 + (np.pi if mirrored else 0.0)) % (2.0 * np.pi)
        points = rng.normal(size=(n, 4, 2)) * force * sign
        points -= points.mean(axis=1, keepdims=True)
        value = (points @ np.array([np.cos(angles), np.sin(angles)])).max(axis=1)
        order = np.argsort(angles)
        friction = {"directions": angles[order].tolist(), "value": value[:, order].tolist()}
    drive: dict[str, Any] = {"times": list(range(6)), "actuation": [[[0.0, 0.0]] * 4, *actuation.tolist()]}
    if drawn.commanded:
        drive["friction"] = {"isotropic": [mu.tolist(), *commands.tolist()]}
    links = {"stiffness": stiffness.tolist(), "between": between}
    data = {"name": "random", "dimension": 2, "tolerance": TOLERANCE, "friction": friction, "drive": drive}
    data["body"] = {"contacts": contacts.tolist(), "links": links}
    held = zip(actuation, commands, strict=True)
    return Driven(data, tuple((a, c if drawn.commanded else None, None) for a, c in held))
