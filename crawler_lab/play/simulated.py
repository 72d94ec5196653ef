"""A simulated crawler as what the server shows and commands."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from crawler_model import CommandError, Scene, load_scene, prepare
from crawler_model.run.ticks import DEFAULT_RATE

from .controls import read_speed
from .export import KEPT
from .lessons import Lesson, read_lessons
from .robot import PAST, Robot
from .session import Session
from .view import Instant

_LONGEST_NAME = 80


class Simulated(Robot):
    """A session of a simulated crawler."""

    keeps = tuple(KEPT)
    simulated = True

    def __init__(self, scene: Scene, rate: float = DEFAULT_RATE, lesson: Lesson | None = None) -> None:
        """Start a session.

        Args:
            scene: the scene.
            rate: ticks per simulated second [Hz].
            lesson: the lesson that it follows.
        """
        super().__init__(scene)
        self.session, self.lesson = Session(scene, rate), lesson

    def describe(self) -> dict[str, Any]:
        """Describe what does not change, with the lessons."""
        lesson = None if self.lesson is None else asdict(self.lesson)
        titles = {lesson.name: lesson.title for lesson in read_lessons().values()}
        drive = self.scene.drive
        period = float(drive.times[-1]) if drive.period is None else drive.period
        return {**super().describe(), "lesson": lesson, "lessons": titles, "period": period}

    def open_lesson(self, name: str) -> Simulated:
        """Prepare a session at the instant of a lesson."""
        if name not in read_lessons():
            raise CommandError(f"lesson: {name!r}; the lessons are {', '.join(read_lessons())}")
        lesson = read_lessons()[name]
        scene = load_scene(lesson.scene)
        prepare(scene)
        robot = Simulated(scene, lesson=lesson)
        robot.session.restore(lesson.state)
        return robot

    def frame(self) -> dict[str, Any]:
        """Describe the present instant."""
        session, tick = self.session, self.session.tick
        crawler = session.crawler
        instant = Instant(
            crawler.displacement,
            crawler.tension,
            crawler.spring_force,
            crawler.margins,
            tick.state,
            session.target,
            crawler.actuation,
        )
        work, dissipation, lost = tick.spent.tolist()
        return {
            "tick": session.now,
            "ticks": len(session.ticks) - 1,
            "time": session.time_ns / 1e9,
            "playing": session.playing,
            "speed": session.speed,
            "yaw": crawler.yaw,
            "work": work,
            "dissipation": dissipation,
            "jump_loss": lost,
            "stored": crawler.stored,
            "words": self.view.tell(instant, tick.unique, tick.jumps),
            "error": session.error,
            **self.show(session.settings, tick.base, instant),
        }

    def past(self, known: tuple[Any, ...] | None) -> tuple[bool, list[list[Any]]]:
        """List the ticks that a page does not know; all of them if the past changed."""
        session = self.session
        fresh = known is None or known[0] != session.changed
        first = max(session.now - PAST, 0) if fresh or known is None else max(known[1], session.now - PAST)
        ticks = enumerate(session.ticks[first + 1 : session.now + 1], first + 1)
        return fresh, [self.write_past(k / float(session.rate), tick.net, tick.state) for k, tick in ticks]

    @property
    def place(self) -> tuple[Any, ...]:
        """How often the past changed, the present tick, and what else a frame shows."""
        session = self.session
        return session.changed, session.now, session.settings, session.playing, session.speed, session.error

    def advance(self, seconds: float) -> None:
        """Let real time pass."""
        self.session.run(seconds)

    def receive(self, message: dict[str, Any]) -> None:
        """Obey a message of the page in control."""
        session = self.session
        session.error = ""
        if {"set", "mode", "wave"} & set(message):
            session.change(message)
        if "speed" in message:
            session.speed = read_speed(message["speed"])
        if "play" in message:
            session.playing = message["play"] is True
        if "step" in message:
            session.playing = False
            session.step()
        if "seek" in message:
            if type(message["seek"]) is not int:
                raise CommandError(f"seek: {message['seek']!r}; it must be the number of a tick")
            session.seek(message["seek"])
        if "undo" in message:
            session.undo()
        if "restore" in message:
            session.restore(str(message["restore"]))

    def link(self) -> str:
        """Write the session as a text for an address."""
        return self.session.encode()

    def keep(self, name: str, folder: Path) -> Callable[[], Path]:
        """Prepare a file about the session as it is now."""
        session = copy.copy(self.session)
        session.ticks, session.crawler = session.ticks[: session.now + 1], session.crawler.copy()
        stem = re.sub(r"[^\w.-]+", "_", session.scene.name)[:_LONGEST_NAME]  # a name may be any text
        file = folder / f"{stem}_by_hand.{name.partition('.')[2]}"

        def write() -> Path:
            KEPT[name](session, file)
            return file

        return write
