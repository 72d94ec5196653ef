"""The node's benchmark on a small case: what it measures is there and makes sense; how fast it is, is not asserted."""

from __future__ import annotations

import json
import math

import pytest
from rich.console import Console

pytest.importorskip("rclpy")
from crawler_bench.node.node import PARTS, measure_node
from crawler_bench.node.replay import JOBS, measure_replay, run_job
from crawler_bench.report import print_rows

KEYS = {
    "throughput": {"n", "recording", "subscriber", "driven", "every", "ticks_per_s", "us_per_tick", "real_time"},
    "latency": {"n", "rate_hz", "trials", "median_ms", "p99_ms", "half_a_period_ms"},
    "echo": {"n", "trips", "trips_per_s", "median_ms", "p99_ms"},
    "round_trips": {"n", "trips", "trips_per_s", "median_ms", "p99_ms"},
    "lock_step": {"n", "ticks_per_s"},
    "real_time": {"n", "rate_hz", "ticks", "late_ticks", "late_ticks_of_an_empty_loop", "core_simulator"},
    "turning": {"n", "rate_hz", "ticks", "late_ticks", "cpu_us_per_tick", "core_simulator", "real_time"},
    "start": {"n", "ready_s", "first_state_s"},
    "ledger": {"n", "feature", "beside", "us_per_tick", "extra_us", "memory_mb", "start_s"},
}
MAY_BE_ZERO = {"late_ticks", "late_ticks_of_an_empty_loop", "extra_us", "core_recorder"}


COUNTS = {
    "throughput": 7,
    "latency": 1,
    "echo": 1,
    "round_trips": 1,
    "lock_step": 1,
    "real_time": 1,
    "turning": 1,
    "start": 1,
    "ledger": 5,
}


@pytest.fixture(scope="module", params=[("latency", "lock_step"), pytest.param(PARTS, marks=pytest.mark.slow)], ids=len)
def rows(request):
    small = {"seconds": 1.0, "repeats": 1, "trials": 10, "parts": request.param}
    found, complete = measure_node(
        (3,), (200.0,), features=("recording", "/diagnostics off", "segment, accuracy 0.001"), **small
    )
    assert complete
    return found


def test_every_case_has_its_figures(rows):
    cases = {row["case"] for row in rows}
    assert cases in ({"latency", "echo", "round_trips", "lock_step"}, KEYS.keys())
    assert len(rows) == sum(COUNTS[case] for case in cases)
    for row in rows:
        assert KEYS[row["case"]] <= row.keys()
        for key, value in row.items():
            if value is None:  # no recording process
                assert (key, row["recording"]) == ("cpu_recorder_us", False)
            elif not isinstance(value, (str, bool)) and key not in MAY_BE_ZERO and not key.endswith("_spread"):
                assert value > 0.0, (key, row)
                assert math.isfinite(value)
    assert next(row for row in rows if row["case"] == "latency")["trials"] == 10


def test_rows_are_plain_and_print(rows, capsys):
    assert json.loads(json.dumps(rows, allow_nan=False)) == rows
    print_rows(rows, Console())
    shown = capsys.readouterr().out
    assert ("real time" if len(rows) > 4 else "latency") in shown


@pytest.mark.slow
def test_replay_is_measured_beside_readers():
    rows = measure_replay(periods=(2,), repeats=1)
    assert [row["what"] for row in rows] == list(JOBS)
    for row in rows:
        assert row["messages"] > 800  # four topics, 100 ticks a second
        assert row["messages_per_s"] * row["seconds"] == pytest.approx(row["messages"])
        assert row["memory_mb"] > 5.0


def test_a_job_that_fails_is_no_measurement(tmp_path):
    with pytest.raises(RuntimeError, match="exit status 1"):
        run_job(JOBS["replay"], tmp_path / "missing")
