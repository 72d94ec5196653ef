"""What is simulated, as arrays: all that a crawler, a run and the theory need of a scene."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ..errors import SceneError
from .body import Body
from .columns import Columns
from .drive import Drive
from .ground import Ground


class Plan(Protocol):
    """A body, what can be commanded of it, where it starts and what drives it."""

    @property
    def name(self) -> str:
        """Of the scene."""
        ...

    @property
    def body(self) -> Body:
        """Contacts and springs."""
        ...

    @property
    def ground(self) -> Ground:
        """Weights, slope and patches of the track."""
        ...

    @property
    def columns(self) -> Columns:
        """The layout of its commands."""
        ...

    @property
    def drive(self) -> Drive:
        """The open-loop commands; one waypoint where nothing drives the body."""
        ...

    @property
    def angles(self) -> np.ndarray:
        """In the plane, the directions in which friction is given, shape (m,) [rad]; m = 0 where it is isotropic."""
        ...

    @property
    def directions(self) -> np.ndarray:
        """The same as unit vectors, shape (m, 2)."""
        ...

    @property
    def start_displacement(self) -> np.ndarray:
        """X at the start, shape (N,), in the plane (N, 2) [m]."""
        ...

    @property
    def tolerance(self) -> float | None:
        """In the plane, the largest error of a ramp relative to the largest change commanded [1]; None: the default."""
        ...


def check_plan(scene: Any, call: str) -> None:
    """Refuse what is no scene.

    Args:
        scene: what was given as one.
        call: the receiver, for the error.

    Raises:
        SceneError: when it is a name, a path, a mapping or anything else that has no arrays.
    """
    if hasattr(scene, "start_displacement"):
        return
    given = " ".join(repr(scene).split())
    given = given if len(given) <= 60 else f"{given[:60]} ..."
    raise SceneError(
        f"{call}: {given} is no Scene; load_scene builds one from a path or a name of the gallery, "
        "Scene.model_validate from a mapping"
    )
