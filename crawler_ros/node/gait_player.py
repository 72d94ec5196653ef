"""The node `gait_player`: plays a scene's drive over `joint_trajectory`, as a controller would.

It waits for a simulator, then sends the drive period by period, each as one stamped trajectory on simulated time, at
least half a period ahead: the crawler passes through every waypoint whatever the delays between the processes are.
Where nothing can come of that - no simulator, simulated time that stands still, refused commands - it ends with one
line that says which.
"""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

import numpy as np
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.serialization import deserialize_message

from crawler_model import CrawlerError, load_scene
from crawler_model.body.drive import NS, Drive

from ..wire import interface
from ..wire.messages import TrajectoryMessage, encode_diagnostics, read_stamp
from ..wire.states import joint_state_names
from .diagnostics import OK, WARN, Status
from .intake.peers import publishers_of, rivals_on_commands, rivals_on_states
from .life.quiet_node import QuietNode
from .life.run import end_on_signals, run_node

DEFAULT_SCENE = "three_contacts_one_way"
_LEAST_MESSAGE_NS = NS // 10
_MOST_AHEAD_NS = 30 * NS
_WAKE_EVERY_S = 10.0  # discovery takes less: who is silent for longer is in lock-step, in the middle of a run
_PATIENCE_S = 30.0
_GONE_S = 3.0  # a simulator that is started anew is away for less


def list_commands(drive: Drive) -> tuple[list[str], list[np.ndarray]]:
    """List what of a drive can be commanded: a ledger has columns that cannot, friction by directions.

    Args:
        drive: the scene's.

    Returns:
        Names, C of them, and for each waypoint its row, shape (C,). What is left out holds at the scene's value.
    """
    columns = drive.columns
    index = [i for i, name in enumerate(columns.names) if name in columns.aliases]
    return [columns.names[i] for i in index], list(np.ascontiguousarray(drive.rows[:, index]))


