"""A simulated crawler in the hands of a person: it ticks, remembers every tick, and returns to any of them."""

from __future__ import annotations

import base64
import binascii
import copy
import hashlib
import json
import time
import zlib
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from crawler_model import CommandError, Crawler, Scene
from crawler_model.motion.jump import Jump
from crawler_model.run.ticks import DEFAULT_RATE, rational_rate, tick_end_ns

from .controls import Clock, Controls, Settings

MOST_TICKS = 360_000
"""Number of ticks that are remembered: an hour at 100 Hz."""
_MOST_BYTES = 1 << 26
"""Largest size of an unpacked link."""
_KEPT = 100
"""Ticks between stored copies of the crawler; the ticks after a copy are followed again."""


@dataclass(frozen=True, eq=False)
class Tick:
    """A tick that was followed.

    Attributes:
        settings: what led to it.
        clock: at its end.
        ends_ns: times of the ends of its ramps after its start, shape (V,) [ns].
        rows: command rows there, as followed, shape (V, C).
        base: the last of them without the share of the slope, shape (C,).
        state: of each contact, 1 slid forward (in the plane: slid), -1 back, 2 both, 0 held, shape (N,).
        spent: work of the actuators, dissipation and energy lost in jumps since the start, shape (3,) [J].
        net: net translation at its end, in the plane shape (2,) [m].
        unique: whether the translation was determined.
        jumps: of contacts onto ground that holds less.
    """

    settings: Settings
    clock: Clock
    ends_ns: np.ndarray
    rows: np.ndarray
    base: np.ndarray
    state: np.ndarray
    spent: np.ndarray
    net: Any
    unique: bool
    jumps: tuple[Jump, ...]


