"""The topics `measured/joint_states` and `measured/pose`: what sensors make of the states of a tick."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import ValidationError

from crawler_model import CrawlerError
from crawler_model.body.body import Body
from crawler_model.body.names import name_each, name_joints
from crawler_model.body.plan import Plan
from crawler_model.scene.sensors import Measurement, Sensors, SensorsPart

from .messages import list_pose
from .states import joint_state_names

MEASURED = ("measured/joint_states", "measured/pose")
"""The names of the topics."""
_PREFIX = "sensors."


def find_sensors(scene: SensorsPart | None, parameters: Mapping[str, Any]) -> SensorsPart | None:
    """Find how a simulator measures.

    Args:
        scene: the sensors of its scene; None if it has none.
        parameters: its parameters by name; -1 leaves what the scene has.

    Returns:
        The sensors; None if neither names any.

    Raises:
        CrawlerError: if a number is out of its bounds.
    """
    given = {name.removeprefix(_PREFIX): value for name, value in parameters.items() if name.startswith(_PREFIX)}
    given = {name: value for name, value in given.items() if value != -1}
    if scene is None and not given:
        return None
    try:
        return SensorsPart.model_validate(({} if scene is None else scene.model_dump()) | given)
    except ValidationError as error:
        raise CrawlerError(f"parameter {_PREFIX}{error.errors()[0]['ctx']['error']}") from None


class MeasuredStates:
    """Measures the states at the ends of ticks."""

    def __init__(self, scene: Plan, sensors: SensorsPart) -> None:
        """Prepare the sensors.

        Args:
            scene: the scene that runs.
            sensors: how they measure.
        """
        body = scene.body
        self._names, self._planar = joint_state_names(body), body.dimension == 2
        self._turns = body.turning is not None
        self._sensors = Sensors(sensors, [*_units_of_positions(body), *_units_of_efforts(body), "m", "m", "rad"])

    def restart(self) -> None:
        """Return to the start of a run."""
        self._sensors.restart()

    def measure(self, ns: int, joints: np.ndarray, pose: np.ndarray) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Measure the state at the end of a tick.

        Args:
            ns: simulated time [ns].
            joints: positions, velocities and efforts of joint_states, shape (3, J).
            pose: its numbers as of `list_pose`, shape (4,).

        Returns:
            Of each measurement that arrives then: its time [ns], joint_states as measured, shape (3, J), and the
            numbers of the pose, shape (4,).
        """
        x, y, z, w = pose.tolist()
        readings = np.concatenate((joints[0], joints[2], (x, y, 2.0 * math.atan2(z, w))))
        return list(map(self._divide, self._sensors.measure(ns, readings)))

    @property
    def latest(self) -> tuple[int, np.ndarray, np.ndarray]:
        """The last measurement that has arrived, or the one of the start, as of `measure`."""
        assert self._sensors.latest is not None
        return self._divide(self._sensors.latest)

    def _divide(self, found: Measurement) -> tuple[int, np.ndarray, np.ndarray]:
        """Divide a measurement into joint_states and a pose."""
        time, values, rates = found
        count = len(self._names)
        x, y, yaw = values[-3:].tolist()
        place = list_pose(x, y if self._planar else 0.0, yaw if self._turns else 0.0)
        return time, np.stack((values[:count], rates[:count], values[count:-3])), np.array(place)


def _units_of_positions(body: Body) -> list[str]:
    joints = name_each("joint", body.lengths - body.springs) if body.turning is not None else []
    return ["rad" if name in joints or name.endswith("/yaw") else "m" for name in joint_state_names(body)]


def _units_of_efforts(body: Body) -> list[str]:
    """Return "N" where an effort is a tension or a torque; the root and free angles have none."""
    joints = {joint + axis for joint in name_joints(body) for axis in ("", "/x", "/y")}
    return ["N" if name in joints else "" for name in joint_state_names(body)]
