"""How nodes start and end, who else is there, and what a killed one leaves behind."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from crawler_ros.node.intake.peers import publishers_of
from crawler_ros.node.life.shared_memory import remove_orphans

from ...processes import children, wait_until
from .graph import environment, node_command
from .machine import Sender, encode_array, simulator, status, stop, value
from .test_security import NOTHING, addresses, is_loopback

CONTROLLERS = ("speed_control", "phase_control", "path_control")
INTERRUPTED = """
import faulthandler, signal, sys
import rclpy
from rclpy.signals import SignalHandlerOptions
from crawler_ros.node import simulator

faulthandler.dump_traceback_later(50, exit=True)
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
node = simulator.Simulator()
node.tick_clock.pause(True, 0)
for instructions in range(10_000):
    left = instructions
    node.stopping = simulator.StopFlag()
    simulator.end_on_signals(node.stopping)

    def trace(frame, event, _):
        global left
        frame.f_trace_opcodes = True
        left -= event == "opcode"
        if left < 0:
            sys.settrace(None)
            signal.raise_signal(signal.SIGINT)
        return trace

    sys.settrace(trace)
    node._wait_for_commands()
    sys.settrace(None)
    if left >= 0:
        break
    assert node.stopping.is_set()
print(instructions, "instructions")
node.close()
"""


# -- signals ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "module", ["node.simulator", "node.gait_player", *(f"examples.{name}" for name in CONTROLLERS)]
)
def test_a_signal_that_arrives_twice_ends_it_in_order(ros, module):
    """As launch without a terminal sends it: to the process, and to its group."""
    bags = ros.folder / "bags"
    running = ros.simulator(f"record:={bags}", hear=("joint_states", "/diagnostics"))
    if module != "node.simulator":
        ros.hear("joint_trajectory")  # a mere publisher would show only that the controller starts
        running = ros.start(f"crawler_ros.{module}")
        wait_until(lambda: ros.heard["joint_trajectory"], what="a controller's command")
    process = running.process
    for _ in range(3):
        process.send_signal(signal.SIGINT)
        os.killpg(process.pid, signal.SIGINT)
    assert process.wait(60) == 0
    assert "Traceback" not in running.said


def test_a_signal_may_interrupt_a_paused_simulator_anywhere():
    """An event that a handler sets while its own thread holds the lock of that event would never be set."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], env=environment(), capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[0]) > 10


def test_asked_again_later_it_ends_at_once_and_the_recording_is_finished(ros):
    bags = ros.folder / "bags"
    running = ros.simulator(f"record:={bags}")
    (recorder,) = children(running.process.pid)
    stop(recorder)
    try:
        running.process.send_signal(signal.SIGINT)
        time.sleep(1.2)  # what makes it another signal
        assert running.process.poll() is None
        running.process.send_signal(signal.SIGINT)
        assert running.process.wait(60) == 130
    finally:
        os.kill(recorder, signal.SIGCONT)
    (folder,) = bags.iterdir()
    wait_until(lambda: (folder / "metadata.yaml").exists(), what="the end of the recording")


def test_ended_while_it_compiles_it_leaves_one_line_and_was_in_no_graph(ros):
    """A node that stood in the graph without answering would hold up whoever waits for it."""
    running = ros.run(simulator(), NUMBA_CACHE_DIR=str(ros.folder / "cache"))
    wait_until(lambda: "compiling the kernels" in running.said, what="a compiler")
    time.sleep(1.0)  # discovery
    assert "crawler" not in ros.node.get_node_names()
    running.process.send_signal(signal.SIGINT)
    assert running.process.wait(60) == 130
    assert running.said.splitlines()[-1] == "simulator: stopped"
    assert "Traceback" not in running.said


# -- who else is there ------------------------------------------------------------------------------------------------


def warned(ros, part, text):
    return any(
        s.name.endswith(part) and s.level == b"\x01" and text in s.message
        for m in ros.heard["/diagnostics"]
        for s in m.status
    )


