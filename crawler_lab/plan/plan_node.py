"""The node `plan`: a controller that follows a path of places by plans over a receding horizon.

At the end of each step it reads the displacements of all contacts from `joint_states`, estimates friction and loads,
optimises the rest lengths and angles of the next steps over the model, and sends them on `joint_trajectory`: in
lock-step the first step, in real time the whole plan, which goes on where the next one comes too late.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from crawler_model import CrawlerError, Scene
from crawler_model.body.drive import NS
from crawler_model.scene.file import load_scene
from crawler_ros.node.life.run import run_node
from crawler_ros.node.parameters import expand_home
from crawler_ros.wire.messages import read_stamp
from crawler_ros.wire.states import joint_state_names
from crawler_ros.wire.topics import message_class, qos_profile, read_topics

from ..answering_node import AnsweringNode, described
from ..optimise.request import find_strokes
from .limits import Limits
from .robot import build_robot
from .tracker import Tracker, read_path

_SLACK_NS = 10
"""Times of ticks are whole nanoseconds."""
_PART = 0.6
"""Part of the lead that a plan may take on the clock."""


class PlanNode(AnsweringNode):
    """Answers the state at the end of each step with the next commands."""

    def __init__(self, **options: Any) -> None:
        """Declare parameters, compile, and open topics.

        Args:
            **options: for rclpy's Node.

        Raises:
            CrawlerError: when the scene or a parameter is invalid.
        """
        super().__init__("plan", **options)
        text = ParameterDescriptor(description="Scene file or gallery name.", read_only=True)
        scene = load_scene(expand_home(self.declare_parameter("scene", "three_contacts_one_way", text).value))
        speed = self.declare_parameter("speed", 0.01, _within(-1e3, 1e3)).value
        path = self.declare_parameter("path", [0.0, 0.0], described("Times, s, and places, m, rad, in turn.")).value
        rate = self.declare_parameter("rate", 20.0, _within(1e-3, 1e3)).value
        count = ParameterDescriptor(integer_range=[IntegerRange(from_value=2, to_value=100)], read_only=True)
        horizon = int(self.declare_parameter("horizon", 16, count).value)
        stroke = self.declare_parameter("stroke", 0.0, _within(0.0, 1e3)).value
        fastest = self.declare_parameter("fastest", 0.0, _within(0.0, 1e6)).value
        effort = self.declare_parameter("effort", 0.15, _within(1e-6, 1e3)).value
        noise = self.declare_parameter("noise", 1e-4, _within(1e-9, 1e3)).value
        measured = self.declare_parameter("measured", False, described("Read measured/joint_states.")).value
        self._delay = round(self.declare_parameter("delay", 0.0, _within(0.0, 10.0)).value * NS)
        self._lock_step = self.declare_parameter("lock_step", False, described("Send one step at a time.")).value
        self._duration = round(self.declare_parameter("duration", 0.0, _within(0.0, 1e9)).value * NS)
        robot, limits = build_robot(scene), build_limits(scene, stroke, fastest / rate, effort)
        self.tracker = Tracker(
            robot, limits, read_path(speed, path, scene.body.turning is not None), round(NS / rate), horizon, noise
        )
        self.tracker.warm_up(scene.start_displacement)
        self._lead = 0 if self._lock_step else self.tracker.step_ns
        self._moved = np.flatnonzero(limits.high > limits.low)
        self.open_commands([scene.columns.names[j] for j in self._moved])
        self._names = joint_state_names(scene.body)
        self._end = -1
        source = read_topics()["measured/joint_states" if measured else "joint_states"]
        self.create_subscription(message_class(source.type), source.name, self._receive, qos_profile(source), raw=True)
        self.get_logger().info(f"{scene.name}: waiting for {source.name}")

    def _receive(self, data: bytes) -> None:
        stamp = read_stamp(data)
        if self.done.is_set() or stamp == self._last_ns:
            return
        if second := self._second.find(stamp):
            self.fail(second)
            return
        if stamp < self._last_ns:  # the simulator was reset
            self.tracker.restart()
            self._end = -1
        self._last_ns, now = stamp, stamp + self._delay
        if self._end < 0:
            self._end = now + self._lead
            if self._lock_step and self._delay:  # so that the first state is as late as all others
                self.send(self._message.encode(0, [self._delay], [self.tracker.robot.before[self._moved]]))
        if now < self._end - self._lead - _SLACK_NS:
            return
        try:
            self._answer(now, deserialize_message(data, JointState))
        except CrawlerError as error:
            self.fail(str(error))

    def _answer(self, now: int, message: Any) -> None:
        """Plan from a state and send the commands; the time is the present one, later by the delay of the state."""
        if list(message.name) != self._names:
            raise CrawlerError(
                f"joint_states has {', '.join(message.name[:5])}, the scene {', '.join(self._names[:5])}: the "
                "simulator and the controller must be started with the same scene"
            )
        self.tracker.see(self._last_ns, np.array(message.position))
        if 0 < self._duration <= self.tracker.passed_ns:
            y, *more = self.tracker.place.tolist()
            place = f"{y:.17g} m" if not more else f"{y:.17g}, {more[0]:.17g} m, yaw {more[1]:.17g} rad"
            self.report(f"done at {self._last_ns / NS:g} s, net translation {place}")
            self.done.set()
            return
        step, count = self.tracker.step_ns, self.tracker.steps
        if self._lock_step:
            begin, stamp, sent = now, 0, 1
            rows = self.tracker.plan(begin)
        else:
            late = max(now + self._lead // 2 - self._end, 0)
            begin = stamp = self._end + -(-late // step) * step
            sent, until = count, time.monotonic() + _PART * self._lead / NS
            rows = self.tracker.plan(begin, lambda: time.monotonic() > until)
        self._end = begin + step
        ends = range(step, sent * step + 1, step)
        self.send(self._message.encode(stamp, ends, list(rows[:sent, self._moved])))

    def report(self, text: str) -> None:
        """Log how well the path was followed, and what was estimated.

        Args:
            text: how the line begins.
        """
        self.get_logger().info(f"{text}: {self.tracker.describe()}")

    def report_following(self) -> None:
        """Log how well the path is followed."""
        self.report("following")


def build_limits(scene: Scene, stroke: float, change: float, effort: float) -> Limits:
    """Build the limits of the commands.

    Args:
        scene: the scene.
        stroke: largest rest length of each link, from 0 on [m], or angle; 0 for the range of the drive of the scene.
        change: largest change in a step [m, rad]; 0 for a fifth of the longest stroke of the links, and of the joints.
        effort: see `Limits`.

    Returns:
        The limits.

    Raises:
        SceneError: if no link moves.
    """
    moves, bounds = find_strokes(scene, (0.0, stroke) if stroke > 0.0 else None)
    low = scene.drive.targets[0, : scene.body.lengths].copy()
    high = low.copy()
    low[moves], high[moves] = np.array(bounds).T
    most = np.empty(low.size)
    for kind in (slice(scene.body.springs), slice(scene.body.springs, None)):
        most[kind] = change or 0.2 * float((high - low)[kind].max(initial=0.0))
    return Limits(low, high, most, effort)


def _within(least: float, most: float) -> Any:
    bounds = FloatingPointRange(from_value=least, to_value=most)
    return ParameterDescriptor(floating_point_range=[bounds], read_only=True)


def main(args: list[str] | None = None) -> int:
    """Follow a path until its duration is over or a signal arrives.

    Args:
        args: command line, for ROS arguments; None for the process's own.

    Returns:
        The exit status: 0, or 1 when the scene or a parameter was invalid.
    """
    parameters = "scene speed path rate horizon stroke fastest effort noise measured delay lock_step duration"
    return run_node("plan", PlanNode, PlanNode.answer_states, args, parameters)


if __name__ == "__main__":
    sys.exit(main())
