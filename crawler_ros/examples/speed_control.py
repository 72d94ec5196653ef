"""An example controller: a PI loop that controls the distance per period by the amplitude of a gait.

The gait lengthens the links one after another and shortens them in the same order. Each period is one trajectory; when
its last state has arrived, the distance travelled determines the amplitude of the next one. Waiting in between does not
change the motion: the crawler is rate-independent.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Generator

from sensor_msgs.msg import JointState

from crawler_ros.examples.periods import PeriodController, from_to, run, within


class SpeedControl(PeriodController):
    """Plays a period, measures the distance travelled, corrects the amplitude, plays the next."""

    def __init__(self) -> None:
        """Declare parameters and open topics."""
        super().__init__("speed_control")
        self.target = self.declare_parameter("target", 0.1, within(-1e3, 1e3)).value  # m per period
        self.kp = self.declare_parameter("kp", 0.05, within(0.0, 1e3)).value
        self.ki = self.declare_parameter("ki", 0.3, within(0.0, 1e3)).value
        self.limit = self.declare_parameter("limit", 0.2, within(0.0, 1e3)).value  # greatest amplitude, m
        self.periods = self.declare_parameter("periods", 0, from_to(0, 10**9)).value  # 0: for ever
        self.pattern = self.declare_parameter("joints", "link_.*").value  # a regular expression
        self.create_subscription(JointState, "joint_states", self.on_joints, 10)
        self.begin()
        try:
            re.compile(self.pattern)
        except re.error as error:
            sys.exit(f"speed_control: joints: {self.pattern!r} is no regular expression: {error}")

    def on_joints(self, message: JointState) -> None:
        """Find the joints to command, once."""
        if not self.joints:
            self.joints = [name for name in message.name if re.fullmatch(self.pattern, name)]
            if not self.joints:
                self.problem = f"joints: {self.pattern!r} matches none of {', '.join(message.name)}"
            self.play_next()

    def choose(self) -> Generator[float, float, None]:
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

    def waypoints(self, choice: float) -> list[tuple[int, list[float]]]:
        """Lengthen the links one after another, and shorten them in the same order."""
        count = len(self.joints)
        return [
            (self.period * k // (2 * count), [choice if i < k <= i + count else 0.0 for i in range(count)])
            for k in range(2 * count + 1)
        ]


def main(args: list[str] | None = None) -> None:
    """Run the controller until its periods are over, or until a signal.

    Args:
        args: command line; None for the process's own.
    """
    run("speed_control", SpeedControl, __doc__, args)


if __name__ == "__main__":
    main()
