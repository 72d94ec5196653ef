"""An example controller: a PI loop that controls the distance per period by the amplitude of a gait.

The gait lengthens the links one after another and shortens them in the same order. Each period is one trajectory; when
its last state has arrived, the distance travelled determines the amplitude of the next one. Waiting in between does not
change the motion: the crawler is rate-independent.
"""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Generator

import rclpy
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

NS = 10**9


def within(least: float, most: float) -> ParameterDescriptor:
    """Describe a parameter with a range, which ROS checks."""
    return ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=least, to_value=most)])


def from_to(least: int, most: int) -> ParameterDescriptor:
    """Describe a parameter that is a whole number in a range."""
    return ParameterDescriptor(integer_range=[IntegerRange(from_value=least, to_value=most)])


class SpeedControl(Node):
    """Plays a period, measures the distance travelled, corrects the amplitude, plays the next."""

    def __init__(self) -> None:
        """Declare parameters and open topics."""
        super().__init__("speed_control")
        self.target = self.declare_parameter("target", 0.1, within(-1e3, 1e3)).value  # m per period
        self.kp = self.declare_parameter("kp", 0.05, within(0.0, 1e3)).value
        self.ki = self.declare_parameter("ki", 0.3, within(0.0, 1e3)).value
        self.limit = self.declare_parameter("limit", 0.2, within(0.0, 1e3)).value  # greatest amplitude, m
        self.period = round(self.declare_parameter("period", 1.0, within(1e-3, 1e6)).value * NS)
        # simulated time for messages to arrive
        self.lead = round(self.declare_parameter("lead", 0.5, within(0.0, 1e3)).value * NS)
        self.periods = self.declare_parameter("periods", 0, from_to(0, 10**9)).value  # 0: for ever
        self.joints = self.declare_parameter("joints", "link_.*").value  # a regular expression
        self.links: list[str] = []
        self.now = self.end = -1  # simulated time, and the end of the current period, ns
        self.y = self.y_before = 0.0
        self.done = Future()
        self.commands = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.create_subscription(JointState, "joint_states", self.on_joints, 10)
        self.create_subscription(PoseStamped, "pose", self.on_pose, 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.refuse_unknown_parameters()
        try:
            re.compile(self.joints)
        except re.error as error:
            sys.exit(f"speed_control: joints: {self.joints!r} is no regular expression: {error}")
        self.rivals = self.problem = ""
        self.repeated = 0
        self.create_timer(
            0.5, self.on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )  # does not depend on /clock
        self.control = self.choose_amplitudes()

    def on_joints(self, message: JointState) -> None:
        """Find the joints to command, once."""
        if not self.links:
            self.links = [name for name in message.name if re.fullmatch(self.joints, name)]
            if not self.links:
                self.problem = f"joints: {self.joints!r} matches none of {', '.join(message.name)}"
            self.play_next()

    def on_pose(self, message: PoseStamped) -> None:
        """Read the net translation and the simulated time."""
        now = message.header.stamp.sec * NS + message.header.stamp.nanosec
        self.repeated += now <= self.now  # once: the simulator was reset
        if self.repeated > 1 and self.count_publishers("pose") > 1:
            self.problem = "two simulators publish pose here: end one, or start it with another ROS_DOMAIN_ID"
            return
        if now < self.now:  # the simulator was reset: start again
            self.end, self.control = -1, self.choose_amplitudes()
        self.now, self.y = now, message.pose.position.x
        self.play_next()

    def on_timer(self) -> None:
        """Ask a simulator in lock-step, which is silent until a command arrives, for one tick that changes nothing."""
        if self.now < 0:
            self.get_logger().info("waiting for a simulator", throttle_duration_sec=5.0)
            if self.commands.get_subscription_count():
                self.commands.publish(JointTrajectory(points=[JointTrajectoryPoint()]))
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

    def refuse_unknown_parameters(self) -> None:
        """Exit with one line when an unknown parameter was passed."""
        known = [p for p in self._parameters if p not in ("use_sim_time", "start_type_description_service")]
        for name in self._parameter_overrides:
            if not self.has_parameter(name) and not name.startswith("qos_overrides"):
                sys.exit(f"speed_control: unknown parameter {name!r}; the parameters are {', '.join(known)}")

    def play_next(self) -> None:
        """Play the next period when the last one is over."""
        if not self.links or self.now < max(self.end, 0) or not self.commands.get_subscription_count():
            return
        try:
            amplitude = next(self.control) if self.end < 0 else self.control.send(self.y - self.y_before)
        except StopIteration:
            self.end = 2**63
            self.done.set_result(None)
            return
        self.y_before, start = self.y, self.now + self.lead
        count = len(self.links)
        trajectory = JointTrajectory(joint_names=self.links)
        trajectory.header.stamp = Time(sec=start // NS, nanosec=start % NS)
        for k in range(2 * count + 1):
            ns = self.period * k // (2 * count)
            point = JointTrajectoryPoint(time_from_start=Duration(sec=ns // NS, nanosec=ns % NS))
            point.positions = [amplitude if i < k <= i + count else 0.0 for i in range(count)]
            trajectory.points.append(point)
        self.end = start + self.period
        self.commands.publish(trajectory)

    def choose_amplitudes(self) -> Generator[float, float, None]:
        """Yield the amplitude of each period; receive the distance travelled in it."""
        amplitude = integral = 0.0
        count = 0
        while not self.periods or count < self.periods:
            gained = yield amplitude
            count += 1
            error = self.target - gained
            self.get_logger().info(f"period {count}: amplitude {amplitude!r} m, gained {gained!r} m, error {error!r} m")
            wanted = integral + (self.kp + self.ki) * error
            amplitude = min(max(wanted, 0.0), self.limit)
            if (wanted - amplitude) * error <= 0.0:  # no integration further into a limit
                integral += self.ki * error


def main(args: list[str] | None = None) -> None:
    """Run the controller until its periods are over, or until a signal.

    Args:
        args: command line; None for the process's own.
    """
    if {"-h", "--help"} & set(sys.argv[1:] if args is None else args):
        print(__doc__)
        return
    signals: list[int] = []  # a handler that set an Event could wait for itself
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # arguments that are not as in --ros-args -p joints:=NAME
        sys.exit(f"speed_control: {error}")
    for number in (signal.SIGINT, signal.SIGTERM):  # no exception: one that is raised in a callback of C is lost
        signal.signal(number, lambda received, _: signals.append(received))
    try:
        node = SpeedControl()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not (signals or node.done.done() or node.problem):
            executor.spin_once(timeout_sec=0.1)
        if node.problem:
            sys.exit(f"speed_control: {node.problem}")
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        sys.exit(f"speed_control: {error}")
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
