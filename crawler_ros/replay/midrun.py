"""The start of a recording that begins in mid-run, read from its states, to simulate from there on."""

from __future__ import annotations

from fractions import Fraction

import numpy as np

from crawler_model import Crawler

from ..recording import bag
from ..recording.decode import JOINT_STATE, TRAJECTORY, Decoder
from ..recording.recorded_robot import Robot
from ..wire.states import StationReader, shown_contacts
from .health import Survey, next_ticks_ns


def fit_start(survey: Survey, robot: Robot, crawler: Crawler, rate: Fraction | None) -> tuple[Crawler, int]:
    """Find the first state that is fully known: the first one at or after the end of the first tick with a command.

    Before that tick the friction in force is not recorded; after it the ledger holds every command, and the states hold
    the positions of the contacts.

    Args:
        survey: survey of the recording.
        robot: the crawler.
        crawler: a crawler with the scene and the method.
        rate: ticks per second [Hz].

    Returns:
        The crawler in that state, and its time [ns].

    Raises:
        BagError: naming what is missing.
    """
    body = crawler.body
    if body.memory:
        raise bag.BagError(
            f"{survey.path}: the recording begins in mid-run, and what the {body.memory} of scene {crawler.scene.name} "
            "remember there is not recorded; record from the start, or from a reset"
        )
    whole = np.unique(shown_contacts(crawler.scene.body)).size == body.contacts
    source = "contact_states" if whole and robot.recorded("contact_states") in survey.topics else "joint_states"
    begins = f"{survey.path}: the recording begins in mid-run"
    if robot.recorded(source) not in survey.topics or (source == "joint_states" and body.segments):
        raise bag.BagError(
            f"{begins}, and without contact_states of {'all contacts' if body.segments else 'any kind'} "
            "the positions of the contacts are not known"
        )
    ledger = Decoder(robot.recorded("applied_commands"), TRAJECTORY)
    states = Decoder(robot.recorded(source), JOINT_STATE)
    head = bag.Bag({})
    commands, seen = _FirstRun(), _FirstRun()
    known, ends = None, np.zeros(0, np.int64)
    for block in bag.read_blocks(survey.path, head):
        commands.extend(ledger.read(block, head.find(block, ledger.topic)), -1)
        seen.extend(states.read(block, head.find(block, states.topic)), 0)
        ends = next_ticks_ns(np.array([ns for ns, _ in commands.messages], np.int64), rate)
        known = next(((ns, x) for ns, x in seen.messages if ends.size and ns >= ends[0]), None)
        if commands.ended or seen.ended or (known is not None and ends[-1] > known[0]):  # no earlier command can follow
            break
    if known is not None:
        _, row = commands.messages[int(np.searchsorted(ends, known[0], side="right")) - 1]
        return _place(crawler, source, known[1], row), known[0]
    what = "no state after its first command is recorded" if commands.messages else "nothing is commanded in it"
    raise bag.BagError(f"{begins}, and {what}{' before it is reset' if commands.ended or seen.ended else ''}")


class _FirstRun:
    """The messages up to the first reset: times [ns] and numbers of those that hold any, and whether one is."""

    def __init__(self) -> None:
        self.messages: list[tuple[int, np.ndarray]] = []
        self.ended = False
        self._last_ns = -1

    def extend(self, groups: list[tuple[np.ndarray, np.ndarray, list[np.ndarray]]], part: int) -> None:
        """Add a part of the numbers of messages, in the order in which these were recorded."""
        added: list[tuple[int, int, np.ndarray | None]] = []
        for at, times, numbers in groups:
            rows = numbers[part] if numbers else [None] * at.size
            added += zip(at.tolist(), times[:, 0].tolist(), rows, strict=True)
        for _, ns, row in sorted(added, key=lambda message: message[0]):
            self.ended |= ns < self._last_ns
            if self.ended:
                return
            self._last_ns = ns
            if row is not None:
                self.messages.append((ns, row))


def _place(crawler: Crawler, source: str, numbers: np.ndarray, row: np.ndarray) -> Crawler:
    body, scene = crawler.body, crawler.scene
    x = np.zeros(body.position.shape)
    shown = shown_contacts(scene.body)
    states = StationReader(body)
    needed = body.position[shown].size if source == "contact_states" else states.size
    for what, found, expected in (
        (f"{source} have", numbers.size, needed),
        ("applied_commands have", row.size, scene.columns.count),
    ):
        if found != expected:
            raise bag.BagError(
                f"its {what} {found} numbers, but with scene {scene.name} they have {expected}; "
                "name the scene with which it was recorded"
            )
    if source == "contact_states":
        x[shown] = numbers.reshape(-1, *body.position.shape[1:]) - body.position[shown]
    else:
        x[body.stations] = states.read(numbers)
    return crawler.placed(x, scene.columns.target(row))
