"""Drives that are slow enough for masses: the motion does not depend on their speed, the inertia number does."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from crawler_model.errors import CommandError, SceneError
from crawler_model.run.simulate import find_inertia
from crawler_model.scene.scene import Scene


def check_slower_than(scene: Scene, most: float | None) -> None:
    """Check a limit of the inertia number.

    Args:
        most: the limit [1]; None for none.

    Raises:
        CommandError: if it is not positive.
        SceneError: if the scene has no masses.
    """
    if most is None:
        return
    if not 0.0 < most < math.inf:
        raise CommandError(f"slower_than: {most:g}; an inertia number must be > 0, for example 0.1")
    if scene.ground.masses is None:
        raise SceneError(f"slower_than: {scene.name} has no masses; give body.masses or body.weights")


def slow_down(scene: Scene, most: float) -> tuple[Scene, float]:
    """Lengthen the drive of a scene until its inertia number is small enough.

    Args:
        scene: a scene with masses and a drive.
        most: largest inertia number [1].

    Returns:
        The scene, and the factor by which its drive takes longer, 1 or more.
    """
    found = find_inertia(scene)
    if found is None or found.number <= most:
        return scene, 1.0
    factor = found.number / most
    document = scene.document()
    return Scene.model_validate(document | {"drive": _stretch(document["drive"], factor)}), factor


def _stretch(drive: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Multiply all times of a drive."""
    slow = dict(drive)
    if "times" in drive:
        slow["times"] = [factor * time for time in drive["times"]]
    if "period" in drive or "strategy" in drive:
        slow["period"] = factor * drive.get("period", 1.0)
    for wave in {"wave", "friction_wave"} & set(drive):
        slow[wave] = drive[wave] | {"period": factor * drive[wave]["period"]}
    return slow