class Session:
    """A crawler, its settings, and all ticks since its start."""

    def __init__(self, scene: Scene, rate: float = DEFAULT_RATE) -> None:
        """Start a session at rest.

        Args:
            scene: the scene.
            rate: ticks per simulated second [Hz].

        Raises:
            CommandError: if the rate is out of range.
        """
        self.scene, self.rate = scene, rational_rate(rate)
        self.controls = Controls(scene)
        self.settings = self.controls.start()
        self.playing, self.speed, self.error = False, 1.0, ""
        self.changed = 0
        """Number of times that the past changed: what a page knows of it is then out of date."""
        self._debt = 0.0
        row = scene.drive.rows[0]
        self.crawler = Crawler(scene)
        state = np.zeros(scene.body.contacts, np.int8)
        first = Tick(
            settings=self.settings,
            clock=Clock(),
            ends_ns=np.zeros(0, np.int64),
            rows=row[None],
            base=row,
            state=state,
            spent=np.zeros(3),
            net=self.crawler.net_translation,
            unique=True,
            jumps=(),
        )
        self.ticks = [first]
        self.now = 0
        self._kept = [self.crawler.copy()]

    @property
    def tick(self) -> Tick:
        """The last tick up to the present instant."""
        return self.ticks[self.now]

    @property
    def time_ns(self) -> int:
        """Simulated time [ns]."""
        return tick_end_ns(self.now, self.rate)

    @property
    def target(self) -> np.ndarray:
        """The target in force, shape (S + 2 N,)."""
        return self.scene.columns.target(self.tick.rows[-1])

    def change(self, message: dict[str, Any]) -> None:
        """Change settings; while the time stands still and the hand leads, the body follows in one tick.

        Args:
            message: as for `Controls.change`.

        Raises:
            CommandError: if a value is out of range, or no equilibrium holds it; nothing changes then.
        """
        before = self.settings
        given = before if "mode" not in message else self.controls.take_over(before, self.tick.base)
        self.settings = self.controls.change(given, message)
        if not self.playing and self.settings.mode == "hand" and "set" in message:
            try:
                self.step()
            except CommandError:
                self.settings = before
                raise

    def step(self) -> None:
        """Follow one tick; the ticks beyond the present instant are forgotten.

        Raises:
            CommandError: if no equilibrium holds the command, or the memory is full; the state does not change.
        """
        if self.now >= MOST_TICKS:
            raise CommandError(f"{MOST_TICKS} ticks are remembered at most; save what you found and reset")
        ns = tick_end_ns(self.now + 1, self.rate) - self.time_ns
        ends, base, clock = self.controls.advance(self.settings, self.tick.clock, ns)
        rows = self.controls.tilt(base, self.settings.slope)
        step, state = self._follow(rows)
        if self.now + 1 < len(self.ticks):
            del self.ticks[self.now + 1 :], self._kept[self.now // _KEPT + 1 :]
            self.changed += 1
        spent = self.tick.spent + np.array([step.work, step.dissipation, step.jump_loss])
        self.ticks.append(
            Tick(
                settings=self.settings,
                clock=clock,
                ends_ns=ends,
                rows=rows,
                base=base[-1],
                state=state,
                spent=spent,
                net=self.crawler.net_translation,
                unique=step.unique,
                jumps=step.jumps,
            )
        )
        self.now += 1
        if self.now % _KEPT == 0:
            self._kept.append(self.crawler.copy())

    def _follow(self, rows: np.ndarray) -> tuple[Any, np.ndarray]:
        """Follow the ramps to some rows; return their account and how each contact slid."""
        columns = self.scene.columns
        self.controls.check(rows)
        targets = np.array(columns.target(rows))
        for target in targets:
            columns.check_equilibrium(target, "command", CommandError)
        step = self.crawler.follow(targets)
        return step, self.crawler.contact_state.copy()

    def seek(self, tick: int) -> None:
        """Return to an instant, or go forward to one that was left; the state is the same to the bit.

        Args:
            tick: its number, 0 .. the number of ticks followed.

        Raises:
            CommandError: if there is no such tick.
        """
        if not 0 <= tick < len(self.ticks):
            raise CommandError(f"seek: tick {tick}; it must be between 0 and {len(self.ticks) - 1}")
        kept = min(tick // _KEPT, len(self._kept) - 1)
        self.crawler = self._kept[kept].copy()
        for k in range(kept * _KEPT + 1, tick + 1):
            self._follow(self.ticks[k].rows)
        self.now, self.settings, self.playing = tick, self.ticks[tick].settings, False
        self.changed += 1

    def undo(self) -> None:
        """Return to the instant before the last change of the settings, or to the start."""
        if self.settings != self.tick.settings:
            self.settings = self.tick.settings
            return
        same = (k for k in range(self.now, 0, -1) if self.ticks[k - 1].settings is not self.ticks[k].settings)
        self.seek(max(next(same, 0) - 1, 0))

    def run(self, seconds: float, most: float = 0.025) -> None:
        """Follow the ticks of a stretch of real time, if the crawler plays.

        Args:
            seconds: real time that passed [s].
            most: real time after which it stops, and the simulation becomes slower than it should be [s].
        """
        if not self.playing:
            self._debt = 0.0
            return
        self._debt += seconds * self.speed * float(self.rate)
        began = time.perf_counter()
        try:
            while self._debt >= 1.0:
                self.step()
                self._debt -= 1.0
                if time.perf_counter() - began > most:
                    self._debt = min(self._debt, 1.0)
        except CommandError as error:
            self.settings, self.playing, self.error = self.tick.settings, False, str(error)

    def encode(self) -> str:
        """Write all settings of the session, with the ticks at which they changed, as a text for an address.

        Returns:
            The text, of letters, digits, "-" and "_".
        """
        changes, before = [], self.ticks[0].settings
        moments = [(k - 1, self.ticks[k].settings) for k in range(1, self.now + 1)] + [(self.now, self.settings)]
        for tick, settings in moments:
            if settings is before or settings == before:
                continue
            hand = {i: v for i, (v, old) in enumerate(zip(settings.hand, before.hand, strict=True)) if v != old}
            changes.append([tick, settings.mode, hand, list(asdict(settings.wave).values()), settings.slope])
            before = settings
        told = {"scene": self._digest(), "rate": str(self.rate), "ticks": self.now, "changes": changes}
        return base64.urlsafe_b64encode(zlib.compress(json.dumps(told).encode(), 9)).decode().rstrip("=")

    def restore(self, text: str) -> None:
        """Repeat a session from its text; afterwards the state is the same to the bit.

        Args:
            text: as from `encode`.

        Raises:
            CommandError: if it is damaged, or belongs to another scene or rate; the session does not change.
        """
        try:
            packed = base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
            told = json.loads(zlib.decompressobj().decompress(packed, _MOST_BYTES))
            ticks, changes = int(told["ticks"]), list(told["changes"])
            scene, rate = told["scene"], told["rate"]
        except (binascii.Error, zlib.error, ValueError, KeyError, TypeError, OverflowError, RecursionError):
            raise CommandError("link: it is damaged; copy it completely") from None
        if scene != self._digest():
            raise CommandError(f"link: it belongs to another scene than {self.scene.name}; start that one")
        if rate != str(self.rate) or not 0 <= ticks <= MOST_TICKS:
            raise CommandError(
                f"link: {ticks} ticks at {rate} Hz; this session runs at {self.rate} Hz: use --rate {rate}"
            )
        repeated = copy.copy(self)
        repeated.ticks, repeated._kept = self.ticks[:1], self._kept[:1]
        repeated.seek(0)
        try:
            for tick, mode, hand, wave, slope in [*changes, [ticks, None, {}, [], 0.0]]:
                while repeated.now < min(tick, ticks):
                    repeated.step()
                if mode is not None:
                    repeated._set(mode, dict(hand), wave, slope)
        except (TypeError, ValueError, IndexError, OverflowError):
            raise CommandError("link: it is damaged; copy it completely") from None
        vars(self).update(vars(repeated))

    def _set(self, mode: Any, hand: dict[str, float], wave: list[float], slope: float) -> None:
        """Set settings from a text, with the checks that settings of a page pass."""
        names = asdict(self.settings.wave)
        given = self.controls.change(self.settings, {"mode": mode, "wave": dict(zip(names, wave, strict=True))})
        row = list(given.hand)
        for column, value in hand.items():
            row[int(column)] = float(value)
        self.settings = replace(given, hand=tuple(row), slope=float(slope))

    def _digest(self) -> str:
        document = json.dumps(self.scene.document(), sort_keys=True)
        return hashlib.sha256(document.encode()).hexdigest()[:16]
