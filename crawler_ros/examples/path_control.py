"""An example controller: a body with two actuators side by side follows straight lines from waypoint to waypoint.

Both links lengthen and shorten once a period; their difference steers. When the last state of a period has arrived,
line-of-sight guidance gives the heading for the next one, alpha - atan(e / ahead), where alpha is the direction of the
line and e the distance of the body to its left. A new line counts from the distance `ahead` before its start on.
"""

from __future__ import annotations

import math
import signal
import sys
from collections.abc import Generator

import rclpy
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Pose, PoseStamped
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
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


class PathControl(Node):
    """Plays a period, reads the pose, chooses the difference of the strokes, plays the next."""

    def __init__(self) -> None:
        """Declare parameters and open topics."""
        super().__init__("path_control")
        # x and y of one waypoint after the other, in the frame of `pose`, whose origin is the start; m
        self.waypoints = self.declare_parameter("waypoints", [5.0, 0.0, 9.0, 4.0, 9.0, 10.0]).value or []
        self.stroke = self.declare_parameter("stroke", 0.2, within(-1e3, 1e3)).value  # mean of both links, m
        self.limit = self.declare_parameter("limit", 0.2, within(0.0, 1e3)).value  # of the deviation from it, m
        self.kp = self.declare_parameter("kp", 0.5, within(0.0, 1e3)).value  # deviation by heading, m/rad
        self.ahead = self.declare_parameter("ahead", 2.0, within(1e-6, 1e6)).value  # m
        self.period = round(self.declare_parameter("period", 1.0, within(1e-3, 1e6)).value * NS)
        # simulated time for messages to arrive
        self.lead = round(self.declare_parameter("lead", 0.5, within(0.0, 1e3)).value * NS)
        self.links = [self.declare_parameter("left", "link_0").value, self.declare_parameter("right", "link_1").value]
        self.now = self.end = -1  # simulated time, and the end of the current period, ns
        self.pose = Pose()
        self.done = Future()
        self.commands = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.create_subscription(PoseStamped, "pose", self.on_pose, 10)
        self.create_subscription(JointState, "joint_states", self.on_joints, 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.refuse_unknown_parameters()
        if not self.waypoints or len(self.waypoints) % 2:
            sys.exit(f"path_control: waypoints: {len(self.waypoints)} number(s); x and y of each waypoint are needed")
        if not all(map(math.isfinite, self.waypoints)):
            sys.exit("path_control: waypoints: they must be finite")
        self.rivals = self.problem = ""
        self.repeated = 0
        self.create_timer(
            0.5, self.on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )  # does not depend on /clock
        self.control = self.follow_path()

    def on_joints(self, message: JointState) -> None:
        """End if the body has no such links: it would not move."""
        for name in self.links:
            if name not in message.name:
                self.problem = f"{name!r} is no joint of this body; its joints are {', '.join(message.name)}"

    def on_pose(self, message: PoseStamped) -> None:
        """Read the pose and the simulated time."""
        now = message.header.stamp.sec * NS + message.header.stamp.nanosec
        self.repeated += now <= self.now  # once: the simulator was reset
        if self.repeated > 1 and self.count_publishers("pose") > 1:
            self.problem = "two simulators publish pose here: end one, or start it with another ROS_DOMAIN_ID"
            return
        if now < self.now:  # the simulator was reset: start again
            self.end, self.control = -1, self.follow_path()
        self.now, self.pose = now, message.pose
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
                sys.exit(f"path_control: unknown parameter {name!r}; the parameters are {', '.join(known)}")

    def play_next(self) -> None:
        """Play the next period when the last one is over."""
        if self.now < max(self.end, 0) or not self.commands.get_subscription_count():
            return
        try:
            steer = next(self.control)
        except StopIteration:
            self.end = 2**63
            self.done.set_result(None)
            return
        start = self.now + self.lead
        trajectory = JointTrajectory(joint_names=self.links)
        trajectory.header.stamp = Time(sec=start // NS, nanosec=start % NS)
        for k in range(3):
            ns = self.period * k // 2
            point = JointTrajectoryPoint(time_from_start=Duration(sec=ns // NS, nanosec=ns % NS))
            point.positions = [self.stroke - steer, self.stroke + steer] if k == 1 else [0.0, 0.0]
            trajectory.points.append(point)
        self.end = start + self.period
        self.commands.publish(trajectory)

    def follow_path(self) -> Generator[float, None, None]:
        """Yield how much longer the right stroke of the next period is than the mean of both, which turns left [m]."""
        x0, y0 = self.pose.position.x, self.pose.position.y
        corners = list(zip(self.waypoints[::2], self.waypoints[1::2], strict=True))
        for k, (x1, y1) in enumerate(corners, start=1):
            alpha, length = math.atan2(y1 - y0, x1 - x0), math.hypot(x1 - x0, y1 - y0)
            early = self.ahead if k < len(corners) else 0.0
            while True:
                dx, dy = self.pose.position.x - x0, self.pose.position.y - y0
                along = dx * math.cos(alpha) + dy * math.sin(alpha)
                left = dy * math.cos(alpha) - dx * math.sin(alpha)
                if along >= length - early:
                    break
                yaw = 2.0 * math.atan2(self.pose.orientation.z, self.pose.orientation.w)
                error = math.remainder(alpha - math.atan2(left, self.ahead) - yaw, 2.0 * math.pi)
                yield min(max(self.kp * error, -self.limit), self.limit)
            self.get_logger().info(f"line {k}: {length - along!r} m before its end, {left!r} m to the left of it")
            x0, y0 = x1, y1


def main(args: list[str] | None = None) -> None:
    """Run the controller until the last waypoint is passed, or until a signal.

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
        sys.exit(f"path_control: {error}")
    for number in (signal.SIGINT, signal.SIGTERM):  # no exception: one that is raised in a callback of C is lost
        signal.signal(number, lambda received, _: signals.append(received))
    try:
        node = PathControl()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not (signals or node.done.done() or node.problem):
            executor.spin_once(timeout_sec=0.1)
        if node.problem:
            sys.exit(f"path_control: {node.problem}")
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        sys.exit(f"path_control: {error}")
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