def test_two_simulators_of_one_name_warn_of_each_other(ros):
    first = ros.simulator(hear=("joint_states", "/diagnostics"))
    second = ros.start("crawler_ros.node.simulator")
    for running in (first, second):
        wait_until(lambda r=running: "two crawlers need two namespaces" in r.said, what="a line in the log")
    wait_until(lambda: warned(ros, "simulation", "another node publishes joint_states"), what="a warning")
    assert first.said.count("two crawlers need two namespaces") <= 2  # not at every report


def test_two_players_of_one_name_warn_and_so_does_the_simulator(ros):
    simulating = ros.simulator("scene:=three_contacts_one_way", hear=("joint_states", "/diagnostics"))
    players = [ros.start("crawler_ros.node.gait_player") for _ in range(2)]
    for running in (simulating, *players):
        wait_until(lambda r=running: "2 publishers command this crawler at once" in r.said, what="a line in the log")
    wait_until(lambda: warned(ros, "commands", "publishers command this crawler"), what="the simulator's warning")
    wait_until(lambda: warned(ros, "gait_player: playing", "publishers command"), what="the player's warning")
    assert players[0].end() == 0
    wait_until(lambda: status(ros, "commands").level == b"\x00", what="peace")


def test_a_player_that_was_killed_and_started_again_is_no_rival_of_itself(ros):
    """The graph lists the one that was killed for another 20 s."""
    simulating = ros.simulator("scene:=three_contacts_one_way", hear=("joint_states", "/diagnostics"))
    topic, said = "joint_trajectory", "publishers command this crawler"
    first = ros.start("crawler_ros.node.gait_player")
    wait_until(lambda: status(ros, "commands") and value(ros, "commands", f"received on {topic}") >= "1", what="a plan")
    wait_until(lambda: publishers_of(ros.node, topic), what="the first in the graph, before it is killed")
    first.process.kill()
    ros.start("crawler_ros.node.gait_player")
    wait_until(lambda: len(publishers_of(ros.node, topic)) == 2, what="both in the graph")
    wait_until(lambda: len(publishers_of(ros.node, topic)) == 1, what="the end of the first in the graph")
    assert said not in simulating.said
    ros.start("crawler_ros.node.gait_player")
    wait_until(lambda: said in simulating.said, what="a line about the third")


def test_two_publishers_of_friction_are_rivals(ros):
    simulating = ros.simulator()
    topic = "friction_controller/commands"
    both = [Sender(ros, topic) for _ in range(2)]

    def are_told() -> bool:
        for sender in both:
            sender.send(topic, encode_array([0.5]))
        return f"2 publishers command this crawler at once (/listener on {topic})" in simulating.said

    wait_until(are_told, what="a line in the log")


@pytest.mark.parametrize("name", CONTROLLERS)
def test_two_controllers_warn_of_each_other(ros, name):
    ros.hear("/diagnostics")
    running = [ros.start(f"crawler_ros.examples.{name}") for _ in range(2)]
    for one in running:
        wait_until(lambda o=one: "waiting for a simulator" in o.said, what="word that it waits")
        wait_until(lambda o=one: "another node publishes joint_trajectory too" in o.said, what="a warning")
    wait_until(lambda: warned(ros, "rivals", "another node publishes joint_trajectory too"), what="a warning")


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("no_such:=1.0", "unknown parameter 'no_such'; the parameters are"),
        ("period:=x", "period"),
        ("period:=-1.0", "Parameter period out of range"),
    ],
)
def test_controllers_refuse_wrong_parameters_in_one_line(name, given, said):
    command = [sys.executable, "-m", f"crawler_ros.examples.{name}", "--ros-args", "-p", given]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"{name}: ")
    assert said in line


