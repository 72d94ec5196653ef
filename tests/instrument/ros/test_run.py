"""`crawler run`: a simulator and a controller as real processes, which end together and lose nothing."""

from __future__ import annotations

import os
import re
import signal
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from crawler_ros.examples import speed_control
from crawler_ros.recording import bag

from ...processes import children, wait_until
from .graph import Graph, Process
from .machine import assert_whole, recorded, stamp_ns

SCENE, SPEED = "three_contacts_one_way", Path(speed_control.__file__)
ENDLESS = """
import os
import time
import rclpy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

rclpy.init()
node = rclpy.create_node("endless")
lengths = node.create_publisher(Float64MultiArray, "actuation_controller/commands", 10)
def answer(state):
    lengths.publish(Float64MultiArray(data=[1e-4 * (state.header.stamp.nanosec % 1000), 0.0]))
    print("tick", flush=True)
while not lengths.get_subscription_count():  # an answer that nobody hears would be the last
    time.sleep(0.01)
node.create_subscription(JointState, "joint_states", answer, 10)
print("controller", os.getpid(), os.environ["ROS_DOMAIN_ID"], os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"], flush=True)
try:
    rclpy.spin(node)
except Exception:  # the context ends before a callback
    pass
"""


def write(folder: Path, text: str) -> str:
    file = folder / "controller.py"
    file.write_text(text)
    return str(file)


def whole(process: Process) -> Path:
    """The recording that the summary names, which lacks nothing."""
    (found,) = re.findall(r"; recorded (\S+)$", process.said, re.M)
    assert_whole(Path(found))
    return Path(found)


def test_in_lock_step_it_repeats_to_the_bit_up_to_its_duration(tmp_path, ros: Graph):
    words = ("run", SCENE, str(SPEED), "--lock-step", "--record", str(tmp_path), "--duration", "2.505")
    runs = []
    for _ in range(2):
        run = ros.command(*words, "--", "--ros-args", "-p", "target:=0.1", "-p", "periods:=40")
        assert run.wait() == 0, run.said
        assert "period 1: amplitude" in run.said
        assert "speed_control.py was ended; simulator stopped after 251 ticks, 0 late; recorded " in run.said
        runs.append([(stamp_ns(m), *m.position, *m.effort) for m in recorded(whole(run), "/joint_states")])
    assert runs[0] == runs[1]
    assert runs[0][-1][0] == 2_510_000_000


def test_it_ends_with_the_controller_and_its_status(tmp_path, ros: Graph):
    ended = ros.command("run", SCENE, str(SPEED), "--lock-step", "--", "--ros-args", "-p", "periods:=2")
    assert ended.wait() == 0, ended.said
    assert re.search(
        r"^speed_control\.py ended with status 0; simulator stopped after \d+ ticks, 0 late$", ended.said, re.M
    )
    raised = ros.command("run", SCENE, write(tmp_path, "import sys\nsys.exit(len(sys.argv))"), "--", "--rate", "x")
    assert raised.wait() == 3
    assert "controller.py ended with status 3; simulator stopped after" in raised.said
    raised = ros.command("run", SCENE, write(tmp_path, "raise RuntimeError('broken')"))
    assert raised.wait() == 1
    assert "RuntimeError: broken" in raised.said
    assert "controller.py ended with status 1; simulator stopped after" in raised.said


SPINNING = """
import threading
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Float64MultiArray

rclpy.init()
node = rclpy.create_node("spinning")
lengths = node.create_publisher(Float64MultiArray, "actuation_controller/commands", 10)
beside = SingleThreadedExecutor()
beside.add_node(rclpy.create_node("beside"))
threading.Thread(target=beside.spin).start()
try:
    while True:
        lengths.publish(Float64MultiArray(data=[0.0, 0.0]))
        rclpy.spin_once(node, timeout_sec=0.01)
finally:
    {finally_}
"""


def test_a_stop_that_was_asked_for_is_no_error_of_the_controller_but_its_own_is(tmp_path, ros: Graph):
    """In lock-step the duration is over only once the controller has commanded."""
    words = (SCENE, write(tmp_path, SPINNING.format(finally_="pass")), "--lock-step", "--duration", "0.1")
    run = ros.command("run", *words)
    assert run.wait() == 0
    said = [line for line in run.said.splitlines() if "compiling" not in line]
    assert said == ["controller.py was ended; simulator stopped after 10 ticks, 0 late"]
    write(tmp_path, SPINNING.format(finally_="raise ValueError('clean-up')"))
    run = ros.command("run", *words)
    assert run.wait() == 0
    assert "ValueError: clean-up" in run.said
    assert "runpy" not in run.said


def test_a_message_of_another_type_is_named_with_the_right_one(tmp_path, ros: Graph):
    deaf = ENDLESS.replace("not lengths.get_subscription_count()", "False")  # it would wait for ever
    text = deaf.replace("Float64MultiArray", "Float32MultiArray").replace("rclpy.spin(node)", WAITS)
    run = ros.command("run", SCENE, write(tmp_path, text))
    assert run.wait() == 1, run.said
    *_, warning, last = (line for line in run.said.splitlines() if "Multi" in line or "crawler: " in line)
    assert warning.endswith(
        "/endless publishes std_msgs/msg/Float32MultiArray on /actuation_controller/commands, which takes "
        "std_msgs/msg/Float64MultiArray: none of its messages is received"
    )
    assert last.endswith(
        "controller.py ended before the simulator received a command: the warning above names the reason"
    )


