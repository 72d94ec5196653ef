"""Other publishers and lost messages, from the ROS graph and the sequence numbers of publications."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from ...wire.facts import LogText

TRIGGERS = (
    "joint_trajectory",
    "actuation_controller/commands",
    "actuation_controller/joint_trajectory",
    "joint_commands",
)
"""Topics whose commands trigger ticks in lock-step; those on others wait for one."""
RIVAL_TOPICS = (
    TRIGGERS,
    ("friction_controller/commands",),
    ("load_controller/commands",),
)
"""Topics whose commands replace each other."""
_MOST_STREAMS = 64
_TURNS, _WITHIN_S, _GONE_S = 3, 10.0, 25.0
"""Publishers replace each other's commands if they have taken so many turns within this time, or have all been listed
for longer than the graph lists one that was killed (20 s)."""
_ASK_AFTER_S = 10.0
"""Silence after which a node asks for a tick. Discovery takes less: to ask earlier would shift all later ticks."""


class Arrivals:
    """Counts the messages of a topic that arrived, and that did not, by their sequence numbers.

    rclpy passes on the number but not the publisher. A number continues the sequence whose last number is nearest below
    it; a gap counts as a loss once the topic's publishers have been the same from before it until after it.
    """

    def __init__(self) -> None:
        """Start with no message counted."""
        self.received = self.lost = 0
        self._last: list[int] = []
        self._at = 0  # the sequence of the last message
        self._gaps = 0
        self._publishers: frozenset[bytes] = frozenset()

    def count_message(self, number: int | None) -> int:
        """Count a message.

        Args:
            number: its sequence number; None where the middleware has none.

        Returns:
            Which of the sequences it continues.
        """
        self.received += 1
        if not number:
            return self._at
        last = self._last
        if self._at < len(last) and last[self._at] == number - 1:
            last[self._at] = number
            return self._at
        below = [k for k, n in enumerate(last) if n < number]
        nearest = max(below, key=last.__getitem__, default=None)
        first = nearest is None or (last[nearest] != number - 1 and len(last) < len(self._publishers))
        if nearest is None or first:  # the first of another publisher
            if len(last) < _MOST_STREAMS:
                last.append(number)
                self._at = len(last) - 1
            return self._at
        self._gaps += number - last[nearest] - 1
        last[nearest] = number
        self._at = nearest
        return nearest

    def count_losses(self, publishers: Iterable[bytes]) -> int:
        """Decide whether the gaps since the last call are losses.

        Args:
            publishers: the present publishers of the topic.

        Returns:
            The messages lost since the last call.
        """
        now = frozenset(publishers)
        gaps, self._gaps = self._gaps, 0
        if now != self._publishers:
            if not self._publishers <= now:  # a publisher has left, and its numbers cannot be identified
                self._last.clear()
            self._publishers = now
            return 0
        self.lost += gaps
        return gaps


class Turns:
    """Notices publishers that replace each other's commands, whichever the graph lists."""

    def __init__(self) -> None:
        """Start before the first message."""
        self._last: tuple[str, int] | None = None
        self._times: deque[float] = deque(maxlen=_TURNS)
        self._listed: frozenset[bytes] = frozenset()
        self._since = 0.0

    def note_message(self, topic: str, stream: int) -> None:
        """Note a message.

        Args:
            topic: its topic.
            stream: which sequence of the topic's messages it continues.
        """
        if self._last not in (None, (topic, stream)):
            self._times.append(time.monotonic())
        self._last = topic, stream

    def find(self, topics: Mapping[str, Sequence[tuple[bytes, str]]]) -> str:
        """Describe the publishers if more than one commands.

        Args:
            topics: the publishers that the graph lists on each topic, by its name.

        Returns:
            A line; empty when no more than one does.
        """
        now, listed = time.monotonic(), frozenset(gid for found in topics.values() for gid, _ in found)
        if listed != self._listed:
            self._listed, self._since = listed, now
        alternate = len(self._times) == _TURNS and now - self._times[0] < _WITHIN_S
        return rivals_on_commands(topics) if alternate or now - self._since > _GONE_S else ""


