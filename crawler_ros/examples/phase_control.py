"""An example controller: a search for the phase between shape and friction that moves two contacts furthest.

The link lengthens and shortens once a period; the friction of one contact rises while the other's falls, delayed
by a phase. Each trial plays two periods, the first to settle, and measures the distance of the second. A coarse scan of
all phases finds the neighbourhood of the best one, and steps halved repeatedly refine it.
"""

from __future__ import annotations

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
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

NS = 10**9
NAMES = ["link_0", "contact_0/friction", "contact_1/friction"]


def within(least: float, most: float) -> ParameterDescriptor:
    """Describe a parameter with a range, which ROS checks."""
    return ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=least, to_value=most)])


def from_to(least: int, most: int) -> ParameterDescriptor:
    """Describe a parameter that is a whole number in a range."""
    return ParameterDescriptor(integer_range=[IntegerRange(from_value=least, to_value=most)])


class PhaseControl(Node):
    """Plays period after period, each with a phase that depends on the distances of earlier ones."""

    def __init__(self) -> None:
        """Declare parameters and open topics."""
        super().__init__("phase_control")
        self.length = self.declare_parameter("length", 4.0, within(-1e3, 1e3)).value  # of the stroke, m
        self.friction = self.declare_parameter("friction", 1.0, within(1e-9, 1e6)).value  # mean, N
        self.depth = self.declare_parameter("depth", 0.5, within(0.0, 1.0)).value  # modulated fraction of it
        self.phases = self.declare_parameter("phases", 8, from_to(1, 1000)).value  # of the coarse scan
        self.tolerance = self.declare_parameter("tolerance", 1e-4, within(1e-9, 1.0)).value  # of the phase, in periods
        self.period = round(self.declare_parameter("period", 1.0, within(1e-3, 1e6)).value * NS)
        # simulated time for messages to arrive
        self.lead = round(self.declare_parameter("lead", 0.5, within(0.0, 1e3)).value * NS)
        self.now = self.end = -1  # simulated time, and the end of the current period, ns
        self.y = self.y_before = 0.0
        self.done = Future()
        self.commands = self.create_publisher(JointTrajectory, "joint_trajectory", 10)
        self.create_subscription(PoseStamped, "pose", self.on_pose, 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.refuse_unknown_parameters()
        self.rivals = self.problem = ""
        self.repeated = 0
        self.create_timer(
            0.5, self.on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )  # does not depend on /clock
        self.control = self.search()

    def on_pose(self, message: PoseStamped) -> None:
        """Read the net translation and the simulated time."""
        now = message.header.stamp.sec * NS + message.header.stamp.nanosec
        self.repeated += now <= self.now  # once: the simulator was reset
        if self.repeated > 1 and self.count_publishers("pose") > 1:
            self.problem = "two simulators publish pose here: end one, or start it with another ROS_DOMAIN_ID"
            return
        if now < self.now:  # the simulator was reset: start again
            self.end, self.control = -1, self.search()
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
                sys.exit(f"phase_control: unknown parameter {name!r}; the parameters are {', '.join(known)}")

    def play_next(self) -> None:
        """Play the next period when the last one is over."""
        if self.now < max(self.end, 0) or not self.commands.get_subscription_count():
            return
        try:
            phase = next(self.control) if self.end < 0 else self.control.send(self.y - self.y_before)
        except StopIteration:
            self.end = 2**63
            self.done.set_result(None)
            return
        self.y_before, start = self.y, self.now + self.lead
        trajectory = JointTrajectory(joint_names=NAMES)
        trajectory.header.stamp = Time(sec=start // NS, nanosec=start % NS)
        for t in sorted({0.0, 0.5, 1.0, (0.25 + phase) % 1.0, (0.75 + phase) % 1.0}):  # where a wave turns
            ns = round(t * self.period)
            point = JointTrajectoryPoint(time_from_start=Duration(sec=ns // NS, nanosec=ns % NS))
            # a triangle: 0, depth, 0, -depth at the quarters of t - phase
            swing = self.depth * (1.0 - 4.0 * abs((t - phase + 0.25) % 1.0 - 0.5))
            length = self.length * (1.0 - abs(1.0 - 2.0 * t))
            point.positions = [length, self.friction * (1.0 + swing), self.friction * (1.0 - swing)]
            trajectory.points.append(point)
        self.end = start + self.period
        self.commands.publish(trajectory)

    def search(self) -> Generator[float, float, None]:
        """Yield the phase of each period; receive the distance travelled in it."""
        step, rounding = 1.0 / self.phases, 1e-9 * self.length
        best, most = 0.0, -float("inf")
        for phase in [k * step for k in range(self.phases)]:
            gained = yield from self.try_phase(phase)
            if gained > most + rounding:
                best, most = phase, gained
        while step > self.tolerance:
            step *= 0.5
            for phase in ((best + step) % 1.0, (best - step) % 1.0):
                gained = yield from self.try_phase(phase)
                if gained > most + rounding:
                    best, most = phase, gained
                    break
        self.get_logger().info(f"best phase {best!r} of a period, {most!r} m per period")

    def try_phase(self, phase: float) -> Generator[float, float, float]:
        """Play a phase for two periods; return the distance of the second."""
        yield phase
        gained = yield phase
        self.get_logger().info(f"phase {phase!r}: gained {gained!r} m")
        return gained


def main(args: list[str] | None = None) -> None:
    """Run the controller until the phase is found, or until a signal.

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
        sys.exit(f"phase_control: {error}")
    for number in (signal.SIGINT, signal.SIGTERM):  # no exception: one that is raised in a callback of C is lost
        signal.signal(number, lambda received, _: signals.append(received))
    try:
        node = PhaseControl()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        while not (signals or node.done.done() or node.problem):
            executor.spin_once(timeout_sec=0.1)
        if node.problem:
            sys.exit(f"phase_control: {node.problem}")
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        sys.exit(f"phase_control: {error}")
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
