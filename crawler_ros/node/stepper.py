"""The times of ticks: simulated time in integer nanoseconds, playing, paused or stepping. It reads no clock itself.

In lock-step, messages trigger the ticks and the wall clock has no effect: see `CommandQueue`.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.run.ticks import tick_end_ns


class Stepper:
    """Counts ticks and computes when the next one is due.

    A tick that starts later than a period after its deadline is counted late, and simulated time slows: the deadlines
    that follow move by as much. None is ever skipped.
    """

    def __init__(self, rate: Fraction, real_time_factor: float = 1.0) -> None:
        """Start playing at simulated time 0.

        Args:
            rate: ticks per simulated second [Hz].
            real_time_factor: simulated seconds per second; 0 for as fast as possible.
        """
        self.rate = rate
        self.late = 0
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
    def real_time_factor(self) -> float:
        """Simulated seconds per second."""
        return self._factor

    @real_time_factor.setter
    def real_time_factor(self, factor: float) -> None:
        self._factor = factor
        self._origin_wall_ns = None

    def pause(self, paused: bool) -> None:
        """Pause or resume."""
        self.paused = paused
        self._origin_wall_ns = None

    def wait_ns(self, wall_ns: int) -> int | None:
        """Compute the time to the next tick.

        Args:
            wall_ns: time of a steady clock [ns].

        Returns:
            The time to the next tick [ns], 0 when it is due; None while paused.
        """
        if self.paused:
            return None
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
        if behind > (self.next_ns - self.now_ns) / self._factor:
            if self.late == 0:
                self.first_late_ns = self.now_ns
            if behind > self.worst_delay_ns:
                self.worst_late_ns, self.worst_delay_ns = self.now_ns, behind
            self.late += 1
            self._origin_wall_ns += behind

    def finish(self, ticks: int = 1) -> None:
        """Count the next tick as done, or several."""
        if ticks == 1:
            self.tick += 1
            self.now_ns, self.next_ns = self.next_ns, tick_end_ns(self.tick + 1, self.rate)
        else:
            self._go_to(self.tick + ticks)

    def ends_ns(self, ticks: int) -> np.ndarray:
        """Compute when the next ticks end.

        Args:
            ticks: their number K.

        Returns:
            Simulated time at the end of each, shape (K,) [ns].
        """
        period, rest = divmod(NS * self.rate.denominator, self.rate.numerator)
        if rest == 0:
            return self.now_ns + period * np.arange(1, ticks + 1)
        return np.array([tick_end_ns(tick, self.rate) for tick in range(self.tick + 1, self.tick + ticks + 1)])

    def reset(self) -> None:
        """Return to simulated time 0; the count of late ticks is not reset."""
        self._go_to(0)
        self._origin_wall_ns = None