def publishers_of(node: Any, topic: str) -> list[tuple[bytes, str]]:
    """List the publishers of a topic.

    Args:
        node: an rclpy node.
        topic: its name, relative to the node.

    Returns:
        The identity of each publisher and the full name of its node.
    """
    found = node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
    return [(bytes(i.endpoint_gid), _name_of(i.node_namespace, i.node_name)) for i in found]


def publishers_of_other_types(node: Any, topic: str, kind: str) -> list[str]:
    """Describe the publishers of a topic whose messages nobody receives.

    Args:
        node: an rclpy node.
        topic: its name, relative to the node.
        kind: the type of the messages that are received.

    Returns:
        A line for each.
    """
    full = node.resolve_topic_name(topic)
    return [
        f"{_name_of(i.node_namespace, i.node_name)} publishes {i.topic_type} on {full}, which takes {kind}: "
        f"{LogText.NONE_RECEIVED.value}"
        for i in node.get_publishers_info_by_topic(full)
        if i.topic_type != kind
    ]


def _name_of(namespace: str, name: str) -> str:
    """Return the full name of a node, or words where only its publisher is discovered so far."""
    known = name not in ("", "_NODE_NAME_UNKNOWN_")
    return f"{namespace.rstrip('/')}/{name}" if known else "a node that is not named yet"


def rivals_on_states(topics: Mapping[str, Sequence[tuple[bytes, str]]]) -> str:
    """Describe publishers of a crawler's states besides its own.

    Args:
        topics: the publishers of each topic, by its name.

    Returns:
        A line; empty when there are none.
    """
    crowded = [name for name, found in topics.items() if len(found) > 1]
    if not crowded:
        return ""
    return f"another node publishes {', '.join(crowded)} here: two crawlers need two namespaces"


class SecondSimulator:
    """Notices that the states of two simulators mix.

    The graph does not show it: a simulator that was killed and started again is listed twice for a while.
    """

    def __init__(self, node: Any, topic: str) -> None:
        """Begin before the first state.

        Args:
            node: an rclpy node.
            topic: a topic of states, relative to the node.
        """
        self._node, self._topic = node, topic
        self._before_ns = -1
        self._repeated = 0

    def find(self, now_ns: int) -> str:
        """Note a state.

        Args:
            now_ns: its stamp [ns].

        Returns:
            A line about the second simulator; empty as long as there is none.
        """
        self._repeated += now_ns <= self._before_ns  # once: the simulator was reset
        self._before_ns = now_ns
        if self._repeated < 2:
            return ""
        found = publishers_of(self._node, self._topic)
        if len(found) < 2:
            return ""
        return (
            f"{len(found)} simulators publish {self._topic} here ({', '.join(sorted(node for _, node in found))}): end "
            "all but one, or start each with a namespace or a ROS_DOMAIN_ID of its own"
        )


class Silence:
    """Notices a simulator that listens but has been silent for long: it is in lock-step, in the middle of a run.

    Time counts only while somebody listens: the first state of a simulator that starts late may be on its way.
    """

    def __init__(self) -> None:
        """Begin now."""
        self._since = time.monotonic()

    def has_lasted(self, is_silent: bool) -> bool:
        """Determine whether to ask for a tick that changes nothing; to be called several times a second.

        Args:
            is_silent: whether no state has arrived although somebody listens to commands.

        Returns:
            Whether the silence has lasted for ten seconds, or as long again since it had.
        """
        now = time.monotonic()
        if not is_silent:
            self._since = now
        lasted = now - self._since > _ASK_AFTER_S
        if lasted:
            self._since = now
        return lasted


def rivals_on_commands(topics: Mapping[str, Sequence[tuple[bytes, str]]]) -> str:
    """Describe publishers whose commands replace each other.

    Args:
        topics: the publishers of each topic that carries lengths, by its name.

    Returns:
        A line; empty when there is at most one node, with at most one publisher per topic.
    """
    nodes = sorted({node for found in topics.values() for _, node in found})
    if len(nodes) < 2 and all(len(found) < 2 for found in topics.values()):
        return ""
    used = ", ".join(name for name, found in topics.items() if found)
    return f"{sum(map(len, topics.values()))} publishers command this crawler at once ({', '.join(nodes)} on {used})"
