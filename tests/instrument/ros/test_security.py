"""What can be reached from outside, what a scene file can do, and what a recording may overwrite."""

from __future__ import annotations

import os
import signal
import socket
import stat
import subprocess
import sys
import threading
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from crawler_ros.recording import bag, bag_folder
from crawler_ros.recording.bag_writer import BagWriter
from crawler_ros.recording.recorder import Recorder

from ...commands import crawler
from ...processes import PATIENCE_S, children, wait_until
from ...sockets import addresses
from ..model.scene.test_file import EVIL
from .graph import environment
from .machine import SOAK, simulator

ASKED = ("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "FASTRTPS_DEFAULT_PROFILES_FILE")
NOTHING = dict.fromkeys(ASKED)


# -- the network ------------------------------------------------------------------------------------------------------


def is_loopback(address: str) -> bool:
    return address.startswith("127.") or address in ("::1", "::ffff:127.0.0.1")


def outer_address() -> str:
    """This machine's address on a network, or a skip."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # nothing is sent
        except OSError:
            pytest.skip("this machine has no network but loopback")
        found = probe.getsockname()[0]
    if is_loopback(found):
        pytest.skip("this machine has no network but loopback")
    return found


def takes(address: str, port: int) -> bool:
    """Whether anybody takes a datagram at an address: the kernel refuses for nobody, sooner or later."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.settimeout(0.3)
        probe.connect((address, port))
        try:
            probe.send(b"RTPS")
            probe.recv(1)
        except ConnectionRefusedError:
            return False
        except TimeoutError:
            return True
    return True


GIVEN = {"nothing": {}, "a range": {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}, "the old way": {"ROS_LOCALHOST_ONLY": "1"}}  # fmt: skip


@pytest.mark.parametrize("given", list(GIVEN) if SOAK else ["nothing"])
def test_every_socket_is_on_loopback_unless_asked_otherwise(ros, given):
    """The simulator's, the gait player's, the viewer's and the recording's; and others still find the simulator."""
    own = NOTHING | GIVEN[given]
    bags = ros.folder / "bags"
    ros.hear("joint_states")  # a plain rclpy node on this machine, without our profile
    simulating = ros.run(simulator(f"record:={bags}", "view:=live"), **own)
    playing = ros.run([sys.executable, "-m", "crawler_ros.node.gait_player"], **own)
    wait_until(lambda: "playing from" in playing.said, what="a walk")
    wait_until(lambda: any(any(m.position) for m in list(ros.heard["joint_states"])), what="a walk heard by others")
    pids = [simulating.process.pid, playing.process.pid, *children(simulating.process.pid)]
    assert len(pids) == 4
    wait_until(lambda: any(p.startswith("tcp") for p, _, _ in addresses(*pids)), what="the viewer's port")
    found = addresses(*pids)
    assert {p for p, _, _ in found} >= {"udp", "tcp"}
    assert [s for s in found if not is_loopback(s[1])] == []
    outer = outer_address()
    for protocol, _, port in found:
        if protocol == "udp":
            assert takes("127.0.0.1", port)
            wait_until(lambda p=port: not takes(outer, p), what=f"a refusal at {outer}:{port}")


LISTENER = """
import sys, time, rclpy
from sensor_msgs.msg import JointState
rclpy.init()
node = rclpy.create_node("somebody")
heard = []
node.create_subscription(JointState, "joint_states", heard.append, 10)
print("listening", flush=True)
while not heard:
    rclpy.spin_once(node, timeout_sec=0.1)
print("heard", flush=True)
"""


@pytest.mark.parametrize("first", ["simulator", "listener"])
def test_a_node_that_was_told_nothing_finds_it(ros, first):
    """The README's own controller: no range, no profile."""
    commands = {"simulator": simulator(), "listener": [sys.executable, "-c", LISTENER]}
    own = NOTHING
    running = {}
    for name in sorted(commands, key=lambda n: n != first):
        running[name] = ros.run(commands[name], **own)
        if first == "simulator" == name:
            wait_until(lambda: "waiting for" in running["simulator"].said, what="the simulator")
        elif name == first:
            wait_until(lambda: "listening" in running["listener"].said, what="the listener")
    wait_until(lambda: "heard" in running["listener"].said, what="a listener that hears")
    assert running["listener"].wait() == 0


def test_asked_otherwise_it_listens_on_the_network(ros):
    outer = outer_address()
    given = NOTHING | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    process = ros.run(simulator(), **given)
    wait_until(lambda: "waiting for" in process.said, what="the simulator")
    open_ports = [port for p, a, port in addresses(process.process.pid) if p == "udp" and not is_loopback(a)]
    assert any(takes(outer, port) for port in open_ports)


def test_a_profile_of_the_users_own_is_left_alone(tmp_path):
    code = "import os; from crawler_ros.node.life.run import stay_on_loopback; stay_on_loopback(); "
    code += f"print([os.environ.get(n) for n in {ASKED!r}])"

    def said(**given: str) -> list[str | None]:
        own = {k: v for k, v in environment().items() if k not in ASKED} | given
        done = subprocess.run([sys.executable, "-c", code], env=own, capture_output=True, text=True, check=True)
        return eval(done.stdout)

    mine = str(tmp_path / "mine.xml")
    assert said(FASTRTPS_DEFAULT_PROFILES_FILE=mine) == ["LOCALHOST", None, None, mine]
    off = said(ROS_AUTOMATIC_DISCOVERY_RANGE="OFF")
    assert off[0] == "OFF"
    assert off[3].endswith("msgs_config/loopback.xml")
    assert said(ROS_LOCALHOST_ONLY="0") == [None, "0", None, None]
    assert said(ROS_STATIC_PEERS="192.0.2.9") == [None, None, "192.0.2.9", None]
    for given in GIVEN.values():
        found = said(**given)
        assert found[:3] == ["SYSTEM_DEFAULT", None, None]
        assert found[3].endswith("msgs_config/loopback.xml")


def test_help_says_what_can_be_reached():
    done = subprocess.run(
        [*simulator(), "--help"], env=environment(), capture_output=True, text=True, timeout=PATIENCE_S
    )
    assert "127.0.0.1 only; ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET" in done.stdout


# -- scene files ------------------------------------------------------------------------------------------------------


def test_the_simulator_and_the_command_say_so_too(tmp_path):
    """One line, exit 1, no traceback, for a bomb, a tag and a pipe that nobody writes to."""
    marker = tmp_path / "done"
    (tmp_path / "bomb.yaml").write_text(EVIL["lists of lists"])
    (tmp_path / "tag.yaml").write_text(EVIL["python/object/apply"].replace("{marker}", str(marker)))
    os.mkfifo(tmp_path / "pipe.yaml")
    for name in ("bomb.yaml", "tag.yaml", "pipe.yaml"):
        path = tmp_path / name
        done = subprocess.run(
            simulator(f"scene:={path}", f"record:={tmp_path / 'bags'}"),
            env=environment(),
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
        for answer in (done, crawler("check", str(path))):
            assert answer.returncode == 1, answer
            assert str(path) in answer.stderr
            assert "Traceback" not in answer.stderr
    assert not marker.exists()
    assert not (tmp_path / "bags").exists()


# -- recordings -------------------------------------------------------------------------------------------------------


class OneSecond(datetime):
    """A clock that stands."""

    @classmethod
    def now(cls, tz=None):
        return datetime(2026, 1, 1, 12, 0, 0)


def test_what_is_in_the_way_is_left_alone(tmp_path, monkeypatch):
    """A recording, a file, a link that leads nowhere and one to another recording: the new folder takes a new name."""
    monkeypatch.setattr(bag_folder, "datetime", OneSecond)
    stem = "crawler_2026_01_01-12_00_00"
    BagWriter(tmp_path / stem, {}).close()
    before = {p.name: p.read_bytes() for p in (tmp_path / stem).iterdir()}
    (tmp_path / f"{stem}_2").write_text("a file")
    (tmp_path / f"{stem}_3").symlink_to(tmp_path / "nowhere")
    (tmp_path / f"{stem}_4").symlink_to(tmp_path / stem)
    (tmp_path / f"{stem}_5").mkdir()
    made = Recorder(tmp_path, "crawler", {})
    made.start()
    made.close()
    assert made.folder == tmp_path / f"{stem}_6"
    assert made.error is None
    assert bag.examine(made.folder).complete
    assert {p.name: p.read_bytes() for p in (tmp_path / stem).iterdir()} == before
    assert (tmp_path / f"{stem}_2").read_text() == "a file"
    assert not (tmp_path / "nowhere").exists()
    assert not list((tmp_path / f"{stem}_5").iterdir())


def test_recordings_of_the_same_second_have_folders_of_their_own(tmp_path, monkeypatch):
    monkeypatch.setattr(bag_folder, "datetime", OneSecond)
    made = []
    at_once = threading.Barrier(16)

    def make():
        at_once.wait()
        made.append(bag_folder.make_folder(tmp_path / "bags", "crawler"))

    threads = [threading.Thread(target=make) for _ in range(16)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(made)) == 16
    assert set(made) == set((tmp_path / "bags").iterdir())


@contextmanager
def read_only(folder: Path):
    """A folder in which nothing can be made, by root neither."""
    folder.mkdir()
    if os.geteuid() != 0:
        folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
        yield folder
        folder.chmod(stat.S_IRWXU)
        return
    done = subprocess.run(["mount", "-t", "tmpfs", "-o", "ro", "tmpfs", folder], capture_output=True, text=True)
    if done.returncode != 0:
        pytest.skip(f"root writes everywhere, and a read-only file system cannot be mounted: {done.stderr.strip()}")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def assert_refused(record: Path) -> None:
    command = simulator(f"record:={record}")
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 1, done.stderr
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("simulator: ")]
    assert str(record) in line
    assert "Traceback" not in done.stderr


def test_where_no_recording_can_be_made_nothing_starts(tmp_path):
    file, link = tmp_path / "file", tmp_path / "link"
    file.write_text("mine")
    link.symlink_to(tmp_path / "nowhere")
    assert_refused(file)
    assert_refused(link)
    assert_refused(file / "below")
    assert file.read_text() == "mine"
    assert not (tmp_path / "nowhere").exists()


def test_a_read_only_folder_is_refused(tmp_path):
    with read_only(tmp_path / "locked") as folder:
        assert_refused(folder)
        assert_refused(folder / "bags")


def test_recovering_overwrites_nothing(ros):
    bags = ros.folder / "bags"
    process = ros.simulator(f"record:={bags}")
    wait_until(lambda: len(ros.heard["joint_states"]) > 80)
    pids = [*children(process.process.pid), process.process.pid]
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    process.process.wait()
    (path,) = bags.iterdir()
    before = bag.find_file(path).read_bytes()
    first = crawler("replay", "--recover", str(path))
    assert first.returncode == 0, first.stderr
    recovered = path.with_name(path.name + "_recovered")
    kept = bag.find_file(recovered).read_bytes()
    again = crawler("replay", "--recover", str(path))
    assert again.returncode == 1
    assert str(recovered) in again.stderr
    assert "Traceback" not in again.stderr
    assert bag.find_file(recovered).read_bytes() == kept
    assert bag.find_file(path).read_bytes() == before
