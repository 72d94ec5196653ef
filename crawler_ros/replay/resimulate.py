"""New simulation of a recording's commands: every ramp with its account, compared with the recorded states."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from crawler_model import Crawler
from crawler_model.body.drive import NS
from crawler_model.crawler.readout import Readout
from crawler_model.crawler.ticks import runs_in_one_call
from crawler_model.run.account import tolerance_of

from ..recording import bag
from ..recording.decode import JOINT_STATE, POSE, TRAJECTORY, Decoder
from ..recording.recorded_robot import Robot
from ..wire.measured import MEASURED, MeasuredStates
from ..wire.states import contact_names, joint_state_names, shown_contacts
from .health import Survey, next_ticks_ns
from .ledger import Ticks, divide, read_ticks
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
    """States that wait for their counterparts: run and time [ns], shape (K, 2), and what they hold, (K, ...)."""

    keys: list[np.ndarray] = field(default_factory=list)
    numbers: list[np.ndarray] = field(default_factory=list)

    def join(self) -> tuple[np.ndarray, np.ndarray]:
        """Return all keys and numbers."""
        return np.concatenate(self.keys), np.concatenate(self.numbers)

    def keep(self, keys: np.ndarray, numbers: np.ndarray, which: np.ndarray) -> np.ndarray:
        """Keep the last of those marked by `which`, shape (K,); return their indices."""
        left = np.flatnonzero(which)[-_MOST_WAITING:]
        self.keys, self.numbers = [keys[left]] * (left.size > 0), [numbers[left]] * (left.size > 0)
        return left


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
        # elements of hysteresis remember what a readout of many ticks does not hold
        self._at_once = runs_in_one_call(start) and not start.hysteresis.size
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
            if theirs.keys:
                self._give_up(theirs.join()[0])
        return result

    def _add_block(self, block: bag.Block, head: bag.Bag) -> None:
        for name, decoder in sorted(self._decoders.items(), key=lambda item: item[0] == LEDGER):  # the states first
            which = head.find(block, decoder.topic)
            if not which.size:
                continue
            groups = decoder.read(block, which)
            self._check_names()
            runs = self._runs[name].of(self._seen[name] + np.arange(which.size))
            self._seen[name] += which.size
            if name == LEDGER:
                self._follow_runs(read_ticks(groups, self._scene.columns.count, decoder.topic), runs)
                continue
            for at, times, numbers in groups:
                keys = np.column_stack((runs[at], times[:, 0]))
                inside = (keys[:, 0] > 0) | ((keys[:, 0] == 0) & (keys[:, 1] >= self._first_ns))
                self.comparison.unmatched += int((~inside).sum())
                self.comparison.outside += int((~inside).sum())
                self._store(name, 1, keys[inside], np.stack(numbers, axis=1)[inside])
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
        self._run += 1
        self._begin_ns, self._last_ns, self._end_ns = 0, -1, 0
        if self._measured is not None:
            self._measured.restart()
        self.comparison.resets += 1
        self._send_start()

    def _follow_runs(self, ticks: Ticks, runs: np.ndarray) -> None:
        """Follow ticks of a block, of the given runs."""
        for run in np.unique(runs).tolist():
            while self._run < run:
                self._reset()
            self._follow(ticks, np.flatnonzero(runs == run))
            if self.comparison.stopped:
                return

    def _follow(self, ticks: Ticks, which: np.ndarray) -> None:
        """Follow the ticks `which` of a run: each once, up to where time goes back."""
        result, which = self.comparison, which[ticks.start_ns[which] >= self._begin_ns]
        start = ticks.start_ns[which]
        later = np.diff(start, prepend=self._last_ns)
        back = np.flatnonzero(later < 0)[:1]
        if back.size:
            before, after = (start[back] - later[back])[0], start[back][0]
            result.stopped = f"the ledger's time goes back from {before / NS:g} s to {after / NS:g} s without a reset"
            which, later = which[: back[0]], later[: back[0]]
        result.duplicates += int((later == 0).sum())
        ticks = ticks.select(which[later > 0])
        if not ticks.start_ns.size:
            return
        end_ns = np.maximum(next_ticks_ns(ticks.start_ns, self._rate), ticks.start_ns)
        begin_ns = np.append(self._end_ns, end_ns[:-1])  # unless ticks are missing
        late = np.flatnonzero(ticks.start_ns > begin_ns + 1)
        if late.size:
            lack = (ticks.start_ns - begin_ns)[late] * float(self._rate or 0) / NS
            result.missing += int(np.maximum(np.rint(lack), 1).sum())
            if result.missing_at is None:
                result.missing_at = float(begin_ns[late[0]] / NS)
        seconds = np.full(end_ns.size, np.nan) if self._begin_ns else (end_ns - ticks.start_ns) / NS
        rows = RampRows(self._scene, self._widths, self._run, divide(ticks, end_ns, self._row))
        (rows.follow_at_once if self._at_once else rows.follow_each)(self._crawler, self._readout, seconds)
        self._row = rows.ramps.rows[-1]
        self._last_ns, self._end_ns = int(ticks.start_ns[-1]), int(end_ns[-1])
        self._send(rows)

    def _send_start(self) -> None:
        """Send the state at the start of a run to the sinks, as a ramp without duration."""
        at, nothing = np.array([self._end_ns]), np.zeros(0, np.int64)
        ticks = Ticks(at, np.zeros(2, np.int64), nothing, np.empty((0, self._row.size)))
        rows = RampRows(self._scene, self._widths, self._run, divide(ticks, at, self._row))
        rows.add_ramp(0, self._crawler, None)
        rows.read(self._readout, self._crawler, np.nan if self._begin_ns else np.inf)
        self._send(rows)

    def _send(self, rows: RampRows) -> None:
        keys = np.column_stack((np.full(rows.ramps.end_ns.size, self._run), rows.ramps.end_ns))
        states = (np.array(rows.joints), np.array(rows.contacts), np.array(rows.poses)[:, None])
        for name, numbers in zip(STATES, states, strict=True):
            self._store(name, 0, keys, numbers)
        if self._measured is not None:
            self._measure(self._measured, keys, *states[::2])
        piece = rows.piece(self._shown)
        for sink in self._sinks:
            sink(piece)

    def _measure(self, sensors: MeasuredStates, keys: np.ndarray, joints: np.ndarray, poses: np.ndarray) -> None:
        """Measure the states at the ends of ticks, as the node did."""
        for (run, ns), joint, pose in zip(keys.tolist(), joints, poses[:, 0], strict=True):
            arrived = sensors.measure(ns, joint, pose[_POSE])
            if ns == 0 and not arrived:  # in lock-step, the measurement of the start is sent before it arrives
                arrived = [sensors.latest]
            for stamp, measured, place in arrived:
                whole = np.zeros((1, pose.size))
                whole[0, _POSE] = place
                for name, numbers in zip(MEASURED, (measured, whole), strict=True):
                    self._store(name, 0, np.array([[run, stamp]]), numbers[None])

    def _store(self, name: str, side: int, keys: np.ndarray, numbers: np.ndarray) -> None:
        if name in self._waiting and keys.size:
            waiting = self._waiting[name][side]
            waiting.keys.append(keys)
            waiting.numbers.append(numbers)

    def _compare_all(self) -> None:
        for name in self._waiting:
            self._compare(name)

    def _compare(self, name: str) -> None:
        """Compare the states whose counterparts have arrived; a bounded number of others wait."""
        ours, theirs = self._waiting[name]
        if not ours.keys or not theirs.keys:
            return
        (simulated, numbers), (recorded, others) = ours.join(), theirs.join()
        place = _find(simulated, recorded)
        found = np.flatnonzero(place >= 0)
        if found.size:
            self._count(name, recorded[found], numbers[place[found]], others[found])
        ours.keep(simulated, numbers, ~_precede(simulated, _last(recorded)))  # a state may be repeated
        place[theirs.keep(recorded, others, (place < 0) & _precede(_last(simulated), recorded))] = 0
        self._give_up(recorded[place < 0])

    def _give_up(self, keys: np.ndarray) -> None:
        """Count states without a counterpart; a recording may end between the ledger of a tick and its states."""
        self._ends[self._run] = self._end_ns
        for run in np.unique(keys[:, 0]).tolist():
            if run in self._ends:
                ns, end = keys[keys[:, 0] == run, 1], self._ends[run]
                most = next_ticks_ns(np.array([end]), self._rate)[0] + 1
                self.comparison.outside += int(((end < ns) & (ns <= most)).sum())
        self.comparison.unmatched += keys.shape[0]

    def _count(self, name: str, keys: np.ndarray, ours: np.ndarray, theirs: np.ndarray) -> None:
        result = self.comparison
        result.compared += keys.shape[0]
        if name == next(iter(self._waiting)):
            result.ticks += keys.shape[0]
        size = np.nan_to_num(np.abs(theirs), nan=0.0)
        result.max_length = max(result.max_length, float(size[:, 0].max(initial=0.0)))
        result.max_force = max(result.max_force, float(size[:, 2:].max(initial=0.0)))
        wrong = ~((ours == theirs) | (np.isnan(ours) & ~np.isnan(theirs)))
        if not wrong.any():
            return
        apart = np.nan_to_num(np.abs(ours - theirs), nan=0.0)
        result.max_difference = max(result.max_difference, float(apart[:, 0].max()))
        result.max_force_difference = max(result.max_force_difference, float(apart[:, 2:].max(initial=0.0)))
        run, ns, row = min((*keys[i].tolist(), i) for i in np.flatnonzero(wrong.any(axis=(1, 2))).tolist())
        first = (run, ns, _COMPARED.index(name))
        if self._first_key is None or first < self._first_key:
            self._first_key, result.first_difference = first, ns / NS
            quantity, place = (int(v) for v in np.argwhere(wrong[row])[0])
            label = ((self._decoders[name].names or ()) + _AXES)[place]
            what = ("position", "velocity", "effort")[quantity]
            pair = f"recorded {theirs[row, quantity, place]:.17g}, simulated {ours[row, quantity, place]:.17g}"
            result.first_where = f"{name} {label} {what}: {pair}"


def _find(keys: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Find where each of the `wanted` keys, (M, 2), is last among `keys`, (K, 2) in order; -1 where it is not."""
    place = np.full(wanted.shape[0], -1)
    for run in np.unique(wanted[:, 0]).tolist():
        begin, end = np.searchsorted(keys[:, 0], (run, run + 1))
        mine = np.flatnonzero(wanted[:, 0] == run)
        at = begin - 1 + np.searchsorted(keys[begin:end, 1], wanted[mine, 1], side="right")
        there = (at >= begin) & (keys[at, 1] == wanted[mine, 1])
        place[mine[there]] = at[there]
    return place


def _precede(keys: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Determine which keys come before others, shape (..., 2) each."""
    same = keys[..., 0] == others[..., 0]
    return np.where(same, keys[..., 1] < others[..., 1], keys[..., 0] < others[..., 0])


def _last(keys: np.ndarray) -> np.ndarray:
    """Return the last of some keys, shape (K, 2)."""
    newest = keys[keys[:, 0] == keys[:, 0].max()]
    return newest[newest[:, 1].argmax()]
