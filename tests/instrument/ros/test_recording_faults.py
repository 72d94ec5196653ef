"""Recordings that are deleted, moved or locked while they are written, and message definitions that are not found."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from crawler_ros.recording import bag
from crawler_ros.replay import simulate_again

from ...processes import wait_until
from .graph import environment
from .machine import simulator, status


def only(bags: Path) -> Path:
    """The one bag folder, once its recording process has opened the file."""
    (file,) = wait_until(lambda: list(bags.glob("*/*.mcap")), what="a recording")
    return file.parent


def wait_for_more(ros, count=50):
    heard = len(ros.heard["joint_states"])
    wait_until(lambda: len(ros.heard["joint_states"]) > heard + count, what="more of joint_states")


@contextmanager
def locked(folder: Path):
    """Take the right to write from a folder; root's too."""
    if os.geteuid() != 0:
        folder.chmod(0o500)
        yield
        folder.chmod(0o700)
        return
    if subprocess.run(["chattr", "+i", folder], capture_output=True).returncode != 0:
        pytest.skip("root can write everywhere here")
    try:
        yield
    finally:
        subprocess.run(["chattr", "-i", folder], check=True)


def assert_trouble_is_shown(ros, process, text):
    wait_until(lambda: getattr(status(ros, "recording"), "level", b"") == b"\x02", what="an error on /diagnostics")
    assert text in status(ros, "recording").message
    wait_until(lambda: text in process.said, what="a line in the log")
    wait_for_more(ros)  # ticks go on


def test_a_recording_that_is_deleted_is_reported_and_fails(ros):
    bags = ros.folder / "bags"
    process = ros.simulator(f"record:={bags}", hear=("joint_states", "/diagnostics"))
    wait_until(lambda: getattr(status(ros, "recording"), "level", b"") == b"\0", what="a healthy recording")
    shutil.rmtree(only(bags))
    assert_trouble_is_shown(ros, process, "was deleted while it was recorded")
    assert process.end() == 1
    last = process.said.splitlines()[-1]
    assert last.startswith(f"simulator: recording stopped: {bags}/crawler_")
    assert last.endswith("was deleted while it was recorded")
    assert "Traceback" not in process.said
    assert not list(bags.iterdir())


def test_a_recording_deleted_in_lock_step_is_noticed_without_a_tick(ros):
    bags = ros.folder / "bags"
    process = ros.simulator(f"record:={bags}", "lock_step:=true", "publish.diagnostics:=false", hear=("joint_states",))
    shutil.rmtree(only(bags))
    wait_until(lambda: "was deleted while it was recorded" in process.said, what="a line in the log")
    assert process.end() == 1


def test_a_recording_that_is_moved_away_loses_nothing_and_is_reported(ros):
    bags = ros.folder / "bags"
    process = ros.simulator(f"record:={bags}", hear=("joint_states", "/diagnostics"))
    source, target = only(bags), ros.folder / "moved"
    source.rename(target)
    assert_trouble_is_shown(ros, process, "was moved or cannot be reached")
    target.rename(source)
    wait_until(lambda: status(ros, "recording").level == b"\0", what="the end of the trouble")
    source.rename(target)
    assert_trouble_is_shown(ros, process, "was moved or cannot be reached")
    assert process.end() == 1
    assert process.said.splitlines()[-1].startswith("simulator: recording stopped: ")
    assert bag.examine(target).complete
    assert (target / "metadata.yaml").is_file()
    assert simulate_again(target).identical


def test_a_folder_that_is_locked_keeps_its_messages_and_is_reported(ros):
    bags = ros.folder / "bags"
    process = ros.simulator(f"record:={bags}", hear=("joint_states", "/diagnostics"))
    folder = only(bags)
    with locked(folder):
        assert_trouble_is_shown(ros, process, "is no longer writable")
        assert process.end() == 1
    assert "metadata.yaml" in process.said.splitlines()[-1]
    assert bag.examine(folder).complete
    assert simulate_again(folder).identical


def test_message_definitions_are_found_beside_an_unrelated_prefix(ros):
    ros.hear("joint_states")
    bags = ros.folder / "bags"
    process = ros.run(simulator(f"record:={bags}"), AMENT_PREFIX_PATH=str(ros.folder))
    wait_until(lambda: ros.heard["joint_states"] or process.process.poll() is not None, what="a state")
    wait_for_more(ros)
    assert process.end() == 0, process.said
    assert bag.examine(only(bags)).complete


WITHOUT_PACKAGES = """
import sys
from crawler_ros.node.simulator import main
sys.prefix = "/nowhere"
sys.exit(main())
"""


def test_a_package_without_definitions_is_named_with_the_variable(tmp_path):
    """A ROS installation elsewhere, of which the environment knows nothing."""
    given = environment() | {"AMENT_PREFIX_PATH": str(tmp_path)}
    words = ["--ros-args", "-p", f"record:={tmp_path / 'bags'}"]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_PACKAGES, *words], env=given, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 1
    said = [line for line in done.stderr.splitlines() if line.startswith("simulator: ")]
    assert len(said) == 1, done.stderr
    assert f"AMENT_PREFIX_PATH={tmp_path}: the ROS package trajectory_msgs is under none of these folders" in said[0]
    assert "Traceback" not in done.stderr
    assert not list((tmp_path / "bags").glob("*"))
