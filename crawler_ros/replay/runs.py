"""The runs between the resets of a recorded crawler, found on each topic from its own stamps.

Messages that are received at nearly the same time may be recorded in any order from topic to topic, so that no message
of one topic tells at which message of another a run begins. Each topic is therefore divided where its own stamps begin
again at 0, and its runs are matched with the ledger's by the times of reception.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..recording.recorded_robot import Robot
from ..wire.measured import MEASURED
from .health import Stamps, Survey

LEDGER, STATES = "applied_commands", ("joint_states", "contact_states", "pose")


@dataclass(frozen=True, eq=False)
class Runs:
    """The runs of a topic.

    Attributes:
        first: index of the first message of each run in the order of their reception, increasing, shape (R,).
        number: number of each run, shape (R,); -1 before the first one that the ledger holds.
    """

    first: np.ndarray
    number: np.ndarray

    def of(self, index: np.ndarray) -> np.ndarray:
        """Look up the runs of messages.

        Args:
            index: indices of messages, shape (K,).

        Returns:
            The number of the run of each, shape (K,).
        """
        return self.number[np.searchsorted(self.first, index, side="right") - 1]


def find_runs(survey: Survey, robot: Robot) -> dict[str, Runs]:
    """Find the runs of the ledger and of the states.

    Args:
        survey: survey of the recording, with a ledger.
        robot: the crawler.

    Returns:
        The runs of all recorded topics, by their names in the table of topics.
    """
    topics = {name: survey.topics.get(robot.recorded(name)) for name in (LEDGER, *STATES, *MEASURED)}
    recorded = {name: topic for name, topic in topics.items() if topic is not None and topic.stamp_ns.size}
    ledger = recorded.pop(LEDGER)
    begins = _find_begins(ledger, recorded.values())
    begins_at = ledger.log_ns[begins]
    return {LEDGER: Runs(begins, np.arange(begins.size))} | {
        name: _match(topic, begins_at, name in MEASURED) for name, topic in recorded.items()
    }


def _find_begins(ledger: Stamps, states: Iterable[Stamps]) -> np.ndarray:
    """Find the ledger's messages that begin a run: stamped 0 after others, or not later after a state stamped 0."""
    stamps, log_ns = ledger.stamp_ns, ledger.log_ns
    zero = np.sort(np.concatenate([np.zeros(0, np.int64), *(s.log_ns[s.stamp_ns == 0] for s in states)]))
    between = np.diff(np.searchsorted(zero, log_ns, side="right")) > 0
    begins = ((stamps[1:] == 0) & (stamps[:-1] > 0)) | (between & (stamps[1:] <= stamps[:-1]))
    return np.append(0, 1 + np.flatnonzero(begins))


def _match(states: Stamps, begins_at: np.ndarray, repeated: bool) -> Runs:
    """Find the runs of states, and to which runs of the ledger, begun at `begins_at` [ns, wall], they belong.

    Measurements may be `repeated`: then several of the start follow each other.
    """
    begins = states.stamp_ns == 0
    if repeated:
        begins[1:] &= states.stamp_ns[:-1] > 0
    first = np.unique(np.append(0, np.flatnonzero(begins)))
    last = np.append(first[1:], states.stamp_ns.size) - 1
    # the last state of a run precedes the next run's first tick; where there is only the state of the start, it, or the
    # first time that it is repeated, precedes the run's own first tick
    ticked = states.stamp_ns[last] > 0
    before = np.searchsorted(begins_at, states.log_ns[last], side="right") - 1
    following = np.searchsorted(begins_at, states.log_ns[first], side="left")
    return Runs(first, np.where(ticked, before, following))
