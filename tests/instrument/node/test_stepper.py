from __future__ import annotations

from fractions import Fraction

import pytest

from crawler_model.motion.jump import Jump
from crawler_ros.node.counts import Counts
from crawler_ros.node.stepper import Stepper

MS = 1_000_000


def run(stepper: Stepper, wall_ns: int) -> None:
    stepper.begin(wall_ns)
    stepper.finish()


def test_simulated_time_is_exact():
    stepper = Stepper(Fraction(30000, 1001))
    for _ in range(30000):
        stepper.finish()
    assert stepper.now_ns == 1001 * 10**9


@pytest.mark.parametrize("rate", [Fraction(1000), Fraction(30000, 1001)])
def test_it_is_over_at_the_end_of_the_tick_that_reaches_the_duration(rate):
    duration = 2.5 / float(rate)
    stepper = Stepper(rate, duration=duration)
    times = stepper.times_ns(16)
    assert (times / 1e9 < duration).tolist() == [True, True, True, False]
    stepper.finish(2)
    assert not stepper.rests
    stepper.finish()
    assert stepper.now_ns == times[-1]
    assert stepper.rests
    stepper.reset(0)
    assert not stepper.rests


def test_ticks_are_due_a_period_apart():
    stepper = Stepper(Fraction(1000))
    assert stepper.wait_ns(5 * MS) == MS
    assert stepper.wait_ns(5 * MS + MS // 2) == MS // 2
    assert stepper.wait_ns(6 * MS) == 0
    run(stepper, 6 * MS)
    assert stepper.wait_ns(6 * MS) == MS


def test_a_little_behind_is_caught_up_and_not_late():
    stepper = Stepper(Fraction(1000))
    stepper.wait_ns(0)
    run(stepper, MS + MS // 2)
    assert stepper.late == 0
    assert stepper.wait_ns(MS + MS // 2) == MS // 2


def test_more_than_a_period_behind_is_late_and_simulated_time_slows():
    stepper = Stepper(Fraction(1000))
    stepper.wait_ns(0)
    run(stepper, 11 * MS)
    assert stepper.late == 1
    assert stepper.tick == 1
    assert stepper.wait_ns(11 * MS) == MS  # none is skipped, none is rushed


def test_real_time_factors():
    fast = Stepper(Fraction(100), 10.0)
    assert fast.wait_ns(0) == MS
    fast.real_time_factor = 0.0
    assert fast.wait_ns(123) == 0
    run(fast, 10**12)
    assert fast.late == 0
    fast.real_time_factor = 0.5
    assert fast.wait_ns(0) == 20 * MS


def test_paused_is_never_due_and_a_pause_makes_nothing_late():
    stepper = Stepper(Fraction(1000))
    stepper.wait_ns(0)
    stepper.pause(True, 0)
    assert stepper.wait_ns(10**12) is None
    run(stepper, 10**12)  # a single step
    stepper.pause(False, 2 * 10**12)
    assert stepper.wait_ns(2 * 10**12) == MS
    assert stepper.late == 0


def test_reset_goes_back_to_zero():
    stepper = Stepper(Fraction(1000))
    stepper.wait_ns(0)
    run(stepper, MS)
    stepper.reset(MS)
    assert stepper.now_ns == 0
    assert stepper.wait_ns(7 * MS) == MS
    assert stepper.describe(7 * MS) == "1 tick, 0 late"  # of all runs
    run(stepper, 8 * MS)
    assert (stepper.tick, stepper.describe(8 * MS)) == (1, "2 ticks, 0 late")


def test_what_slips_is_the_lag_and_stays():
    stepper = Stepper(Fraction(1000))
    stepper.wait_ns(0)
    assert stepper.lag_ns(MS) == 0
    run(stepper, 11 * MS)  # due at 1 ms
    assert stepper.lag_ns(11 * MS) == 10 * MS
    for k in range(1, 100):
        assert stepper.wait_ns((11 + k) * MS) == 0
        run(stepper, (11 + k) * MS)
    assert stepper.lag_ns(110 * MS) == 10 * MS
    assert stepper.achieved_factor(110 * MS) == 100 / 110


def test_late_ticks_are_caught_up_without_a_pause_if_asked():
    stepper = Stepper(Fraction(1000), catches_up=True)
    stepper.wait_ns(0)
    run(stepper, 11 * MS)
    ticks = 1
    while stepper.wait_ns(12 * MS) == 0:
        run(stepper, 12 * MS)
        ticks += 1
    assert ticks == 12
    assert stepper.lag_ns(12 * MS) == 0
    assert stepper.now_ns == 12 * MS


def test_what_is_caught_up_is_bounded():
    stepper = Stepper(Fraction(1000), catches_up=True)
    stepper.wait_ns(0)
    run(stepper, 5001 * MS)  # 5 s late
    assert stepper.lag_ns(5001 * MS) == 4999 * MS  # one tick has been caught up
    while stepper.wait_ns(5002 * MS) == 0:
        run(stepper, 5002 * MS)
    assert stepper.lag_ns(5002 * MS) == 4000 * MS


def test_pauses_and_resets_do_not_change_the_factor_achieved():
    stepper = Stepper(Fraction(100), 2.0)
    for begin in (0, 10**12):
        for k in range(10):
            stepper.wait_ns(begin + 5 * k * MS)
            run(stepper, begin + 5 * (k + 1) * MS)
        stepper.pause(True, begin + 50 * MS)
        assert stepper.achieved_factor(begin + 10**11) == 2.0
        stepper.reset(begin + 10**11)
        stepper.pause(False, begin + 10**11)


def test_counts_add_up_the_accounts_of_ticks():
    counts = Counts()
    for k, stability in enumerate((0.4, 0.1, 0.3), start=1):
        counts.add_ticks(ambiguous=k == 2, overspent=k > 1, unsolved=k > 2)
        counts.add_jumps([Jump(0, 0.0, 0, None, 0.0, 0.5 * k)] * (k - 1), stability)
    assert counts == Counts(1, 2, 1, 3, 4.0, 0, 0.1)
