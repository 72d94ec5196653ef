"""docs/controllers.md: its blocks, run as they stand there."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
from crawler_ros import interface

from .graph import _domains, environment
from .launch_files import FOLDER, read

ROOT = Path(__file__).parent.parent.parent
PAGE = ROOT / "docs" / "controllers.md"
TEXT = PAGE.read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```$", TEXT, re.S | re.M)
SCRIPTS = [text for language, text in BLOCKS if language == "bash"]
MARK = "# needs a ROS 2 installation"
BAD = ("Traceback", "command not found", "refused", "rror")


def run(folder: Path, script: str) -> str:
    """Run a block in a shell with job control, in a folder that holds the page's Python files."""
    for language, text in BLOCKS:
        if language == "python":
            (folder / text.splitlines()[0].removeprefix("# ")).write_text(text)
    paths = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    lines = f"set -m\n{script}\nwait\n"
    shell = subprocess.Popen(
        ["bash", "-c", lines],
        env=environment(next(_domains)) | paths,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        said, _ = shell.communicate(timeout=120)
    finally:
        subprocess.run(["pkill", "-KILL", "-s", str(shell.pid)], check=False)  # its jobs have groups of their own
    for word in BAD:
        assert word not in said.replace("error ", ""), said
    return said


def test_there_are_blocks_of_the_kinds_that_are_run_or_read():
    assert {language for language, _ in BLOCKS} == {"bash", "python", "console"}
    assert len(SCRIPTS) == 8
    assert all(text.startswith(MARK) for language, text in BLOCKS if language == "console")
    assert all(re.match(r"# \w+\.py\n", text) for language, text in BLOCKS if language == "python")


def test_the_first_controller_is_short():
    code = next(text for language, text in BLOCKS if language == "python")
    assert sum(1 for line in code.splitlines() if line.strip() and not line.startswith(("#", "import", "from"))) <= 25


@pytest.mark.parametrize("script", SCRIPTS, ids=[str(i) for i in range(len(SCRIPTS))])
def test_every_shell_block_runs(tmp_path, script):
    said = run(tmp_path, script)
    assert "stopped after" in said
    if "controller.py" in script:
        assert re.search(r"link 0 is at 50 mm after \d+ states", said)
    if "speed-control" in script:
        assert re.search(r"period 40: amplitude 0\.0(8000|79999)\d* m", said)
    if "phase-control" in script:
        assert re.search(r"best phase 0\.(2000|1999)\d* of a period, 2\.(8|799)\d* m per period", said)
    if "services.py" in script:
        for word in ("paused", "at simulated time", "at the scene's start", "playing"):
            assert word in said
    if "listen.py" in script:
        assert "['contact_0', 'link_0', 'link_1']" in said


@pytest.mark.parametrize("script", [text for language, text in BLOCKS if language == "console"])
def test_what_needs_a_ros_installation_is_shell_and_names_what_there_is(script):
    assert subprocess.run(["bash", "-n", "-c", script], capture_output=True, text=True).stderr == ""
    for line in script.splitlines():
        words = line.split()
        if words[:3] == ["ros2", "launch", "crawler_ros"]:
            arguments = {a.get("name") for a in read(FOLDER / words[3]).findall("arg")}
            assert {word.split(":=")[0] for word in words[4:]} <= arguments, line
        elif words[:3] == ["ros2", "run", "crawler_ros"]:
            assert (ROOT / "resource" / "lib" / words[3]).is_file()


def test_the_topics_that_it_names_are_there():
    for name in re.findall(r"^\| `([a-z_/]+)`[^|]*\| (?!std_srvs)", TEXT, re.M):
        known = {**interface.topics(), **interface.services()}
        assert name in known, name


def test_without_security_in_the_middleware_it_does_not_run_open(tmp_path):
    enclave = tmp_path / "keys" / "enclaves" / "crawler"
    enclave.mkdir(parents=True)
    for name in (
        "identity_ca.cert.pem",
        "cert.pem",
        "key.pem",
        "permissions_ca.cert.pem",
        "governance.p7s",
        "permissions.p7s",
    ):
        (enclave / name).touch()
    keys = {
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": str(tmp_path / "keys"),
    }
    command = [sys.executable, "-m", "crawler_ros.simulator", "--ros-args", "--enclave", "/crawler"]
    done = subprocess.run(command, env=environment(1) | keys, capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert "security" in done.stderr
