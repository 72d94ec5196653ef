"""A robot with topics as what the server shows and commands: the simulator in another process, or a real one.

The command goes to the robot as short trajectories, in straight ramps of limited rate. It stops where it is when the
page in control is closed or falls silent; with this process it ends, and the robot holds the end of the last
trajectory that it received.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import numpy as np
import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rclpy.validate_namespace import validate_namespace
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from crawler_model import CommandError, CrawlerError, Scene
from crawler_model.theory.stasis import bound_distances
from crawler_pictures.ground import local_bounds
from crawler_ros.node.intake.peers import RIVAL_TOPICS
from crawler_ros.node.life.log_pipe import unblocked_log
from crawler_ros.node.life.quiet_node import QuietNode
from crawler_ros.node.life.run import stay_on_loopback
from crawler_ros.wire.definitions import find_ament_prefix
from crawler_ros.wire.messages import TrajectoryMessage, read_stamp
from crawler_ros.wire.states import contact_names, find_command, joint_state_names
from crawler_ros.wire.topics import qos_profile, read_topics

from .controls import Clock, read_speed
from .robot import PAST, Robot
from .view import Instant

SLEW = 0.5
"""Largest rate of a command: part of the range of its slider per second."""
_STATES = ("joint_states", "contact_states")
_COMMANDS = "joint_trajectory"
_UNREAD = 1000
"""States that wait between two frames; of more, the oldest are lost."""
_LONGEST = 0.1
"""Longest time of a trajectory [s]: as long as the robot goes on if nothing more is sent."""
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
        self._began = 0  # states seen before the robot began anew
        self.error = ""
        self._first = scene.body.dimension if scene.body.turning is None else 3  # of a joint behind the root
        self.row: np.ndarray | None = None  # as sent last; None before the first command
        self._unanswered: float | None = None  # since when the robot has been silent after a command [s]
        self._past: list[list[Any]] = []
        self._looked, self._rivals = -_LOOKS, list[str]()
        self._arrived: dict[str, bytes] = {}
        self._names = dict(zip(_STATES, (joint_state_names(scene.body), contact_names(scene.body)), strict=True))
        topics, columns = read_topics(), scene.columns
        self._columns = [i for i, name in enumerate(columns.names) if name in columns.aliases]
        self._message = TrajectoryMessage([columns.names[i] for i in self._columns])
        self._publisher = node.create_publisher(JointTrajectory, _COMMANDS, qos_profile(topics[_COMMANDS]))
        self.instant = self._measure()
        self._subscriptions = {}
        for name in _STATES:
            profile = qos_profile(topics[name])
            profile.depth = _UNREAD
            self._subscriptions[name] = node.create_subscription(JointState, name, lambda _: None, profile, raw=True)

    def _take(self, name: str) -> list[bytes]:
        """Take all messages that wait; an executor would wake for each, which takes ten times as long."""
        subscription, taken = self._subscriptions[name], list[bytes]()
        with subscription.handle:
            while len(taken) < _UNREAD and (found := subscription.handle.take_message(JointState, True)) is not None:
                taken.append(found[0])
        if taken:
            self._arrived[name] = taken[-1]
        return taken

    def _read(self, name: str) -> np.ndarray:
        """Read positions, velocities and efforts of the last message, as `_parse` does; zeros before the first."""
        if name not in self._arrived:
            return np.zeros((3, len(self._names[name])))
        return self._parse(name, self._arrived[name])

    def _parse(self, name: str, data: bytes) -> np.ndarray:
        """Read positions, velocities and efforts of a message of this body, shape (3, M)."""
        message = deserialize_message(data, JointState)
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
        """Obey a message of the page in control; after a hold, the ramp begins at the command in force.

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
        answers, contacts = (self._take(name) for name in _STATES)
        if answers:
            self.received += len(answers)
            self._unanswered = None
        if self._is_silent:
            self.hold(_NO_ANSWER)
        try:
            self.instant = self._measure()
            self._remember(contacts)
        except CommandError as error:
            self._arrived.clear()
            self.error = str(error)
            self.hold("another robot answers")
        if self._arrived:
            self._hold_after_reset()
        if self.row is None or self.held:
            return
        ns = round(min(seconds, 0.1) * 1e9 * self.speed) if self.playing else 0
        _, rows, self.clock = self.controls.advance(self.settings, self.clock, ns)
        goal = self.controls.tilt(rows, self.settings.slope)[-1]
        way = goal - self.row
        if not way.any():
            return
        seconds = min(seconds, _LONGEST)
        parts = np.abs(way) / (SLEW * seconds * self._ranges())
        self._send(goal if parts.max() <= 1.0 else self.row + way / parts.max(), round(seconds * 1e9))

    def _remember(self, contacts: list[bytes]) -> None:
        """Keep what contacts did in all states that came: a slip may be shorter than a frame."""
        share, home = self.scene.body.share, self.scene.body.position
        for data in contacts:
            stamp = read_stamp(data)
            if self._past and stamp / 1e9 < self._past[-1][0]:  # the robot began anew
                self._past.clear()
                self._began = self.seen
            place, velocity, _ = self._parse(_STATES[1], data).reshape(3, *home.shape)
            self._past.append(self.write_past(stamp / 1e9, share @ (place - home), self._slides(velocity)))
            self.seen += 1
        del self._past[:-PAST]

    def _slides(self, velocity: np.ndarray) -> np.ndarray:
        """Find how each contact slides from its velocity [m/s], shape (N,) as in `Instant`."""
        if self.scene.body.dimension == 1:
            return (np.sign(velocity) * (np.abs(velocity) > _RESTS)).astype(np.int8)
        return (np.abs(velocity) > _RESTS).any(axis=1).astype(np.int8)

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
        self.row = None
        self.settings = replace(self.settings, hand=tuple(self._find_row().tolist()))

    def _ranges(self) -> np.ndarray:
        """The range of the slider of each column, shape (C,)."""
        ranges = np.ones(self.scene.columns.count)
        for control in self.controls.controls.values():
            ranges[list(control.columns)] = control.most - control.least
        return ranges

    def _send(self, row: np.ndarray, ns: int) -> None:
        """Publish a trajectory to a row that takes some time [ns]."""
        self._publisher.publish(self._message.encode(0, [ns], [row[self._columns]]))
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
        shape = (-1, 2) if body.dimension == 2 and body.turning is None else (-1,)
        lengths = target[: body.lengths].reshape(shape)
        return Instant(displacement, tension.reshape(shape), force, margins, self._slides(velocity), target, lengths)

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
        listeners = node.count_subscribers(_COMMANDS)
        heard = f"{listeners} listener{'s' * (listeners != 1)}"
        told.append(f"{self.sent} commands sent to {heard}; {self.received} states read")
        told.append(f"holds: {self.held}" if self.held else "commands at half the range of a slider per second at most")
        if time.monotonic() - self._looked > _LOOKS:
            self._looked, self._rivals = time.monotonic(), list(self._find_rivals())
        return told + self._rivals

    def _find_rivals(self) -> Iterator[str]:
        """Tell who else commands; to ask costs more than all else of a frame."""
        node = self.node
        for topic in (name for names in RIVAL_TOPICS for name in names):
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
        if known is None or known[0] < self._began:
            return True, self._past
        return False, self._past[max(len(self._past) - self.seen + known[0], 0) :]


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
