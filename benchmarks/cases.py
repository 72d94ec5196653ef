"""The crawlers on which methods are compared, and their exact solutions."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene, load_scene
from crawler_model.body.drive import NS
from tests.instrument.model.sliding import follow_sliding
from tests.scenes import wave_scene

PERIODS = 2
"""Periods over which errors are measured, at every quarter."""
QUARTERS = 4 * PERIODS


@dataclass(frozen=True, eq=False)
class Reference:
    """The solution with which a method is compared.

    Attributes:
        displacement: x at the end of each quarter, shape (8, N), in the plane (8, N, 2) [m].
        size: the largest range of a displacement, by which errors are divided [m].
        kind: "rational" (exact arithmetic), "exact" (every event followed), or "integrated" (by scipy, in the plane).
        certificate: finite numbers that certify it.
    """

    displacement: np.ndarray
    size: float
    kind: str
    certificate: dict[str, float]

    def error(self, displacement: np.ndarray) -> float:
        """Compute the largest error, relative to the size of the motion.

        Returns:
            The relative error.
        """
        return float(np.abs(displacement - self.displacement).max() / self.size)


@dataclass(frozen=True, eq=False)
class Case:
    """A crawler with a drive of period 1 s.

    Attributes:
        name: its name for the command.
        title: its description, for a picture.
        scene: the crawler.
        rational: x at the end of each quarter by rational arithmetic, from fractions; None when not computed.
        gain: net translation per period after the first in closed form [m]; in the plane its length.
    """

    name: str
    title: str
    scene: Scene
    rational: np.ndarray | None = None
    gain: float | None = None

    @property
    def contacts(self) -> int:
        """Number of contacts N."""
        return self.scene.body.contacts

    @property
    def waypoints(self) -> int:
        """Number of waypoints per period."""
        return self.scene.drive.times.size - 1

    @functools.lru_cache(maxsize=8)  # noqa: B019  a case lives as long as the run
    def quarters(self, ticks: int, through_waypoints: bool) -> tuple[np.ndarray, ...]:
        """Sample the commands of one period.

        Returns:
            The targets of the ramps of each quarter, shape (ramps, S + 2 N) each.
        """
        drive = self.scene.drive
        ends = np.rint(np.arange(1, ticks + 1) * (NS / ticks)).astype(np.int64)
        if through_waypoints:
            ends = np.union1d(ends, drive.waypoints_between(0, NS)[0])
        cuts = np.searchsorted(ends, np.arange(5) * (NS // 4), side="right")
        return tuple(np.ascontiguousarray(drive.sample(ends[a:b])) for a, b in itertools.pairwise(cuts))

    @functools.cached_property
    def reference(self) -> Reference:
        """The solution with which methods are compared."""
        if self.scene.dimension == 2:
            return self._integrate()
        crawler = Crawler(self.scene)
        start = crawler.displacement
        steps, found, net = [], [], []
        for quarter in range(QUARTERS):
            steps.append(crawler.follow(self.quarters(4, True)[quarter % 4]))
            found.append(crawler.displacement)
            net.append(crawler.net_translation)
        x = np.array(found)
        work = sum(abs(step.work) for step in steps)
        certificate = {
            "energy_residual": abs(sum(step.certificate.energy_residual for step in steps)) / work,
            "violation": max(step.certificate.violation for step in steps),
            "complementarity": max(step.certificate.complementarity for step in steps),
        }
        certificate |= self._compare_gain(np.array(net))
        size = float(np.ptp(np.concatenate((start[None], x)), axis=0).max())
        if self.rational is not None:
            certificate["rational_difference"] = float(np.abs(x - self.rational).max())
            return Reference(self.rational, size, "rational", certificate)
        return Reference(x, size, "exact", certificate)

    def _integrate(self) -> Reference:
        """Follow the case in the plane by another method than ours."""
        quarters = self.quarters(4, True)
        x, account = follow_sliding(self.scene, [quarters[number % 4] for number in range(QUARTERS)])
        certificate = {
            "energy_residual": abs(account.energy_residual) / account.work,
            "violation": max(account.violation, 0.0),
            **self._compare_gain(x.mean(axis=1)),
        }
        size = float(np.ptp(np.concatenate((self.scene.start_displacement[None], x)), axis=0).max())
        return Reference(x, size, "integrated", certificate)

    def _compare_gain(self, net: np.ndarray) -> dict[str, float]:
        """Compare the gain of the second period with its closed form, from y at the end of each quarter."""
        if self.gain is None:
            return {}
        gained = float(np.linalg.norm(net[-1] - net[3]))
        return {"closed_form": self.gain, "closed_form_difference": abs(gained - self.gain)}


def _strategy_a() -> Case:
    quarters = [[0, 1.5], [0, 3], [0.5, 3], [2, 3], [2, 3.5], [2, 5], [2.5, 5], [4, 5]]
    return Case(
        "strategy_a",
        "two anchors, strategy A, k Lmax = 4 mu: friction changes with time",
        load_scene("two_anchor_a"),
        np.array(quarters),
        2.0,
    )


def _peristaltic() -> Case:
    return Case("peristaltic", "ten contacts, a peristaltic wave", load_scene("ten_contact_wave"))


def _wave(contacts: int) -> Case:
    return Case(f"wave_{contacts}", f"{contacts:,} contacts, waves twenty links long", wave_scene(contacts, 20.0))


def _long_wave(contacts: int) -> Case:
    """Build five waves along a body, with the same total friction for any number of contacts."""
    title = f"{contacts:,} contacts, five waves along the body"
    scene = wave_scene(contacts, (contacts - 1) / 5.0, 100.0 / contacts)
    return Case(f"long_wave_{contacts}", title, scene)


def _segment() -> Case:
    scene = load_scene("continuous_segment")
    return Case("segment", f"a continuous segment, {scene.body.springs} elements", scene, gain=0.05)


def _graph() -> Case:
    per_mille = [
        [0, 62.5, 35],
        [2.5, 62.5, 102.5],
        [77.5, 62.5, 127.5],
        [112.5, 115, 127.5],
        [112.5, 175, 147.5],
        [115, 175, 215],
        [190, 175, 240],
        [225, 227.5, 240],
    ]
    return Case(
        "graph",
        "three contacts, each joined to each by a spring",
        load_scene("three_springs"),
        np.array(per_mille) / 1000.0,
        9 / 80,
    )


def _planar() -> Case:
    gain = float(np.hypot(0.06, 0.03)) - 0.3 / 20.0
    return Case("planar", "three points in the plane, isotropic friction", load_scene("planar_three_points"), gain=gain)


def _planar_turning() -> Case:
    angle, start = 2.0 * np.pi * np.arange(17) / 16.0, 2.0 * np.pi * np.arange(3) / 3.0
    angle[-1] = 0.0
    turned = angle[:, None] + start
    actuation = 0.06 * np.stack((np.cos(turned) - np.cos(start), np.sin(turned) - np.sin(start)), axis=2)
    document = load_scene("planar_three_points").document() | {
        "name": "planar_turning",
        "drive": {"times": (np.arange(17) / 16).tolist(), "period": 1.0, "actuation": actuation.tolist()},
    }
    title = "three points in the plane, rest lengths turn in circles: curved paths"
    return Case("planar_turning", title, Scene.model_validate(document))


CASES: dict[str, Callable[[], Case]] = {
    "strategy_a": _strategy_a,
    "peristaltic": _peristaltic,
    "wave_100": lambda: _wave(100),
    "wave_1000": lambda: _wave(1_000),
    "wave_10000": lambda: _wave(10_000),
    "wave_100000": lambda: _wave(100_000),
    "long_wave_100": lambda: _long_wave(100),
    "long_wave_1000": lambda: _long_wave(1_000),
    "segment": _segment,
    "graph": _graph,
    "planar": _planar,
    "planar_turning": _planar_turning,
}
"""All cases, built on request."""
LONG = ("wave_10000", "wave_100000", "long_wave_1000")
"""Cases that a quick run leaves out."""


def describe(reference: Reference) -> dict[str, Any]:
    """Convert the certificate of a reference to plain data.

    Returns:
        Its kind, size and certificate.
    """
    return {"reference": reference.kind, "size": reference.size, **reference.certificate}
