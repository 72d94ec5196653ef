"""The messages of sensors, recorded and published when they arrive."""

from __future__ import annotations

import numpy as np

from crawler_model import Scene

from ..wire.measured import MEASURED, MeasuredStates
from ..wire.messages import lay_out_joint_state, lay_out_pose
from ..wire.states import joint_state_names
from .outgoing import Outlet


class MeasuredTopics:
    """Sends what sensors measure of the states at the ends of ticks."""

    def __init__(self, scene: Scene, states: MeasuredStates, outlets: dict[str, Outlet], frame: str) -> None:
        """Lay out the messages.

        Args:
            scene: the scene that runs.
            states: the sensors.
            outlets: the outgoing topics by name.
            frame: the frame of positions on the ground.
        """
        self._states = states
        self._joints, self._pose = (outlets[name] for name in MEASURED)
        self._layouts = lay_out_joint_state(joint_state_names(scene.body)), lay_out_pose(frame)

    def restart(self) -> None:
        """Return to the start of a run."""
        self._states.restart()

    def send(self, times_ns: np.ndarray, joints: np.ndarray, poses: np.ndarray) -> None:
        """Measure K states, and send what arrives.

        Args:
            times_ns: simulated time of each, shape (K,) [ns].
            joints: as of `Readout.read`, shape (K, 3, J).
            poses: x, y, and z and w of the orientation come first, shape (K, 7).
        """
        for ns, of_joints, pose in zip(times_ns.tolist(), joints, poses[:, :4], strict=True):
            for stamp, measured, place in self._states.measure(ns, of_joints, pose):
                self._joints.send(self._layouts[0].encode(stamp, measured.ravel()))
                self._pose.send(self._layouts[1].encode(stamp, place))
