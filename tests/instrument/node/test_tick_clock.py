from __future__ import annotations

from fractions import Fraction

import pytest

from crawler_model.motion.jump import Jump
from crawler_ros.node.counts import Counts
from crawler_ros.node.tick_clock import TickClock

MS = 1_000_000


def run(tick_clock: TickClock, wall_ns: int) -> None:
    tick_clock.begin(wall_ns)
    tick_clock.finish()


def test_simulated_time_is_exact():
    tick_clock = TickClock(Fraction(30000, 1001))
    for _ in range(30000):
        tick_clock.finish()
    assert tick_clock.now_ns == 1001 * 10**9


@pytest.mark.parametrize("rate", [Fraction(1000), Fraction(30000, 1001)])
def test_it_is_over_at_the_end_of_the_tick_that_reaches_the_duration(rate):
    duration = 2.5 / float(rate)
    tick_clock = TickClock(rate, duration=duration)
    times = tick_clock.times_ns(16)
    assert (times / 1e9 < duration).tolist() == [True, True, True, False]
    tick_clock.finish(2)
    assert not tick_clock.rests
    tick_clock.finish()
    assert tick_clock.now_ns == times[-1]
    assert tick_clock.rests
    tick_clock.reset(0)
    assert not tick_clock.rests


def test_a_duration_below_a_nanosecond_is_over_after_a_tick():
    tick_clock = TickClock(Fraction(1000), duration=1e-12)
    assert not tick_clock.rests
    tick_clock.finish()
    assert tick_clock.rests


def test_ticks_are_due_a_period_apart():
    tick_clock = TickClock(Fraction(1000))
    assert tick_clock.wait_ns(5 * MS) == MS
    assert tick_clock.wait_ns(5 * MS + MS // 2) == MS // 2
    assert tick_clock.wait_ns(6 * MS) == 0
    run(tick_clock, 6 * MS)
    assert tick_clock.wait_ns(6 * MS) == MS


def test_a_little_behind_is_caught_up_and_not_late():
    tick_clock = TickClock(Fraction(1000))
    tick_clock.wait_ns(0)
    run(tick_clock, MS + MS // 2)
    assert tick_clock.late == 0
    assert tick_clock.wait_ns(MS + MS // 2) == MS // 2


def test_more_than_a_period_behind_is_late_and_simulated_time_slows():
    tick_clock = TickClock(Fraction(1000))
    tick_clock.wait_ns(0)
    run(tick_clock, 11 * MS)
    assert tick_clock.late == 1
    assert tick_clock.tick == 1
    assert tick_clock.wait_ns(11 * MS) == MS  # none is skipped, none is rushed


def test_real_time_factors():
    fast = TickClock(Fraction(100), 10.0)
    assert fast.wait_ns(0) == MS
    fast.real_time_factor = 0.0
    assert fast.wait_ns(123) == 0
    run(fast, 10**12)
    assert fast.late == 0
    fast.real_time_factor = 0.5
    assert fast.wait_ns(0) == 20 * MS


def test_paused_is_never_due_and_a_pause_makes_nothing_late():
    tick_clock = TickClock(Fraction(1000))
    tick_clock.wait_ns(0)
    tick_clock.pause(True, 0)
    assert tick_clock.wait_ns(10**12) is None
    run(tick_clock, 10**12)  # a single step
    tick_clock.pause(False, 2 * 10**12)
    assert tick_clock.wait_ns(2 * 10**12) == MS
    assert tick_clock.late == 0


def test_reset_goes_back_to_zero():
    tick_clock = TickClock(Fraction(1000))
    tick_clock.wait_ns(0)
    run(tick_clock, MS)
    tick_clock.reset(MS)
    assert tick_clock.now_ns == 0
    assert tick_clock.wait_ns(7 * MS) == MS
    assert tick_clock.describe(7 * MS) == "1 tick, 0 late"  # of all runs
    run(tick_clock, 8 * MS)
    assert (tick_clock.tick, tick_clock.describe(8 * MS)) == (1, "2 ticks, 0 late")


def test_what_slips_is_the_lag_and_stays():
    tick_clock = TickClock(Fraction(1000))
    tick_clock.wait_ns(0)
    assert tick_clock.lag_ns(MS) == 0
    run(tick_clock, 11 * MS)  # due at 1 ms
    assert tick_clock.lag_ns(11 * MS) == 10 * MS
    for k in range(1, 100):
        assert tick_clock.wait_ns((11 + k) * MS) == 0
        run(tick_clock, (11 + k) * MS)
    assert tick_clock.lag_ns(110 * MS) == 10 * MS
    assert tick_clock.achieved_factor(110 * MS) == 100 / 110


def test_late_ticks_are_caught_up_without_a_pause_if_asked():
    tick_clock = TickClock(Fraction(1000), catches_up=True)
    tick_clock.wait_ns(0)
    run(tick_clock, 11 * MS)
    ticks = 1
    while tick_clock.wait_ns(12 * MS) == 0:
        run(tick_clock, 12 * MS)
        ticks += 1
    assert ticks == 12
    assert tick_clock.lag_ns(12 * MS) == 0
    assert tick_clock.now_ns == 12 * MS


def test_what_is_caught_up_is_bounded():
    tick_clock = TickClock(Fraction(1000), catches_up=True)
    tick_clock.wait_ns(0)
    run(tick_clock, 5001 * MS)  # 5 s late
    assert tick_clock.lag_ns(5001 * MS) == 4999 * MS  # one tick has been caught up
    while tick_clock.wait_ns(5002 * MS) == 0:
        run(tick_clock, 5002 * MS)
    assert tick_clock.lag_ns(5002 * MS) == 4000 * MS


def test_pauses_and_resets_do_not_change_the_factor_achieved():
    tick_clock = TickClock(Fraction(100), 2.0)
    for begin in (0, 10**12):
        for k in range(10):
            tick_clock.wait_ns(begin + 5 * k * MS)
            run(tick_clock, begin + 5 * (k + 1) * MS)
        tick_clock.pause(True, begin + 50 * MS)
        assert tick_clock.achieved_factor(begin + 10**11) == 2.0
        tick_clock.reset(begin + 10**11)
        tick_clock.pause(False, begin + 10**11)


def test_counts_add_up_the_accounts_of_ticks():
    counts = Counts()
    for k, stability in enumerate((0.4, 0.1, 0.3), start=1):
        counts.add_ticks(ambiguous=k == 2, overspent=k > 1, unsolved=k > 2)
        counts.add_jumps([Jump(0, 0.0, 0, None, 0.0, 0.5 * k)] * (k - 1), stability)
    assert counts == Counts(1, 2, 1, 3, 4.0, 0, 0.1)