WAITS = """
    from diagnostic_msgs.msg import DiagnosticArray
    reports = []
    node.create_subscription(DiagnosticArray, "/diagnostics", reports.append, 10)
    while len(reports) < 3:  # each follows a look at the publishers
        rclpy.spin_once(node)
"""


def test_the_summary_counts_what_was_refused(tmp_path, ros: Graph):
    text = ENDLESS.replace("data=[1e-4 * (state.header.stamp.nanosec % 1000), 0.0]", "data=[0.0]")
    text = text.replace("    print(", "    raise SystemExit\n    print(")
    run = ros.command("run", SCENE, write(tmp_path, text), "--lock-step")
    assert run.wait() == 0, run.said
    assert (
        "refused a message on actuation_controller/commands: actuation command has 1 value(s); it needs 2" in run.said
    )
    assert run.said.splitlines()[-1].endswith("simulator stopped after 0 ticks, 0 late; 1 message(s) were refused")


@pytest.mark.parametrize(
    ("command", "which"),
    [
        ("[0.0]", "all 1 command(s) so far were"),
        ("[0.0, 0.0][:1 + (state.header.stamp.nanosec < 5e7)]", "the last command was"),
    ],
    ids=["all", "the last"],
)
def test_a_controller_that_waits_behind_a_refused_command_is_ended(tmp_path, ros: Graph, command: str, which: str):
    text = ENDLESS.replace("[1e-4 * (state.header.stamp.nanosec % 1000), 0.0]", command)
    run = ros.command("run", SCENE, write(tmp_path, text), "--lock-step", "--record", str(tmp_path))
    assert run.wait() == 1, run.said
    assert f"{which} refused, and in lock-step nothing moves without one" in run.said
    assert run.said.splitlines()[-1].endswith(
        "controller.py was ended: it waits behind a refused command; the warnings above name the reason"
    )
    (recording,) = (path for path in tmp_path.iterdir() if path.is_dir())
    assert bag.examine(recording).complete


def start(ros: Graph, folder: Path, **more: str | None) -> tuple[Process, int, list[str]]:
    """Start an endless controller as a user does; return the command, the process of the controller and its domain."""
    crawler = [sys.executable, "-m", "crawler_command.app"]
    controller = write(folder, ENDLESS)
    process = ros.run([*crawler, "run", SCENE, controller, "--lock-step", "--record", str(folder)], **more)
    wait_until(lambda: process.said.count("tick") > 20 or process.process.poll() is not None, what="ticks")
    pid, *domain = re.search(r"^controller (\d+) (\d+) (\w+)$", process.said, re.M).groups()
    return process, int(pid), domain


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_both_and_completes_the_recording(tmp_path, ros: Graph, number):
    process, controller, domain = start(ros, tmp_path)
    assert domain[0] == str(ros.domain)
    simulator = next(pid for pid in children(process.process.pid) if pid != controller)
    assert process.end(number) == 128 + number
    for pid in (controller, simulator):
        assert not Path(f"/proc/{pid}").exists()
    assert "simulator stopped after" in process.said
    whole(process)


def test_it_has_a_domain_of_its_own_where_none_is_set(tmp_path, ros: Graph):
    process, _, domain = start(ros, tmp_path, ROS_DOMAIN_ID=None, ROS_AUTOMATIC_DISCOVERY_RANGE=None)
    assert domain[0] not in ("0", str(ros.domain))
    assert domain[1] == "LOCALHOST"
    assert process.end() == 130


def test_a_simulator_that_dies_ends_the_controller(tmp_path, ros: Graph):
    process, controller, _ = start(ros, tmp_path)
    os.kill(next(pid for pid in children(process.process.pid) if pid != controller), signal.SIGKILL)
    assert process.wait() == 1
    assert not Path(f"/proc/{controller}").exists()
    assert "crawler: the simulator failed" in process.said


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["nowhere", str(SPEED)], "the simulator has not started: nowhere: no such file, nor a scene of the gallery"),
        ([SCENE, "nowhere.py"], "nowhere.py: no such file; name the Python file of a controller"),
        ([SCENE, str(SPEED), "--duration", "-1"], "--duration: -1 s; it must be > 0"),
        ([SCENE, str(SPEED), "--record", "/proc/x"], "the simulator has not started: record: /proc/x: the folder"),
        ([SCENE, str(SPEED), "-p", "rate=50"], "-p rate=50: write NAME:=VALUE, for example -p rate:=200.0"),
        ([SCENE, str(SPEED), "-p", "scene:=x"], "-p scene:=x: scene is chosen by the command"),
        ([SCENE, str(SPEED), "-p", "rate:=-1.0"], "the simulator has not started: "),
        ([SCENE, "silent.py"], "silent.py ended before the simulator received a command; let it wait until"),
    ],
    ids=["scene", "controller", "duration", "record", "form", "chosen", "parameter", "silent"],
)
def test_what_cannot_run_is_one_line(tmp_path, ros: Graph, words, text):
    if "silent.py" in words:
        (tmp_path / "silent.py").write_text("")
        words = [SCENE, str(tmp_path / "silent.py")]
    run = ros.command("run", *words)
    assert run.wait() == 1
    (line,) = run.said.splitlines()
    assert line.startswith("crawler: ")
    assert text in line
