from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from crawler_ros.node import server as module
from crawler_ros.node.life.stop import StopFlag
from crawler_ros.node.server import Server

US = 1000
NODE = SimpleNamespace(get_logger=lambda: SimpleNamespace(fatal=lambda _: None))


class Executor:
    """An executor and a clock of its own: it never has work, and a call of it takes a microsecond and its timeout."""

    def __init__(self, calls: int, stopping: StopFlag) -> None:
        self.now_ns = 0
        self.timeouts: list[float] = []
        self.before: Callable[[], None] = lambda: None
        self._calls, self._stopping = calls, stopping

    def remove_node(self, _: object) -> None: ...

    def spin_once(self, timeout_sec: float) -> None:
        self.before()
        self.timeouts.append(timeout_sec)
        self.now_ns += US + round(timeout_sec * 1e9)
        if len(self.timeouts) == self._calls:
            self._stopping.set()


@pytest.fixture
def prepared(monkeypatch):
    """Return a function that builds a server on two processors, and its executor, which stops after a thousand calls."""
    stopping = StopFlag()
    executor = Executor(1000, stopping)
    monkeypatch.setattr(module.time, "monotonic_ns", lambda: executor.now_ns)
    monkeypatch.setattr(module.os, "sched_getaffinity", lambda _: {0, 1}, raising=False)
    return lambda: (Server(NODE, stopping), executor)


def serve_after(server: Server, executor: Executor, answers_ns: list[int]) -> list[float]:
    """Serve after answers at some times; return the timeouts of the executor."""
    for now_ns in answers_ns:
        executor.now_ns = now_ns
        server.expect_reply()
    server.start(executor)
    server.join()
    return executor.timeouts


def test_after_quick_answers_it_polls_for_a_while_and_then_it_sleeps(prepared):
    timeouts = serve_after(*prepared(), [10_000 * US, 10_400 * US])
    polls = timeouts.count(0.0)
    assert polls == 300
    assert set(timeouts[polls:]) == {0.1}


def test_without_an_answer_shortly_before_it_does_not_poll(prepared):
    assert set(serve_after(*prepared(), [10_000 * US, 10_600 * US])) == {0.1}


def test_on_a_single_processor_it_does_not_poll(prepared, monkeypatch):
    monkeypatch.setattr(module.os, "sched_getaffinity", lambda _: {3}, raising=False)
    assert set(serve_after(*prepared(), [10_000 * US, 10_400 * US])) == {0.1}


def test_it_ends_while_it_polls(prepared):
    server, executor = prepared()
    executor.before = server.expect_reply  # a command at every call
    assert 0.1 not in serve_after(server, executor, [10_000 * US, 10_400 * US])


def test_a_failure_is_said_and_ends_the_simulator(prepared):
    said: list[str] = []
    stopping = StopFlag()
    node = SimpleNamespace(get_logger=lambda: SimpleNamespace(fatal=said.append))
    _, executor = prepared()

    def fail() -> None:
        raise RuntimeError("no middleware")

    executor.before = fail
    server = Server(node, stopping)
    server.start(executor)
    server.join()
    assert stopping.is_set()
    assert "no middleware" in said[0]
