"""Random ramps in the plane, with the error that is left in units of the tolerance."""

from __future__ import annotations

from typing import Any

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.scene.parts import LEAST_TOLERANCE

from .planar_reference import Reference


def _plane(contacts, ends, stiffness, friction, directions, actuation, tolerance):
    mu = {"isotropic": friction[:, 0].tolist()}
    if directions is not None:
        angles = np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)
        mu = {"directions": angles.tolist(), "value": friction.tolist()}
    body = {"contacts": contacts.tolist(), "links": {"stiffness": stiffness.tolist(), "between": ends}}
    drive = {"times": list(range(len(actuation))), "actuation": actuation.tolist()}
    scene = {"name": "ramps", "dimension": 2, "body": body, "friction": mu, "drive": drive, "tolerance": tolerance}
    return Crawler(Scene.model_validate(scene))


def polygon(angle, corners):
    """Directions, one of them at an angle, in counterclockwise order from the x axis."""
    angles = np.sort((angle + 2.0 * np.pi * np.arange(corners) / corners) % (2.0 * np.pi))
    return np.stack((np.cos(angles), np.sin(angles)), 1)


def on_a_line(stiffness, friction, ramps, tolerance, angle=0.0, corners=0):
    """Lay a chain on a line in the plane; its error against the line, in tolerances, and whether it was overspent.

    Args:
        stiffness: of N - 1 links.
        friction: of N contacts.
        ramps: pairs of N - 1 rest lengths and N frictions.
        tolerance: of the scene.
        angle: of the line.
        corners: of the polygon of friction, an even number; 0 for a disc.
    """
    n = len(friction)
    along = np.array([np.cos(angle), np.sin(angle)])
    body = {"contacts": list(range(n)), "links": {"stiffness": list(stiffness)}}
    line = Crawler(Scene.model_validate({"name": "line", "body": body, "friction": {"isotropic": list(friction)}}))
    lengths = np.array([np.zeros(n - 1), *(length for length, _ in ramps)])
    each = max(corners, 1)
    plane = _plane(
        np.arange(n)[:, None] * along,
        [[i, i + 1] for i in range(n - 1)],
        np.array(stiffness, float),
        np.repeat(np.array(friction, float)[:, None], each, 1),
        polygon(angle, corners) if corners else None,
        lengths[:, :, None] * along,
        tolerance,
    )
    size = np.ptp(lengths[:, :, None] * along, axis=0).max()
    worst = 0.0
    for count, (length, mu) in enumerate(ramps, 1):
        if not line.advance(length, mu, mu).unique:
            break  # the translation is a matter of choice
        mu_there = np.repeat(np.array(mu, float)[:, None], corners, 1) if corners else np.array(mu, float)
        if plane.advance(np.array(length)[:, None] * along, mu_there).overspent:
            return np.inf
        off = np.abs(plane.displacement - line.displacement[:, None] * along).max()
        worst = max(worst, off / (count * tolerance * size))
    return float(worst)


