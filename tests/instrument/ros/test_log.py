"""A log that nobody reads stops nobody, and peers cannot flood it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import socket
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from ...processes import children, wait_until
from .graph import environment
from .machine import Sender, encode_array, simulator, status, value

TALKER = """
import os, sys
from crawler_ros.node.life.log_pipe import unblocked_log
with unblocked_log():
    for k in range(50_000):
        os.write(2, f"line {k:06d} {'x' * 90}\\n".encode())
    print("written", flush=True)
print("last words", file=sys.stderr, flush=True) if len(sys.argv) > 1 else None
"""


def channel(kind: str) -> tuple[int, int]:
    """Two ends of what can be somebody's standard error: where it is read, where it is written."""
    if kind == "pipe":
        return os.pipe()
    if kind == "terminal":
        return pty.openpty()
    reader, writer = socket.socketpair()
    return reader.detach(), writer.detach()


def read_all(fd: int) -> str:
    data = b""
    while True:
        try:
            block = os.read(fd, 1 << 16)
        except OSError:  # a terminal whose other end is closed
            block = b""
        if not block:
            os.close(fd)
            return data.decode()
        data += block


@pytest.mark.parametrize("kind", ["pipe", "terminal", "socket"])
def test_five_megabytes_that_nobody_reads_block_nobody(kind):
    reader, writer = channel(kind)
    process = subprocess.Popen([sys.executable, "-c", TALKER], stdout=subprocess.PIPE, stderr=writer)
    os.close(writer)
    assert process.stdout.readline() == b"written\n"
    assert process.wait(60) == 0
    said = read_all(reader)
    assert said.startswith("line 000000")
    assert said.count("\n") < 50_000


def test_what_is_read_late_is_whole_or_counted():
    reader, writer = channel("pipe")
    process = subprocess.Popen([sys.executable, "-c", TALKER], stdout=subprocess.PIPE, stderr=writer)
    os.close(writer)
    assert process.stdout.readline() == b"written\n"
    said = read_all(reader)  # the drain still waits for a reader
    assert process.wait(60) == 0
    lines = said.splitlines()
    (dropped,) = (int(line.split()[0]) for line in lines if "were dropped because they were not read" in line)
    assert dropped + len(lines) - 1 == pytest.approx(50_000, abs=len(lines) // 100)  # a torn line at each block's ends


def test_what_is_read_arrives_whole_and_in_order():
    code = TALKER.replace("50_000", "9_000")  # less than what waits for a reader: nothing is dropped
    process = subprocess.run([sys.executable, "-c", code, "more"], capture_output=True, text=True, timeout=60)
    lines = process.stderr.splitlines()
    assert lines[-1] == "last words"
    assert [int(line.split()[1]) for line in lines[:-1]] == list(range(9_000))


def test_a_crash_does_not_take_the_last_words_along():
    code = TALKER.replace("range(50_000)", "range(10)").replace('print("written", flush=True)', "os.abort()")
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert process.returncode == -signal.SIGABRT
    assert process.stderr.count("line ") == 10


@pytest.mark.parametrize("turn", range(4))
def test_with_its_log_in_a_full_pipe_the_simulator_runs_serves_and_ends(ros, turn):
    reader, writer = os.pipe()
    os.write(writer, bytes(fcntl.fcntl(writer, fcntl.F_GETPIPE_SZ)))  # not a byte more goes in
    for name in ("joint_states", "/diagnostics"):
        ros.hear(name)
    process = subprocess.Popen(simulator(), env=environment(ros.domain), stderr=writer, start_new_session=True)
    os.close(writer)
    try:
        wait_until(lambda: ros.heard["joint_states"], what="the first state")
        for k in range(30):
            ros.publish("actuation_controller/commands", Float64MultiArray(data=[float("nan")] * (k + 3)))
        wait_until(lambda: status(ros, "commands") and value(ros, "commands", "refused") == "30", what="30 refused")
        assert ros.call("/crawler/pause", "std_srvs/srv/SetBool", data=True).success
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
    finally:
        process.kill()
        os.close(reader)


def test_endpoints_that_do_not_fit_are_warned_of_once_a_second_and_topic(ros):
    process = ros.simulator(hear=("joint_states",))
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    count = 40
    for _ in range(count):
        ros.node.create_subscription(JointState, "joint_states", lambda m: None, latched)
    wait_until(lambda: "a subscription of joint_states has incompatible QoS" in process.said, what="a warning")
    wait_until(lambda: "more like it" in process.said, what="the count of those that were not logged")
    assert process.said.count("a subscription of joint_states") < count
    assert "New subscription discovered" not in process.said
    assert process.end() == 0


def test_torn_messages_are_refused_before_the_middleware_decodes_them(ros):
    process = ros.simulator(hear=("/diagnostics",))
    names = ("actuation_controller/commands", "joint_trajectory")
    sender = Sender(ros, *names)
    for name in names:
        for torn in (
            b"\0\1\0\0" + b"\xff" * 40,
            encode_array([1.0, 2.0])[:-4],
            b"\0\1\0\0",
            b"\0\x0b\0\0" + b"\0" * 40,
        ):
            sender.send(name, torn)
    sender.wait()
    wait_until(lambda: value(ros, "commands", "refused") == "8", what="8 refused")
    assert "not a message of this type" in process.said
    assert "sequence size" not in process.said
    assert process.end() == 0


def test_its_log_is_emptied_by_one_process_that_ends_with_it(ros):
    process = subprocess.Popen(simulator(), env=environment(ros.domain), stderr=subprocess.PIPE)
    ros.hear("joint_states")
    wait_until(lambda: ros.heard["joint_states"], what="the first state")
    (drain,) = children(process.pid)
    process.send_signal(signal.SIGINT)
    said = process.stderr.read().decode()
    assert process.wait(20) == 0
    # the last line, and it was there before the process ended
    assert re.search(r"stopped after \d+ ticks, \d+ late.*; no command was received$", said.splitlines()[-1])
    assert not os.path.exists(f"/proc/{drain}")


def test_warnings_name_the_namespace(ros):
    process = ros.start("crawler_ros.node.simulator", "scene:=ice", arguments=("-r", "__ns:=/left"))
    ros.publish(
        "/left/actuation_controller/commands", Float64MultiArray(data=[0.1, 0.2]), "actuation_controller/commands"
    )
    wait_until(lambda: "[left.crawler]: refused a message on actuation_controller/commands" in process.said)
