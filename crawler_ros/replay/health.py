"""Survey of a recording: the messages on each topic, their rates, and what is missing."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import CommandError
from crawler_model.body.drive import NS
from crawler_model.run.ticks import rational_rate

from ..recording import bag
from ..recording.decode import JOINT_STATE, ODOMETRY, POSE, TRAJECTORY, rows_at
from ..recording.incidents import DIAGNOSTICS, Parts, read_diagnostics
from ..recording.recorded_robot import Robot, noted_robot, robot_in

_STAMPED = (JOINT_STATE, TRAJECTORY, POSE, ODOMETRY, "rosgraph_msgs/msg/Clock")
_TYPES = {
    "applied_commands": TRAJECTORY,
    "joint_states": JOINT_STATE,
    "contact_states": JOINT_STATE,
    "pose": POSE,
    "odom": ODOMETRY,
}
"""The topics that have a message at every tick, or states at every n-th one."""
_LEDGER = "applied_commands"
_ESSENTIAL = (_LEDGER, "joint_states")
"""A recording must have at least one of these topics of a crawler."""
_MOST_GAPS = 20


@dataclass(frozen=True, eq=False)
class Stamps:
    """The stamps of a topic's messages and the times when they were received, in the order of their reception.

    Attributes:
        type: type of the topic.
        stamp_ns: stamps of the headers [ns, simulated], shape (K,); shape (0,) for types without a stamp.
        log_ns: times of reception, shape (K,) [ns, wall].
    """

    type: str
    stamp_ns: np.ndarray
    log_ns: np.ndarray


@dataclass(frozen=True, eq=False)
class Survey:
    """The stamps, attachments and completeness of a recording.

    Attributes:
        path: the recording.
        attachments: data by name: scene, parameters, versions, start, node, topics.
        complete: whether the files have their ends and all messages counted there, and none is missing.
        damaged: number of chunks and messages that could not be read.
        lost: number of messages counted at the end of the files but not found; None when it is not known.
        topics: stamps of each topic by name.
        diagnostics: the last message of each node on /diagnostics.
        ended: whether the files have their ends.
        missing: a line for each file that is not there, has no end, or holds other messages than are counted.
    """

    path: Path
    attachments: dict[str, Any]
    complete: bool
    damaged: int
    lost: int | None
    topics: dict[str, Stamps]
    diagnostics: dict[str, Parts] = field(default_factory=dict)
    ended: bool = True
    missing: tuple[str, ...] = ()

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(t.log_ns.size for t in self.topics.values())


def survey_recording(path: Path, progress: Callable[[float], None] | None = None) -> Survey:
    """Read all stamps of a recording.

    Args:
        path: a bag folder or an .mcap file.
        progress: called with the fraction done, in [0, 1].

    Returns:
        The survey.

    Raises:
        BagError: when the file is not a recording.
    """
    head = bag.Bag({})
    stamps: dict[str, array[int]] = {}
    received: dict[str, array[int]] = {}
    types: dict[str, str] = {}
    diagnostics: dict[str, Parts] = {}
    for block in bag.read_blocks(path, head, progress):
        present = np.unique(block.channel).tolist()
        for topic, kind in {head.channels[n][0].topic: head.channels[n][1].name for n in present}.items():
            if topic not in types:
                types[topic] = kind
                stamps[topic], received[topic] = array("q"), array("q")
            which = head.find(block, topic)
            received[topic].frombytes(block.log_ns[which].tobytes())
            if types[topic] == DIAGNOSTICS:
                for first, size in zip(block.first[which], block.size[which], strict=True):
                    diagnostics |= read_diagnostics(block.data[first : first + size].tobytes())
            if types[topic] in _STAMPED:
                which = which[block.size[which] >= 12]
                words = rows_at(block.data, block.first[which] + 4, 8).view("<i4").astype(np.int64)
                stamps[topic].frombytes((words[:, 0] * NS + (words[:, 1] & 0xFFFFFFFF)).tobytes())
    topics = {
        name: Stamps(kind, np.array(stamps[name], np.int64), np.array(received[name], np.int64))
        for name, kind in types.items()
    }
    counted = (head.complete, head.damaged, head.lost)
    return Survey(path, head.attachments, *counted, topics, diagnostics, head.ended, head.missing)


def choose_robot(survey: Survey, namespace: str | None) -> Robot:
    """Find the crawler in a recording.

    Args:
        survey: survey of the recording.
        namespace: namespace of the crawler, where there are several; None for the only one.

    Returns:
        The crawler, with the names of its topics.

    Raises:
        BagError: when there is no crawler, or there are several and no namespace is named.
    """
    noted = noted_robot(survey.attachments)
    found: dict[str, Robot] = {}
    for name in _ESSENTIAL:
        if noted is not None and noted.recorded(name) in survey.topics:
            found[noted.namespace] = noted
    own = set(found[noted.namespace].topics.values()) if noted is not None and found else set()
    for topic, stamps in survey.topics.items():
        for name in _ESSENTIAL:
            if topic.endswith("/" + name) and stamps.type == _TYPES[name] and topic not in own:
                space = topic.removesuffix(name).rstrip("/") or "/"
                found.setdefault(space, robot_in(space))
    names = ", ".join(sorted(found))
    damaged = f"; {survey.damaged} damaged chunk(s) cannot be read" if survey.damaged else ""
    if not survey.topics:
        missing = "" if survey.complete or damaged else "; its end is missing, and no message before it can be read"
        raise bag.BagError(f"{survey.path}: the recording has no messages{missing}{damaged}")
    if namespace is not None:
        wanted = f"/{namespace.strip('/')}"
        if wanted in found:
            return found[wanted]
        there = f"there are {names}" if found else "the recording has no crawler"
        raise bag.BagError(f"{survey.path}: no crawler in the namespace {wanted}; {there}")
    if not found:
        listed = [f"{name} ({stamps.type})" for name, stamps in sorted(survey.topics.items())]
        more = f" and {len(listed) - 4} more" if len(listed) > 4 else ""
        raise bag.BagError(
            f"{survey.path}: no crawler in this recording: its topics are neither applied_commands nor "
            f"joint_states but {', '.join(listed[:4])}{more}{damaged}"
        )
    if len(found) > 1:
        raise bag.BagError(f"{survey.path}: {len(found)} robots; choose one with --namespace {names}")
    return found.popitem()[1]


def find_rate(survey: Survey, robot: Robot) -> Fraction | None:
    """Find the rate at which a crawler ran.

    Args:
        survey: survey of the recording.
        robot: the crawler.

    Returns:
        The rate in its parameters, else the rate of its stamps; None when there are too few.
    """
    parameters = survey.attachments.get("parameters")
    if isinstance(parameters, dict) and "rate" in parameters:
        try:
            return rational_rate(parameters["rate"])
        except CommandError:
            return None
    for name in _ESSENTIAL:
        stamps = survey.topics.get(robot.recorded(name))
        if stamps is not None and stamps.stamp_ns.size > 2:
            steps = np.diff(stamps.stamp_ns)
            steps = steps[steps > 0]
            if steps.size:
                try:
                    return rational_rate(round(NS / float(np.median(steps)), 6))
                except CommandError:  # of stamps that are none
                    return None
    return None


def published_every(attachments: Mapping[str, Any]) -> int | None:
    """Read how many ticks lie between the published states, the parameter `publish.every`.

    Args:
        attachments: attachments of a recording.

    Returns:
        The number of ticks; None when no parameters are recorded.
    """
    parameters = attachments.get("parameters")
    if not isinstance(parameters, dict):
        return None
    every = parameters.get("publish.every")
    return every if isinstance(every, int) and every > 0 else 1


def states_every(survey: Survey, robot: Robot, rate: Fraction | None) -> int:
    """Find how many ticks lie between the states of a recording.

    Args:
        survey: survey of the recording.
        robot: the crawler.
        rate: ticks per second [Hz]; None when it is not known.

    Returns:
        The parameter `publish.every`; when no parameters are recorded, the usual number of ticks.
    """
    every = published_every(survey.attachments)
    if every is not None:
        return every
    states = survey.topics.get(robot.recorded("joint_states"))
    steps = np.diff(states.stamp_ns) if states is not None else np.zeros(0)
    steps = steps[steps > 0]
    return max(round(float(np.median(steps) * float(rate)) / NS), 1) if rate is not None and steps.size else 1


def next_ticks_ns(stamp_ns: np.ndarray, rate: Fraction | None) -> np.ndarray:
    """Compute the ends of the ticks that begin at some stamps.

    Args:
        stamp_ns: simulated times of their starts, shape (K,) [ns].
        rate: ticks per second [Hz]; None when it is not known.

    Returns:
        Simulated times of their ends [ns], or of their starts when the rate is not known.
    """
    if rate is None:
        return stamp_ns
    n, d, whole = rate.numerator, NS * rate.denominator, stamp_ns
    if 4 * (int(np.abs(stamp_ns).max(initial=0)) * n + d) >= 1 << 63:
        whole = stamp_ns.astype(object)  # integers of any size
    tick = (2 * whole * n + d) // (2 * d)
    return np.where(tick * d // n == stamp_ns, (tick + 1) * d // n, whole + d // n).astype(np.int64)


@dataclass(frozen=True)
class TopicHealth:
    """The number, rate and gaps of the messages on one topic.

    Attributes:
        type: its type.
        count: number of messages.
        rate: messages per simulated second where they are stamped, else per second of reception [Hz]; None for a single
            message.
        first: earliest stamp [s]; None when there are no stamps.
        last: latest stamp [s].
        gaps: (after, before, missing ticks) of the first twenty gaps; times in s.
        missing: number of ticks without a message that should have one.
        out_of_order: number of stamps that decrease, other than to 0.
        duplicates: number of stamps equal to the one before.
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
        """Convert to plain values for JSON.

        Returns:
            The attributes by name, as plain numbers, lists and text.
        """
        gaps = [{"after": a, "before": b, "missing": n} for a, b, n in self.gaps]
        return {**self.__dict__, "gaps": gaps}


