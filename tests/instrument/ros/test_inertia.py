from __future__ import annotations

import pytest

pytest.importorskip("rclpy")

from ...processes import wait_until
from .machine import status, value
from .test_nodes import trajectory

SCENE = """
name: two
body: {contacts: [0.0, 0.2], masses: 0.05, links: {stiffness: 20.0}}
friction: {forward: 0.1, backward: 0.3}
"""


@pytest.mark.parametrize("lock_step", ["true", "false"])
def test_diagnostics_report_the_number_since_the_last_reset(ros, tmp_path, lock_step):
    scene = tmp_path / "two.yaml"
    scene.write_text(SCENE)
    pace = f"lock_step:={lock_step}", "real_time_factor:=0.0"
    ros.simulator(f"scene:={scene}", *pace, hear=("/diagnostics",))  # a flood of states would push out the answer
    ros.publish("joint_trajectory", trajectory(["link_0"], (0.5, [0.1]), (1.0, [0.0])))
    wait_until(lambda: status(ros, "simulation") is not None, what="a report")
    wait_until(lambda: value(ros, "simulation", "inertia number") == "0.5", what="the number")
    assert value(ros, "simulation", "inertia number found").startswith("contact 1 at ")
    assert value(ros, "simulation", "relative deviation of the gain by inertia") == "not to be predicted"
    assert ros.call("/crawler/reset", "std_srvs/srv/Trigger").success
    wait_until(lambda: value(ros, "simulation", "inertia number") == "0", what="the number after a reset")


def test_ticks_of_a_body_too_long_to_follow_its_pieces_have_a_number(ros, tmp_path):
    """Their mean velocities stand for those of pieces, so that each tick is followed by itself."""
    scene = tmp_path / "long.yaml"
    contacts = ", ".join(f"{0.2 * k:.1f}" for k in range(1001))
    scene.write_text(SCENE.replace("[0.0, 0.2]", f"[{contacts}]"))
    ros.simulator(f"scene:={scene}", "lock_step:=true", hear=("joint_states", "/diagnostics"))
    ros.publish("joint_trajectory", trajectory(["link_0"], (0.5, [0.1]), (1.0, [0.0])))
    wait_until(lambda: value(ros, "simulation", "inertia number") not in ("", "0"), what="a number")
