"""The contract of the robots for which plans are made, and the choice of the robot of a scene.

The implementations are `line_robot` for bodies on a line and `plane_robot` for bodies that turn. A place is what a path
is made of: the net translation [m], in the plane x and y [m] and the yaw [rad], D numbers.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np

from crawler_model.errors import SceneError
from crawler_model.scene.scene import Scene


class Start(Protocol):
    """A body at rest, from which paths begin."""

    @property
    def robot(self) -> Robot:
        """The robot."""

    @property
    def x(self) -> np.ndarray:
        """Displacement, shape (N,), in the plane (N, 2) [m]."""

    @property
    def before(self) -> np.ndarray:
        """Rest lengths and angles in force, shape (J,) [m, rad]."""

    def follow(self, rows: np.ndarray) -> np.ndarray:
        """Follow a path.

        Args:
            rows: rest lengths and angles that are reached one after another, shape (V, J) [m, rad].

        Returns:
            Displacement after each ramp, shape (V, N), in the plane (V, N, 2) [m].

        Raises:
            CommandError: if a ramp cannot be followed.
        """

    def differentiate_places(self, rows: np.ndarray, moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Follow a path with the derivatives of its places with respect to its rows.

        Args:
            rows: as for `follow`.
            moved: the M numbers of a row that change.

        Returns:
            The place after each ramp, shape (V, D), and its derivatives with respect to the moved numbers of each row
            in turn, shape (V, D, V M).

        Raises:
            CommandError: if a ramp cannot be followed, or has no derivatives.
        """


class Robot(Protocol):
    """A body, and what factors of its friction and additional loads make of it."""

    @property
    def scene(self) -> Scene:
        """Its scene."""

    @property
    def before(self) -> np.ndarray:
        """Rest lengths and angles at the start of the scene, shape (J,) [m, rad]."""

    @property
    def scale(self) -> np.ndarray:
        """Length that an error of each number of a place counts for, shape (D,) [1, m/rad]."""

    @property
    def nominal(self) -> np.ndarray:
        """Factors as in the scene: first F of friction, 1, then additional loads, 0 N, shape (P,)."""

    @property
    def frictions(self) -> int:
        """Number of factors of friction F."""

    @property
    def prior(self) -> np.ndarray:
        """What is expected of factors before anything was seen: prior @ (factors - nominal) has variances of 1."""

    @property
    def remembers(self) -> int:
        """Number of states from which the factors are estimated."""

    def read(self, positions: np.ndarray) -> np.ndarray:
        """Compute displacements from the positions in joint_states [m, rad], shape (N,), in the plane (N, 2) [m]."""

    def locate(self, x: np.ndarray) -> np.ndarray:
        """Compute places from displacements, shape (..., D)."""

    def miss(self, place: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Compute by how much places differ from those wanted, shape (..., D) [m, rad]."""

    def begin(self, x: np.ndarray, before: np.ndarray, factors: np.ndarray) -> Start:
        """Place the body at rest at the start of paths.

        Friction at the start is at least what the springs prove: with less the body would not be at rest. It changes to
        what the factors give in the first ramp.

        Args:
            x: displacement, shape (N,), in the plane (N, 2) [m].
            before: rest lengths and angles in force, shape (J,) [m, rad].
            factors: as in `nominal`, shape (P,).

        Returns:
            The start.
        """

    def differentiate_factors(
        self, x: np.ndarray, before: np.ndarray, rows: np.ndarray, factors: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Follow a path with the derivatives of its displacements with respect to the factors.

        Args:
            x: displacement at its start, shape (N,), in the plane (N, 2) [m].
            before: rest lengths and angles in force there, shape (J,) [m, rad].
            rows: as for `Start.follow`.
            factors: as in `nominal`, shape (P,).

        Returns:
            Displacement after each ramp, shape (V, N), in the plane (V, N, 2) [m], and its derivatives, with a further
            axis (P,).

        Raises:
            CommandError: as `Start.differentiate_places`.
        """

    def describe(self, factors: np.ndarray) -> str:
        """Describe factors in a line."""


def build_robot(scene: Scene) -> Robot:
    """Build the robot of a scene.

    Args:
        scene: a body that turns, or a body of contacts and links on a line, on ground that is the same everywhere.

    Returns:
        The robot.

    Raises:
        SceneError: if no plans are made for such a body.
    """
    if scene.body.turning is not None:
        from .plane_robot import build_plane_robot

        return build_plane_robot(scene)
    reason = scene.inexact or ("has segments" if scene.body.segments else "")
    if reason:
        raise SceneError(
            f"scene: {scene.name} {reason}; plans are made for bodies that turn, and on a line for contacts and links "
            "without memory, on ground that is the same everywhere"
        )
    from .line_robot import build_line_robot

    return build_line_robot(scene)
