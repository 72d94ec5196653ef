"""Randomisation: what differs from episode to episode, drawn from the seed, and the scenes that follow."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from crawler_model import CrawlerError, Scene
from crawler_model.body.turning import SIDES

from ..sweep.stack import Stack, stack
from ..sweep.vary import Variations, vary

OF_SCENE = ("friction", "stiffness", "loads", "slope")
"""What changes the scene: factors on friction and on stiffness, an additional load on each contact [N] (on segments
[N/m]), the slope [degrees]."""
KEYS = (*OF_SCENE, "delay", "noise", "noise_seed")
"""The others: delay of the actions in steps; standard deviation of the noise of the sensors relative to the scale of
each reading; the seed of that noise."""
_FRICTION = (*SIDES, "isotropic", "value", "added", "coefficient", "with_elongation")
"""The keys that hold friction or coefficients of friction, tables of them, or parts with such keys."""
MOST_DELAY = 1000
MOST_SEED = 2**63 - 1


@dataclass(frozen=True, eq=False)
class Ranges:
    """The ranges from which episodes are drawn.

    Attributes:
        ranges: least and largest value by key, in the order of KEYS.
    """

    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def most_delay(self) -> int:
        """Largest delay [steps]."""
        return int(self.ranges.get("delay", (0, 0))[1])

    @property
    def of_scene(self) -> tuple[str, ...]:
        """The keys that change the scene."""
        return tuple(key for key in self.ranges if key in OF_SCENE)

    @property
    def loads(self) -> bool:
        """Whether episodes have loads or slopes."""
        return "loads" in self.ranges or "slope" in self.ranges

    def draw(self, random: np.random.Generator) -> dict[str, Any]:
        """Draw the values of an episode.

        Args:
            random: the generator of the environment.

        Returns:
            The values by key; given as options of `reset`, they repeat the episode.
        """
        drawn: dict[str, Any] = {}
        for key, (low, high) in self.ranges.items():
            if key == "delay":
                drawn[key] = int(random.integers(int(low), int(high), endpoint=True))
            elif key == "noise_seed":
                drawn[key] = int(low)
            else:
                drawn[key] = low if low == high else float(random.uniform(low, high))
        if drawn.get("noise", 0.0) > 0.0 and "noise_seed" not in drawn:
            drawn["noise_seed"] = int(random.integers(MOST_SEED))
        return drawn


def read_ranges(options: Any) -> Ranges:
    """Check the options of `reset`.

    Args:
        options: for each key a number, or the least and the largest of a range.

    Returns:
        The ranges.

    Raises:
        CrawlerError: if a key is unknown, or a value is not such a number or range.
    """
    if not isinstance(options, Mapping):
        raise CrawlerError(f"options: {options!r}; they must be a mapping with keys of {', '.join(KEYS)}")
    for key in options:
        if key not in KEYS:
            near = difflib.get_close_matches(str(key), KEYS, n=1, cutoff=0.0)[0]
            raise CrawlerError(f"options: unknown key {key!r}; the nearest is {near!r}, of {', '.join(KEYS)}")
    return Ranges({key: _range(key, options[key]) for key in KEYS if key in options})


def _range(key: str, given: Any) -> tuple[float, float]:
    whole = key in ("delay", "noise_seed")
    try:
        pair = (given, given) if np.ndim(given) == 0 else tuple(given)
        low, high = (int(v) if whole and int(v) == v else float(v) for v in pair)
    except (TypeError, ValueError, OverflowError):
        low = high = math.nan
    bounds = {
        "friction": (0.0, 1e6, "factors >= 0"),
        "stiffness": (1e-6, 1e6, "factors > 0"),
        "loads": (-1e9, 1e9, "loads [N]"),
        "slope": (-89.0, 89.0, "degrees between -89 and 89"),
        "delay": (0, MOST_DELAY, f"whole numbers of steps, 0 .. {MOST_DELAY}"),
        "noise": (0.0, 1e3, "relative deviations >= 0"),
        "noise_seed": (0, MOST_SEED, "whole numbers >= 0"),
    }
    least, most, what = bounds[key]
    fits = math.isfinite(low) and math.isfinite(high) and least <= low <= high <= most
    if not fits or (whole and not (isinstance(low, int) and isinstance(high, int))):
        raise CrawlerError(f"options: {key} is {given!r}; it must be a number or [least, largest], of {what}")
    if key == "noise_seed" and low != high:
        raise CrawlerError(f"options: noise_seed is {given!r}; it must be a single number")
    return low, high


def vary_scene(scene: Scene, keys: tuple[str, ...], values: Mapping[str, np.ndarray]) -> Variations:
    """Build the variations of a scene that follow from drawn values.

    Args:
        scene: the scene.
        keys: the keys that change it.
        values: of each key, shape (K,).

    Returns:
        K scenes.

    Raises:
        SceneError: if a key has no effect in this scene.
    """
    columns: dict[str, np.ndarray] = {}
    document = scene.document()
    for key in keys:
        value = np.asarray(values[key], dtype=np.float64)
        if key == "slope":
            columns["ground.slope"] = value
        elif key == "loads":
            if scene.dimension == 2:
                raise CrawlerError("options: loads is for bodies on a line; in the plane randomise slope or friction")
            given = list(_numbers(document.get("loads", 0.0), "loads"))
            columns |= {name: number + value for name, number in given}
        else:
            columns |= {name: number * value for name, number in _of(document, key)}
    return vary(scene, columns, grid=False)


def assemble(variations: Variations) -> Stack:
    """Assemble variations together.

    Args:
        variations: the variations.

    Returns:
        The stack of their arrays.

    Raises:
        CrawlerError: with the reason of the first invalid one.
    """
    whole = stack(variations)
    for at, reason in sorted(whole.reasons.items()):
        drawn = ", ".join(f"{key} {column[at]:g}" for key, column in variations.values.items())
        raise CrawlerError(f"options: with {drawn} the scene is invalid: {reason}")
    return whole


def _of(document: dict[str, Any], key: str) -> Iterator[tuple[str, float]]:
    """List the numbers of friction, or of stiffness, in the document of a scene."""
    body = document["body"]
    if key == "stiffness":
        yield from _stiffnesses(body.get("links", ()), "body.links")
    elif "friction" in document:
        yield from _numbers(document["friction"], "friction")
    for segment in body.get("segments", ()):
        name = f"body.segments.{segment['name']}"
        yield from _stiffnesses(segment, name) if key == "stiffness" else _numbers(segment[key], f"{name}.{key}")


def _stiffnesses(node: Any, name: str) -> Iterator[tuple[str, float]]:
    """List the numbers of stiffness below links or a segment: of springs and stops, and the tensions of curves."""
    for key, inner in node.items() if isinstance(node, Mapping) else ():
        if key == "stiffness":
            yield from _numbers(inner, f"{name}.{key}")
        elif key == "curve":
            yield from _numbers(inner["tension"], f"{name}.{key}.tension")
        else:
            yield from _stiffnesses(inner, f"{name}.{key}")
    for i, inner in enumerate(node if isinstance(node, (list, tuple)) else ()):
        yield from _stiffnesses(inner, f"{name}[{i}]")


def _numbers(node: Any, name: str) -> Iterator[tuple[str, float]]:
    """List the numbers below a key that are friction, stiffness, tensions or loads: not places, angles or links."""
    if isinstance(node, Mapping):
        for key, inner in node.items():
            if key in _FRICTION:
                yield from _numbers(inner, f"{name}.{key}")
    elif isinstance(node, list):
        for i, inner in enumerate(node):
            yield from _numbers(inner, f"{name}[{i}]")
    else:
        yield name, float(node)
