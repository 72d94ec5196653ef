"""The README's commands and code, run as they stand there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from crawler_ros import interface

from .test_command import CRAWLER, good

ROOT = Path(__file__).parent.parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")
BIN = Path(sys.executable).parent


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.S)


def commands() -> list[str]:
    lines = [line.split("  #")[0].strip() for block in blocks("console") for line in block.splitlines()]
    return [line for line in lines if line]


@pytest.fixture(scope="module")
def demonstrated(tmp_path_factory):
    pytest.importorskip("rclpy")
    folder = tmp_path_factory.mktemp("demo")
    return folder, good("demo", cwd=folder, timeout=240)


def test_demo_ends_with_a_summary_on_one_screen(demonstrated):
    folder, text = demonstrated
    assert len(text.splitlines()) < 24
    assert re.search(r"distance per period\s+0\.140000000000 m \(closed form 0\.140000000000 m", text)
    assert re.search(r"late ticks\s+\d+", text)
    for suffix in (".mcap", ".rrd", ".png"):
        (path,) = re.findall(rf"^\s+(\S+{re.escape(suffix)})\b", text, re.M)[:1]
        assert (folder / path).stat().st_size > 10_000
    assert "crawler view" in text


def test_demos_recording_is_whole(demonstrated):
    folder, _ = demonstrated
    (recording,) = [p for p in (folder / "demo").iterdir() if p.is_dir()]
    text = good("replay", str(recording))
    assert "whole" in text
    assert "identical to the bit" in text
    assert "nothing to recover" in good("replay", str(recording), "--recover")


def test_the_make_targets_are_there():
    assert commands()[:2] == ["make demo", "make test"]
    for target, runs in (("demo", "crawler demo"), ("test", "python -m pytest")):
        text = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=True).stdout
        assert runs in text


def test_every_command_of_the_readme_exists():
    for line in commands():
        words = line.split()
        if words[0] == "crawler":
            good(words[1], "--help")
        elif words[0].startswith("crawler-"):
            assert (BIN / words[0]).exists()
        else:
            assert words[0] in ("make", "cd", "colcon", "ros2", "pip"), line


@pytest.mark.parametrize(
    "line", [c for c in commands() if c.split()[:2] in (["crawler", v] for v in ("scenes", "simulate", "check"))]
)
def test_the_models_commands_run(line):
    assert good(*line.split()[1:])


def test_the_python_of_the_readme_runs(capsys):
    _, code, many = blocks("python")
    exec(compile(code + many, "README", "exec"), {})
    said = capsys.readouterr().out
    assert said.splitlines()[:2] == ["[2. 2. 2.]", "[0. 3.]"]
    assert said.splitlines()[2].startswith("True Certificate")
    assert said.splitlines()[3] == "[2.  1.5]"


def test_the_controller_of_the_readme_moves_the_simulator(tmp_path):
    pytest.importorskip("rclpy")
    from tests.ros.graph import environment, graph, wait_until

    with graph(tmp_path) as ros:
        ros.simulator(hear=("joint_states",))
        code = blocks("python")[0]
        script = tmp_path / "controller.py"
        script.write_text(code + "import time; time.sleep(1.0)\n")
        subprocess.run([sys.executable, script], env=environment(ros.domain), timeout=60, check=True)
        wait_until(lambda: ros.heard["joint_states"][-1].effort[1] != 0.0)


def test_every_topic_and_parameter_is_in_the_tables():
    for name, topic in interface.topics().items():
        assert f"| `{name}` | {topic.type.replace('/msg/', '/')} | {topic.direction}" in README, name
    for name in interface.parameters():
        assert f"`{name}`" in README or f"`.{name.split('.')[-1]}`" in README, name


def test_its_files_and_pictures_are_there():
    for link in re.findall(r"\]\(([^)#]+)\)", README):
        if not link.startswith("http"):
            assert (ROOT / link).is_file(), link


def test_the_nodes_are_found_through_the_ament_index():
    pytest.importorskip("rclpy")
    from ament_index_python.packages import get_package_prefix

    os.environ.pop("AMENT_PREFIX_PATH", None)
    interface.find_ament_prefix()
    prefix = Path(get_package_prefix("crawler_ros"))
    assert (prefix / "share" / "crawler_ros" / "package.xml").is_file()
    for name in ("simulator", "gait_player"):
        executable = prefix / "lib" / "crawler_ros" / name
        assert os.access(executable, os.X_OK)
        command = [executable, "--ros-args", "-p", "scene:=nowhere"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert done.returncode == 1
        assert "nowhere: no such file, nor a scene of the gallery" in done.stderr


def test_the_command_is_that_of_this_environment():
    assert Path(CRAWLER).is_file()
