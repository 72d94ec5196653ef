"""Rows of results, and the accounts of runs from which they follow."""

from __future__ import annotations

from typing import Any

import numpy as np

from crawler_model.body.body import Body
from crawler_model.body.plan import Plan
from crawler_model.crawler.crawler import Crawler
from crawler_model.run.account import Energy, Total, average_displacement
from crawler_model.run.screw import gain_in_frame
from crawler_model.run.transport import body_lengths, cost_of_transport, supporting_force

DONE, INVALID = 1, 2  # 0 where it has not run
LENGTHS = ("net_translation", "gained", "per_period", "settling")
FORCES = ("work", "dissipation", "stored", "residual", "violation", "visited_margin")
COMPARED = ("period_work", "period_dissipation", "cost_of_transport", "body_lengths")
SCREW = ("dx", "dy", "dyaw")
_NO_SCREW = np.full(len(SCREW), np.nan)
COUNTS = ("events", "overspent", "unsolved", "periods")
ROW = np.dtype(
    [("status", np.uint8), ("dimension", np.uint8), ("unique", np.bool_)]
    + [(name, np.float64, (2,)) for name in LENGTHS]
    + [(name, np.float64) for name in (*FORCES, *COMPARED, *SCREW)]
    + [("kernel_s", np.float64)]
    + [(name, np.int64) for name in COUNTS]
)
"""Results of a run; `kernel_s`, the time spent in its kernels [s], determines how runs are distributed."""


def find_legs(ends: np.ndarray, ramps: int) -> np.ndarray:
    """Find the ramps at which the account is read: the ends of the last two periods, and the last ramp.

    Args:
        ends: ramps that end a period, increasing, shape (E,).
        ramps: number of ramps V.

    Returns:
        The first ramp of each leg, and V, shape (L + 1,).
    """
    return np.array(sorted({0, *(ends[-2:] + 1).tolist(), ramps}), dtype=np.int64)


