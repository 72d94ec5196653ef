"""Ctrl-C ends long measurements, and what they found before stays."""

from __future__ import annotations

import os
import signal
import time

import pytest

from crawler_bench.node.steps import Steps


def test_what_was_measured_before_an_interruption_stays_and_nothing_is_measured_after_it():
    shown, found = [], []
    steps = Steps(4, lambda part, name: shown.append((part, name)))
    with steps.keep():
        for name in ("first", "second", "third"):
            steps(name)
            if name == "second":
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(10.0)  # the signal ends it
            found.append(name)
    assert steps.interrupted
    with steps.keep():
        steps("fourth")
        found.append("fourth")
    assert found == ["first"]
    assert shown == [(0.0, "first"), (0.25, "second")]


def test_other_errors_are_not_swallowed():
    steps = Steps(1, lambda part, name: None)
    with pytest.raises(ValueError, match="of the measurement"), steps.keep():
        raise ValueError("of the measurement")
    assert not steps.interrupted
