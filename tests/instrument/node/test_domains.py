"""Domains that are reserved: nobody gets one that another has, and what ends gives its own back."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import tempfile

import pytest

from crawler_model import CrawlerError
from crawler_ros.node.life import domains
from crawler_ros.node.life.domains import domain_environment, reserved_domain

HOLD = """
import sys
from crawler_ros.node.life import domains
domains.DOMAINS = range(*map(int, sys.argv[1:]))
with domains.reserved_domain() as number:
    print(number, flush=True)
    sys.stdin.read()
"""


@pytest.fixture
def three(tmp_path, monkeypatch):
    """Three numbers that belong to no ROS domain, reserved in a folder of their own."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(domains, "DOMAINS", range(-20, -17))
    return set(domains.DOMAINS)


def reserve_all(count: int) -> set[int]:
    with contextlib.ExitStack() as stack:
        return {stack.enter_context(reserved_domain()) for _ in range(count)}


def test_a_domain_is_reserved_once_and_given_back(three):
    assert reserve_all(3) == three
    assert reserve_all(3) == three
    with pytest.raises(CrawlerError, match="all ROS domains from -20 to -18 are taken"):
        reserve_all(4)


def test_what_another_process_has_is_free_when_it_is_killed(three):
    command = [sys.executable, "-c", HOLD, str(min(three)), str(max(three) + 1)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        theirs = int(other.stdout.readline())
        assert reserve_all(2) == three - {theirs}
        with pytest.raises(CrawlerError):
            reserve_all(3)
        other.send_signal(signal.SIGKILL)
    assert reserve_all(3) == three


@pytest.mark.usefixtures("three")
def test_a_domain_in_which_somebody_listens_is_left_out(monkeypatch):
    """A node that was started by hand, or outlived its test, has reserved nothing."""
    others = range(-24, -21)  # the other tests of this file may run at the same time: a port is open for all of them
    monkeypatch.setattr(domains, "DOMAINS", others)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as node:
        node.bind(("127.0.0.1", 7400 - 250 * 23 + 10))
        assert reserve_all(2) == set(others) - {-23}
    assert reserve_all(3) == set(others)


def test_real_domains_are_neither_everybodys_nor_beyond_the_ports():
    with reserved_domain() as number:
        assert 1 <= number <= 101
        given = domain_environment(number)
    assert given["ROS_DOMAIN_ID"] == str(number)
    assert given["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "ROS_LOCALHOST_ONLY" not in given
