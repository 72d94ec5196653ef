"""What actuators make of commands: limited rates, a lag, steps, and some that are stuck."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from crawler_model import CommandError, Scene

from .intake.commanded_path import Vertices
from .intake.limits import lengths_of_columns

_ARRIVED = 1e-9
"""Distance below which a lag ends [m, rad]."""


class Actuators:
    """Actuators of the links, segments and joints of a body; what they do takes the place of what is commanded.

    Between two vertices of the commands an actuator moves towards the later one: without a lag at once, else by
    1 - exp(-t / lag) of the way that is left after a time t, and never by more than its rate allows.
    """

    def __init__(self, scene: Scene, parameters: Mapping[str, Any]) -> None:
        """Start where the scene does.

        Args:
            scene: the scene that runs.
            parameters: the parameters of the simulator by name, of which `actuators.*` count.

        Raises:
            CommandError: if a name in `actuators.frozen` is unknown.
        """
        self._columns, self._scale = scene.columns, lengths_of_columns(scene)
        self._rate, self._lag, self._step = (float(parameters[f"actuators.{name}"]) for name in ("rate", "lag", "step"))
        self._frozen = self._read_names(parameters["actuators.frozen"])
        self.reset(scene.drive.rows[0])

    def reset(self, row: np.ndarray) -> None:
        """Return to a row of commands, at which all actuators are.

        Args:
            row: shape (C,).
        """
        self._commanded = row
        self._place = row[: self._scale.size].copy()  # before it is rounded to steps
        self.row = self._rounded()
        """What the actuators did last, with the friction and the loads in force, shape (C,)."""
        self._judge()

    def _judge(self) -> None:
        ideal = self._rate == self._lag == self._step == 0.0 and not self._frozen.any()
        self.are_ideal = ideal and bool((self._place == self._commanded[: self._place.size]).all())
        """Whether they do what is commanded, so that `move` is not needed."""

    def freeze(self, names: str, in_force: np.ndarray) -> None:
        """Let actuators stick where they are, and all others move.

        Args:
            names: of links, segments and joints, separated by commas.
            in_force: the row of commands in force, at which ideal ones are, shape (C,).

        Raises:
            CommandError: if a name is unknown.
        """
        self._frozen = self._read_names(names)
        if self.are_ideal:
            self.reset(in_force)
        self._judge()

    def _read_names(self, names: str) -> np.ndarray:
        frozen = np.zeros(self._scale.size, np.bool_)
        known = {name: at for name, at in self._columns.aliases.items() if at[0] < frozen.size}
        for name in filter(None, (name.strip() for name in names.split(","))):
            if name not in known:
                raise CommandError(f"actuators.frozen: {name!r}; the actuators are {', '.join(known)}")
            frozen[known[name]] = True
        return frozen

    def move(self, taken: Vertices) -> Vertices:
        """Move through ticks.

        Args:
            taken: what is commanded in them.

        Returns:
            What the actuators do: a vertex for each one commanded, and one at the end of each tick in which they still
            move; without those that repeat the row before them.
        """
        due_ns, rows, first = list[int](), list[np.ndarray](), [0]
        times_ns, vertices = taken.times_ns.tolist(), taken.first.tolist()
        for tick, end_ns in enumerate(times_ns[1:]):
            now_ns = times_ns[tick]
            steps = [(int(taken.due_ns[v]), taken.rows[v]) for v in range(vertices[tick], vertices[tick + 1])]
            for next_ns, commanded in (*steps, (end_ns, None)):
                if commanded is not None:
                    self._commanded = commanded
                self._advance(max(next_ns - now_ns, 0) / 1e9)
                now_ns = max(next_ns, now_ns)
                row = self._rounded()
                if row.tobytes() != self.row.tobytes():
                    due_ns.append(now_ns)
                    rows.append(row)
                    self.row = row
            first.append(len(due_ns))
        self._judge()
        found = np.array(rows) if rows else np.empty((0, self.row.size))
        return Vertices(taken.times_ns, np.array(due_ns, np.int64), found, np.array(first), taken.ended)

    def _advance(self, seconds: float) -> None:
        place, goal = self._place, self._commanded[: self._place.size]
        if self._lag:
            near = np.abs(goal - place) * self._scale < _ARRIVED
            goal = np.where(near, goal, goal + (place - goal) * math.exp(-seconds / self._lag))
        if self._rate:
            most = self._rate * seconds / self._scale
            goal = np.where(np.abs(goal - place) <= most, goal, place + np.copysign(most, goal - place))
        self._place = np.where(self._frozen, place, goal)

    def _rounded(self) -> np.ndarray:
        row = self._commanded.copy()
        row[: self._place.size] = self._place
        if self._step:
            step = self._step / self._scale
            row[: self._place.size] = step * np.rint(self._place / step)
        return row