def check_topics(survey: Survey, robot: Robot, rate: Fraction | None) -> dict[str, TopicHealth]:
    """Check every topic of a recording.

    Args:
        survey: survey of the recording.
        robot: the crawler.
        rate: ticks per second [Hz].

    Returns:
        The health of each topic by name.
    """
    every = states_every(survey, robot, rate)
    return {
        name: _check_topic(
            stamps, rate if robot.meant(name) in _TYPES else None, 1 if robot.meant(name) == _LEDGER else every
        )
        for name, stamps in sorted(survey.topics.items())
    }


def _check_topic(stamps: Stamps, rate: Fraction | None, every: int) -> TopicHealth:
    count, ns = stamps.log_ns.size, stamps.stamp_ns
    if ns.size == 0:
        span = float(stamps.log_ns.max() - stamps.log_ns.min()) / NS if count > 1 else 0.0
        return TopicHealth(
            type=stamps.type,
            count=count,
            rate=count / span if span else None,
            first=None,
            last=None,
            gaps=(),
            missing=0,
            out_of_order=0,
            duplicates=0,
        )
    step = np.diff(ns)
    back = (step < 0) & (ns[1:] != 0)
    again = (step == 0) & (ns[1:] != 0)
    span = float(step[step > 0].sum()) / NS
    gaps: list[tuple[float, float, int]] = []
    missing = 0
    if rate is not None and ns.size > 1:
        at = np.flatnonzero(step * float(rate) > (every + 0.5) * NS)
        before = np.rint(ns[at] * float(rate) / NS).astype(np.int64)
        after = before + np.rint(step[at] * float(rate) / NS).astype(np.int64)
        counts = (after - 1) // every - before // every
        missing = int(counts.sum())
        gaps = [(ns[i] / NS, ns[i + 1] / NS, int(n)) for i, n in zip(at[:_MOST_GAPS], counts, strict=False)]
    return TopicHealth(
        type=stamps.type,
        count=count,
        rate=float(np.count_nonzero(step > 0)) / span if span else None,
        first=float(ns.min()) / NS,
        last=float(ns.max()) / NS,
        gaps=tuple(gaps),
        missing=missing,
        out_of_order=int(back.sum()),
        duplicates=int(again.sum()),
    )
