"""New simulation of a recording's commands: every ramp with its account, compared with the recorded states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from crawler_model import Crawler
from crawler_model.body.drive import NS
from crawler_model.crawler.readout import Readout
from crawler_model.run.account import tolerance_of

from ..recording import bag
from ..recording.layouts import JOINT_STATE, POSE, TRAJECTORY, Decoder
from ..recording.recorded_robot import Robot
from ..wire.states import contact_names, joint_state_names, shown_contacts
from .health import Survey, next_tick_ns
from .ramp_rows import RampRows
from .ramps import Sink

_MOST_WAITING = 20_000
_ROUNDING = 1e-9
"""Differences up to this part of the largest number are taken for rounding, which grows along a run; in the plane those
up to the tolerance of the scene, as other roundings there lead to other steps."""
_LEDGER, _JOINTS = "applied_commands", "joint_states"
_STATES = {_JOINTS: JOINT_STATE, "contact_states": JOINT_STATE, "pose": POSE}
_AXES = ("x", "y", "z", *(f"orientation.{axis}" for axis in "xyzw"))


@dataclass
class Comparison:
    """The differences between recorded and simulated states.

    Attributes:
        ticks: number of states compared.
        resets: number of times that simulated time returned to 0.
        max_difference: largest difference of a displacement or elongation [m].
        max_force_difference: largest difference of a force [N].
        max_length: largest displacement or elongation recorded [m].
        max_force: largest force recorded [N].
        first_difference: simulated time of the first difference [s]; None when there is none.
        first_where: the joint, its quantity, recorded and simulated value there.
        unmatched: number of recorded states without a simulated one.
        stopped: why the ledger could not be followed to its end; "" when it could.
        missing: number of ticks whose ledger message is missing.
        missing_at: simulated time of the first of them [s]; None when there is none.
        duplicates: number of repeated ledger messages; each was followed once.
        rounding: part of the largest number below which differences are taken for rounding [1].
    """

    ticks: int = 0
    resets: int = 0
    max_difference: float = 0.0
    max_force_difference: float = 0.0
    max_length: float = 0.0
    max_force: float = 0.0
    first_difference: float | None = None
    first_where: str = ""
    unmatched: int = 0
    stopped: str = ""
    missing: int = 0
    missing_at: float | None = None
    duplicates: int = 0
    rounding: float = _ROUNDING

    @property
    def identical(self) -> bool:
        """Whether every number compared has the same bits."""
        return self.ticks > 0 and self.first_difference is None

    @property
    def equal(self) -> bool:
        """Whether all lengths and forces are the same up to rounding."""
        lengths = self.max_difference <= self.rounding * self.max_length
        return self.ticks > 0 and lengths and self.max_force_difference <= self.rounding * self.max_force


@dataclass(eq=False)
class _Unpaired:
    """States that wait for their counterparts: keys and numbers."""

    keys: list[tuple[int, int]] = field(default_factory=list)
    numbers: list[np.ndarray] = field(default_factory=list)


class Resimulation:
    """Follows the ledger of a recording and compares the states."""

    def __init__(
        self,
        survey: Survey,
        robot: Robot,
        start: Crawler,
        rate: Fraction | None,
        sinks: Sequence[Sink],
        begin: tuple[Crawler, int],
    ) -> None:
        """Prepare the simulation at its start.

        Args:
            survey: survey of the recording.
            robot: the crawler.
            start: the crawler at simulated time 0, where it returns to when it is reset.
            rate: ticks per second [Hz].
            sinks: callables that receive every ramp.
            begin: the crawler where the recording begins, and its simulated time, before which ledger messages are
                skipped [ns].
        """
        self.comparison = Comparison(rounding=max(_ROUNDING, tolerance_of(start.scene)))
        self._survey, self._rate, self._sinks = survey, rate, sinks
        self._start, self._crawler, self._begin_ns = start, begin[0].copy(), begin[1]
        scene = start.scene
        self._scene, self._body = scene, scene.body
        self._shown = shown_contacts(scene.body)
        self._readout = Readout(scene.body, self._shown)
        self._widths = len(joint_state_names(scene.body)), len(contact_names(scene.body))
        self._row = self._crawler.row
        self._target = scene.columns.target(self._row)
        self._run, self._last_ns, self._ticked = 0, self._begin_ns - 1, False
        self._end_ns = self._begin_ns
        self._waiting = {name: (_Unpaired(), _Unpaired()) for name in _STATES}
        self._decoders = {
            name: Decoder(robot.recorded(name), kind)
            for name, kind in {_LEDGER: TRAJECTORY, **_STATES}.items()
            if robot.recorded(name) in survey.topics
        }

    def run(self, progress: Callable[[float], None] | None = None) -> Comparison:
        """Read the recording once and simulate it.

        Args:
            progress: called with the fraction done, in [0, 1].

        Returns:
            The comparison.

        Raises:
            BagError: when the joints of the recording and of the scene differ.
        """
        head = bag.Bag({})
        self._send_start()
        for block in bag.read_blocks(self._survey.path, head, progress):
            self._add_block(block, head)
            if self.comparison.stopped:
                break
        self.comparison.unmatched += sum(len(theirs.keys) for _, theirs in self._waiting.values())
        return self.comparison

    def _add_block(self, block: bag.Block, head: bag.Bag) -> None:
        places = {name: head.find(block, decoder.topic) for name, decoder in self._decoders.items()}
        read = {name: self._decoders[name].read(block, which) for name, which in places.items() if which.size}
        self._check_names()
        resets = self._find_resets(places, read)
        for name in _STATES:
            for at, times, numbers in read.get(name, []):
                where = places[name][at]
                runs = self._run + np.searchsorted(resets, where, side="right")
                self._store(name, 1, runs, times[:, 0], np.stack(numbers, axis=1))
        self._follow_block(places.get(_LEDGER, np.zeros(0, np.int64)), read.get(_LEDGER, []), resets)
        for name in _STATES:
            self._compare(name)

    def _check_names(self) -> None:
        wanted = {
            _LEDGER: self._scene.columns.names,
            _JOINTS: tuple(joint_state_names(self._body)),
            "contact_states": tuple(contact_names(self._scene.body)),
            "pose": (),
        }
        for name, decoder in self._decoders.items():
            if decoder.names is not None and decoder.names != wanted[name] and (decoder.names or name != _LEDGER):
                raise bag.BagError(
                    f"{self._survey.path}: {decoder.topic} has {', '.join(decoder.names[:5])}, the scene "
                    f"{self._scene.name} {', '.join(wanted[name][:5])}: this is not the recorded scene"
                )

    def _find_resets(self, places: dict[str, np.ndarray], read: dict[str, list[Any]]) -> np.ndarray:
        """Find where in a block simulated time returns to 0: at a state of time 0 after ticks."""
        ledger = places.get(_LEDGER, np.zeros(0, np.int64))
        found: list[int] = []
        if _JOINTS in self._decoders:
            groups = read.get(_JOINTS, [])
            zero = np.sort(np.concatenate([places[_JOINTS][at[t[:, 0] == 0]] for at, t, _ in groups] or [ledger[:0]]))
            before, ticked = 0, self._ticked
            for place in zero.tolist():
                ticks = int(np.searchsorted(ledger, place))
                if ticked or ticks > before:
                    found.append(place)
                before, ticked = ticks, False
            return np.array(found, dtype=np.int64)
        order = sorted(
            (int(ledger[i]), int(stamp))
            for at, times, _ in read.get(_LEDGER, [])
            for i, stamp in zip(at, times[:, 0], strict=True)
        )
        last = self._last_ns
        for place, stamp in order:
            if stamp == 0 and last > 0:
                found.append(place)
            last = stamp
        return np.array(found, dtype=np.int64)

    def _reset(self) -> None:
        self._crawler = self._start.copy()
        self._row = self._start.row
        self._target = self._scene.columns.target(self._start.row)
        self._run += 1
        self._begin_ns, self._last_ns, self._ticked, self._end_ns = 0, -1, False, 0
        self.comparison.resets += 1
        self._send_start()

    def _follow_block(self, places: np.ndarray, groups: list[Any], resets: np.ndarray) -> None:
        """Follow the ledger's messages of a block, in order."""
        messages: list[tuple[int, int, np.ndarray, list[np.ndarray], int]] = []
        for at, times, numbers in groups:
            for j, i in enumerate(at.tolist()):
                messages.append((int(places[i]), int(times[j, 0]), times[j, 1:], numbers, j))
        messages.sort(key=lambda m: m[0])
        turns = resets.tolist()
        rows = RampRows(self._scene, self._widths)
        for place, stamp, offsets, numbers, j in messages:
            while turns and turns[0] < place:
                turns.pop(0)
                self._send(rows)
                rows = RampRows(self._scene, self._widths)
                self._reset()
            if stamp < self._begin_ns:
                continue
            if stamp == self._last_ns:
                self.comparison.duplicates += 1
                continue
            if stamp < self._last_ns:
                self.comparison.stopped = (
                    f"the ledger's time goes back from {self._last_ns / NS:g} s to {stamp / NS:g} s without a reset"
                )
                break
            self._tick(rows, stamp, offsets, [n[j] for n in numbers])
        self._send(rows)
        for _ in turns:
            self._reset()

    def _tick(self, rows: RampRows, stamp: int, offsets: np.ndarray, points: list[np.ndarray]) -> None:
        if stamp > self._end_ns + 1:
            self.comparison.missing += max(round((stamp - self._end_ns) * float(self._rate or 0) / NS), 1)
            if self.comparison.missing_at is None:
                self.comparison.missing_at = self._end_ns / NS
        end = max(next_tick_ns(stamp, self._rate), stamp)
        crawler, before = self._crawler, stamp
        whole = crawler
        if len(points) > 1:
            # the node follows a tick in one call: its displacements are the sums over the ramps up to rounding
            whole = crawler.copy()
            whole.follow(np.array([self._scene.columns.target(np.ascontiguousarray(row)) for row in points]))
        for number, row in enumerate(points):
            target = self._scene.columns.target(np.ascontiguousarray(row))
            step = crawler.follow(target[None])
            until = min(max(stamp + int(offsets[number]), before), end)
            ends_tick = number == len(points) - 1 and until >= end - 1  # stamps are rounded
            until = end if ends_tick else until
            rows.add(self._run, before, until, ends_tick, row, target, crawler, step)
            self._row, self._target, before = row, target, until
        if not points:
            crawler.follow(self._target[None][:0])
        if before < end or not points:
            rows.add(self._run, before, end, True, self._row, self._target, crawler, None)
        rows.read(self._readout, whole, np.nan if self._begin_ns else (end - stamp) / NS)
        self._last_ns, self._end_ns, self._ticked = stamp, end, True

    def _send_start(self) -> None:
        """Send the state at the start of a run to the sinks, as a ramp without duration."""
        rows = RampRows(self._scene, self._widths)
        rows.add(self._run, self._end_ns, self._end_ns, True, self._row, self._target, self._crawler, None)
        rows.read(self._readout, self._crawler, np.nan if self._begin_ns else np.inf)
        self._send(rows)

    def _send(self, rows: RampRows) -> None:
        if not rows.run:
            return
        ends = np.array(rows.end_ns)[np.array(rows.ends_tick)]
        runs = np.array(rows.run)[np.array(rows.ends_tick)]
        states = (np.array(rows.joints), np.array(rows.contacts), np.array(rows.poses)[:, None])
        for name, numbers in zip(_STATES, states, strict=True):
            self._store(name, 0, runs, ends, numbers)
        piece = rows.piece(self._shown)
        for sink in self._sinks:
            sink(piece)

    def _store(self, name: str, side: int, runs: np.ndarray, ns: np.ndarray, numbers: np.ndarray) -> None:
        if name in self._decoders:
            waiting = self._waiting[name][side]
            waiting.keys += zip(runs.tolist(), ns.tolist(), strict=True)
            waiting.numbers.append(numbers)

    def _compare(self, name: str) -> None:
        """Compare the states whose counterparts have arrived; a bounded number of others wait."""
        ours, theirs = self._waiting[name]
        if not ours.keys or not theirs.keys:
            return
        numbers, recorded = np.concatenate(ours.numbers), np.concatenate(theirs.numbers)
        place = {key: i for i, key in enumerate(ours.keys)}
        pairs = np.array([place.get(key, -1) for key in theirs.keys])
        found = np.flatnonzero(pairs >= 0)
        if found.size:
            self._count(name, [theirs.keys[i] for i in found], numbers[pairs[found]], recorded[found])
        newest = max(theirs.keys)
        left = [i for i, key in enumerate(ours.keys) if key > newest][-_MOST_WAITING:]
        ours.keys, ours.numbers = [ours.keys[i] for i in left], [numbers[left]]
        latest = max(place)
        alone = np.flatnonzero(pairs < 0).tolist()
        rest = [i for i in alone if theirs.keys[i] > latest][-_MOST_WAITING:]
        self.comparison.unmatched += len(alone) - len(rest)
        theirs.keys, theirs.numbers = [theirs.keys[i] for i in rest], [recorded[rest]]

    def _count(self, name: str, keys: list[tuple[int, int]], ours: np.ndarray, theirs: np.ndarray) -> None:
        result = self.comparison
        if name == _JOINTS:
            result.ticks += len(keys)
        size = np.nan_to_num(np.abs(theirs), nan=0.0)
        result.max_length = max(result.max_length, float(size[:, 0].max(initial=0.0)))
        result.max_force = max(result.max_force, float(size[:, 2:].max(initial=0.0)))
        wrong = ~((ours == theirs) | (np.isnan(ours) & ~np.isnan(theirs)))
        if not wrong.any():
            return
        apart = np.nan_to_num(np.abs(ours - theirs), nan=0.0)
        result.max_difference = max(result.max_difference, float(apart[:, 0].max()))
        result.max_force_difference = max(result.max_force_difference, float(apart[:, 2:].max(initial=0.0)))
        row, quantity, place = (int(v) for v in np.argwhere(wrong)[0])
        seconds = keys[row][1] / NS
        if result.first_difference is None:
            result.first_difference = seconds
            label = ((self._decoders[name].names or ()) + _AXES)[place]
            what = ("position", "velocity", "effort")[quantity]
            pair = f"recorded {theirs[row, quantity, place]:.17g}, simulated {ours[row, quantity, place]:.17g}"
            result.first_where = f"{name} {label} {what}: {pair}"
