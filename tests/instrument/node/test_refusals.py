"""Counting of refused messages by reason."""

from __future__ import annotations

import pytest

from crawler_ros.node.intake import refusals as refusals_module
from crawler_ros.node.intake.refusals import Refusals, Throttle


def refusals() -> Refusals:
    return Refusals(Throttle(lambda line: None))


def test_reasons_that_differ_only_in_numbers_and_names_count_as_one():
    counted = refusals()
    counted.count_refusal("a", "entry 0 is -1 N; friction must be >= 0", 5)
    counted.count_refusal("a", "entry 12 is -2.5e-3 N; friction must be >= 0", 7)
    counted.count_refusal("a", "no joint is called 'x y'; there are link_0", 8)
    counted.count_refusal("a", "no joint is called 'z'; there are link_1", 9)
    counted.count_refusal("b", "entry 0 is nan; it must be finite", 9)
    counted.count_refusal("b", "entry 3 is inf; it must be finite", 10)
    found = [(r.topic, r.count, r.first_ns, r.last_ns) for r in counted.reasons]
    assert found == [("a", 2, 5, 7), ("a", 2, 8, 9), ("b", 2, 9, 10)]
    assert counted.reasons[0].why == "entry 0 is -1 N; friction must be >= 0"
    assert counted.total == 6


def test_one_since_the_last_tick_is_of_a_topic_and_of_this_run():
    counted = refusals()
    counted.count_refusal("a", "too late", 0)
    counted.count_refusal("b", "too late", 5)
    assert counted.has_refused_at(0, ("a",))
    assert counted.has_refused_at(5, ("a", "b"))
    assert not counted.has_refused_at(5, ("a",))
    assert not counted.has_refused_at(6, ("a", "b"))
    counted.restart()
    assert not counted.has_refused_at(0, ("a",))
    counted.count_refusal("a", "too late", 0)
    assert counted.has_refused_at(0, ("a",))


def test_their_number_is_bounded():
    counted = refusals()
    for k in range(1000):
        counted.count_refusal("a", f"reason {'x' * k}", k)
    assert len(counted.reasons) == 33
    assert counted.reasons[-1].why == "other reasons"
    assert sum(reason.count for reason in counted.reasons) == counted.total == 1000


@pytest.fixture
def lines(monkeypatch):
    """A throttle on a clock that the test sets; what it logs."""
    now = [100.0]
    monkeypatch.setattr(refusals_module.time, "monotonic", lambda: now[0])
    logged: list[str] = []
    return Throttle(logged.append), logged, now


def test_causes_within_one_second_are_logged_each_with_its_own_count(lines):
    throttle, logged, now = lines
    counted = Refusals(throttle)
    causes = [
        "entry {} is nan; it must be finite",
        "no joint is called '{}'",
        "{} values; there are 2 links",
        "too late",
    ]
    for k in range(12):
        for number, cause in enumerate(causes):
            if k % (number + 1) == 0:
                counted.count_refusal("commands", cause.format(k), k)
    first = [f"refused a message on commands: {cause.format(0)}" for cause in causes]
    assert logged == first
    throttle.flush()
    assert logged == first
    now[0] += 1.0
    throttle.flush()
    last = [(0, 11, 10), (1, 10, 4), (2, 9, 2), (3, 8, 1)]
    assert logged[4:] == [
        f"refused a message on commands: {causes[number].format(k)} (and {more} more like it)"
        for number, k, more in last
    ]


def test_held_lines_are_logged_in_the_order_in_which_their_kinds_were_held(lines):
    throttle, logged, now = lines
    for text in ("a", "b", "c", "c", "a", "b", "a"):
        throttle.warn("subject", text)
    now[0] += 1.0
    throttle.flush()
    assert logged == ["a", "b", "c", "c", "a (and 1 more like it)", "b"]


def test_a_line_after_a_quiet_second_is_logged_at_once_and_one_that_is_held_stays_behind_it(lines):
    throttle, logged, now = lines
    throttle.warn("subject", "a 1")
    now[0] += 1.0
    throttle.warn("subject", "a 2")
    throttle.warn("subject", "a 3")
    now[0] += 5.0
    throttle.warn("subject", "a 4")  # "a 3" is still held
    throttle.flush()
    assert logged == ["a 1", "a 2", "a 4 (and 1 more like it)"]


def test_the_kinds_in_a_second_are_bounded(lines):
    throttle, logged, now = lines
    for k in range(1000):
        throttle.warn("subject", f"cause {'x' * k}")
    assert len(logged) == 65
    now[0] += 1.0
    throttle.flush()
    assert logged[65:] == [f"cause {'x' * 999} (and 934 more)"]
    throttle.flush()
    now[0] += 1.0
    throttle.flush()
    throttle.warn("subject", "cause")
    assert logged[66:] == ["cause"]