def random_line(seed, tolerance, corners=0):
    """The error of several random ramps of a random chain on a line in the plane, in tolerances."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 6))
    stiffness, friction = np.exp(rng.uniform(-1.5, 1.5, n - 1)), np.exp(rng.uniform(-1.5, 1.0, n))
    if seed % 3 == 0:  # contacts reach bounds together
        stiffness, friction = rng.integers(1, 9, n - 1) / 2.0, rng.integers(1, 9, n) / 4.0
    ramps = []
    for _ in range(int(rng.integers(1, 5))):
        length = rng.uniform(-3.0, 3.0, n - 1) * np.exp(rng.uniform(-1.0, 1.0))
        ramps.append((length, friction if seed % 2 else friction * rng.uniform(0.2, 2.0, n)))
    angle = rng.choice([0.0, rng.uniform(0.0, 2.0 * np.pi)])
    return on_a_line(stiffness, friction, ramps, tolerance, angle, corners)


class Planar:
    """Random ramps of a body in the plane, and where they really lead."""

    def __init__(self, seed, directional=False):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(2, 5))
        self.ends = [[i, i + 1] for i in range(n - 1)] + ([[0, n - 1]] if n > 2 and seed % 2 else [])
        links = len(self.ends)
        self.stiffness = np.exp(rng.uniform(-1.0, 1.0, links))
        self.contacts = rng.normal(size=(n, 2))
        self.directions = polygon(rng.uniform(0.0, 6.0), int(rng.integers(3, 7))) if directional else None
        points = rng.normal(size=(n, 5, 2))
        wide = (points - points.mean(1, keepdims=True)) @ (self.directions.T if directional else np.eye(2))
        self.friction = wide.max(1) if directional else np.exp(rng.uniform(-1.0, 0.5, (n, 1)))
        count = int(rng.integers(1, 4))
        commanded = seed % 3 == 0
        self.lengths = np.concatenate((np.zeros((1, links, 2)), rng.normal(size=(count, links, 2)) * 2.0))
        factors = rng.uniform(0.3, 1.7, (count, n, 1)) if commanded else np.ones((count, n, 1))
        self.frictions = factors * self.friction
        reference = Reference(self.ends, self.stiffness, self.friction, self.directions)
        self.places = [reference.ramp(*ramp) for ramp in zip(self.lengths[1:], self.frictions, strict=True)]

    def error(self, tolerance):
        """The largest error in tolerances; infinite if the steps were spent."""
        crawler = _plane(
            self.contacts, self.ends, self.stiffness, self.friction, self.directions, self.lengths, tolerance
        )
        size = np.ptp(self.lengths, axis=0).max()
        worst = 0.0
        for count, place in enumerate(self.places, 1):
            mu = self.frictions[count - 1]
            if crawler.advance(self.lengths[count], mu if self.directions is not None else mu[:, 0]).overspent:
                return np.inf
            worst = max(worst, np.abs(crawler.displacement - place).max() / (count * tolerance * size))
        return float(worst)


def stiff(seed: int, loaded: bool) -> dict[str, Any]:
    """Draw a chain or a ring whose springs stretch by 1/100 to 1/3000 of the strokes until contacts slide."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 6))
    between = [[i, i + 1] for i in range(n - 1)] + ([[0, n - 1]] if seed % 4 == 3 else [])
    mu, stroke = rng.uniform(0.5, 2.0, n), 10.0 ** rng.uniform(-1.0, 0.0)
    stiffness = 10.0 ** rng.uniform(2.0, 3.5) * mu.mean() / stroke * np.where(seed % 3, 1.0, rng.uniform(0.5, 2.0))
    strokes = np.concatenate((np.zeros((1, len(between), 2)), rng.normal(size=(3, len(between), 2)) * stroke))
    pull = rng.normal(size=(n, 2))
    pull *= (mu * rng.uniform(0.2, 0.85) / np.hypot(*pull.T))[:, None]
    body = {"contacts": rng.normal(size=(n, 2)).tolist()}
    body["links"] = {"stiffness": float(stiffness), "between": between}
    drive = {"times": [0, 1, 2, 3], "actuation": strokes.tolist()}
    scene = {"name": "stiff", "dimension": 2, "body": body, "friction": {"isotropic": mu.tolist()}, "drive": drive}
    return scene | ({"loads": pull.tolist(), "start": "relaxed"} if loaded else {})


def stiff_error(seed: int, loaded: bool, tolerance: float) -> float:
    """Return the error of the ramps of `stiff` against a tolerance that is a hundred times smaller, in tolerances."""
    document = stiff(seed, loaded)
    rough, fine = (
        Crawler(Scene.model_validate(document | {"tolerance": t}))
        for t in (tolerance, max(tolerance / 100.0, LEAST_TOLERANCE))
    )
    strokes = np.array(document["drive"]["actuation"])
    worst = 0.0
    for count, stroke in enumerate(strokes[1:], 1):
        if not (rough.advance(stroke).unique and fine.advance(stroke).unique):
            break
        off = np.abs(rough.displacement - fine.displacement).max()
        worst = max(worst, off / (count * tolerance * np.ptp(strokes, axis=0).max()))
    return float(worst)
