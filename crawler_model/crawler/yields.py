"""How long actuators were beyond the limits of their tension: tendons slack, motors stalled. Events: `line.springs`."""

from __future__ import annotations

import numpy as np

from ..body.body import Body
from ..body.drive import NS
from ..body.names import name_joints

_WORDS = ((-1, "slack"), (1, "stalled"))
_MOST_NAMED, _MOST_WAITING = 5, 100


class YieldTimes:
    """Adds up simulated time by link; for a segment, its elements on average count. A tick counts as at its end."""

    def __init__(self, body: Body) -> None:
        """Start at zero.

        Args:
            body: the body; for one without limits of tension there is nothing to count.
        """
        self._body, self._limits = body, body.joint_limits
        names = name_joints(body)
        self._names = [names[joint] for joint in self._limits.index]
        self._ns = {state: np.zeros(len(self._names), np.int64) for state, _ in _WORDS}
        self._waiting: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._reported = {state: times.copy() for state, times in self._ns.items()}

    def add_ticks(self, elongation: np.ndarray, lengths: np.ndarray, ns: np.ndarray) -> None:
        """Add K ticks.

        Args:
            elongation: z of each joint at their ends, shape (K, J) [m].
            lengths: L of each joint, the sum over its springs, of the same shape [m].
            ns: their durations, shape (K,) [ns].
        """
        self._waiting.append((elongation.copy(), lengths, ns))
        if len(self._waiting) == _MOST_WAITING or ns.size > 1:
            self._add_waiting()

    def _add_waiting(self) -> None:
        """Add the ticks that wait: together they take little longer than one of them."""
        if self._waiting:
            elongation, lengths, ns = map(np.concatenate, zip(*self._waiting, strict=True))
            self._waiting.clear()
            found = self._limits.find_states(elongation, lengths)
            for state, times in self._ns.items():
                times += ns @ (found == state)

    def list_seconds(self) -> dict[str, dict[str, float]]:
        """List how long links were slack or stalled.

        Returns:
            By the name of the link or segment `slack` and `stalled`, each if it can be that [s].
        """
        self._add_waiting()
        found: dict[str, dict[str, float]] = {name: {} for name in self._names}
        for state, word in _WORDS:
            for k in np.flatnonzero(self._limits.can_be(state)).tolist():
                found[self._names[k]][word] = float(self._ns[state][k]) / NS
        return found

    def report(self) -> tuple[str, list[tuple[str, str]]]:
        """Describe what has happened since the last call, and how long it has lasted in the whole run.

        Returns:
            A message, and for each link that can be slack or stalled the times.
        """
        self._add_waiting()
        told = []
        for state, word in _WORDS:
            times = self._ns[state]
            now = [name for name, more in zip(self._names, times > self._reported[state], strict=True) if more]
            self._reported[state] = times.copy()
            if now:
                rest = f" and {len(now) - _MOST_NAMED} more" if len(now) > _MOST_NAMED else ""
                told.append(f"{word}: {', '.join(now[:_MOST_NAMED])}{rest}")
        entries = [
            (f"{name} {word} [s]", f"{seconds:.9f}")
            for name, times in self.list_seconds().items()
            for word, seconds in times.items()
        ]
        return "; ".join(told) or "within the limits of tension", entries


def start_yield_times(body: Body) -> YieldTimes | None:
    """Start to count, if a link can be slack or stalled.

    Args:
        body: the body.

    Returns:
        The times, all zero; None for bodies without limits of tension.
    """
    return YieldTimes(body) if body.joint_limits.index.size else None
