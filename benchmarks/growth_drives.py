"""The drives on which the growth of the time of a ramp is measured: the hardest ones for the solver."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from crawler_model import Scene
from crawler_model.crawler.method import Method
from tests.scenes import wave_scene

_TICKS = 64
"""Ramps per period of a drive that is sampled."""
_FRICTION = {"forward": 0.1, "backward": 0.3}
_BOTH: tuple[Method, ...] = "catch_up", "exact"
_LINE = 1_000, 3_000, 10_000, 30_000, 100_000


@dataclass(frozen=True)
class GrowthDrive:
    """A body of any number of contacts, and the targets that it follows.

    Attributes:
        build: builds the scene of N contacts, and the targets of its ramps, shape (V, F).
        sizes: the numbers of contacts N that are measured, increasing.
        methods: the methods that apply.
    """

    build: Callable[[int], tuple[Scene, np.ndarray]]
    sizes: tuple[int, ...] = _LINE
    methods: tuple[Method, ...] = _BOTH


def _sampled(scene: Scene) -> tuple[Scene, np.ndarray]:
    """Sample the drive of a scene, of period 1 s, at the ends of its ramps."""
    ends = np.arange(1, _TICKS + 1) * (1_000_000_000 // _TICKS)
    return scene, np.ascontiguousarray(scene.drive.sample(ends))


def _from_start(scene: Scene, changes: np.ndarray) -> tuple[Scene, np.ndarray]:
    """Change the rest lengths from their start in each ramp: to each row of `changes` in turn, shape (V, S)."""
    targets = np.repeat(scene.drive.targets[:1], len(changes), axis=0)
    targets[:, : changes.shape[1]] += changes
    return scene, targets


def _there_and_back(scene: Scene, change: np.ndarray) -> tuple[Scene, np.ndarray]:
    return _from_start(scene, np.stack((change, np.zeros_like(change))))


def _chain(name: str, n: int, stiffness: Any = 1.0) -> Scene:
    body = {"contacts": list(range(n)), "links": {"stiffness": stiffness}}
    return Scene.model_validate({"name": name, "body": body, "friction": _FRICTION})


def _changed(scene: Scene, **more: Any) -> Scene:
    return Scene.model_validate(scene.document() | more)


def _five(n: int) -> tuple[float, float]:
    """The length of five waves along a body [m], and the factor that gives it the same total friction for any N."""
    return (n - 1) / 5.0, 100.0 / n


# -- chains -----------------------------------------------------------------------------------------------------------


def _random_loads(n: int) -> tuple[Scene, np.ndarray]:
    widths = np.random.default_rng(n).uniform(-5.0, 5.0, (8, n - 1))
    return _from_start(_chain("random", n), widths * (_FRICTION["forward"] + _FRICTION["backward"]))


def _stalling(n: int) -> tuple[Scene, np.ndarray]:
    """Motors whose limits are sums of the friction of contacts, so that parts of the body are free."""
    scene = wave_scene(n, 20.0)
    links = {"stiffness": 1.0, "tension": sum(_FRICTION.values())}
    return _sampled(_changed(scene, body=scene.document()["body"] | {"links": links}, start="relaxed"))


def _patches(n: int, count: int) -> tuple[Scene, np.ndarray]:
    length = n / count
    patches = [{"from": (k + 0.3) * length, "to": (k + 0.8) * length, "friction": 0.6} for k in range(count)]
    return _sampled(_changed(wave_scene(n, 20.0), ground={"patches": patches}))


# -- segments ---------------------------------------------------------------------------------------------------------


def _segment(elements: int) -> dict[str, Any]:
    return {"name": "s", "from": 0, "to": 1, "stiffness": 1.0, "elements": elements, "friction": _FRICTION}


def _stretched(n: int, part: float) -> tuple[Scene, np.ndarray]:
    scene = Scene.model_validate({"name": "stretched", "body": {"segments": [_segment(n - 1)]}})
    return _there_and_back(scene, np.full(n - 1, part / (n - 1)))


def _segment_waves(n: int) -> tuple[Scene, np.ndarray]:
    wave = {"amplitude": 0.2, "wavelength": 0.2, "period": 1.0}
    document = {"name": "waves", "body": {"segments": [_segment(n - 1)]}, "start": "relaxed", "drive": {"wave": wave}}
    return _sampled(Scene.model_validate(document))


# -- graphs -----------------------------------------------------------------------------------------------------------


def _hybrid(n: int) -> tuple[Scene, np.ndarray]:
    links = {"stiffness": [4.0, 1.0], "between": [["s.to", 0], ["s.from", 0]]}
    body = {"segments": [_segment(n - 2)], "contacts": [1.5], "links": links}
    wave = {"amplitude": 0.2, "wavelength": 0.2, "period": 1.0}
    document = {"name": "hybrid", "body": body, "friction": _FRICTION, "start": "relaxed", "drive": {"wave": wave}}
    return _sampled(Scene.model_validate(document))


def _grid(n: int) -> tuple[Scene, np.ndarray]:
    side = round(n**0.5)
    at = np.arange(n).reshape(side, side)
    right, down = (np.stack((a.ravel(), b.ravel()), 1) for a, b in ((at[:, :-1], at[:, 1:]), (at[:-1], at[1:])))
    between = np.concatenate((right, down))
    body = {"contacts": list(range(n)), "links": {"stiffness": 1.0, "between": between.tolist()}}
    scene = Scene.model_validate({"name": "grid", "body": body, "friction": _FRICTION})
    return _from_start(scene, np.random.default_rng(n).uniform(-0.2, 0.2, (8, len(between))))


# -- the plane --------------------------------------------------------------------------------------------------------


def _planar_waves(n: int, friction: dict[str, Any], wavelength: float, ground: float) -> tuple[Scene, np.ndarray]:
    """Waves that turn the rest vectors of a chain in the plane; `ground` is a factor of the friction."""
    times = np.arange(_TICKS + 1) / _TICKS
    turned = 2.0 * np.pi * (times[:, None] - (np.arange(n - 1) + 0.5) / wavelength)
    lengths = np.stack((np.sin(turned), 0.5 * np.cos(turned)), axis=2)
    lengths[-1] = lengths[0]
    document: dict[str, Any] = {"name": "planar", "dimension": 2, "start": "relaxed"}
    document["body"] = {"contacts": [[i, 0] for i in range(n)], "links": {"stiffness": 1.0}}
    document["friction"] = {
        key: value if key == "directions" else (ground * np.array(value)).tolist() for key, value in friction.items()
    }
    document["drive"] = {"times": times.tolist(), "period": 1.0, "actuation": lengths.tolist()}
    return _sampled(Scene.model_validate(document))


_DISC = {"isotropic": 0.2}
_POLYGON = {"directions": (np.pi * np.arange(4) / 2.0).tolist(), "value": [0.1, 0.2, 0.3, 0.2]}
_PLANE: dict[str, Any] = {"sizes": (10, 100, 300, *_LINE), "methods": ("catch_up",)}


DRIVES: dict[str, GrowthDrive] = {
    "waves of 20 links": GrowthDrive(lambda n: _sampled(wave_scene(n, 20.0))),
    "five waves": GrowthDrive(lambda n: _sampled(wave_scene(n, *_five(n)))),
    "random loads": GrowthDrive(_random_loads),
    "motors that stall at a balance": GrowthDrive(_stalling, (100, 300, 1_000), ("exact",)),
    "eleven patches": GrowthDrive(lambda n: _patches(n, 11), methods=("exact",)),
    "stretched by 50 %": GrowthDrive(lambda n: _stretched(n, 0.5)),
    "five waves of strain": GrowthDrive(_segment_waves),
    "ring of a segment and a foot": GrowthDrive(_hybrid, (100, 300, *_LINE)),
    "grid of springs": GrowthDrive(_grid, (100, 400, 900, 2_500, 10_000, 30_276, 99_856)),
    "plane, waves of 20 links": GrowthDrive(lambda n: _planar_waves(n, _DISC, 20.0, 1.0), **_PLANE),
    "plane, waves of 20 links, friction by directions": GrowthDrive(
        lambda n: _planar_waves(n, _POLYGON, 20.0, 1.0), **_PLANE
    ),
}