class GaitPlayer(QuietNode):
    """Sends trajectories ahead of the simulated time that it reads from joint_states."""

    def __init__(self, **options: Any) -> None:
        """Load the scene's drive and open topics.

        Args:
            **options: for rclpy's Node.

        Raises:
            CrawlerError: when the scene is wrong or has no drive.
        """
        super().__init__("gait_player", **options)
        text = {"description": "Scene file or gallery name whose drive is played.", "read_only": True}
        whole = {"description": "Periods to play; 0 plays on and on.", "read_only": True}
        bounds = [IntegerRange(from_value=0, to_value=10**9)]
        path = self.declare_parameter("scene", DEFAULT_SCENE, ParameterDescriptor(**text)).value
        scene = load_scene(interface.in_home(path))
        descriptor = ParameterDescriptor(**whole, integer_range=bounds)
        self.periods = int(self.declare_parameter("periods", 0, descriptor).value)
        meaning = "Seconds to wait for a simulator, or for simulated time to go on; then it ends. 0 is for ever."
        descriptor = ParameterDescriptor(
            description=meaning,
            read_only=True,
            floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1e9)],
        )
        self.patience_s = float(self.declare_parameter("patience", _PATIENCE_S, descriptor).value) or float("inf")
        if scene.drive.holds:
            raise CrawlerError(f"scene: {scene.name} has no drive to play")
        self.drive = scene.drive
        names, self._rows = list_commands(self.drive)
        self._message = TrajectoryMessage(names)
        topic = interface.topics()["joint_trajectory"]
        self._publisher = self.create_publisher(
            interface.message_class(topic.type), topic.name, interface.qos_profile(topic)
        )
        states = interface.topics()["joint_states"]
        self._states = self.resolve_topic_name(states.name)
        self.create_subscription(
            interface.message_class(states.type), states.name, self._on_state, interface.qos_profile(states), raw=True
        )
        health = interface.topics()["/diagnostics"]
        self.create_subscription(
            interface.message_class(health.type), health.name, self._on_diagnostics, interface.qos_profile(health)
        )
        self._refused: int | None = None  # commands that the simulator had refused when it was last asked
        self._diagnostics = interface.open_publisher(self, interface.topics()["/diagnostics"])
        self._rivals = ""
        self.drive_name = scene.name
        self._joints = joint_state_names(scene.body)
        self._met = False
        self.problem = ""
        self._start_ns: int | None = None
        self._sent = 0
        self._said = 0
        self.end_ns: int | None = None
        self.now_ns = -1
        self.done = threading.Event()

    def _on_state(self, data: bytes) -> None:
        if not self._met and not self._is_ours(data):
            return
        now_ns = read_stamp(data)
        if now_ns < self.now_ns:  # the simulator was reset: from the beginning
            self._start_ns, self._sent, self._said = None, 0, 0
        self.now_ns = now_ns
        if self._publisher.get_subscription_count() == 0:
            return
        if self._start_ns is None:
            self._start_ns = self._choose_start()
            self.get_logger().info(f"playing from simulated time {self._start_ns / NS:.3f} s")
        if self.drive.period is None:
            if self._sent == 0:
                self._send_once()
        else:
            self._send_ahead()
            self._say_progress()
        if self.end_ns is not None and self.now_ns >= self.end_ns:
            self.done.set()

    def _is_ours(self, data: bytes) -> bool:
        """Check once that the simulator has the body that the drive is for."""
        from sensor_msgs.msg import JointState

        found = list(deserialize_message(data, JointState).name)
        self._met = found == self._joints
        if not self._met:
            self.give_up(
                f"the simulator's joints are {', '.join(found[:6])}, the scene's {', '.join(self._joints[:6])}: "
                "both must be started with the same scene"
            )
        return self._met

    def _on_diagnostics(self, message: Any) -> None:
        """End when the simulator has refused what was sent; it counts what it refuses, by topic."""
        mine = self.get_namespace().strip("/")
        topic = interface.topics()["joint_trajectory"].name
        for status in message.status:
            node, _, part = status.name.rpartition(": ")
            if part != "commands" or node.rpartition("/")[0] != mine:
                continue
            refused = int({v.key: v.value for v in status.values}.get(f"refused on {topic}", 0))
            before, self._refused = self._refused, refused
            news = status.level != status.OK if before is None else refused > before  # what is old may be another's
            if not (self._sent and refused and news):
                continue
            if self.count_publishers(self._publisher.topic_name) > 1:  # it may be another's
                self.get_logger().warning(f"a command was refused, of this player or another one: {status.message}")
            else:
                self.give_up(f"the simulator refuses the commands: {status.message}")

    def give_up(self, problem: str) -> None:
        """End with an error.

        Args:
            problem: what is wrong.
        """
        self.problem = self.problem or problem
        self.done.set()

    def describe_silence(self) -> tuple[float, str]:
        """Say why no state comes, as far as the graph shows it.

        Returns:
            How long that may last before it is hopeless [s], and what it is.
        """
        met = self.now_ns >= 0
        standing = f"simulated time stands still at {self.now_ns / NS:.3f} s" if met else "no state has come"
        if self.count_publishers(self._states):
            paused = f"ros2 service call {self.get_namespace().rstrip('/')}/crawler/pause std_srvs/srv/SetBool"
            return self.patience_s, f"{standing}: is it paused? Then let it go on: {paused} '{{data: false}}'"
        if met:
            return min(_GONE_S, self.patience_s), f"the simulator has gone at simulated time {self.now_ns / NS:.3f} s"
        where = "start crawler-simulator in the same namespace and domain (a first start compiles for minutes)"
        return 10.0 * self.patience_s, f"there is none: {where}"

    def look_for_rivals(self) -> None:
        """Warn, here and on /diagnostics, of other players and of other crawlers under this one's name."""
        states = {"joint_states": publishers_of(self, "joint_states")}
        commands = {"joint_trajectory": publishers_of(self, "joint_trajectory")}
        found = [rivals_on_states(states), rivals_on_commands(commands)]
        text = "; ".join(rival for rival in found if rival)
        if text != self._rivals:
            self._rivals = text
            if text:
                self.get_logger().warning(text)
        name = self.get_fully_qualified_name().lstrip("/")
        status: Status = (WARN if text else OK, f"{name}: playing", text or "alone", self.drive_name, [])
        self._diagnostics.publish(encode_diagnostics(time.time_ns(), [status]))

    def wake(self) -> None:
        """Ask a simulator in lock-step for one tick that changes nothing: it is silent until a command comes."""
        if self._publisher.get_subscription_count() > 0:
            self._publisher.publish(TrajectoryMessage([]).encode(0, [0], [np.zeros(0)]))

    def _say_progress(self) -> None:
        assert self._start_ns is not None
        assert self.drive.period is not None
        done = int((self.now_ns - self._start_ns) / (self.drive.period * NS))
        if self.periods and done > self._said:
            self._said = done
            self.get_logger().info(f"period {done} of {self.periods}")

    def _choose_start(self) -> int:
        """Take a round tenth of a second, far enough ahead that the first message arrives before it."""
        return (self.now_ns // (NS // 10) + 3) * (NS // 10)

    def _send_once(self) -> None:
        assert self._start_ns is not None
        times = np.rint(self.drive.times * NS).astype(np.int64)
        self._publish(self._start_ns, times.tolist(), list(range(times.size)))
        self.end_ns = self._start_ns + int(times[-1])

    def _send_ahead(self) -> None:
        """Send what begins within the next second, or half a period; short periods many to a message."""
        assert self._start_ns is not None
        assert self.drive.period is not None
        span = self.drive.period * NS
        while self.periods == 0 or self._sent < self.periods:
            begin = self._start_ns + round(self._sent * span)
            if begin - self.now_ns > max(min(span / 2, _MOST_AHEAD_NS), NS):
                return
            count = max(int(_LEAST_MESSAGE_NS / span), 1)
            if self.periods:
                count = min(count, self.periods - self._sent)
            times, rows = self._waypoints(count)
            self._publish(begin, times, rows)
            self._sent += count
        self.end_ns = self._start_ns + round(self.periods * span)

    def _waypoints(self, periods: int) -> tuple[list[int], list[int]]:
        """List the waypoints of some periods, both ends included: times from their start [ns], and rows."""
        assert self.drive.period is not None
        inner = np.flatnonzero(self.drive.times < self.drive.period)
        starts = self.drive.period * np.arange(periods)[:, None]
        times = np.rint((starts + self.drive.times[inner]) * NS).astype(np.int64).ravel().tolist()
        rows = np.tile(inner, periods).tolist()
        return [*times, round(periods * self.drive.period * NS)], [*rows, 0]

    def _publish(self, start_ns: int, times: list[int], rows: list[int]) -> None:
        self._publisher.publish(self._message.encode(start_ns, times, [self._rows[r] for r in rows]))


def main(args: list[str] | None = None) -> int:
    """Play until the periods asked for are over, or until SIGINT or SIGTERM.

    Args:
        args: command line, for ROS arguments; None for the process's own.

    Returns:
        The exit status: 0, or 1 when the scene was wrong or the drive could not be played to its end.
    """
    return run_node("gait_player", GaitPlayer, _spin, args, "scene periods patience")


def _spin(node: GaitPlayer) -> None:
    end_on_signals(node.done.set, node.done.is_set)
    executor = EventsExecutor()
    executor.add_node(node)
    moved = said = woken = looked = time.monotonic()
    seen_ns = node.now_ns
    while not node.done.is_set():
        executor.spin_once(timeout_sec=0.1)
        now = time.monotonic()
        if node.now_ns != seen_ns:
            seen_ns, moved = node.now_ns, now
        if now - looked > 1.0:
            looked = now
            node.look_for_rivals()
            node.throttle.flush()
        if node.now_ns < 0 and now - woken > _WAKE_EVERY_S:
            woken = now
            node.wake()
        if min(now - moved, now - said) > _GONE_S:
            said = now
            patience_s, why = node.describe_silence()
            if now - moved > patience_s:
                node.give_up(f"{why}; given up after {now - moved:.0f} s")
            elif node.now_ns < 0:
                node.get_logger().info(f"waiting for joint_states of a simulator; {why}")
            else:
                node.get_logger().warning(why)
    node.destroy_node()
    if node.problem:
        raise CrawlerError(node.problem)


if __name__ == "__main__":
    sys.exit(main())
