"""An example controller: a body with two actuators side by side follows straight lines from waypoint to waypoint.

Both links lengthen and shorten once a period; their difference steers. When the last state of a period has arrived,
line-of-sight guidance gives the heading for the next one, alpha - atan(e / ahead), where alpha is the direction of the
line and e the distance of the body to its left. A new line counts from the distance `ahead` before its start on.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Generator

from sensor_msgs.msg import JointState

from crawler_ros.examples.periods import PeriodController, run, within


class PathControl(PeriodController):
    """Plays a period, reads the pose, chooses the difference of the strokes, plays the next."""

    def __init__(self) -> None:
        """Declare parameters and open topics."""
        super().__init__("path_control")
        # x and y of one waypoint after the other, in the frame of `pose`, whose origin is the start; m
        self.corners = self.declare_parameter("waypoints", [5.0, 0.0, 9.0, 4.0, 9.0, 10.0]).value or []
        self.stroke = self.declare_parameter("stroke", 0.2, within(-1e3, 1e3)).value  # mean of both links, m
        self.limit = self.declare_parameter("limit", 0.2, within(0.0, 1e3)).value  # of the deviation from it, m
        self.kp = self.declare_parameter("kp", 0.5, within(0.0, 1e3)).value  # deviation by heading, m/rad
        self.ahead = self.declare_parameter("ahead", 2.0, within(1e-6, 1e6)).value  # m
        self.joints = [self.declare_parameter("left", "link_0").value, self.declare_parameter("right", "link_1").value]
        self.create_subscription(JointState, "joint_states", self.on_joints, 10)
        self.begin()
        if not self.corners or len(self.corners) % 2:
            sys.exit(f"path_control: waypoints: {len(self.corners)} number(s); x and y of each waypoint are needed")
        if not all(map(math.isfinite, self.corners)):
            sys.exit("path_control: waypoints: they must be finite")

    def on_joints(self, message: JointState) -> None:
        """End if the body has no such links: it would not move."""
        for name in self.joints:
            if name not in message.name:
                self.problem = f"{name!r} is no joint of this body; its joints are {', '.join(message.name)}"

    def choose(self) -> Generator[float, float, None]:
        """Yield how much longer the right stroke of the next period is than the mean of both, which turns left [m]."""
        x0, y0 = self.pose.position.x, self.pose.position.y
        corners = list(zip(self.corners[::2], self.corners[1::2], strict=True))
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

    def waypoints(self, choice: float) -> list[tuple[int, list[float]]]:
        """Lengthen both links, the left one less and the right one more, and shorten them."""
        strokes = [self.stroke - choice, self.stroke + choice]
        return [(0, [0.0, 0.0]), (self.period // 2, strokes), (self.period, [0.0, 0.0])]


def main(args: list[str] | None = None) -> None:
    """Run the controller until the last waypoint is passed, or until a signal.

    Args:
        args: command line; None for the process's own.
    """
    run("path_control", PathControl, __doc__, args)


if __name__ == "__main__":
    main()
