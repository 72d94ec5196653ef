"""The controls of a scene: what a person can change, with units and the ends of sliders."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from crawler_model import Scene
from crawler_model.run.table import unit_of_command

SLOPE = "slope"
"""Name of the control of the slope, which adds to the loads of all contacts."""


@dataclass(frozen=True)
class Control:
    """A number that a person can change.

    Attributes:
        name: as in commands, such as "link_0" or "contact_1/forward".
        kind: "actuation", "friction" or "loads", or "slope".
        unit: of the number.
        columns: the columns of a command row that it sets; none for the slope.
        least: lower end of its slider [unit].
        most: upper end of its slider [unit].
    """

    name: str
    kind: str
    unit: str
    columns: tuple[int, ...]
    least: float
    most: float


def list_controls(scene: Scene, tilts: bool) -> list[Control]:
    """List the controls of a scene.

    Args:
        scene: the scene.
        tilts: whether the slope can be changed.

    Returns:
        One for each quantity that commands can change, in the order of a command row, then the slope.
    """
    columns, rows = scene.columns, scene.drive.rows
    found: list[Control] = []
    seen: set[int] = set()
    single = {name: columns.aliases[name] for name in columns.names if name in columns.aliases}
    for name, sets in {**single, **columns.aliases}.items():
        where = [int(column) for column in sets if column not in seen]
        if not where or (name.endswith("/friction") and columns.planar is None):
            continue
        seen.update(where)
        kind, unit = columns.kind(where[0]), unit_of_command(columns, where[0])
        least, most = _limits(scene, kind, unit, rows[:, where])
        found.append(Control(name, kind, unit, tuple(where), least, most))
    slope = [Control(SLOPE, SLOPE, "°", (), -45.0, 45.0)] if tilts else []
    return found + slope


def _limits(scene: Scene, kind: str, unit: str, rows: np.ndarray) -> tuple[float, float]:
    """Choose the ends of a slider: what the drive commands, and what moves the body well."""
    body, reach = scene.body, 1.5 * float(np.abs(rows).max())
    friction = scene.drive.rows[:, scene.columns.lengths :][:, : scene.columns.frictions]
    if kind == "friction":
        return 0.0, round_up(max(2.0 * float(rows.max()), 0.5 * float(friction.max())) or 1.0)
    if kind == "loads":
        reach = max(reach, float(friction.max()))
    elif unit == "m":
        gaps = np.linalg.norm(
            (body.position[body.ends[:, 1]] - body.position[body.ends[:, 0]]).reshape(body.springs, -1), axis=1
        )
        reach = max(reach, 0.5 * float(gaps.mean()))
    else:
        reach = max(reach, math.pi / 2.0 if unit == "rad" else 0.5)
    return -round_up(reach), round_up(reach)


def round_up(value: float) -> float:
    """Round to two digits, away from zero.

    Args:
        value: >= 0 [any unit].

    Returns:
        The value; 1 for 0 [the same unit].
    """
    if value == 0.0:
        return 1.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(f"{math.ceil(value / digit - 1e-9) * digit:.2g}")


def plain_name(name: str) -> str:
    """Write the name of a command in plain words.

    Args:
        name: such as "contact_0/forward".

    Returns:
        Such as "foot 0, forward".
    """
    return name.replace("contact_", "foot ").replace("_", " ").replace("/", ", ")
