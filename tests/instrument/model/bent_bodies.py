"""Random bodies whose springs are bent, as scenes and in rational numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction as F
from typing import Any

import numpy as np

from .rational_bends import RationalBentBody, RationalCurve, RationalGround, RationalLink, Row

STIFFNESS = (1, 2, 4, 8)
"""Powers of two, so that knots at tensions of 1/8 N are floats."""


def eighths(rng: np.random.Generator, least: int, most: int) -> F:
    """A multiple of 1/8."""
    return F(int(rng.integers(least, most + 1)), 8)


def line(stiffness: F) -> RationalCurve:
    """The curve of a linear spring."""
    return RationalCurve([F(0)], [F(0)], stiffness, stiffness)


def _knots(rng: np.random.Generator) -> tuple[dict[str, Any], RationalCurve]:
    """A curve with knots; some of its pieces are flat."""
    count = int(rng.integers(2, 5))
    at, value = [eighths(rng, -12, 0)], [eighths(rng, -8, 4)]
    for _ in range(count - 1):
        step = F(int(rng.choice([2, 4, 8])), 8)
        at.append(at[-1] + step)
        value.append(value[-1] + step * int(rng.choice([0, 1, 2, 4, 8])))
    slopes = [(b - a) / (t - s) for a, b, s, t in zip(value, value[1:], at, at[1:], strict=False)]
    if not any(slopes):
        value[-1] += 1
        slopes[-1] = 1 / (at[-1] - at[-2])
    part = {"elongation": [float(v) for v in at], "tension": [float(v) for v in value]}
    return part, RationalCurve(at, value, slopes[0], slopes[-1])


def _actuator(rng: np.random.Generator) -> tuple[dict[str, Any], RationalCurve]:
    kind = rng.choice(["linear", "tendon", "motor", "both", "curve", "none"], p=[0.15, 0.25, 0.25, 0.1, 0.2, 0.05])
    if kind == "none":
        return {}, line(F(0))
    if kind == "curve":
        part, curve = _knots(rng)
        return {"curve": part}, curve
    k = F(int(rng.choice(STIFFNESS)))
    least, most = (F(0) if kind == "tendon" else -eighths(rng, 1, 12)), eighths(rng, 1, 12)
    if kind == "linear":
        return {"stiffness": float(k)}, line(k)
    if kind == "tendon":
        return {"stiffness": float(k), "tension": {"least": 0.0}}, RationalCurve([F(0)], [F(0)], F(0), k)
    if kind == "motor":
        least = -most
    limits = {"least": float(least), "most": float(most)}
    return {"stiffness": float(k), "tension": limits}, RationalCurve([least / k, most / k], [least, most], F(0), F(0))


def _passive(rng: np.random.Generator, needed: bool) -> tuple[dict[str, Any], RationalCurve]:
    kind = rng.choice(["none", "spring", "stops", "curve"], p=[0.35, 0.25, 0.25, 0.15])
    if kind == "none" and needed:
        kind = "spring"
    if kind == "none":
        return {}, line(F(0))
    if kind == "spring":
        k = F(int(rng.choice(STIFFNESS)))
        return {"passive": {"stiffness": float(k)}}, line(k)
    if kind == "curve":
        part, curve = _knots(rng)
        return {"passive": {"curve": part}}, curve
    shortest, longest, k = -eighths(rng, 1, 4), eighths(rng, 1, 4), F(64)
    stops = {"shortest": float(shortest), "longest": float(longest), "stiffness": float(k)}
    return {"passive": {"stops": stops}}, RationalCurve([shortest, longest], [F(0), F(0)], k, k)


def draw_link(rng: np.random.Generator, a: int, b: int) -> tuple[dict[str, Any], RationalLink]:
    """A link of any kind."""
    part, actuator = _actuator(rng)
    beside, passive = _passive(rng, needed=not part)
    return part | beside | {"between": [a, b]}, RationalLink(a, b, actuator, passive)


def draw_ground(rng: np.random.Generator, weights: Row, dyadic: bool) -> tuple[dict[str, Any], RationalGround]:
    """One to three patches, some that touch, with slopes where contacts have weights."""
    count, fine = int(rng.integers(1, 4)), 8 if dyadic else 997
    cuts = sorted(rng.choice(np.arange(-fine, 4 * fine), 2 * count, replace=False).tolist())
    if rng.random() < 0.3 and count > 1:
        cuts[2] = cuts[1]
    patches, borders, factors, rises = [], [], [F(1)], [F(0)]
    for begin, end in zip(cuts[::2], cuts[1::2], strict=True):
        factor = F(int(rng.choice([2, 4, 8, 16])), 8) if dyadic else F(int(rng.integers(250, 2000)), 1000)
        rise = F(int(rng.integers(-4, 5)), 16) if any(weights) else F(0)
        if borders and borders[-1] == F(begin, fine):
            factors[-1:], rises[-1:] = [factor], [rise]
        else:
            borders, factors, rises = [*borders, F(begin, fine)], [*factors, factor], [*rises, rise]
        borders, factors, rises = [*borders, F(end, fine)], [*factors, F(1)], [*rises, F(0)]
        patch = {"from": begin / fine, "to": end / fine, "friction": float(factor)}
        patches.append(patch | ({"slope": math.degrees(math.asin(rise))} if rise else {}))
    loads = [[-weight * rise for weight in weights] for rise in rises]
    return {"patches": patches}, RationalGround(borders, factors, loads)


def draw_body(
    rng: np.random.Generator, contacts: int, extra: int = 0, patches: bool = False, dyadic: bool = True
) -> tuple[dict[str, Any], RationalBentBody, list[Row]]:
    """A scene, the same body in rational numbers, and the commands of its drive; at will, on patches of ground."""
    pairs = [(i, i + 1) for i in range(contacts - 1)]
    pairs += [tuple(sorted(rng.choice(contacts, 2, replace=False).tolist())) for _ in range(extra)]
    drawn = [draw_link(rng, a, b) for a, b in pairs]
    forward = [eighths(rng, 1, 16) for _ in range(contacts)]
    backward = [eighths(rng, 1, 16) for _ in range(contacts)]
    position = [F(i) for i in range(contacts)]
    document: dict[str, Any] = {}
    ground, held = None, [F(1)] * contacts
    if patches:
        weights = [min(forward[i], backward[i]) / 8 * int(rng.random() < 0.8) for i in range(contacts)]
        weights = [weight * F(int(rng.integers(1, 5)), 2) for weight in weights]
        if rng.random() < 0.6:
            weights = [F(0)] * contacts
        document["ground"], ground = draw_ground(rng, weights, dyadic)
        held = [min(ground.factors)] * contacts
    body = RationalBentBody(contacts, [link for _, link in drawn], forward, backward, position, ground)
    for i, force in enumerate(body.forces()):  # tensions where z and L are 0 are held
        load = max(abs(loads[i]) for loads in ground.loads) if ground else F(0)
        forward[i] = max(forward[i], (force + load + F(1, 8)) / held[i])
        backward[i] = max(backward[i], (F(1, 8) + load - force) / held[i])
    body = RationalBentBody(contacts, body.links, forward, backward, position, ground)
    rows = [[F(0)] * len(pairs) + forward + backward]
    for _ in range(5):
        row = [eighths(rng, -16, 16) for _ in pairs]
        friction = [*forward, *backward]
        if rng.random() < 0.3:
            friction = [f * F(int(rng.integers(4, 9)), 8) for f in friction]
        rows.append(row + friction)
    document |= {
        "name": "bent",
        "body": {"contacts": [float(p) for p in position], "links": [part for part, _ in drawn]},
        "friction": {"forward": [float(v) for v in forward], "backward": [float(v) for v in backward]},
        "drive": drive_of(rows, len(pairs), contacts),
    }
    if patches:
        document["body"]["weights"] = [float(weight) for weight in weights]
    return document, body, rows


def drive_of(rows: Sequence[Sequence[F]], links: int, contacts: int) -> dict[str, Any]:
    """A drive along rows of lengths, forward and backward friction, one a second."""
    return {
        "times": list(range(len(rows))),
        "actuation": [[float(v) for v in row[:links]] for row in rows],
        "friction": {
            "forward": [[float(v) for v in row[links : links + contacts]] for row in rows],
            "backward": [[float(v) for v in row[links + contacts :]] for row in rows],
        },
    }
