"""The node `gait_player`: plays a scene's drive over `joint_trajectory`, as a controller would.

It waits for a simulator, then sends the drive period by period, each as one stamped trajectory on simulated time, at
least half a period ahead: the crawler passes through every waypoint whatever the delays between the processes are.
When playing is impossible (no simulator, simulated time standing still, refused commands), it ends with a one-line
error that names the cause.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.duration import Duration
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.serialization import deserialize_message

from crawler_model import CrawlerError, load_scene
from crawler_model.body.drive import NS, Drive

from ..wire.facts import REFUSED_ON, read_count, rows_dropped, ticks_refused
from ..wire.messages import NO_CHANGE, TrajectoryMessage, encode_diagnostics, read_stamp
from ..wire.states import joint_state_names
from ..wire.topics import message_class, open_publisher, qos_profile, read_topics
from .diagnostics import OK, WARN, Status
from .intake.peers import SecondSimulator, Silence, publishers_of, rivals_on_commands, rivals_on_states
from .life.quiet_node import QuietNode
from .life.run import run_node
from .life.stop import StopFlag, end_on_signals
from .parameters import expand_home

DEFAULT_SCENE = "three_contacts_one_way"
_LEAST_MESSAGE_NS = NS // 10
_MOST_AHEAD_NS = 30 * NS
_PATIENCE_S = 30.0
_STILL_S = 0.3  # simulated time that has not advanced for as long waits for a command, as in lock-step
_GONE_S = 3.0  # a simulator that restarts is absent for less, and one that runs sends diagnostics more often


def count_refusals(status: Any, topic: str) -> int:
    """Count what a simulator has refused: messages of a topic, and rows and whole ticks of any commands.

    Args:
        status: the part of its diagnostics about commands.
        topic: name of the topic.

    Returns:
        The number, of ticks since the last reset.
    """
    entries = {entry.key: entry.value for entry in status.values}
    return read_count(entries, f"{REFUSED_ON}{topic}") + ticks_refused(entries) + rows_dropped(entries)


def list_commands(drive: Drive) -> tuple[list[str], list[np.ndarray]]:
    """List the columns of a drive that can be commanded, which friction by directions cannot.

    Args:
        drive: the scene's drive.

    Returns:
        C names, and for each waypoint its row, shape (C,). Columns left out stay at the scene's values.
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
            CrawlerError: when the scene is invalid or has no drive.
        """
        super().__init__("gait_player", **options)
        text = {"description": "Scene file or gallery name whose drive is played.", "read_only": True}
        whole = {"description": "Number of periods to play; 0 plays without end.", "read_only": True}
        bounds = [IntegerRange(from_value=0, to_value=10**9)]
        path = self.declare_parameter("scene", DEFAULT_SCENE, ParameterDescriptor(**text)).value
        scene = load_scene(expand_home(path))
        descriptor = ParameterDescriptor(**whole, integer_range=bounds)
        self.periods = int(self.declare_parameter("periods", 0, descriptor).value)
        meaning = (
            "Time [s] to wait for simulated time to advance before giving up, ten times as long for a simulator to "
            "start; 0 waits for ever."
        )
        descriptor = ParameterDescriptor(
            description=meaning,
            read_only=True,
            floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1e9)],
        )
        self.patience_s = float(self.declare_parameter("patience", _PATIENCE_S, descriptor).value) or float("inf")
        if scene.drive.holds:
            raise CrawlerError(f"scene: {scene.name} has {scene.unmoving_drive}, and no gait to play")
        self.drive = scene.drive
        names, self._rows = list_commands(self.drive)
        self._message = TrajectoryMessage(names)
        topic = read_topics()["joint_trajectory"]
        self._publisher = self.create_publisher(message_class(topic.type), topic.name, qos_profile(topic))
        states = read_topics()["joint_states"]
        self._states = self.resolve_topic_name(states.name)
        self.create_subscription(message_class(states.type), states.name, self._on_state, qos_profile(states), raw=True)
        health = read_topics()["/diagnostics"]
        self.create_subscription(message_class(health.type), health.name, self._on_diagnostics, qos_profile(health))
        self._refused: int | None = None  # by the simulator, according to its last diagnostics
        self._diagnostics = open_publisher(self, read_topics()["/diagnostics"])
        self._rivals = ""
        self._second = SecondSimulator(self, states.name)
        self._silence = Silence()
        self.drive_name = scene.name
        self._joints = joint_state_names(scene.body)
        self._met = False
        self.problem = ""
        self._start_ns: int | None = None
        self._sent = 0
        self._reported = 0
        self.end_ns: int | None = None
        self.ended_s: float | None = None
        """Wall-clock time at which the drive had been played to its end [s]."""
        self.now_ns = -1
        self._interval_ns = 0  # between the last two states
        self.done = StopFlag()

    def _on_state(self, data: bytes) -> None:
        if not self._met and not self._has_our_body(data):
            return
        now_ns = read_stamp(data)
        if second := self._second.find(now_ns):
            self.fail(second)
        if self.problem:
            return
        if now_ns < self.now_ns:  # the simulator was reset: start again
            self._start_ns, self._sent, self._reported, self.ended_s = None, 0, 0, None
            self._refused = None  # ticks are counted anew
        self._interval_ns = now_ns - self.now_ns if self.now_ns >= 0 else 0
        self.now_ns = now_ns
        if self._publisher.get_subscription_count() == 0:
            return
        if self._sent == 0 and (self._start_ns is None or now_ns >= self._start_ns):
            self._start_ns = self._choose_start()  # the next state shows whether this one was up to date
        else:
            self.send()

    def send(self) -> None:
        """Send what is due, from the start that was chosen, or where simulated time stands still, from one after it."""
        if self._start_ns is None:
            if self._publisher.get_subscription_count() == 0:
                return
            self._start_ns = self._choose_start()
        if self._sent == 0:
            self.get_logger().info(f"playing from simulated time {self._start_ns / NS:.3f} s")
        if self.drive.period is None:
            if self._sent == 0:
                self._send_once()
        else:
            self._send_ahead()
            self._report_progress()
        if self.end_ns is not None and self.now_ns >= self.end_ns and self.ended_s is None:
            self.ended_s = time.monotonic()  # the next diagnostics show whether all of it was followed

    def _has_our_body(self, data: bytes) -> bool:
        """Check once that the simulator has the body for which the drive was written."""
        from sensor_msgs.msg import JointState

        found = list(deserialize_message(data, JointState).name)
        self._met = found == self._joints
        if not self._met:
            self.fail(
                f"the simulator's joints are {', '.join(found[:6])}, the scene's {', '.join(self._joints[:6])}: "
                "both must be started with the same scene"
            )
        return self._met

    def _on_diagnostics(self, message: Any) -> None:
        """End when the simulator has refused a command of this player."""
        namespace = self.get_namespace().strip("/")
        topic = read_topics()["joint_trajectory"].name
        for status in message.status:
            node, _, part = status.name.rpartition(": ")
            if part != "commands" or node.rpartition("/")[0] != namespace:
                continue
            refused = count_refusals(status, topic)
            before, self._refused = self._refused, refused
            # an old refusal may be another player's
            news = status.level != status.OK if before is None else refused > before
            if not (self._sent and refused and news):
                if self.ended_s is not None:
                    self.done.set()
                continue
            if self._has_rivals():
                self.get_logger().warning(f"a command of this player or of another one was refused: {status.message}")
            else:
                self.fail(f"the simulator refuses the commands: {status.message}")

    def _has_rivals(self) -> bool:
        """Determine whether a refused command may come from another node, on any topic."""
        topics = [self.resolve_topic_name(name) for name, topic in read_topics().items() if topic.direction == "in"]
        return sum(map(self.count_publishers, topics)) > 1

    @property
    def waits_to_send(self) -> bool:
        """Whether a state has arrived and nothing been sent yet."""
        return self.now_ns >= 0 and self._sent == 0

    def wait_for_receipt(self) -> None:
        """Wait until the simulator has received all that was sent, which ends with this process otherwise."""
        if not self.problem and self._sent:
            self._publisher.wait_for_all_acked(Duration(seconds=_GONE_S))

    def fail(self, problem: str) -> None:
        """End with an error.

        Args:
            problem: the error message.
        """
        self.problem = self.problem or problem
        self.done.set()

    def describe_silence(self) -> tuple[float, str]:
        """Explain why no state arrives, as far as the graph shows it.

        Returns:
            How long to wait before giving up [s], and the explanation.
        """
        met = self.now_ns >= 0
        standing = f"simulated time stands still at {self.now_ns / NS:.3f} s" if met else "no state has arrived"
        if self.count_publishers(self._states):
            paused = f"ros2 service call {self.get_namespace().rstrip('/')}/crawler/pause std_srvs/srv/SetBool"
            return self.patience_s, f"{standing}: if it is paused, resume it with: {paused} '{{data: false}}'"
        if met:
            gone = f"the simulator disappeared at simulated time {self.now_ns / NS:.3f} s"
            return min(_GONE_S, self.patience_s), gone
        where = (
            "start crawler-simulator in the same namespace and domain (its first start compiles for a minute or two)"
        )
        return 10.0 * self.patience_s, f"no simulator was found: {where}"

    def look_for_rivals(self) -> None:
        """Warn in the log and on /diagnostics about other players and other crawlers with the same topics."""
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
        """Ask a simulator that is silent in the middle of a run in lock-step for one tick that changes nothing."""
        if self._silence.has_lasted(self.now_ns < 0 and self._publisher.get_subscription_count() > 0):
            self._publisher.publish(NO_CHANGE)

    def _report_progress(self) -> None:
        assert self._start_ns is not None
        assert self.drive.period is not None
        done = min(int((self.now_ns - self._start_ns) / (self.drive.period * NS)), self.periods)
        if done > self._reported:
            self._reported = done
            self.get_logger().info(f"period {done} of {self.periods}")

    def _choose_start(self) -> int:
        """Choose a whole tenth of a second, far enough ahead that the next state and the first message precede it."""
        tenth = NS // 10
        return (self.now_ns // tenth + max(3, 1 + 2 * self._interval_ns // tenth)) * tenth

    def _send_once(self) -> None:
        assert self._start_ns is not None
        times = np.rint(self.drive.times * NS).astype(np.int64)
        self._publish(self._start_ns, times.tolist(), list(range(times.size)))
        self._sent = 1
        self.end_ns = self._start_ns + int(times[-1])

    def _send_ahead(self) -> None:
        """Send the periods that begin within the next second or half a period; one message may hold many short ones."""
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
        """List the waypoints of some periods, both ends included: times from the start [ns] and row numbers."""
        assert self.drive.period is not None
        inner = np.flatnonzero(self.drive.times < self.drive.period)
        starts = self.drive.period * np.arange(periods)[:, None]
        times = np.rint((starts + self.drive.times[inner]) * NS).astype(np.int64).ravel().tolist()
        rows = np.tile(inner, periods).tolist()
        return [*times, round(periods * self.drive.period * NS)], [*rows, 0]

    def _publish(self, start_ns: int, times: list[int], rows: list[int]) -> None:
        self._publisher.publish(self._message.encode(start_ns, times, [self._rows[r] for r in rows]))


def main(args: list[str] | None = None) -> int:
    """Play the requested number of periods, or until SIGINT or SIGTERM.

    Args:
        args: command line, for ROS arguments; None for the process's own.

    Returns:
        The exit status: 0, or 1 when the scene was invalid or the drive could not be played to its end.
    """
    return run_node("gait_player", GaitPlayer, _spin, args, "scene periods patience")


def _spin(node: GaitPlayer) -> None:
    end_on_signals(node.done)
    executor = EventsExecutor()
    executor.add_node(node)
    moved = reported = looked = time.monotonic()
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
        if node.ended_s is not None:
            if now - node.ended_s > _GONE_S:
                node.done.set()
            continue
        if node.waits_to_send and now - moved > _STILL_S:
            node.send()
        node.wake()
        if min(now - moved, now - reported) > _GONE_S:
            reported = now
            patience_s, why = node.describe_silence()
            if now - moved > patience_s:
                node.fail(f"{why}; gave up after {now - moved:.0f} s")
            elif node.now_ns < 0:
                node.get_logger().info(f"waiting for joint_states of a simulator; {why}")
            else:
                node.get_logger().warning(why)
    node.wait_for_receipt()
    node.leave()
    if node.problem:
        raise CrawlerError(node.problem)


if __name__ == "__main__":
    sys.exit(main())
