"""What the example controllers share: they play one period of a gait after the other. Copy this file with them.

Each period is one trajectory. When its last state has arrived, the controller chooses the next one. Waiting in between
does not change the motion: the crawler is rate-independent.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Generator
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Pose, PoseStamped
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

NS = 10**9
GONE = 6
"""Timer calls without a simulator after which it counts as gone."""
SILENT = 20
"""Timer calls without a state after which a simulator that listens is asked for a tick. The first state takes less to
arrive: a tick that was asked for too early would shift all later ones, and runs in lock-step would differ."""


def within(least: float, most: float) -> ParameterDescriptor:
    """Describe a parameter with a range, which ROS checks."""
    return ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=least, to_value=most)])


def from_to(least: int, most: int) -> ParameterDescriptor:
    """Describe a parameter that is a whole number in a range."""
    return ParameterDescriptor(integer_range=[IntegerRange(from_value=least, to_value=most)])


class PeriodController(Node):
    """Plays a period, waits for its last state, and asks `choose` for the next one."""

    def __init__(self, name: str) -> None:
        """Declare the parameters that all controllers have, and open topics; `begin` is to be called afterwards."""
        super().__init__(name)
        self.period = round(self.declare_parameter("period", 1.0, within(1e-3, 1e6)).value * NS)
        # simulated time for messages to arrive
        self.lead = round(self.declare_parameter("lead", 0.5, within(0.0, 1e3)).value * NS)
        self.joints: list[str] = []  # names in a trajectory; nothing is played before they are known
        self.now = self.end = -1  # simulated time, and the end of the current period, ns
        self.pose = Pose()
        self.before = 0.0  # x at the start of the current period, m
        self.done = Future()
        self.rivals = self.problem = ""
        self.repeated = self.missed = self.silent = 0
        self.commands = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)

    def choose(self) -> Generator[Any, float, None]:
        """Yield what distinguishes each period; receive the distance travelled in it [m]."""
        raise NotImplementedError

    def waypoints(self, choice: Any) -> list[tuple[int, list[float]]]:
        """Lay out a period: the time from its start [ns] and the positions of all joints at each waypoint."""
        raise NotImplementedError

    def begin(self) -> None:
        """Start, once all parameters are declared; exit with one line when an unknown one was passed."""
        known = [p for p in self._parameters if p not in ("use_sim_time", "start_type_description_service")]
        for name in self._parameter_overrides:
            if not self.has_parameter(name) and not name.startswith("qos_overrides"):
                sys.exit(f"{self.get_name()}: unknown parameter {name!r}; the parameters are {', '.join(known)}")
        self.control = self.choose()
        self.create_subscription(PoseStamped, "pose", self.on_pose, 10)
        wall = Clock(clock_type=ClockType.STEADY_TIME)  # does not depend on /clock
        self.create_timer(0.5, self.on_timer, clock=wall)

    def on_pose(self, message: PoseStamped) -> None:
        """Read the pose and the simulated time."""
        now = message.header.stamp.sec * NS + message.header.stamp.nanosec
        self.repeated += now <= self.now  # once: the simulator was reset
        if self.repeated > 1 and self.count_publishers("pose") > 1:
            self.problem = "two simulators publish pose here: end one, or start it with another ROS_DOMAIN_ID"
            return
        if now < self.now:  # the simulator was reset: start again
            self.end, self.control = -1, self.choose()
        self.now, self.pose = now, message.pose
        self.play_next()

    def on_timer(self) -> None:
        """Ask a simulator in lock-step, silent in the middle of a run, for a tick that changes nothing."""
        if self.now < 0:
            self.get_logger().info("waiting for a simulator", throttle_duration_sec=5.0)
            self.silent = self.silent + 1 if self.commands.get_subscription_count() else 0
            if self.silent > SILENT:
                self.silent = 0
                self.commands.publish(JointTrajectory(points=[JointTrajectoryPoint()]))
        self.missed = 0 if self.now < 0 or self.count_publishers("pose") else self.missed + 1
        if self.missed > GONE:
            self.problem = f"the simulator disappeared at simulated time {self.now / NS:.3f} s"
        self.look_for_rivals()
        self.play_next()

    def look_for_rivals(self) -> None:
        """Warn in the log and on /diagnostics when another controller or another simulator has the same topics."""
        crowded = [name for name in ("joint_trajectory", "pose") if self.count_publishers(name) > 1]
        text = f"another node publishes {' and '.join(crowded)} too" if crowded else ""
        if text and text != self.rivals:
            self.get_logger().warning(text)
        if text or self.rivals:  # the last message withdraws the warning
            status = DiagnosticStatus(name=f"{self.get_name()}: rivals", message=text or "alone")
            status.level = DiagnosticStatus.WARN if text else DiagnosticStatus.OK
            message = DiagnosticArray(status=[status])
            message.header.stamp = self.get_clock().now().to_msg()
            self.diagnostics.publish(message)
        self.rivals = text

    def play_next(self) -> None:
        """Play the next period when the last one is over."""
        if not self.joints or self.now < max(self.end, 0) or not self.commands.get_subscription_count():
            return
        x = self.pose.position.x
        try:
            choice = next(self.control) if self.end < 0 else self.control.send(x - self.before)
        except StopIteration:
            self.end = 2**63
            self.done.set_result(None)
            return
        self.before, start = x, self.now + self.lead
        trajectory = JointTrajectory(joint_names=self.joints)
        trajectory.header.stamp = Time(sec=start // NS, nanosec=start % NS)
        for ns, positions in self.waypoints(choice):
            duration = Duration(sec=ns // NS, nanosec=ns % NS)
            trajectory.points.append(JointTrajectoryPoint(time_from_start=duration, positions=positions))
        self.end = start + self.period
        self.commands.publish(trajectory)


def run(name: str, make: Callable[[], PeriodController], text: str | None, args: list[str] | None) -> None:
    """Run a controller until its periods are over, or until a signal.

    Args:
        name: of the controller, for messages.
        make: makes it.
        text: printed for --help.
        args: command line; None for the process's own.
    """
    if {"-h", "--help"} & set(sys.argv[1:] if args is None else args):
        print(text)
        return
    signals: list[int] = []  # a handler that set an Event could wait for itself
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # arguments that are not as in --ros-args -p period:=2.0
        sys.exit(f"{name}: {error}")
    for number in (signal.SIGINT, signal.SIGTERM):  # no exception: one that is raised in a callback of C is lost
        signal.signal(number, lambda received, _: signals.append(received))
    try:
        node = make()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not (signals or node.done.done() or node.problem):
            executor.spin_once(timeout_sec=0.1)
        if node.problem:
            sys.exit(f"{name}: {node.problem}")
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        sys.exit(f"{name}: {error}")
    finally:
        rclpy.try_shutdown()