class Ledger:
    """The accounts of M runs in progress, whose ramps end periods at the same times."""

    def __init__(
        self, body: Body, x: np.ndarray, tension: np.ndarray, visited: np.ndarray, actuation: np.ndarray | None = None
    ) -> None:
        """Begin the accounts.

        Args:
            body: the body; its stiffness has shape (S,), or (M, S).
            x: displacement at the start, shape (M, N), in the plane (M, N, 2) [m].
            tension: tension at the start, shape (M, S), in the plane (M, S, 2) [N].
            visited: visited margin at the start, shape (M,).
            actuation: L at the start, shape (M, S); bent springs need it [m].
        """
        self._body, self._x, self._tension = body, x, tension
        flat = x.reshape(x.shape[0], -1)
        self._marks = np.concatenate((flat, np.zeros(flat.shape)), axis=1)[:, None]
        self._last = self._marks[:, 0]
        lengths = None if actuation is None else actuation[:, None]
        self._start = self._stored = body.energy(tension[:, None], x[:, None], lengths)[:, 0]
        self._peak = np.abs(self._start)
        self._total = Total(visited)
        self._spent = np.zeros((2, x.shape[0], 2))
        self._periods = 0

    def add_ramps(
        self,
        accounts: np.ndarray,
        spent: np.ndarray,
        records: np.ndarray,
        ends: np.ndarray,
        jump_loss: float = 0.0,
        actuation: np.ndarray | None = None,
        remembered: float = 0.0,
    ) -> None:
        """Add ramps.

        Args:
            accounts: accounts of the ramps, shape (M, 15).
            spent: work, and energy lost to friction, on these ramps up to the end of each leg, shape (M, L, 2) [J].
            records: displacement, its rest and tension after each ramp, shape (M, V, R).
            ends: ramps that end a period, shape (E,).
            jump_loss: energy lost in jumps [J].
            actuation: L after each ramp, shape (M, V, S); bent springs need it [m].
            remembered: energy that elements of hysteresis have stored since the start [J].
        """
        before = np.stack((self._total.work, self._total.dissipation), axis=-1)
        for leg, until in enumerate(find_legs(ends, records.shape[1])[1:]):
            if until - 1 in ends[-2:]:
                self._spent = np.stack((self._spent[1], before + spent[:, leg]))
        self._total.add_account(accounts, jump_loss)
        width = self._last.shape[1]
        tension = records[:, :, width:].reshape(*records.shape[:2], *self._tension.shape[1:])
        x = records[:, :, : width // 2].reshape(*records.shape[:2], *self._x.shape[1:])
        energy = self._body.energy(tension, x, actuation)
        self._stored, self._peak = energy[:, -1] + remembered, np.maximum(self._peak, np.abs(energy).max(axis=1))
        self._last = records[:, -1, :width].copy()
        self._periods += ends.size
        if ends.size:
            self._marks = np.concatenate((self._marks, records[:, ends[-3:], :width]), axis=1)[:, -3:]

    def rows(self, plan: Plan, length: np.ndarray, kernel_s: float, screw: np.ndarray = _NO_SCREW) -> np.ndarray:
        """Complete the accounts.

        Args:
            plan: the scene, or all variations.
            length: length of the body, shape (M,) [m].
            kernel_s: time spent in the kernels for each run [s].
            screw: for bodies that turn, what `PeriodScrew` measured, shape (3,).

        Returns:
            Shape (M,), dtype ROW.
        """
        total, count = self._total, self._x.shape[0]
        rows = np.zeros(count, ROW)
        stored: Any = self._stored - self._start
        peak: Any = self._peak
        account = Energy(total.work, total.dissipation, stored, total.residual, peak, total.loads_work, total.jump_loss)
        values = {"status": DONE, "dimension": plan.body.dimension, "unique": total.unique, "kernel_s": kernel_s}
        values |= {"work": total.work, "dissipation": total.dissipation, "stored": stored}
        values |= {"residual": account.relative_residual, "violation": total.violation, "visited_margin": total.visited}
        values |= {"events": total.events, "overspent": total.overspent, "unsolved": total.unsolved}
        values |= dict(zip(SCREW, screw, strict=True))
        values |= {"periods": self._periods} | self._compare(plan, length, screw) | self._lengths()
        for name, value in values.items():
            column = rows[name]
            if column.ndim == 2 and plan.body.dimension == 1:
                column[:, 0] = value
            else:
                column[...] = value
        return rows

    def _lengths(self) -> dict[str, np.ndarray]:
        """Compute the lengths of the runs, each of shape (M,), in the plane (M, 2) [m]."""
        shape, width = self._x.shape, self._last.shape[1] // 2
        end = average_displacement(self._body, self._last[:, :width].reshape(shape))
        begin = average_displacement(self._body, self._x)
        gains = self._gains()
        none = np.full(begin.shape, np.nan)
        period = gains[:, -1] if gains.shape[1] else none
        settling = gains[:, -1] - gains[:, -2] if gains.shape[1] > 1 else none
        return dict(zip(LENGTHS, (end, end - begin, period, settling), strict=True))

    def _gains(self) -> np.ndarray:
        """Compute y gained in the last periods, shape (M, K), in the plane (M, K, 2) [m]."""
        moved = self._marks[:, 1:] - self._marks[:, :-1]
        count, kept, width = moved.shape[0], moved.shape[1], moved.shape[2] // 2
        each = (moved[:, :, :width] + moved[:, :, width:]).reshape(count * kept, *self._x.shape[1:])
        return average_displacement(self._body, each).reshape(count, kept, *self._x.shape[2:])

    def _compare(self, plan: Plan, length: np.ndarray, screw: np.ndarray) -> dict[str, np.ndarray]:
        """Compute what a period cost, and the numbers that compare crawlers of different sizes, each of shape (M,)."""
        if not self._periods:
            return dict.fromkeys(COMPARED, np.full(length.shape, np.nan))
        work, lost = (self._spent[1] - self._spent[0]).T
        gained = self._gains()[:, -1]
        distance = np.linalg.norm(gained, axis=1) if gained.ndim == 2 else np.abs(gained)
        if plan.body.turning is not None:  # contacts that go round a point go nowhere on the mean
            distance = np.hypot(screw[:1], screw[1:2])
        half = self._last.shape[1] // 2
        size = np.abs(self._marks[:, :, :half]).max(axis=(1, 2))
        cost = cost_of_transport(supporting_force(plan), work, distance, np.maximum(size, length))
        lengths = body_lengths(length, distance if gained.ndim == 2 else gained)
        return dict(zip(COMPARED, (work, lost, cost, lengths), strict=True))


class PeriodScrew:
    """The motion of a body that turns in its last whole period, in its own frame."""

    def __init__(self, crawler: Crawler) -> None:
        """Begin at the start of a run.

        Args:
            crawler: the crawler, which moves on.
        """
        self._crawler = crawler
        self._places: list[tuple[np.ndarray, float]] = []
        self.mark()

    def mark(self) -> None:
        """Note the end of a period."""
        if self._crawler.body.turning is not None:
            self._places = [*self._places[-1:], (self._crawler.displacement, self._crawler.yaw)]

    def gain(self) -> np.ndarray:
        """Compute the gain of the last period.

        Returns:
            dx, dy [m] and dyaw [rad], shape (3,); NaN without a period, and for bodies that do not turn.
        """
        if len(self._places) < 2:
            return _NO_SCREW
        (x, yaw), (end, turned) = self._places
        return gain_in_frame(self._crawler.body, x[None], (end - x)[None], np.array([turned - yaw]))[0]
