"""Units of the numbers of a scene."""

from __future__ import annotations

import re

from crawler_model import Scene

_UNITS = {
    "polygon": "m",
    "left_of": "m",
    "added": "N",
    "forward": "N",
    "backward": "N",
    "left": "N",
    "right": "N",
    "angle": "rad",
    "isotropic": "N",
    "friction": "N",
    "stiffness": "N/m",
    "length": "m",
    "period": "s",
    "times": "s",
    "wavelength": "m",
    "contacts": "m",
    "points": "m",
    "radius": "m",
    "from": "m",
    "to": "m",
    "at": "m",
    "elongation": "m",
    "longest": "m",
    "shortest": "m",
    "tolerance": "m",
    "displacement": "m",
    "actuation": "m",
    "amplitude": "m",
    "mean": "m",
    "directions": "rad",
    "loads": "N",
    "weights": "N",
    "slope": "degrees",
    "direction": "rad",
}


def unit_of(scene: Scene, key: str) -> str:
    """Return the unit of a number of a scene.

    Args:
        scene: the scene.
        key: its dotted key.

    Returns:
        The unit; "1" for a number without one.
    """
    named = re.split(r"[.\[\]]+", key.removesuffix("]"))
    steps = [step for step in named if not step.isdecimal()]
    if "coefficient" in steps:
        return "1"
    if "tension" in steps:
        return "N"
    if steps[:2] == ["body", "joints"]:
        return "N m/rad"
    if named[:2] == ["drive", "actuation"] and len(named) == 4 and scene.body.dimension == 1:
        return "m" if int(named[3]) < scene.columns.links else "1"
    if named[:2] == ["drive", "actuation"] and len(named) == 4 and scene.body.turning is not None:
        return "m" if int(named[3]) < scene.body.springs else "rad"
    unit = next((_UNITS[step] for step in reversed(steps) if step in _UNITS), "1")
    if {"patches", "profile", "regions"} & set(steps):
        return "1" if unit == "N" else unit
    if steps[:2] == ["friction", "with_elongation"] and len(named) > 2 and scene.parts.couplings[int(named[2])].segment:
        return "N/m" if unit == "N" else unit
    if (steps[-1] in ("loads", "weights") or named[:2] == ["drive", "friction"]) and scene.body.segments:
        alone, indices = int(scene.body.isolated.size), [int(step) for step in named if step.isdecimal()]
        if alone and len(indices) <= steps.count("drive"):  # a whole row
            return "N, N/m"
        return "N" if indices and indices[-1] < alone else "N/m"
    if "segments" in steps:
        if steps[-1] in ("elongation", "longest", "shortest"):  # strains
            return "1"
        return {"N": "N/m", "N/m": "N"}.get(unit, unit)
    if "friction_wave" in steps and unit == "m" and steps[-1] != "wavelength":
        return "N, N/m" if scene.parts.body.segments else "N"
    return (
        "1" if scene.parts.body.segments and not scene.parts.body.links and steps[-1] in ("amplitude", "mean") else unit
    )
