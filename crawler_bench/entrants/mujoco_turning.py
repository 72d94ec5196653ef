"""MuJoCo on a snake: links that stretch and joints that bend, and spheres that gravity presses onto a plane.

Friction in MuJoCo's contacts acts along axes of the ground, so only isotropic friction is the same for both. The mass
goes with the square of the time step: inertia, which the model does not have, is then as small as the step allows.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from crawler_model import Scene

_MASS, _DAMPING = 10.0, 0.3
"""Mass of a contact relative to the stiffness of a link times the squared time step, and damping of links and joints
relative to the critical one: of masses, dampings, integrators and settings of contacts, those of the least error."""
_RADIUS = 0.01
_SETTLING = 200
"""Steps at the start in which the spheres settle on the plane."""


class MujocoTurningRun:
    """A MuJoCo model of a snake, stepped through the commands."""

    def __init__(self, scene: Scene, steps: int) -> None:
        """Build the model at the scene's start.

        Args:
            scene: a chain of points on the x axis with equal lengths, stiffness and isotropic friction.
            steps: steps per period, a multiple of 4.
        """
        import mujoco

        self._mujoco, n = mujoco, scene.body.contacts
        self.model: Any = mujoco.MjModel.from_xml_string(build_turning_document(scene, steps))
        self.data: Any = mujoco.MjData(self.model)
        self._position = scene.body.position
        self._feet = [self.model.body(f"p{i}").id for i in range(n)]
        names = [*(f"l{i}" for i in range(n - 1)), *(f"j{i}" for i in range(n - 2))]
        self._at = [self.model.joint(name).qposadr[0] for name in names]
        ends = np.rint(np.arange(1, steps + 1) * (1e9 / steps)).astype(np.int64)
        self._actuation = np.split(scene.drive.sample(ends)[:, : len(names)], 4)
        points = self._position + scene.start_displacement
        along = np.diff(points, axis=0)
        angles = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
        self.data.qpos[:3] = *points[0], angles[0]
        spacing = np.diff(self._position[:, 0])
        self.data.qpos[self._at] = np.concatenate((np.hypot(*along.T) - spacing, np.diff(angles)))
        self.model.qpos_spring[self._at] = scene.drive.sample(np.zeros(1, np.int64))[0, : len(names)]
        mujoco.mj_step(self.model, self.data, _SETTLING)

    @property
    def displacement(self) -> np.ndarray:
        """Displacement x, shape (N, 2) [m]."""
        self._mujoco.mj_kinematics(self.model, self.data)
        return np.array(self.data.xpos[self._feet, :2]) - self._position

    def quarter(self, number: int) -> float:
        """Simulate a quarter of a period.

        Args:
            number: of the quarter, from 0.

        Returns:
            Its processor time [s].
        """
        model, data, step = self.model, self.data, self._mujoco.mj_step
        rest, at = model.qpos_spring, self._at
        began = time.thread_time()
        for row in self._actuation[number % 4]:
            rest[at] = row
            step(model, data)
        return time.thread_time() - began


def build_turning_document(scene: Scene, steps: int) -> str:
    """Write a snake in MuJoCo's XML: links `l0`, `l1`, ..., joints `j0`, `j1`, ... and spheres `p0`, `p1`, ... .

    Args:
        scene: as for `MujocoTurningRun`.
        steps: steps per second.

    Returns:
        The document.
    """
    body, turning = scene.body, scene.body.turning
    assert turning is not None
    link, joint = float(body.stiffness[0]), float(turning.joint_stiffness[0])
    length, friction = float(np.diff(body.position[:2, 0])[0]), float(scene.drive.targets[0, -1])
    mass = _MASS * link / steps**2
    damping = float(2.0 * _DAMPING * np.sqrt(mass * link))
    torsional = float(2.0 * _DAMPING * np.sqrt(mass * length**2 * joint))
    tree = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>'
    tree = f'<body pos="0 0 {_RADIUS}">{tree}'
    for i in range(body.contacts):
        if i > 0:
            tree += f'<body pos="{length!r} 0 0"><joint name="l{i - 1}" type="slide" axis="1 0 0" '
            tree += f'stiffness="{link!r}" damping="{damping!r}"/>'
        if 0 < i < body.contacts - 1:
            tree += f'<joint name="j{i - 1}" axis="0 0 1" stiffness="{joint!r}" damping="{torsional!r}"/>'
        tree += f'<body name="p{i}"><joint type="slide" axis="0 0 1"/><geom mass="{mass!r}"/></body>'
    return (
        f'<mujoco><option gravity="0 0 {-friction / mass!r}" timestep="{1.0 / steps!r}" integrator="implicitfast" '
        'cone="elliptic" iterations="50" tolerance="1e-12" noslip_iterations="20" noslip_tolerance="1e-12"/>'
        '<compiler boundmass="1e-12" boundinertia="1e-12" angle="radian"/><default>'
        f'<geom size="{_RADIUS}" friction="1 0 0" contype="2" conaffinity="1" solref="{5.0 / steps!r} 1" '
        'solimp="0.5 0.5 0.001 0.5 2"/></default><worldbody><geom type="plane" size="0 0 1" contype="1" '
        f'conaffinity="2"/>{tree}{"</body>" * body.contacts}</worldbody></mujoco>'
    )
