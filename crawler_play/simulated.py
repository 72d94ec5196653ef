"""A simulated crawler as what the server shows and commands."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import CommandError, Scene

from .keep import KEPT
from .session import Session
from .view import Instant, View

_PAST = 1000
"""Number of ticks of the past that a new page receives."""
_MARKS = {0: ".", 1: "f", -1: "b", 2: "x"}
FASTEST = 100.0
"""Largest speed, simulated seconds per second."""


def write_states(states: np.ndarray) -> str:
    """Write how contacts slid, one letter each: f forward, b back, x both, . held.

    Args:
        states: shape (N,).

    Returns:
        The letters.
    """
    return "".join(_MARKS[int(state)] for state in states)


class Simulated:
    """A session of a simulated crawler."""

    def __init__(self, scene: Scene, rate: float = 100.0) -> None:
        """Start a session.

        Args:
            scene: the scene.
            rate: ticks per simulated second [Hz].
        """
        self.session, self.view = Session(scene, rate), View(scene)
        self.keeps = tuple(KEPT)

    def describe(self) -> dict[str, Any]:
        """Describe what does not change."""
        session = self.session
        return {
            **self.view.describe_scene(),
            "rate": float(session.rate),
            "controls": session.controls.describe(),
            "modes": [mode for mode in ("hand", "scene", "wave") if mode != "scene" or not session.scene.drive.holds],
            "keeps": self.keeps,
            "simulated": True,
        }

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
            "mode": session.settings.mode,
            "wave": asdict(session.settings.wave),
            "slope": session.settings.slope,
            "values": session.controls.values(session.settings, self._shown_row()),
            "net": np.atleast_1d(crawler.net_translation).tolist(),
            "yaw": crawler.yaw,
            "work": work,
            "dissipation": dissipation + lost,
            "words": self.view.tell(instant, tick.unique, tick.jumps),
            "error": session.error,
            **self.view.describe(instant),
        }

    def _shown_row(self) -> np.ndarray:
        """The row that the controls show: what the leader moves as it is, the rest as chosen."""
        settings, row = self.session.settings, np.array(self.session.settings.hand)
        led = self.session.controls.led(settings.mode)
        row[led] = self.session.tick.base[led]
        return row

    def past(self, known: tuple[Any, ...] | None) -> tuple[bool, list[list[Any]]]:
        """List the ticks that a page does not know.

        Args:
            known: `place` when the page was last sent ticks; None for a new page.

        Returns:
            Whether the page has to forget those that it knows; and for each tick its time [s], the net translation [m]
            and how the shown contacts slid.
        """
        session = self.session
        fresh = known is None or known[0] != session.changed
        first = max(session.now - _PAST, 0) if fresh or known is None else max(known[1], session.now - _PAST)
        period = float(1 / session.rate)
        rows = [
            [k * period, float(np.atleast_1d(tick.net)[0]), write_states(tick.state[self.view.shown])]
            for k, tick in enumerate(session.ticks[first + 1 : session.now + 1], first + 1)
        ]
        return fresh, rows

    @property
    def place(self) -> tuple[Any, ...]:
        """How often the past changed, the present tick, and what else a frame shows."""
        session = self.session
        return session.changed, session.now, session.settings, session.playing, session.speed, session.error

    def advance(self, seconds: float) -> None:
        """Let real time pass.

        Args:
            seconds: real time [s].
        """
        self.session.run(seconds)

    def receive(self, message: dict[str, Any]) -> None:
        """Obey a message of the page that has the hand.

        Args:
            message: one or more of "set", "mode", "wave" as for `Controls.change`, "play", "speed", "step", "seek",
                "undo", "restore".

        Raises:
            CommandError: if a value is out of range.
        """
        session = self.session
        session.error = ""
        if {"set", "mode", "wave"} & set(message):
            session.change(message)
        if "speed" in message:
            speed = message["speed"]
            if isinstance(speed, bool) or not isinstance(speed, (int, float)) or not 0.0 < speed <= FASTEST:
                raise CommandError(f"speed: {speed!r}; it must be a number above 0 and at most {FASTEST:g}")
            session.speed = float(speed)
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

    def hold(self, reason: str) -> None:
        """Nothing: a simulated crawler goes on without a page, and loses nothing.

        Args:
            reason: why a robot would have to hold.
        """

    def link(self) -> str:
        """Write the session as a text for an address."""
        return self.session.encode()

    def keep(self, name: str, folder: Path) -> Callable[[], Path]:
        """Prepare a file about the session as it is now.

        Args:
            name: one of `keeps`.
            folder: the folder to write to.

        Returns:
            A function that writes the file, in any thread, and returns it.
        """
        session = copy.copy(self.session)
        session.ticks, session.crawler = session.ticks[: session.now + 1], session.crawler.copy()
        file = folder / f"{session.scene.name}_by_hand.{name.partition('.')[2]}"

        def write() -> Path:
            KEPT[name](session, file)
            return file

        return write

    def close(self) -> None:
        """Nothing is open."""
