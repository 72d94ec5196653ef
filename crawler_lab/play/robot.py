"""What the server shows and commands: a simulated crawler, or a robot with topics."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import CommandError, Scene

from .controls import Controls, Settings
from .view import Instant, View

_MARKS = {0: ".", 1: "f", -1: "b", 2: "x"}
PAST = 1000
"""Number of past states that a new page receives."""


class Robot(ABC):
    """A crawler that pages show, and that the page in control commands."""

    keeps: tuple[str, ...] = ()
    simulated = False

    def __init__(self, scene: Scene) -> None:
        """Prepare its controls and its pictures.

        Args:
            scene: its body, ground and drive.
        """
        self.scene, self.controls, self.view = scene, Controls(scene), View(scene)

    def describe(self) -> dict[str, Any]:
        """Describe what does not change."""
        modes = [mode for mode in ("hand", "scene", "wave") if mode != "scene" or not self.scene.drive.holds]
        controls = self.controls.describe()
        about = {"controls": controls, "modes": modes, "keeps": self.keeps, "simulated": self.simulated}
        about["grips"] = self.controls.grips()
        return {**self.view.describe_scene(), **about}

    def show(self, settings: Settings, row: np.ndarray, instant: Instant) -> dict[str, Any]:
        """Describe settings and pictures.

        Args:
            settings: what a person has chosen.
            row: the command row in force without the share of the slope, shape (C,).
            instant: the crawler.

        Returns:
            The part of a frame that all robots have.
        """
        shown, led = np.array(settings.hand), self.controls.led(settings.mode)
        shown[led] = row[led]
        return {
            "mode": settings.mode,
            "wave": asdict(settings.wave),
            "slope": settings.slope,
            "values": self.controls.values(settings, shown),
            "net": np.atleast_1d(self.scene.body.share @ instant.displacement).tolist(),
            **self.view.describe(instant),
        }

    def write_past(self, time: float, net: Any, state: np.ndarray) -> list[Any]:
        """Write a past state for the page.

        Args:
            time: of the state [s].
            net: net translation, in the plane shape (2,) [m].
            state: how each contact slid, shape (N,).

        Returns:
            The time, the net translation along each axis, and a letter for each shown contact: f forward, b back,
            x both, . held.
        """
        marks = "".join(_MARKS[int(one)] for one in state[self.view.shown])
        return [time, np.atleast_1d(net).tolist(), marks]

    @property
    @abstractmethod
    def place(self) -> tuple[Any, ...]:
        """What a frame depends on: with equal places, frames are equal."""

    @abstractmethod
    def frame(self) -> dict[str, Any]:
        """Describe the present instant."""

    @abstractmethod
    def past(self, known: tuple[Any, ...] | None) -> tuple[bool, list[list[Any]]]:
        """List the past states that a page does not know.

        Args:
            known: `place` when it was last sent states; None for a new page.

        Returns:
            Whether it has to forget those that it knows, and the states, as of `write_past`.
        """

    @abstractmethod
    def advance(self, seconds: float) -> None:
        """Let real time pass.

        Args:
            seconds: real time [s].
        """

    @abstractmethod
    def receive(self, message: dict[str, Any]) -> None:
        """Obey a message of the page in control.

        Args:
            message: "set", "mode", "wave" as for `Controls.change`, "play", "speed", and for a simulated crawler
                "step", "seek", "undo" and "restore".

        Raises:
            CommandError: if a value is out of range.
        """

    def open_lesson(self, name: str) -> Robot:
        """Prepare the robot of a lesson, in any thread.

        Args:
            name: of the lesson.

        Raises:
            CommandError: always, because only simulated crawlers have lessons.
        """
        raise CommandError(f"lesson: {name}; only a simulated crawler opens lessons, start it without --ros")

    def hold(self, reason: str) -> None:  # noqa: B027
        """Stop, as the page in control is lost; a simulated crawler goes on, and loses nothing.

        Args:
            reason: why.
        """

    def link(self) -> str:
        """Write the state as a text for an address.

        Raises:
            CommandError: if it cannot be put into a state.
        """
        raise CommandError("link: only a simulated crawler can be put into a state; start it without --ros")

    def keep(self, name: str, folder: Path) -> Callable[[], Path]:
        """Prepare a file about the session as it is now.

        Args:
            name: one of `keeps`.
            folder: the folder to write to.

        Raises:
            CommandError: always, because robots record their own runs.
        """
        raise CommandError(f"{name}: a robot records its own run")
