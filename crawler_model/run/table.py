"""The columns of the table of a run: one for each quantity."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..body.body import Body
from ..body.columns import Columns
from ..body.names import name_every_contact, name_every_spring
from ..body.plan import Plan
from ..body.turning import SIDES
from ..errors import CrawlerError

ENERGIES = ("work", "dissipation", "loads_work", "jump_loss", "stored", "internal_dissipation")


class Group(NamedTuple):
    """Columns that belong together: how the values are called in `Trajectory`, names and units of the columns."""

    values: str
    names: tuple[str, ...]
    units: tuple[str, ...]


_YIELDS = ("slack", "stalled")


def _name_torques(body: Body) -> Group:
    """Name the tensions of links and the torques of joints of a body that turns."""
    names, links, joints = name_every_spring(body), body.springs, body.lengths - body.springs
    each = [f"{name}/{'tension' if i < links else 'torque'}" for i, name in enumerate(names)]
    return Group("tension", tuple(each), ("N",) * links + ("N m",) * joints)


def unit_of_command(columns: Columns, column: int) -> str:
    """Find the unit of a column of command rows.

    Args:
        columns: the layout of the rows.
        column: index of the column.

    Returns:
        Its unit; "1" for strain.
    """
    segment = any(columns.names[column].split("/")[0] == name for name, _, _ in columns.segments)
    if columns.kind(column) == "actuation":
        return "1" if segment else "rad" if column >= columns.links and columns.joints is not None else "m"
    return "N/m" if segment else "N"


@dataclass(frozen=True, eq=False)
class TrajectoryColumns:
    """The columns of `Trajectory.to_table` for a scene, in their order.

    The file `docs/tables.md` describes them.

    Attributes:
        scene: the scene.
    """

    scene: Plan

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(name for group in self.groups for name in group.names)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column; "1" for numbers without one."""
        return {n: unit for group in self.groups for n, unit in zip(group.names, group.units, strict=True)}

    def __repr__(self) -> str:
        """State how many columns there are, and the first ones."""
        return f"TrajectoryColumns({self.scene.name}, {len(self.names)} columns: {', '.join(self.names[:4])}, ...)"

    @functools.cached_property
    def commanded(self) -> np.ndarray:
        """Indices of the command columns in the table: lengths and strains, and what else the drive commands."""
        return np.flatnonzero(self.scene.commanded)

    @functools.cached_property
    def loaded(self) -> bool:
        """Whether the table has loads."""
        return self.scene.columns.slope_load is not None or self.scene.ground.track is not None

    @functools.cached_property
    def groups(self) -> tuple[Group, ...]:
        """The columns by quantity.

        Raises:
            CrawlerError: if a segment has the name of a column.
        """
        scene, body = self.scene, self.scene.body
        planar = body.dimension == 2
        axes = ("_x", "_y") if planar else ("",)
        contacts, springs = name_every_contact(body), name_every_spring(body)
        if planar:
            sides = [f"direction_{k}" for k in range(scene.columns.planar or 0)] or ["friction"]
            sides = sides if body.turning is None else list(SIDES)
            friction = [f"{contact}/{side}" for contact in contacts for side in sides]
        else:
            friction = [f"{contact}/{side}" for side in ("forward", "backward") for contact in contacts]

        def group(values: str, names: list[str], unit: str) -> Group:
            return Group(values, tuple(names), (unit,) * len(names))

        def each(items: tuple[str, ...], quantity: str) -> list[str]:
            return [f"{item}/{quantity}{axis}" for item in items for axis in axes]

        positions = [f"{contact}/{axis}" for contact in contacts for axis in "xy"] if planar else list(contacts)
        commands = tuple(f"command/{scene.columns.names[column]}" for column in self.commanded)
        found = (
            group("time", ["time"], "s"),
            group("position", positions, "m"),
            group("elongation", [segment.name for segment in body.segments], "m"),
            Group(
                "commands", commands, tuple(unit_of_command(scene.columns, int(column)) for column in self.commanded)
            ),
            group("velocity", each(contacts, "velocity"), "m/s"),
            group("state", [f"{contact}/state" for contact in contacts], "1"),
            group("ground_force", each(contacts, "ground_force"), "N"),
            group("friction", friction, "N"),
            group("load", each(contacts, "load") if self.loaded else [], "N"),
            group("tension", each(springs, "tension"), "N") if body.turning is None else _name_torques(body),
            group("yields", [f"{springs[k]}/{word}" for k in body.limits.index for word in _YIELDS], "1"),
            group("net_translation", [f"net_translation{axis}" for axis in axes], "m"),
            group("yaw", ["yaw"] if body.turning is not None else [], "rad"),
            group("energies", list(ENERGIES), "J"),
        )
        own = {name for part in found if part.values != "elongation" for name in part.names}
        for segment in body.segments:
            if segment.name in own:
                raise CrawlerError(
                    f"to_table: the segment {segment.name} has the name of a column of the table; rename it"
                )
        return found
