"""Units of the numbers of a scene."""

from __future__ import annotations

from crawler_model import Scene
from crawler_model.sweep.keys import key_steps

_UNITS = {
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
    "displacement": "m",
    "actuation": "m",
    "amplitude": "m",
    "mean": "m",
    "directions": "rad",
    "loads": "N",
    "weights": "N",
    "slope": "degrees",
}


def unit_of(scene: Scene, key: str) -> str:
    """Return the unit of a number of a scene.

    Args:
        scene: the scene.
        key: its dotted key.

    Returns:
        The unit; "1" for a number without one.
    """
    named = key_steps(key)
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
    if steps[-1] in ("loads", "weights") and scene.body.segments:
        alone = int(scene.body.isolated.size)
        return "N, N/m" if not named[-1].isdecimal() else "N" if int(named[-1]) < alone else "N/m"
    if "segments" in steps:
        return {"N": "N/m", "N/m": "N"}.get(unit, "m" if steps[-1] in ("from", "to") else unit)
    if "friction_wave" in steps and unit == "m" and steps[-1] != "wavelength":
        return "N, N/m" if scene.parts.body.segments else "N"
    return (
        "1" if scene.parts.body.segments and not scene.parts.body.links and steps[-1] in ("amplitude", "mean") else unit
    )
