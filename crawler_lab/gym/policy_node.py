"""The node `policy`: a policy of the environment `Crawler-v0` controls a simulator, or a robot with the same topics.

At every state that arrives on `joint_states` and `contact_states` it builds the observation of the environment, asks
the policy for an action, and sends the command that follows on `joint_trajectory`. Against a simulator in lock-step at
the rate of the environment, the path equals the environment's to the bit.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import yaml
from rcl_interfaces.msg import IntegerRange
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from crawler_model import CommandError, CrawlerError
from crawler_model.run.ticks import tick_end_ns
from crawler_ros.node.life.run import run_node
from crawler_ros.node.parameters import expand_home
from crawler_ros.wire.messages import read_stamp
from crawler_ros.wire.states import contact_names, joint_state_names
from crawler_ros.wire.topics import message_class, qos_profile, read_topics

from ..answering_node import AnsweringNode, described
from .env import describe_bad, read_action
from .kernel.layout import ALONG, TERMINATED
from .lanes import Lanes
from .policy import load_policy
from .randomise import Ranges
from .spec import build_spec, list_settings

DEFAULT_SCENE = "three_contacts_one_way"
_STATES = ("joint_states", "contact_states")


class PolicyNode(AnsweringNode):
    """Answers each state of a crawler with the command that a policy chooses."""

    def __init__(self, **options: Any) -> None:
        """Load the policy and the settings of its environment, and open topics.

        Args:
            **options: for rclpy's Node.

        Raises:
            CrawlerError: when the policy, the scene or a setting is invalid.
        """
        super().__init__("policy", **options)
        name = self.declare_parameter("policy", "", described("module:function, or the path of an .onnx file."))
        scene = self.declare_parameter("scene", DEFAULT_SCENE, described("Scene file or gallery name."))
        task = self.declare_parameter("task", "translation", described("Task of the environment."))
        settings = self.declare_parameter(
            "settings", "{}", described("Other settings of the environment, a YAML mapping in a text.")
        )
        bounds = described("Number of steps to control; 0 for no end.")
        bounds.integer_range = [IntegerRange(from_value=0, to_value=10**9)]
        self.steps = int(self.declare_parameter("steps", 0, bounds).value)
        self.policy = load_policy(expand_home(name.value))
        given = read_settings(settings.value)
        spec = build_spec(expand_home(scene.value), task.value, **given)
        self.environment = spec.with_ranges(Ranges())  # what was randomised is left to the robot
        self.lanes = Lanes(self.environment, 1, threads=1)
        self.lanes.reset(np.zeros(1, np.int64), [{}])
        columns, body = self.environment.scene.columns, self.environment.scene.body
        self._free = self.environment.actions.free
        self._names = dict(zip(_STATES, (joint_state_names(body), contact_names(body)), strict=True))
        self.open_commands([columns.names[c] for c in self._free])
        for state in _STATES:
            self._listen(state)
        self._arrived: dict[str, bytes] = {}
        self._done_steps = 0
        self.get_logger().info(f"{self.environment.scene.name}: waiting for joint_states and contact_states")

    def _listen(self, name: str) -> None:
        topic = read_topics()[name]

        def receive(data: bytes) -> None:
            if name == "joint_states" and (second := self._second.find(read_stamp(data))):
                self.fail(second)
            self._arrived[name] = data
            self._answer()

        self.create_subscription(message_class(topic.type), topic.name, receive, qos_profile(topic), raw=True)

    def _answer(self) -> None:
        """Answer a state once both of its messages have arrived."""
        if len(self._arrived) < 2 or self.done.is_set():
            return
        stamps = [read_stamp(self._arrived[name]) for name in _STATES]
        now_ns = stamps[0]
        if stamps[0] != stamps[1] or now_ns == self._last_ns:
            return
        try:
            readings = [self._read(name) for name in _STATES]
            first = self._last_ns < 0 or now_ns < self._last_ns
            if first:
                self.lanes.reset(np.zeros(1, np.int64), [{}])
                self._done_steps = 0
            else:
                self._check_rate(now_ns - self._last_ns)
                self._done_steps += 1
            self._last_ns = now_ns
            self.lanes.observe_readings(first, *readings)
            if self._is_over():
                return
            self._pending = []  # an answer to an earlier state is out of date
            self.send(self._choose())
        except CrawlerError as error:
            self.fail(str(error))

    def _read(self, name: str) -> np.ndarray:
        """Read positions, velocities and efforts of a message, shape (3, M)."""
        message = deserialize_message(self._arrived[name], JointState)
        if list(message.name) != self._names[name]:
            raise CrawlerError(
                f"{name} has {', '.join(message.name[:5])}, the scene {', '.join(self._names[name][:5])}: the "
                "simulator and the policy must be started with the same scene"
            )
        return np.array([message.position, message.velocity, message.effort])

    def _check_rate(self, passed_ns: int) -> None:
        rate = self.environment.rate
        if abs(passed_ns - tick_end_ns(1, rate)) > 1:
            self.warn_once(
                f"{passed_ns / 1e9:g} s passed between two states, but a step of the environment takes "
                f"{float(1 / rate):g} s: start the simulator with rate:={float(rate)}"
            )

    def _is_over(self) -> bool:
        result = self.lanes.results[0]
        over = result[TERMINATED] == 1.0 or 0 < self.steps <= self._done_steps
        if over:
            self.get_logger().info(f"done after {self._done_steps} steps, net translation {result[ALONG]:.17g} m")
            self.done.set()
        return bool(over)

    def _choose(self) -> bytes:
        shape = self.lanes.actions[0].shape
        action = read_action(self.policy(self.lanes.observations[0].copy()), shape)
        if not np.isfinite(action).all():
            raise CommandError(describe_bad(action, self.environment.actions.names))
        self.lanes.actions[0] = action
        return self._message.encode(0, [0], [self.lanes.choose_row()[self._free]])


def read_settings(text: str) -> dict[str, Any]:
    """Read the settings of an environment.

    Args:
        text: a mapping in YAML.

    Returns:
        The settings.

    Raises:
        CrawlerError: if it is no mapping, or names an unknown setting.
    """
    try:
        given = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise CrawlerError(f"settings: {text!r} is not YAML: {' '.join(str(error).split())}") from None
    if given is None:
        given = {}
    known = list_settings()
    if not isinstance(given, dict):
        raise CrawlerError(f"settings: {text!r}; it must be a mapping, as {{rate: 50.0}}")
    for name in given:
        if name not in known:
            raise CrawlerError(f"settings: unknown setting {name!r}; the settings are {', '.join(known)}")
    return given


def main(args: list[str] | None = None) -> int:
    """Control a crawler until the steps are done, the task is, or a signal arrives.

    Args:
        args: command line, for ROS arguments; None for the process's own.

    Returns:
        The exit status: 0, or 1 when the policy or a setting was invalid, or the policy failed.
    """
    return run_node("policy", PolicyNode, PolicyNode.answer_states, args, "policy scene task settings steps")


if __name__ == "__main__":
    sys.exit(main())
