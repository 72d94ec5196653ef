"""The times of ticks: simulated time in integer nanoseconds, playing, paused or stepping. It reads no clock itself.

In lock-step, messages trigger the ticks and the wall clock has no effect: see `CommandQueue`.
"""

from __future__ import annotations

import sys
from fractions import Fraction

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.run.ticks import tick_end_ns

MOST_CAUGHT_UP_NS = NS
"""Lag that ticks without a pause catch up; what exceeds it stays, or an overloaded simulator would never pause."""


class TickClock:
    """Counts ticks and computes when the next one is due.

    A tick that starts later than a period after its deadline is counted late. None is ever skipped. Simulated time
    either slips, as the deadlines that follow move by as much, or catches up, as ticks follow each other without a
    pause until the lag is gone.
    """

    def __init__(
        self, rate: Fraction, real_time_factor: float = 1.0, catches_up: bool = False, duration: float = 0.0
    ) -> None:
        """Start playing at simulated time 0.

        Args:
            rate: ticks per simulated second [Hz].
            real_time_factor: simulated seconds per second; 0 for as fast as possible.
            catches_up: whether simulated time catches up after late ticks, by at most MOST_CAUGHT_UP_NS, instead of
                slipping.
            duration: simulated time at which it is over, at the end of a tick [s]; 0 for never.
        """
        self.rate = rate
        self._until_ns = max(round(duration * NS), 1) if duration else sys.maxsize
        self._catches_up = catches_up
        self._slipped_ns = 0
        self._played = [0, 0]  # wall and simulated time before the present stretch of playing [ns]
        self._playing: tuple[int, int] | None = None  # both at its start
        self.late = 0
        self._before = 0  # ticks before the last reset
        self.first_late_ns = self.worst_late_ns = self.worst_delay_ns = 0
        """Simulated time at the start of the first late tick and of the one that began latest, and its delay [ns]."""
        self.paused = False
        self._factor = real_time_factor
        self._origin_wall_ns: int | None = None
        self._origin_ns = 0
        self._go_to(0)

    def _go_to(self, tick: int) -> None:
        self.tick = tick
        self.now_ns = tick_end_ns(tick, self.rate)
        """Simulated time: the end of the last tick [ns]."""
        self.next_ns = tick_end_ns(tick + 1, self.rate)
        """The end of the next tick [ns]."""

    @property
    def is_over(self) -> bool:
        """Whether the duration is reached."""
        return self.ends_at(self.now_ns)

    def ends_at(self, ns: int) -> bool:
        """Determine whether the duration is reached at a simulated time [ns]."""
        return ns >= self._until_ns

    @property
    def rests(self) -> bool:
        """Whether no tick follows by itself: it is paused, or over."""
        return self.paused or self.is_over

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second."""
        return self._factor

    @real_time_factor.setter
    def real_time_factor(self, factor: float) -> None:
        self._factor = factor
        self._origin_wall_ns = None

    def pause(self, paused: bool, wall_ns: int) -> None:
        """Pause or resume.

        Args:
            paused: whether to pause.
            wall_ns: time of a steady clock [ns].
        """
        self.paused = paused
        self.end_stretch(wall_ns)

    def end_stretch(self, wall_ns: int) -> None:
        """End the present stretch of playing, if any: what was still to be caught up has slipped.

        Args:
            wall_ns: time of a steady clock [ns].
        """
        self._slipped_ns = self.lag_ns(wall_ns)
        self._origin_wall_ns = None
        if self._playing is not None:
            self._played[0] += wall_ns - self._playing[0]
            self._played[1] += self.now_ns - self._playing[1]
            self._playing = None

    def achieved_factor(self, wall_ns: int) -> float:
        """Compute how many simulated seconds have passed per second of playing; pauses do not count.

        Args:
            wall_ns: time of a steady clock [ns].

        Returns:
            The factor [1]; NaN before the first tick is due.
        """
        wall, simulated = self._played
        if self._playing is not None:
            wall, simulated = wall + wall_ns - self._playing[0], simulated + self.now_ns - self._playing[1]
        return simulated / wall if wall > 0 else float("nan")

    def lag_ns(self, wall_ns: int) -> int:
        """Compute by how much simulated time lags behind the clock: what has slipped, and what is being caught up.

        Args:
            wall_ns: time of a steady clock [ns].

        Returns:
            The lag [ns of the clock].
        """
        if self._origin_wall_ns is None or self._factor == 0.0:
            return self._slipped_ns
        behind = wall_ns - self._deadline()
        return self._slipped_ns + (behind if self._is_late(behind) else 0)

    def describe_lag(self, wall_ns: int) -> str:
        """Describe the lag and the pace of simulated time in one line for a log.

        Args:
            wall_ns: time of a steady clock [ns].
        """
        lag, factor = self.lag_ns(wall_ns) / NS, self.achieved_factor(wall_ns)
        return f"simulated time lags {lag:.3f} s behind the clock, real-time factor {factor:.4f}"

    def describe(self, wall_ns: int) -> str:
        """Describe the ticks of all runs so far, and if any was late also the lag.

        Args:
            wall_ns: time of a steady clock [ns].
        """
        count = self._before + self.tick
        text = f"{count} tick{'s' * (count != 1)}, {self.late} late"
        return f"{text}; {self.describe_lag(wall_ns)}" if self.late else text

    def _is_late(self, behind: int) -> bool:
        return behind > (self.next_ns - self.now_ns) / self._factor

    def wait_ns(self, wall_ns: int) -> int | None:
        """Compute the time to the next tick.

        Args:
            wall_ns: time of a steady clock [ns].

        Returns:
            The time to the next tick [ns], 0 when it is due; None while paused.
        """
        if self.paused:
            return None
        if self._playing is None:
            self._playing = wall_ns, self.now_ns
        if self._factor == 0.0:
            return 0
        if self._origin_wall_ns is None:
            self._origin_wall_ns, self._origin_ns = wall_ns, self.now_ns
        return max(self._deadline() - wall_ns, 0)

    def _deadline(self) -> int:
        assert self._origin_wall_ns is not None
        return self._origin_wall_ns + round((self.next_ns - self._origin_ns) / self._factor)

    def begin(self, wall_ns: int) -> None:
        """Record that the next tick starts now, and count it if it is late."""
        if self.paused or self._factor == 0.0 or self._origin_wall_ns is None:
            return
        behind = wall_ns - self._deadline()
        if self._is_late(behind):
            if self.late == 0:
                self.first_late_ns = self.now_ns
            if behind > self.worst_delay_ns:
                self.worst_late_ns, self.worst_delay_ns = self.now_ns, behind
            self.late += 1
            slips = max(behind - MOST_CAUGHT_UP_NS, 0) if self._catches_up else behind
            self._slipped_ns += slips
            self._origin_wall_ns += slips

    def finish(self, ticks: int = 1) -> None:
        """Count the next tick as done, or several."""
        if ticks == 1:
            self.tick += 1
            self.now_ns, self.next_ns = self.next_ns, tick_end_ns(self.tick + 1, self.rate)
        else:
            self._go_to(self.tick + ticks)

    def times_ns(self, ticks: int) -> np.ndarray:
        """Compute when the next ticks begin and end.

        Args:
            ticks: their largest number K; they are fewer where it is over before.

        Returns:
            Simulated time at the start of the first and at the end of each, shape (K + 1,) [ns].
        """
        if ticks == 1:
            return np.array([self.now_ns, self.next_ns])
        period, rest = divmod(NS * self.rate.denominator, self.rate.numerator)
        if rest == 0:
            times = self.now_ns + period * np.arange(ticks + 1)
        else:
            times = np.array([tick_end_ns(tick, self.rate) for tick in range(self.tick, self.tick + ticks + 1)])
        return times[: 2 + np.searchsorted(times[1:], self._until_ns)]

    def reset(self, wall_ns: int) -> None:
        """Return to simulated time 0; the count of late ticks and the lag are not reset.

        Args:
            wall_ns: time of a steady clock [ns].
        """
        self.end_stretch(wall_ns)
        self._before += self.tick
        self._go_to(0)
