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
from ..wire.measured import MEASURED, MeasuredStates
from ..wire.states import contact_names, joint_state_names, shown_contacts
from .health import Survey, next_tick_ns
from .ramp_rows import RampRows
from .ramps import Sink
from .runs import LEDGER, STATES, find_runs

_MOST_WAITING = 20_000
_ROUNDING = 1e-9
"""Differences up to this part of the largest number are taken for rounding, which grows along a run; in the plane those
up to the tolerance of the scene, as other roundings there lead to other steps."""
_COMPARED = (*STATES, *MEASURED)
_KINDS = dict(zip(_COMPARED, (JOINT_STATE, JOINT_STATE, POSE, JOINT_STATE, POSE), strict=True))
_POSE = [0, 1, 5, 6]
"""Of the numbers of a pose, those that are not constant on the ground."""
_AXES = ("x", "y", "z", *(f"orientation.{axis}" for axis in "xyzw"))


@dataclass
class Comparison:
    """The differences between recorded and simulated states.

    Attributes:
        ticks: number of states compared: messages of the first topic of states that was recorded.
        compared: number of messages compared, of all topics of states.
        resets: number of times that simulated time returned to 0.
        max_difference: largest difference of a displacement or elongation [m].
        max_force_difference: largest difference of a force [N].
        max_length: largest displacement or elongation recorded [m].
        max_force: largest force recorded [N].
        first_difference: simulated time of the first difference [s]; None when there is none.
        first_where: the joint, its quantity, recorded and simulated value there.
        unmatched: number of recorded messages of states without a simulated one.
        outside: number of unmatched messages outside the compared stretch: before the state at which the simulation
            begins, or a tick after the end of the ledger.
        stopped: why the ledger could not be followed to its end; "" when it could.
        missing: number of ticks whose ledger message is missing.
        missing_at: simulated time of the first of them [s]; None when there is none.
        duplicates: number of repeated ledger messages; each was followed once.
        rounding: part of the largest number below which differences are taken for rounding [1].
    """

    ticks: int = 0
    compared: int = 0
    resets: int = 0
    max_difference: float = 0.0
    max_force_difference: float = 0.0
    max_length: float = 0.0
    max_force: float = 0.0
    first_difference: float | None = None
    first_where: str = ""
    unmatched: int = 0
    outside: int = 0
    stopped: str = ""
    missing: int = 0
    missing_at: float | None = None
    duplicates: int = 0
    rounding: float = _ROUNDING

    @property
    def left_out(self) -> int:
        """Number of recorded messages of the compared stretch that were not compared."""
        return self.unmatched - self.outside

    @property
    def whole(self) -> bool:
        """Whether all recorded states of the compared stretch were compared, and the stretch is not cut."""
        return self.ticks > 0 and self.left_out == 0 and not self.stopped

    @property
    def identical(self) -> bool:
        """Whether every recorded number was compared and has the same bits."""
        return self.whole and self.first_difference is None

    @property
    def equal(self) -> bool:
        """Whether all lengths and forces are the same up to rounding."""
        lengths = self.max_difference <= self.rounding * self.max_length
        return self.whole and lengths and self.max_force_difference <= self.rounding * self.max_force


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
        measured: MeasuredStates | None = None,
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
            measured: the sensors at the start of a run, if there were any.
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
        self._run, self._last_ns = 0, self._begin_ns - 1
        self._end_ns = self._begin_ns
        self._runs = find_runs(survey, robot)
        self._measured = None if self._begin_ns else measured
        if self._measured is None:  # what was measured before is not known, and later noise depends on it
            self._runs = {name: runs for name, runs in self._runs.items() if name not in MEASURED}
        self._seen = dict.fromkeys(self._runs, 0)
        self._decoders = {
            name: Decoder(robot.recorded(name), kind)
            for name, kind in {LEDGER: TRAJECTORY, **_KINDS}.items()
            if name in self._runs
        }
        self._waiting = {name: (_Unpaired(), _Unpaired()) for name in _COMPARED if name in self._runs}
        self._first_ns = self._begin_ns
        self._ends: dict[int, int] = {}  # of the ledger, in runs that are over
        self._first_key: tuple[int, int, int] | None = None

    def run(self, progress: Callable[[float], None] | None = None) -> Comparison:
        """Read the recording once and simulate it.

        Args:
            progress: called with the fraction done, in [0, 1].

        Returns:
            The comparison.

        Raises:
            BagError: when the joints of the recording and of the scene differ.
        """
        head, result = bag.Bag({}), self.comparison
        self._send_start()
        for block in bag.read_blocks(self._survey.path, head, progress):
            self._add_block(block, head)
            if result.stopped:
                break
        else:
            while self._run < max(int(runs.number[-1]) for runs in self._runs.values()):
                self._reset()  # no tick follows
            self._compare_all()
        for _, theirs in self._waiting.values():
            self._give_up(theirs.keys)
        return result

    def _add_block(self, block: bag.Block, head: bag.Bag) -> None:
        ledger: list[Any] = []
        for name, decoder in self._decoders.items():
            which = head.find(block, decoder.topic)
            if not which.size:
                continue
            groups = decoder.read(block, which)
            self._check_names()
            runs = self._runs[name].of(self._seen[name] + np.arange(which.size))
            self._seen[name] += which.size
            if name == LEDGER:
                ledger = [(groups, runs)]
                continue
            for at, times, numbers in groups:
                inside = (runs[at] > 0) | ((runs[at] == 0) & (times[:, 0] >= self._first_ns))
                self.comparison.unmatched += int((~inside).sum())
                self.comparison.outside += int((~inside).sum())
                self._store(name, 1, runs[at][inside], times[inside, 0], np.stack(numbers, axis=1)[inside])
        for groups, runs in ledger:
            self._follow_block(groups, runs)
        self._compare_all()

    def _check_names(self) -> None:
        wanted = {
            LEDGER: self._scene.columns.names,
            "joint_states": tuple(joint_state_names(self._body)),
            "contact_states": tuple(contact_names(self._scene.body)),
            "pose": (),
            "measured/joint_states": tuple(joint_state_names(self._body)),
            "measured/pose": (),
        }
        for name, decoder in self._decoders.items():
            if decoder.names is not None and decoder.names != wanted[name] and (decoder.names or name != LEDGER):
                raise bag.BagError(
                    f"{self._survey.path}: {decoder.topic} has {', '.join(decoder.names[:5])}, the scene "
                    f"{self._scene.name} {', '.join(wanted[name][:5])}: this is not the recorded scene"
                )

    def _reset(self) -> None:
        self._ends[self._run] = self._end_ns
        self._crawler = self._start.copy()
        self._row = self._start.row
        self._target = self._scene.columns.target(self._start.row)
        self._run += 1
        self._begin_ns, self._last_ns, self._end_ns = 0, -1, 0
        if self._measured is not None:
            self._measured.restart()
        self.comparison.resets += 1
        self._send_start()

    def _follow_block(self, groups: list[Any], runs: np.ndarray) -> None:
        """Follow the ledger's messages of a block, in order."""
        messages: list[tuple[int, int, np.ndarray, list[np.ndarray], int]] = []
        for at, times, numbers in groups:
            for j, place in enumerate(at.tolist()):
                messages.append((place, int(times[j, 0]), times[j, 1:], numbers, j))
        messages.sort(key=lambda m: m[0])
        rows = RampRows(self._scene, self._widths)
        for place, stamp, offsets, numbers, j in messages:
            while self._run < runs[place]:
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
            rows.add_ramp(self._run, before, until, ends_tick, row, target, crawler, step)
            self._row, self._target, before = row, target, until
        if not points:
            crawler.follow(self._target[None][:0])
        if before < end or not points:
            rows.add_ramp(self._run, before, end, True, self._row, self._target, crawler, None)
        rows.read(self._readout, whole, np.nan if self._begin_ns else (end - stamp) / NS)
        self._last_ns, self._end_ns = stamp, end

    def _send_start(self) -> None:
        """Send the state at the start of a run to the sinks, as a ramp without duration."""
        rows = RampRows(self._scene, self._widths)
        rows.add_ramp(self._run, self._end_ns, self._end_ns, True, self._row, self._target, self._crawler, None)
        rows.read(self._readout, self._crawler, np.nan if self._begin_ns else np.inf)
        self._send(rows)

    def _send(self, rows: RampRows) -> None:
        if not rows.run:
            return
        ends = np.array(rows.end_ns)[np.array(rows.ends_tick)]
        runs = np.array(rows.run)[np.array(rows.ends_tick)]
        states = (np.array(rows.joints), np.array(rows.contacts), np.array(rows.poses)[:, None])
        for name, numbers in zip(STATES, states, strict=True):
            self._store(name, 0, runs, ends, numbers)
        if self._measured is not None:
            self._measure(self._measured, runs, ends, *states[::2])
        piece = rows.piece(self._shown)
        for sink in self._sinks:
            sink(piece)

    def _measure(
        self, sensors: MeasuredStates, runs: np.ndarray, ends: np.ndarray, joints: np.ndarray, poses: np.ndarray
    ) -> None:
        """Measure the states at the ends of ticks, as the node did."""
        for run, ns, joint, pose in zip(runs, ends.tolist(), joints, poses[:, 0], strict=True):
            arrived = sensors.measure(ns, joint, pose[_POSE])
            if ns == 0 and not arrived:  # in lock-step, the measurement of the start is sent before it arrives
                arrived = [sensors.latest]
            for stamp, measured, place in arrived:
                whole = np.zeros((1, pose.size))
                whole[0, _POSE] = place
                for name, numbers in zip(MEASURED, (measured, whole), strict=True):
                    self._store(name, 0, np.array([run]), np.array([stamp]), numbers[None])

    def _store(self, name: str, side: int, runs: np.ndarray, ns: np.ndarray, numbers: np.ndarray) -> None:
        if name in self._waiting:
            waiting = self._waiting[name][side]
            waiting.keys += zip(runs.tolist(), ns.tolist(), strict=True)
            waiting.numbers.append(numbers)

    def _compare_all(self) -> None:
        for name in self._waiting:
            self._compare(name)

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
        left = [i for i, key in enumerate(ours.keys) if key >= newest][-_MOST_WAITING:]  # a state may be repeated
        ours.keys, ours.numbers = [ours.keys[i] for i in left], [numbers[left]]
        latest = max(place)
        alone = np.flatnonzero(pairs < 0).tolist()
        rest = [i for i in alone if theirs.keys[i] > latest][-_MOST_WAITING:]
        self._give_up([theirs.keys[i] for i in set(alone) - set(rest)])
        theirs.keys, theirs.numbers = [theirs.keys[i] for i in rest], [recorded[rest]]

    def _give_up(self, keys: list[tuple[int, int]]) -> None:
        """Count states without a counterpart; a recording may end between the ledger of a tick and its states."""
        for run, ns in keys:
            end = self._ends.get(run, self._end_ns if run == self._run else ns)
            self.comparison.outside += end < ns <= next_tick_ns(end, self._rate) + 1
        self.comparison.unmatched += len(keys)

    def _count(self, name: str, keys: list[tuple[int, int]], ours: np.ndarray, theirs: np.ndarray) -> None:
        result = self.comparison
        result.compared += len(keys)
        if name == next(iter(self._waiting)):
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
        differing = np.flatnonzero(wrong.any(axis=(1, 2))).tolist()
        row = min(differing, key=lambda i: keys[i])
        first = (*keys[row], _COMPARED.index(name))
        if self._first_key is None or first < self._first_key:
            self._first_key, result.first_difference = first, keys[row][1] / NS
            quantity, place = (int(v) for v in np.argwhere(wrong[row])[0])
            label = ((self._decoders[name].names or ()) + _AXES)[place]
            what = ("position", "velocity", "effort")[quantity]
            pair = f"recorded {theirs[row, quantity, place]:.17g}, simulated {ours[row, quantity, place]:.17g}"
            result.first_where = f"{name} {label} {what}: {pair}"
