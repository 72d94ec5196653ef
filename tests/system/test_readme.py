"""What the README promises: the demonstration, its controller, its nodes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from crawler_ros.wire.definitions import find_ament_prefix

from ..pages import ROOT, blocks
from ..processes import PATIENCE_S
from .test_command import CRAWLER, good

README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory):
    pytest.importorskip("rclpy")
    folder = tmp_path_factory.mktemp("demo")
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    command = {"cwd": folder, "env": environment | {"COLUMNS": "120"}, "timeout": 3 * PATIENCE_S}
    done = subprocess.run([CRAWLER, "demo"], capture_output=True, text=True, **command)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def test_demo_ends_with_a_summary_on_one_screen(demonstrated):
    folder, text = demonstrated
    assert len(text.splitlines()) < 24
    assert re.search(r"distance per period\s+0\.140000000000 m \(closed form 0\.140000000000 m", text)
    for suffix in (".mcap", ".rrd", ".png"):
        (path,) = re.findall(rf"^\s+(\S+{re.escape(suffix)})\b", text, re.M)[:1]
        assert (folder / path).stat().st_size > 10_000
    assert "crawler view" in text


def test_demos_recording_is_whole(demonstrated):
    folder, _ = demonstrated
    (recording,) = [p for p in (folder / "demo").iterdir() if p.is_dir()]
    text = good("replay", str(recording))
    assert "complete" in text
    assert "identical to the bit" in text
    assert "nothing to recover" in good("replay", str(recording), "--recover")


def test_the_two_commands_are_there():
    first = next(block for block in blocks("README.md", README) if block.language == "bash")
    assert [line.split("  ")[0] for line in first.text.splitlines()[1:]] == ["make demo", "make test"]
    for target, runs in (("demo", "crawler demo"), ("test", "python -m pytest")):
        text = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        assert runs in text


def test_the_controller_of_the_readme_moves_the_simulator(tmp_path):
    pytest.importorskip("rclpy")
    from tests.instrument.ros.graph import environment, graph

    from ..processes import wait_until

    (script,) = [block for block in blocks("README.md", README) if block.file == "my_controller.py"]
    with graph(tmp_path) as ros:
        ros.simulator(hear=("joint_states",))
        (tmp_path / script.file).write_text(script.text)
        subprocess.run(
            [sys.executable, tmp_path / script.file], env=environment(ros.domain), timeout=PATIENCE_S, check=True
        )
        wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0)


def test_the_nodes_are_found_through_the_ament_index():
    pytest.importorskip("rclpy")
    from ament_index_python.packages import get_package_prefix

    os.environ.pop("AMENT_PREFIX_PATH", None)
    find_ament_prefix()
    prefix = Path(get_package_prefix("crawler_ros"))
    assert (prefix / "share" / "crawler_ros" / "package.xml").is_file()
    for name in ("simulator", "gait_player"):
        executable = prefix / "lib" / "crawler_ros" / name
        assert os.access(executable, os.X_OK)
        command = [executable, "--ros-args", "-p", "scene:=nowhere"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S)
        assert done.returncode == 1
        assert "nowhere: no such file, nor a scene of the gallery" in done.stderr


def test_the_command_is_that_of_this_environment():
    assert Path(CRAWLER).is_file()
