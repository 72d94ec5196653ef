"""The interface of a scene for the crawler, runs and theory: arrays only."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ..errors import SceneError
from .body import Body
from .columns import Columns
from .drive import Drive
from .ground import Ground


class Plan(Protocol):
    """A body, the layout of its commands, its start and its drive."""

    @property
    def name(self) -> str:
        """Name of the scene."""

    @property
    def body(self) -> Body:
        """Contacts and springs."""

    @property
    def ground(self) -> Ground:
        """Weights of the contacts, and the slope."""

    @property
    def columns(self) -> Columns:
        """Layout of the commands."""

    @property
    def drive(self) -> Drive:
        """Open-loop commands; a single waypoint if the scene has no drive."""

    @property
    def commanded(self) -> np.ndarray:
        """Which columns the drive commands, bool, shape (C,); the others hold values of the scene."""

    @property
    def angles(self) -> np.ndarray:
        """Angles of the friction directions in the plane, shape (m,) [rad]; m = 0 for isotropic friction."""

    @property
    def directions(self) -> np.ndarray:
        """The same directions as unit vectors, shape (m, 2)."""

    @property
    def start_displacement(self) -> np.ndarray:
        """X at the start, shape (N,), in the plane (N, 2) [m]."""

    @property
    def tolerance(self) -> float | None:
        """Largest error of a planar ramp, relative to the largest commanded change [1]; None for the default."""


def check_plan(scene: Any, call: str) -> None:
    """Raise an error for anything that is not a scene.

    Args:
        scene: the argument.
        call: name of the caller, for the error message.

    Raises:
        SceneError: if it is a name, a path, a mapping or anything else without arrays.
    """
    if hasattr(scene, "start_displacement"):
        return
    given = " ".join(repr(scene).split())
    given = given if len(given) <= 60 else f"{given[:60]} ..."
    raise SceneError(
        f"{call}: {given} is not a Scene; load_scene builds one from a path or a gallery name, "
        "Scene.model_validate from a mapping"
    )