@pytest.mark.parametrize("name", CONTROLLERS)
def test_controllers_refuse_malformed_arguments_without_a_traceback(name):
    command = [sys.executable, "-m", f"crawler_ros.examples.{name}", "--ros-args", "-p", "joints:=["]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    assert done.stderr.splitlines()[-1].startswith(f"{name}: ")
    assert "joints:=[" in done.stderr.splitlines()[-1]


STUCK = """
import time
from crawler_ros.node.life import run
from crawler_ros.node.life.quiet_node import QuietNode

class Stuck(QuietNode):
    def destroy_node(self):
        time.sleep(1000.0)

run._LEAVING_S = 0.5
run.run_node("stuck", lambda: Stuck("stuck"), lambda node: node.leave(), [], "")
"""


def test_a_node_that_cannot_leave_the_graph_ends_all_the_same():
    """Fast DDS waits for ever, now and then, where two nodes leave at the same moment."""
    done = subprocess.run([sys.executable, "-c", STUCK], env=environment(), capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (1, "")


LEFT = """
import atexit, os, signal, sys
from crawler_command import executables
from crawler_ros.node import gait_player
from crawler_ros.node.life import run
from crawler_ros.node.life.quiet_node import QuietNode

def interrupt():
    for number in (signal.SIGINT, signal.SIGTERM):
        os.kill(os.getpid(), number)
    print("left")

atexit.register(interrupt)
gait_player.main = lambda: run.run_node("left", lambda: QuietNode("left"), lambda node: node.leave(), [], "")
sys.exit(executables.gait_player())
"""


def test_a_signal_that_arrives_while_a_node_exits_changes_nothing():
    done = subprocess.run([sys.executable, "-c", LEFT], env=environment(), capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "left\n", "")


# -- what is left behind ----------------------------------------------------------------------------------------------

SEGMENT = re.compile(r"fastrtps_[0-9a-f]{16}")


def segments(pid: int) -> set[str]:
    """Shared memory that a process has locked as its own."""
    links = [os.readlink(f) for f in Path(f"/proc/{pid}/fd").iterdir() if f.is_symlink()]
    names = [Path(link).name.removesuffix("_el") for link in links if link.endswith("_el")]
    return {name for name in names if SEGMENT.fullmatch(name)}


def test_the_next_one_removes_what_a_killed_one_left(ros):
    running = ros.simulator()
    own = segments(running.process.pid)
    assert own
    remove_orphans()
    assert all(Path("/dev/shm", name).exists() for name in own)  # it lives
    running.end(signal.SIGKILL)
    again = ros.simulator()  # another test's may have been the next
    wait_until(lambda: "waiting for commands" in again.said, what="the next one")
    assert not any(Path("/dev/shm", f"{name}{end}").exists() for name in own for end in ("", "_el"))
    assert all(Path("/dev/shm", name).exists() for name in segments(again.process.pid))


def test_without_discovery_it_is_on_loopback_as_well_and_nobody_finds_it(ros):
    ros.hear("joint_states")
    process = ros.run(simulator(), **(NOTHING | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}))
    wait_until(lambda: "waiting for commands" in process.said, what="the simulator")
    found = addresses(process.process.pid)
    assert found
    assert [s for s in found if not is_loopback(s[1])] == []
    time.sleep(2.0)  # discovery
    assert not ros.heard["joint_states"]
    assert process.end() == 0


def test_with_closed_streams_it_runs_and_ends_in_order(ros):
    ros.hear("joint_states")
    words = node_command("crawler_ros.node.simulator")
    process = ros.run(["sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *words])
    wait_until(lambda: ros.heard["joint_states"] or process.process.poll() is not None, what="a state")
    assert process.process.poll() is None
    assert process.end() == 0


def test_started_with_interrupts_ignored_the_tests_restore_them_for_their_processes():
    code = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); import tests.conftest; "
    code += "print(signal.getsignal(signal.SIGINT) is signal.default_int_handler)"
    root = Path(__file__).parents[3]
    done = subprocess.run([sys.executable, "-c", code], cwd=root, capture_output=True, text=True, check=True)
    assert done.stdout == "True\n"
