"""Is a recording whole? A first look through it: what is on each topic, how often, and what is missing."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import CommandError
from crawler_model.body.drive import NS
from crawler_model.run.simulate import rational_rate

from ..recording import bag
from ..recording.layouts import JOINT_STATE, POSE, TRAJECTORY
from ..recording.recorded_robot import Robot, noted_robot, robot_in

_STAMPED = (JOINT_STATE, TRAJECTORY, POSE, "nav_msgs/msg/Odometry", "rosgraph_msgs/msg/Clock")
_TYPES = {
    "applied_commands": TRAJECTORY,
    "joint_states": JOINT_STATE,
    "contact_states": JOINT_STATE,
    "pose": POSE,
    "odom": "nav_msgs/msg/Odometry",
}
"""The topics that have a message at every tick."""
_TELLING = ("applied_commands", "joint_states")
"""The topics of which a crawler has at least one in a recording that can be understood."""
_MOST_GAPS = 20


@dataclass(frozen=True, eq=False)
class Stamps:
    """When the messages of a topic were meant and heard, in the order of the file.

    Attributes:
        type: the topic's type.
        stamp_ns: of the header [ns, simulated], shape (K,); of types without one, none, shape (0,).
        log_ns: shape (K,) [ns, wall].
    """

    type: str
    stamp_ns: np.ndarray
    log_ns: np.ndarray


@dataclass(frozen=True, eq=False)
class Survey:
    """What a first look finds.

    Attributes:
        path: the recording.
        attachments: name to data: scene, parameters, versions, start, node, topics.
        complete: whether the file has its end and all messages that it promises.
        damaged: chunks that could not be read.
        lost: messages that the file promises and does not give; None where its end is missing.
        topics: by name.
    """

    path: Path
    attachments: dict[str, Any]
    complete: bool
    damaged: int
    lost: int | None
    topics: dict[str, Stamps]

    @property
    def messages(self) -> int:
        """How many there are."""
        return sum(t.log_ns.size for t in self.topics.values())


def survey_recording(path: Path, progress: Callable[[float], None] | None = None) -> Survey:
    """Read all stamps of a recording.

    Args:
        path: a bag folder or an .mcap file.
        progress: called with the part done, in [0, 1].

    Returns:
        What was found.

    Raises:
        BagError: when it is no recording at all.
    """
    head = bag.Bag({})
    stamps: dict[str, array[int]] = {}
    heard: dict[str, array[int]] = {}
    types: dict[str, str] = {}
    for block in bag.read_blocks(path, head, progress):
        for channel in np.unique(block.channel).tolist():
            if channel not in head.channels:
                continue
            described, schema = head.channels[channel]
            topic = described.topic
            if topic not in types:
                types[topic] = schema.name
                stamps[topic], heard[topic] = array("q"), array("q")
            which = np.flatnonzero(block.channel == channel)
            heard[topic].frombytes(block.log_ns[which].tobytes())
            if schema.name in _STAMPED:
                which = which[block.size[which] >= 12]
                words = block.data[block.first[which][:, None] + np.arange(4, 12)].copy().view("<i4").astype(np.int64)
                stamps[topic].frombytes((words[:, 0] * NS + (words[:, 1] & 0xFFFFFFFF)).tobytes())
    topics = {
        name: Stamps(kind, np.array(stamps[name], np.int64), np.array(heard[name], np.int64))
        for name, kind in types.items()
    }
    return Survey(path, head.attachments, head.complete, head.damaged, head.lost, topics)


def choose_robot(survey: Survey, namespace: str | None) -> Robot:
    """Find the crawler in a recording.

    Args:
        survey: of the recording.
        namespace: which, where there are several; None for the only one.

    Returns:
        The crawler, with the names of its topics.

    Raises:
        BagError: when there is none, or several and none is named.
    """
    noted = noted_robot(survey.attachments)
    found: dict[str, Robot] = {}
    for name in _TELLING:
        if noted is not None and noted.recorded(name) in survey.topics:
            found[noted.namespace] = noted
    own = set(found[noted.namespace].topics.values()) if noted is not None and found else set()
    for topic, stamps in survey.topics.items():
        for name in _TELLING:
            if topic.endswith("/" + name) and stamps.type == _TYPES[name] and topic not in own:
                space = topic.removesuffix(name).rstrip("/") or "/"
                found.setdefault(space, robot_in(space))
    names = ", ".join(sorted(found))
    if namespace is not None:
        wanted = f"/{namespace.strip('/')}"
        if wanted in found:
            return found[wanted]
        there = f"there are {names}" if found else "there is no crawler in it"
        raise bag.BagError(f"{survey.path}: no crawler in the namespace {wanted}; {there}")
    if not survey.topics:
        hint = "" if survey.complete else "; its end is missing, and nothing before it can be read"
        raise bag.BagError(f"{survey.path}: there is no message in it{hint}")
    if not found:
        listed = [f"{name} ({stamps.type})" for name, stamps in sorted(survey.topics.items())]
        more = f" and {len(listed) - 4} more" if len(listed) > 4 else ""
        raise bag.BagError(
            f"{survey.path}: no crawler in it: neither applied_commands nor joint_states is among its topics, "
            f"{', '.join(listed[:4])}{more}"
        )
    if len(found) > 1:
        raise bag.BagError(f"{survey.path}: {len(found)} robots; choose one with --namespace {names}")
    return found.popitem()[1]


def find_rate(survey: Survey, robot: Robot) -> Fraction | None:
    """Tell at how many ticks a second a crawler ran.

    Args:
        survey: of the recording.
        robot: what its topics begin with.

    Returns:
        The rate of its parameters, else the one that its stamps show; None when they show none.
    """
    given = survey.attachments.get("parameters")
    if isinstance(given, dict) and "rate" in given:
        try:
            return rational_rate(given["rate"])
        except CommandError:
            return None
    for name in _TELLING:
        stamps = survey.topics.get(robot.recorded(name))
        if stamps is not None and stamps.stamp_ns.size > 2:
            steps = np.diff(stamps.stamp_ns)
            steps = steps[steps > 0]
            if steps.size:
                return rational_rate(round(NS / float(np.median(steps)), 6))
    return None


def next_tick_ns(stamp_ns: int, rate: Fraction | None) -> int:
    """Tell when the tick that begins at a stamp ends.

    Args:
        stamp_ns: simulated time of the tick's start [ns].
        rate: ticks per second [Hz]; None where it is not known.

    Returns:
        Simulated time of the tick's end [ns]; for unknown rates that of its start.
    """
    if rate is None:
        return stamp_ns
    n, d = rate.numerator, NS * rate.denominator
    tick = (2 * stamp_ns * n + d) // (2 * d)
    if tick * d // n == stamp_ns:
        return (tick + 1) * d // n
    return stamp_ns + d // n


@dataclass(frozen=True)
class TopicHealth:
    """What is right and wrong on one topic.

    Attributes:
        type: its type.
        count: messages.
        rate: messages per simulated second where they are stamped, else per second heard [Hz]; None for a single one.
        first: earliest stamp [s]; None where there is none.
        last: latest stamp [s].
        gaps: (after, before, missing ticks), the first twenty; times in s.
        missing: ticks without a message, all gaps together.
        out_of_order: stamps that go back other than to 0.
        duplicates: stamps that repeat the one before.
    """

    type: str
    count: int
    rate: float | None
    first: float | None
    last: float | None
    gaps: tuple[tuple[float, float, int], ...]
    missing: int
    out_of_order: int
    duplicates: int

    def as_plain(self) -> dict[str, Any]:
        """Lay it out for JSON.

        Returns:
            The attributes by name, as plain numbers, lists and text.
        """
        gaps = [{"after": a, "before": b, "missing": n} for a, b, n in self.gaps]
        return {**self.__dict__, "gaps": gaps}


def check_topics(survey: Survey, robot: Robot, rate: Fraction | None) -> dict[str, TopicHealth]:
    """Judge every topic of a recording.

    Args:
        survey: of the recording.
        robot: the crawler.
        rate: of its ticks [Hz].

    Returns:
        By the topic's name.
    """
    return {
        name: _check_topic(stamps, rate if robot.meant(name) in _TYPES else None)
        for name, stamps in sorted(survey.topics.items())
    }


def _check_topic(stamps: Stamps, rate: Fraction | None) -> TopicHealth:
    count, ns = stamps.log_ns.size, stamps.stamp_ns
    if ns.size == 0:
        span = float(stamps.log_ns.max() - stamps.log_ns.min()) / NS if count > 1 else 0.0
        return TopicHealth(stamps.type, count, count / span if span else None, None, None, (), 0, 0, 0)
    step = np.diff(ns)
    back = (step < 0) & (ns[1:] != 0)
    again = (step == 0) & (ns[1:] != 0)
    span = float(step[step > 0].sum()) / NS
    gaps: list[tuple[float, float, int]] = []
    missing = 0
    if rate is not None and ns.size > 1:
        at = np.flatnonzero(step * float(rate) > 1.5 * NS)
        counts = np.rint(step[at] * float(rate) / NS).astype(np.int64) - 1
        missing = int(counts.sum())
        gaps = [(ns[i] / NS, ns[i + 1] / NS, int(n)) for i, n in zip(at[:_MOST_GAPS], counts, strict=False)]
    return TopicHealth(
        stamps.type,
        count,
        float(np.count_nonzero(step > 0)) / span if span else None,
        float(ns.min()) / NS,
        float(ns.max()) / NS,
        tuple(gaps),
        missing,
        int(back.sum()),
        int(again.sum()),
    )
