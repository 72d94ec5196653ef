"""Counting of refused messages by reason."""

from __future__ import annotations

from crawler_ros.node.intake.refusals import Refusals, Throttle


def refusals() -> Refusals:
    return Refusals(Throttle(lambda line: None))


def test_reasons_that_differ_only_in_numbers_and_names_count_as_one():
    counted = refusals()
    counted.add("a", "entry 0 is -1 N; friction must be >= 0", 5)
    counted.add("a", "entry 12 is -2.5e-3 N; friction must be >= 0", 7)
    counted.add("a", "no joint is called 'x y'; there are link_0", 8)
    counted.add("a", "no joint is called 'z'; there are link_1", 9)
    counted.add("b", "entry 0 is nan; it must be finite", 9)
    counted.add("b", "entry 3 is inf; it must be finite", 10)
    found = [(r.topic, r.count, r.first_ns, r.last_ns) for r in counted.reasons]
    assert found == [("a", 2, 5, 7), ("a", 2, 8, 9), ("b", 2, 9, 10)]
    assert counted.reasons[0].why == "entry 0 is -1 N; friction must be >= 0"
    assert counted.total == 6


def test_their_number_is_bounded():
    counted = refusals()
    for k in range(1000):
        counted.add("a", f"reason {'x' * k}", k)
    assert len(counted.reasons) == 33
    assert counted.reasons[-1].why == "other reasons"
    assert sum(reason.count for reason in counted.reasons) == counted.total == 1000
