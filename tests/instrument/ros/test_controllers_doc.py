"""docs/controllers.md and node.md: what they promise outside their blocks, which tests/system/test_docs.py runs."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
from crawler_ros.wire.topics import read_services, read_topics

from ...pages import ROOT, blocks
from ...processes import PATIENCE_S
from .graph import environment

TEXT = (ROOT / "docs" / "controllers.md").read_text(encoding="utf-8")
NODE = (ROOT / "docs" / "node.md").read_text(encoding="utf-8")


def test_the_first_controller_is_short():
    code = next(block for block in blocks("controllers.md", TEXT) if block.language == "python")
    assert (
        sum(1 for line in code.text.splitlines() if line.strip() and not line.startswith(("#", "import", "from"))) <= 25
    )


def test_the_topics_that_they_name_are_there():
    for name in re.findall(r"^\| `([a-z_/]+)`[^|]*\| (?!std_srvs)", TEXT + NODE, re.M):
        known = {**read_topics(), **read_services()}
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
    command = [sys.executable, "-m", "crawler_ros.node.simulator", "--ros-args", "--enclave", "/crawler"]
    done = subprocess.run(command, env=environment() | keys, capture_output=True, text=True, timeout=PATIENCE_S)
    assert done.returncode == 1
    assert "security" in done.stderr
