"""What a person can move in a scene: its controls with limits and units, and the command row that they add up to."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal, get_args

import numpy as np

from crawler_model import CommandError, Scene
from crawler_model.body.drive import wave
from crawler_model.body.turning import check_sides
from crawler_model.errors import LARGEST

from .sliders import SLOPE, list_controls, plain_name, round_up

Mode = Literal["hand", "scene", "wave"]
_STEEPEST, _FASTEST = 60.0, 100.0


@dataclass(frozen=True)
class Wave:
    """A travelling wave of lengths, strains or angles.

    Attributes:
        amplitude: of the wave [m, 1, rad].
        mean: its mean value [m, 1, rad].
        wavelength: not 0; positive for a wave towards +x [m].
        period: > 0 [s].
        phase: part of a period by which it is ahead [1].
    """

    amplitude: float
    mean: float
    wavelength: float
    period: float
    phase: float = 0.0


@dataclass(frozen=True)
class Settings:
    """All that a person has chosen at an instant.

    Attributes:
        mode: who leads: the "hand", the drive of the "scene", or the "wave". What the leader does not move follows the
            hand.
        hand: the command row set by hand, shape (C,).
        wave: parameters of the wave.
        slope: of the ground [degrees].
    """

    mode: Mode
    hand: tuple[float, ...]
    wave: Wave
    slope: float


@dataclass(frozen=True)
class Clock:
    """How far the leaders have come; neither moves while the hand leads.

    Attributes:
        drive_ns: time within the drive of the scene [ns].
        turns: number of periods of the wave [1].
    """

    drive_ns: int = 0
    turns: float = 0.0


class Controls:
    """The controls of a scene, and how settings become command rows."""

    def __init__(self, scene: Scene) -> None:
        """Find what can be controlled.

        Args:
            scene: the scene.
        """
        self.scene, rows = scene, scene.drive.rows
        self._driven = np.flatnonzero((rows != rows[0]).any(axis=0))
        self._waved, self._places, self._shares = _find_wave(scene, self._driven)
        self._weights, self._by_weight = _find_weights(scene)
        self.controls = {control.name: control for control in list_controls(scene, self._weights.size > 0)}

    def start(self) -> Settings:
        """Choose the settings at the start: the drive of the scene leads, without one the hand."""
        scene = self.scene
        mode: Mode = "hand" if scene.drive.holds else "scene"
        slope = math.degrees(float(scene.ground.slope))
        return Settings(mode, tuple(scene.drive.rows[0].tolist()), self._first_wave(), slope)

    def _first_wave(self) -> Wave:
        """Take the wave of the scene; without one a wave that is as long as the body."""
        part = self.scene.parts.drive
        if part is not None and part.wave is not None:
            given = part.wave
            return Wave(given.amplitude, given.mean, given.wavelength, given.period)
        rows = self.scene.drive.rows[:, self._waved]
        reach = float(np.ptp(rows)) / 2.0 if rows.size else 0.0
        length = float(np.ptp(self._places)) if self._places.size else 0.0
        most = next((c.most for c in self.controls.values() if c.kind == "actuation"), 1.0)
        return Wave(reach or most / 4.0, 0.0, round_up(length) if length > 0.0 else 1.0, self.scene.drive.period or 1.0)

    def change(self, settings: Settings, message: Mapping[str, Any]) -> Settings:
        """Change settings by a message of the page.

        Args:
            settings: those before.
            message: any of "set" (numbers by the name of a control), "mode" and "wave" (numbers by name).

        Returns:
            The settings after.

        Raises:
            CommandError: if a name is unknown or a value is out of range.
        """
        hand, slope = list(settings.hand), settings.slope
        for name, value in _mapping(message, "set").items():
            if name not in self.controls:
                raise CommandError(f"{name}: no such control; the controls are {', '.join(self.controls)}")
            control, number = self.controls[name], _number(name, value)
            if control.kind == SLOPE:
                if not abs(number) <= _STEEPEST:
                    raise CommandError(
                        f"slope: {number:g} degrees; it must be between -{_STEEPEST:g} and {_STEEPEST:g}"
                    )
                slope = number
            for column in control.columns:
                hand[column] = number
        mode = message.get("mode", settings.mode)
        if mode not in get_args(Mode):
            raise CommandError(f"mode: {mode!r}; it must be one of {', '.join(get_args(Mode))}")
        if mode == "scene" and self.scene.drive.holds:
            raise CommandError(f"mode: scene; {self.scene.name} has {self.scene.unmoving_drive}, use hand or wave")
        return Settings(mode, tuple(hand), _change_wave(settings.wave, _mapping(message, "wave")), slope)

    def led(self, mode: Mode) -> np.ndarray:
        """Find the columns that the leader moves.

        Args:
            mode: who leads.

        Returns:
            The columns, shape (K,).
        """
        return {"hand": self._driven[:0], "scene": self._driven, "wave": self._waved}[mode]

    def take_over(self, settings: Settings, row: np.ndarray) -> Settings:
        """Hand the columns that the leader moves to the hand, with the values that they have.

        Args:
            settings: those before.
            row: the command row without the share of the slope, shape (C,).

        Returns:
            The settings, with the values of the leader in the hand's place.
        """
        hand, led = np.array(settings.hand), self.led(settings.mode)
        hand[led] = row[led]
        return replace(settings, hand=tuple(hand.tolist()))

    def advance(self, settings: Settings, clock: Clock, ns: int) -> tuple[np.ndarray, np.ndarray, Clock]:
        """Compute the command rows of a tick.

        Args:
            settings: what a person has chosen.
            clock: how far the leaders are at its start.
            ns: its duration [ns].

        Returns:
            The times of the ends of its straight ramps after its start, the last one `ns`, shape (V,) [ns]; the rows
            there without the share of the slope, shape (V, C); and the clock at its end.
        """
        drive, ends = self.scene.drive, np.array([ns])
        if settings.mode == "scene":
            end = clock.drive_ns + ns
            ways, way_rows = drive.waypoints_between(clock.drive_ns, end)
            ends = np.union1d(ways, [end])
            moved = drive.sample_rows(ends)
            moved[np.searchsorted(ends, ways)] = drive.rows[way_rows]
            ends, clock = ends - clock.drive_ns, replace(clock, drive_ns=end)
        rows = np.tile(np.array(settings.hand), (ends.size, 1))
        if settings.mode == "scene":
            rows[:, self._driven] = moved[:, self._driven]
        elif settings.mode == "wave":
            given = settings.wave
            clock = replace(clock, turns=clock.turns + ns / 1e9 / given.period)
            turns = np.array([clock.turns + given.phase])
            rows[:, self._waved] = self._shares * wave(
                given.mean, given.amplitude, given.wavelength, turns, self._places
            )
        return ends, rows, clock

    def tilt(self, rows: np.ndarray, slope: float) -> np.ndarray:
        """Add what a slope changes compared with the scene's.

        A slope acts as loads -w sin(theta), and on friction that follows from the weight by the factor cos(theta).

        Args:
            rows: command rows, shape (V, C).
            slope: of the ground [degrees].

        Returns:
            Rows of the same shape.
        """
        before, now = float(self.scene.ground.slope), math.radians(slope)
        if self._weights.size == 0 or slope == math.degrees(before):
            return rows
        tilted = rows.copy()
        tilted[:, -self._weights.size :] += self._weights * (math.sin(before) - math.sin(now))
        tilted[:, self._by_weight] *= math.cos(now) / math.cos(before)
        return tilted

    def check(self, rows: np.ndarray) -> None:
        """Check command rows.

        Args:
            rows: shape (V, C).

        Raises:
            CommandError: if a value is not finite or too large, or a friction is negative or, if the body turns, far
                from others.
        """
        columns = self.scene.columns
        for column in np.flatnonzero(~(np.abs(rows) <= LARGEST).all(axis=0))[:1]:
            value = rows[np.abs(rows[:, column]).argmax(), column]
            raise CommandError(f"{columns.names[column]}: {value:g}; it must be at most {LARGEST:g} in size")
        friction = rows[:, columns.lengths :][:, : columns.frictions]
        for k in np.flatnonzero((friction < 0.0).any(axis=0))[:1]:
            raise CommandError(
                f"{columns.names[columns.lengths + k]}: {friction[:, k].min():g} N; friction must be >= 0"
            )
        if columns.joints is not None:
            for row in friction:
                check_sides(row.reshape(columns.contacts, -1), "friction", CommandError)

    def describe(self) -> list[dict[str, Any]]:
        """List the controls for the page."""
        driven, waved = set(self._driven.tolist()), set(self._waved.tolist())
        return [
            {
                **asdict(control),
                "title": plain_name(control.name),
                "driven": bool(driven & set(control.columns)),
                "waved": bool(waved & set(control.columns)),
            }
            for control in self.controls.values()
        ]

    def grips(self) -> list[tuple[list[str], float]]:
        """Find what pulls at each spring.

        Returns:
            For each spring the names of the controls of its length, of a vector spring those of both components, and
            the length by which all that they move grows per unit of them [m]. No names where a body that turns has a
            spring that neither its drive nor a wave moves: it is a rod.
        """
        body, columns = self.scene.body, self.scene.columns
        names = {column: control.name for control in self.controls.values() for column in control.columns}
        each = body.lengths // body.springs if body.turning is None else 1
        index, factor = columns.index[: body.springs * each], columns.factor[: body.springs * each]
        moved = set(self._driven.tolist()) | set(self._waved.tolist()) if body.turning is not None else set(names)
        found = []
        for k in range(body.springs):
            own = [int(column) for column in index[each * k : each * (k + 1)] if int(column) in moved]
            reach = float(factor[index == own[0]].sum()) if own else 1.0
            found.append(([names[column] for column in own], reach))
        return found

    def values(self, settings: Settings, row: np.ndarray) -> list[float]:
        """Read the controls.

        Args:
            settings: what a person has chosen.
            row: the command row without the share of the slope, shape (C,).

        Returns:
            The value of each control, in order; for one that sets several columns, the value of the first.
        """
        return [settings.slope if c.kind == SLOPE else float(row[c.columns[0]]) for c in self.controls.values()]


def _mapping(message: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    given = message.get(key, {})
    if not isinstance(given, dict):
        raise CommandError(f"{key}: {given!r}; it must be a mapping of numbers by name")
    return given


def _number(name: str, value: Any) -> float:
    try:
        if not isinstance(value, bool) and isinstance(value, (int, float)) and math.isfinite(value):
            return float(value)
    except OverflowError:  # an integer beyond all doubles
        pass
    raise CommandError(f"{name}: {value!r}; it must be a finite number")


def read_speed(value: Any) -> float:
    """Check a speed.

    Args:
        value: simulated seconds per second, as a page sent it.

    Returns:
        The speed [1].

    Raises:
        CommandError: if it is out of range.
    """
    speed = _number("speed", value)
    if not 0.0 < speed <= _FASTEST:
        raise CommandError(f"speed: {speed:g}; it must be above 0 and at most {_FASTEST:g}")
    return speed


def _change_wave(given: Wave, changes: Mapping[str, Any]) -> Wave:
    names = [f.name for f in fields(Wave)]
    for name, value in changes.items():
        if name not in names:
            raise CommandError(f"wave: {name}; a wave has {', '.join(names)}")
        number = _number(f"wave {name}", value)
        if (name == "period" and number <= 0.0) or (name == "wavelength" and number == 0.0):
            raise CommandError(f"wave {name}: {number:g}; it must be {'> 0' if name == 'period' else 'not 0'}")
        given = replace(given, **{name: number})
    return given


def _find_wave(scene: Scene, driven: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the columns that a wave moves, their places along the body [m] and their shares.

    Of a body with joints these are the joints, or if the drive moves links and no joints, the links that it moves.
    Joints of a single hub are taken as if they were 1 m apart.
    """
    body, columns = scene.body, scene.columns
    middle = 0.5 * (body.position[body.ends[:, 0]] + body.position[body.ends[:, 1]])
    if columns.joints:
        assert body.turning is not None
        links = driven[driven < body.springs]
        if links.size and not (driven >= body.springs).any():
            return links, middle[links, 0], np.ones(links.size)
        at = body.position[body.turning.joints[:, 1], 0]
        places = at if np.ptp(at) > 0.0 else np.arange(float(at.size))
        return np.arange(body.springs, columns.lengths), places, np.ones(at.size)
    if body.dimension == 1:
        found = scene.columns.index[: body.springs]
        spring = np.array([int(np.flatnonzero(found == c).mean()) for c in range(columns.lengths)], dtype=np.int64)
        return np.arange(columns.lengths), middle[spring], np.ones(columns.lengths)
    if body.turning is not None:
        return np.arange(body.springs), middle[:, 0], np.ones(body.springs)
    along = body.position[body.ends[:, 1]] - body.position[body.ends[:, 0]]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    return np.arange(2 * body.springs), np.repeat(middle[:, 0], 2), along.ravel()


def _find_weights(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Find the weight behind each load column, and the friction columns that follow from the weight."""
    body, columns, ground = scene.body, scene.columns, scene.ground
    none = np.zeros(0), np.zeros(0, np.int64)
    if body.shares_contacts:
        return none  # a contact that parts share has a weight that belongs to none of them
    weight = ground.weight / body.ground
    firsts = np.array([*body.isolated, *(s.first for s in body.segments)], dtype=np.int64)
    if not columns.loads or not weight.any():
        return none
    if any(np.ptp(weight[s.contacts]) > 1e-12 * weight.max() for s in body.segments):
        return none  # the weight varies along the segment, its load does not
    by_weight = np.repeat(ground.by_coefficient[firsts], columns.friction_sizes)
    friction = columns.lengths + np.flatnonzero(np.tile(by_weight, columns.sides))
    if ground.direction is None:
        return weight[firsts], friction
    uphill = np.array([math.cos(ground.direction), math.sin(ground.direction)])
    return np.outer(weight[firsts], uphill).ravel(), friction
