"""The messages of sensors, recorded and published when they arrive."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from crawler_model import Scene

from ..wire.measured import MEASURED, MeasuredStates
from ..wire.messages import lay_out_joint_state, lay_out_pose
from ..wire.states import joint_state_names
from .outgoing import Outlet


class MeasuredTopics:
    """Sends what sensors measure of the states at the ends of ticks."""

    def __init__(
        self, scene: Scene, states: MeasuredStates, outlets: dict[str, Outlet], frame: str, each_tick: bool
    ) -> None:
        """Lay out the messages.

        Args:
            scene: the scene that runs.
            states: the sensors.
            outlets: the outgoing topics by name.
            frame: the frame of positions on the ground.
            each_tick: whether the last measurement is sent again at ticks at which none arrives: in lock-step, where a
                controller waits for it.
        """
        self._states, self._each_tick = states, each_tick
        self._outlets = [outlets[name] for name in MEASURED]
        self._layouts = lay_out_joint_state(joint_state_names(scene.body)), lay_out_pose(frame)

    def send(self, times_ns: np.ndarray, joints: np.ndarray, poses: np.ndarray) -> None:
        """Measure K states, and send what arrives.

        Args:
            times_ns: simulated time of each, shape (K,) [ns].
            joints: as of `Readout.read`, shape (K, 3, J).
            poses: x, y, and z and w of the orientation come first, shape (K, 7).
        """
        for state in zip(times_ns.tolist(), joints, poses, strict=True):
            for outlet, data in self._measure(*state):
                outlet.send(data)

    def send_start(self, joints: np.ndarray, pose: np.ndarray) -> None:
        """Measure the state at the start of a run, and send what arrives then.

        Args:
            joints: as of `Readout.read`, shape (3, J).
            pose: as for `send`, shape (7,).
        """
        self._states.restart()
        for outlet, data in self._measure(0, joints, pose):
            outlet.record(data)
            outlet.publish_start(data)

    def resend(self) -> None:
        """Publish the measurement of the start again where there are more subscribers than before."""
        for outlet in self._outlets:
            outlet.resend_start()

    def _measure(self, ns: int, joints: np.ndarray, pose: np.ndarray) -> Iterator[tuple[Outlet, bytes]]:
        """Measure a state; yield the messages that arrive, and where they go."""
        arrived = self._states.measure(ns, joints, pose[:4])
        if not arrived and self._each_tick:
            arrived = [self._states.latest]
        for stamp, *measured in arrived:
            for outlet, layout, numbers in zip(self._outlets, self._layouts, measured, strict=True):
                yield outlet, layout.encode(stamp, numbers.ravel())
