"""A robot with topics as what the server shows and commands: the simulator in another process, or a real one.

The command goes to the topics in straight ramps of limited rate. It stops where it is when the page that has the hand
is closed or falls silent; with this process it ends, and the robot holds the last command that it received.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_namespace import validate_namespace
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from crawler_model import CommandError, CrawlerError, Scene
from crawler_model.theory.stasis import bound_distances
from crawler_pictures.ground import local_bounds
from crawler_ros.node.life.log_pipe import unblocked_log
from crawler_ros.node.life.quiet_node import QuietNode
from crawler_ros.node.life.run import stay_on_loopback
from crawler_ros.wire.definitions import find_ament_prefix
from crawler_ros.wire.messages import read_stamp
from crawler_ros.wire.states import contact_names, find_command, joint_state_names
from crawler_ros.wire.topics import qos_profile, read_topics

from .controls import Clock, read_speed
from .robot import PAST, Robot
from .view import Instant

SLEW = 0.5
"""Largest rate of a command: part of the range of its slider per second."""
_STATES = ("joint_states", "contact_states")
_COMMANDS = ("load_controller/commands", "friction_controller/commands", "actuation_controller/commands")
"""In the order in which they are sent: friction and loads take effect with the next actuation."""
_RIVALS = (*_COMMANDS, "joint_trajectory", "actuation_controller/joint_trajectory")
_LOOKS = 0.5
"""Time after which it looks again who else commands [s]."""
_SILENCE = 1.0
"""Time without a state after a command, after which nothing more is sent: a robot that does not move on would follow it
all at once later [s]."""
_NO_ANSWER = f"the robot does not answer: no state for {_SILENCE:g} s"
_RESTS = 1e-9
"""A contact below this speed holds [m/s]."""


class Console(Robot):
    """The topics of a robot, and the command that a person gives it."""

    def __init__(self, scene: Scene, node: QuietNode) -> None:
        """Open the topics.

        Args:
            scene: the body of the robot.
            node: an rclpy node; its remappings and its namespace choose the robot.

        Raises:
            CrawlerError: if the topics do not show all of the body.
        """
        if len(contact_names(scene.body)) != scene.body.contacts * scene.body.dimension:
            raise CrawlerError(f"--ros: {scene.name} has contacts that contact_states does not show; set shown higher")
        super().__init__(scene)
        self.node = node
        self.settings, self.clock = replace(self.controls.start(), mode="hand"), Clock()
        self.playing, self.speed, self.held = False, 1.0, "nothing was commanded yet"
        self.sent = self.received = self.seen = 0
        self._stamp = 0  # of the last state [ns]
        self.error = ""
        self._first = scene.body.dimension if scene.body.turning is None else 3  # of a joint behind the root
        self.row: np.ndarray | None = None  # as sent last; None before the first command
        self._closes = False  # whether lengths follow once more
        self._unanswered: float | None = None  # since when the robot has been silent after a command [s]
        self._past: list[list[Any]] = []
        self._looked, self._rivals = -_LOOKS, list[str]()
        self._arrived: dict[str, bytes] = {}
        self._names = dict(zip(_STATES, (joint_state_names(scene.body), contact_names(scene.body)), strict=True))
        topics = read_topics()
        self._publishers = {
            name: node.create_publisher(Float64MultiArray, name, qos_profile(topics[name])) for name in _COMMANDS
        }
        self.instant = self._measure()
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(node)
        for name in _STATES:
            profile = qos_profile(topics[name])
            profile.depth, profile.reliability = 1, ReliabilityPolicy.BEST_EFFORT  # the newest state is enough
            node.create_subscription(JointState, name, self._receiver(name), profile, raw=True)

    def _receiver(self, name: str) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            self._arrived[name] = data
            if name == _STATES[0]:
                self.received += 1
                self._unanswered = None

        return receive

    def _read(self, name: str) -> np.ndarray:
        """Read positions, velocities and efforts of the last message, shape (3, M); zeros before the first.

        Raises:
            CommandError: if another body answers.
        """
        if name not in self._arrived:
            return np.zeros((3, len(self._names[name])))
        message = deserialize_message(self._arrived[name], JointState)
        if list(message.name) != self._names[name]:
            raise CommandError(f"{name} has {', '.join(message.name[:4])}: the robot differs from {self.scene.name}")
        return np.array([message.position, message.velocity, message.effort])

    def _find_row(self) -> np.ndarray:
        """Find the command in force, at which a ramp begins.

        What the states do not reveal of it, friction and loads above all, is what was sent last, or what the scene has.
        """
        row = self.scene.drive.rows[0] if self.row is None else self.row
        return find_command(self.scene, self._read("joint_states"), row)

    def receive(self, message: dict[str, Any]) -> None:
        """Obey a message of the page that has the hand; after a hold, the ramp begins at the command in force.

        Raises:
            CommandError: if a value is out of range, or no robot answers.
        """
        if not self._arrived:
            raise CommandError("no robot answers on joint_states; start one, such as crawler-simulator")
        if self._is_silent:
            raise CommandError(_NO_ANSWER)
        if self.held:
            self.row = self._find_row()
            self.settings = replace(self.settings, hand=tuple(self.row.tolist()))
        if {"set", "mode", "wave"} & set(message):
            settings = self.controls.change(self.controls.take_over(self.settings, self._base), message)
            _, rows, _ = self.controls.advance(settings, self.clock, 0)
            self.controls.check(self.controls.tilt(rows, settings.slope))
            self.settings = settings
        if "speed" in message:
            self.speed = read_speed(message["speed"])
        if "play" in message:
            self.playing = message["play"] is True
        self.held = self.error = ""

    @property
    def _is_silent(self) -> bool:
        """Whether the robot has not answered the last command for too long."""
        return self._unanswered is not None and time.monotonic() - self._unanswered > _SILENCE

    @property
    def _base(self) -> np.ndarray:
        return np.array(self.settings.hand) if self.row is None else self.row

    def hold(self, reason: str) -> None:
        """Stop where the command is."""
        if self.row is not None and not self.held:
            hand = tuple(self.row.tolist())
            slope = self.controls.start().slope  # what another slope added is in the row
            self.settings = replace(self.settings, mode="hand", hand=hand, slope=slope)
            self.playing, self.held = False, reason

    def advance(self, seconds: float) -> None:
        """Send the next command of the ramp, and remember what the robot did."""
        for _ in _STATES:
            self._executor.spin_once(timeout_sec=0.0)
        if self._is_silent:
            self.hold(_NO_ANSWER)
        try:
            self.instant = self._measure()
        except CommandError as error:
            self._arrived.clear()
            self.error = str(error)
            self.hold("another robot answers")
        if self._arrived:
            self._hold_after_reset()
            net = self.scene.body.share @ self.instant.displacement
            self._past.append(self.write_past(time.monotonic(), net, self.instant.state))
            self.seen += 1
            del self._past[:-PAST]
        if self.row is None or self.held:
            return
        ns = round(min(seconds, 0.1) * 1e9 * self.speed) if self.playing else 0
        _, rows, self.clock = self.controls.advance(self.settings, self.clock, ns)
        goal = self.controls.tilt(rows, self.settings.slope)[-1]
        way = goal - self.row
        if not way.any():
            if self._closes:
                self._send(self.row)
            return
        parts = np.abs(way) / (SLEW * min(seconds, 0.1) * self._ranges())
        self._send(goal if parts.max() <= 1.0 else self.row + way / parts.max())

    @property
    def _now_ns(self) -> int:
        """Stamp of the last state; 0 before the first [ns]."""
        return read_stamp(self._arrived["joint_states"]) if "joint_states" in self._arrived else 0

    def _hold_after_reset(self) -> None:
        """Hold when the time of the states goes back, and begin at the command with which the robot began anew."""
        last, self._stamp = self._stamp, self._now_ns
        if self._stamp >= last or self.row is None:
            return
        self.hold("the robot began anew")
        self.row, self._closes = None, False
        self.settings = replace(self.settings, hand=tuple(self._find_row().tolist()))

    def _ranges(self) -> np.ndarray:
        """The range of the slider of each column, shape (C,)."""
        ranges = np.ones(self.scene.columns.count)
        for control in self.controls.controls.values():
            ranges[list(control.columns)] = control.most - control.least
        return ranges

    def _send(self, row: np.ndarray) -> None:
        """Publish what changes; always the lengths, with which friction and loads take effect.

        Messages of several topics may be taken in another order, so lengths follow once more after the last friction.
        """
        columns, before = self.scene.columns, self._base
        self._closes = False
        ends = np.cumsum([columns.lengths, columns.frictions])
        sizes = (columns.load_sizes, np.tile(columns.friction_sizes, columns.sides), columns.actuation_sizes)
        parts = zip(_COMMANDS, reversed(np.split(row, ends)), reversed(np.split(before, ends)), sizes, strict=True)
        for name, part, old, size in parts:
            changes = bool((part != old).any())
            self._closes |= changes and name != _COMMANDS[-1]
            if changes or name == _COMMANDS[-1]:
                if columns.segments:  # one number for all columns of a segment
                    part = part[np.concatenate(([0], np.cumsum(size)[:-1])).astype(np.int64)]
                self._publishers[name].publish(Float64MultiArray(data=part.tolist()))
        self.row = row
        self.sent += 1
        if self._unanswered is None:
            self._unanswered = time.monotonic()

    def _measure(self) -> Instant:
        """Read the robot; margins are known on a line, where the commanded friction and loads decide."""
        scene, body = self.scene, self.scene.body
        joints, contacts = self._read("joint_states"), self._read("contact_states")
        tension = joints[2, self._first : self._first + body.lengths]
        target = scene.columns.target(self._base)
        place, velocity, ground = contacts.reshape(3, *body.position.shape)
        displacement = place - body.position if "contact_states" in self._arrived else np.zeros(place.shape)
        force, margins = -ground, np.full(body.contacts, np.nan)
        if body.dimension == 1:
            if scene.columns.slope_load is not None:
                force = force - target[-body.contacts :]
            margins = bound_distances(force, *local_bounds(scene, target, displacement))
            state = np.sign(velocity) * (np.abs(velocity) > _RESTS)
        else:
            state = (np.abs(velocity) > _RESTS).any(axis=1)
        shape = (-1, 2) if body.dimension == 2 and body.turning is None else (-1,)
        lengths = target[: body.lengths].reshape(shape)
        return Instant(displacement, tension.reshape(shape), force, margins, state.astype(np.int8), target, lengths)

    def frame(self) -> dict[str, Any]:
        """Describe the present instant."""
        return {
            "tick": 0,
            "ticks": 0,
            "time": self._now_ns / 1e9,
            "playing": self.playing,
            "speed": self.speed,
            "words": self.view.tell(self.instant) if self._arrived else "no robot answers on joint_states yet",
            "error": self.error,
            "console": self._tell(),
            "seen": self.seen,
            **self.show(self.settings, self._base, self.instant),
        }

    def _tell(self) -> list[str]:
        """Tell who listens, who answers and who else commands."""
        node, told = self.node, []
        listeners = node.count_subscribers(_COMMANDS[-1])
        heard = f"{listeners} listener{'s' * (listeners != 1)}"
        told.append(f"{self.sent} commands sent to {heard}; {self.received} states read")
        told.append(f"holds: {self.held}" if self.held else "commands at half the range of a slider per second at most")
        if time.monotonic() - self._looked > _LOOKS:
            self._looked, self._rivals = time.monotonic(), list(self._find_rivals())
        return told + self._rivals

    def _find_rivals(self) -> Iterator[str]:
        """Tell who else commands; to ask costs more than all else of a frame."""
        node = self.node
        for topic in _RIVALS:
            own = node.get_name(), node.get_namespace()
            ends = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
            others = sorted({end.node_name for end in ends if (end.node_name, end.node_namespace) != own})
            if others:
                yield f"{', '.join(others)} commands too, on {topic}"

    @property
    def place(self) -> tuple[Any, ...]:
        """What changes with every frame."""
        return self.seen, self.sent, self.settings, self.playing, self.held, self.error

    def past(self, known: tuple[Any, ...] | None) -> tuple[bool, list[list[Any]]]:
        """List the states since then, or the last ones."""
        count = PAST if known is None else self.seen - known[0]
        return known is None, self._past[max(len(self._past) - count, 0) :]


@contextmanager
def open_console(scene: Scene, namespace: str) -> Iterator[Console]:
    """Open a node.

    Args:
        scene: the body of the robot.
        namespace: of the robot, such as "/left".

    Yields:
        The console.

    Raises:
        CrawlerError: if the namespace is invalid.
    """
    find_ament_prefix()
    stay_on_loopback()
    with unblocked_log():
        context = rclpy.Context()
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        try:
            validate_namespace(f"/{namespace.strip('/')}")
            node = QuietNode(f"crawler_play_{os.getpid()}", context=context, namespace=namespace)
            yield Console(scene, node)
        except InvalidNamespaceException as error:
            raise CrawlerError(f"--namespace: {namespace}: {' '.join(str(error).split())}") from None
        finally:
            rclpy.shutdown(context=context)
