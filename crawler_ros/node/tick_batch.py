"""Many ticks at once: followed and read in one compiled call, their messages filled in as rows of tables.

The messages and their order equal `Outgoing`'s to the bit. Nothing is waited for between the ticks, so this is
for a simulator that runs as fast as possible, and for the ticks of a trajectory in lock-step.
"""

from __future__ import annotations

import importlib
import sys
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene, prepare
from crawler_model.body.drive import NS
from crawler_model.crawler.readout import Readout
from crawler_model.crawler.ticks import follow_ticks, runs_in_one_call
from crawler_model.crawler.yields import YieldTimes

from ..recording.record_head import HEAD_SEQUENCE, HEAD_SIZE, HEAD_TIMES, message_head
from ..wire.messages import JointStateMessage, MessageLayout
from ..wire.states import contact_names, joint_state_names, shown_contacts
from .intake.commanded_path import CommandedPath, Vertex, Vertices
from .outgoing import Outgoing
from .outlet import Outlet

_MOST_TICKS = 256
_MOST_CONTACTS = 65536
"""Contacts of all ticks of one call together, so that their messages take at most some ten MB. With fewer, the numpy
calls around each compiled call would count: with 16 ticks of a thousand contacts, they took a third of the time."""
_CALL_NS = 2_000_000
"""Processor time of a call [ns], to which the number of its ticks is adjusted: commands and services wait as long."""
_LEDGER = "applied_commands"


class _Rows:
    """A table of bytes with the messages of one tick in each row, behind the heads of their records if recorded."""

    def __init__(self, outlets: Mapping[str, Outlet], layouts: Mapping[str, MessageLayout], rows: int) -> None:
        slices = dict[str, tuple[int, int]]()
        model = b""
        for name, layout in layouts.items():
            if outlets[name].channel >= 0:
                model += message_head(outlets[name].channel + 1, 0, 0, 0, len(layout.data))
            slices[name] = len(model), len(model) + len(layout.data)
            model += layout.data
        self.size, self.rows = len(model), rows
        in_order = sorted(slices, key=_LEDGER.__eq__)
        self.slices = [(outlets[name], *slices[name]) for name in in_order]
        """The outlet of each message, the states first, and where the message begins and ends in a row."""
        self.table = np.tile(np.frombuffer(model, np.uint8), (rows, 1))
        placed = {name: (slices[name][0], layout) for name, layout in layouts.items()}
        heads = {name: first - HEAD_SIZE for name, (first, _) in placed.items() if outlets[name].channel >= 0}
        self.stamps = {n: self._view("<u4", a + m.stamp, (2,), (4,)) for n, (a, m) in placed.items()}
        self.numbers = {n: self._view("<f8", a + m.numbers, m.shape, m.strides) for n, (a, m) in placed.items()}
        self.times = {
            n: self._view("<u4", a + m.times, (m.shape[0], 2), (m.strides[0], 4))
            for n, (a, m) in placed.items()
            if m.times >= 0
        }
        self.numbers_on_channel = {n: self._view("<u4", a + HEAD_SEQUENCE, (), ()) for n, a in heads.items()}
        self.received = {n: self._view("<u8", a + HEAD_TIMES, (2,), (8,)) for n, a in heads.items()}

    def _view(self, kind: str, place: int, shape: tuple[int, ...], strides: tuple[int, ...]) -> np.ndarray:
        return np.ndarray((self.rows, *shape), kind, self.table.data, place, (self.size, *strides))


class _Batch:
    """What the messages of K ticks hold: the commands and the states, and when they were recorded."""

    def __init__(self, taken: Vertices, starts_ns: np.ndarray, ends_ns: np.ndarray, read: np.ndarray) -> None:
        self.taken, self.starts_ns, self.read = taken, starts_ns, read
        self.state = np.cumsum(read) - 1
        """Of each tick that is read: the number of its state."""
        self.stamps = {True: np.divmod(starts_ns, NS), False: np.divmod(ends_ns, NS)}
        """Of the ledger and of the states [s, ns]."""
        self.states: dict[str, np.ndarray] = {}
        self.received = np.zeros(starts_ns.size, np.int64)
        """The times of the records of each tick [ns, wall]."""
        self.first_on_channel: dict[str, int] = {}


class TickBatch:
    """Runs many ticks at once and sends their messages."""

    def __init__(self, scene: Scene, outgoing: Outgoing, recorder: Any, every: int) -> None:
        """Allocate memory.

        Args:
            scene: the scene that runs.
            outgoing: the messages of a tick.
            recorder: the recorder, if there is one.
            every: the states are sent after each tick whose number is a multiple of this.
        """
        self._most = max(1, min(_MOST_TICKS, _MOST_CONTACTS // scene.body.contacts))
        self.ticks = min(self._most, 16)
        """Number of ticks of the next call."""
        self._scene, self._outgoing, self._recorder, self._every = scene, outgoing, recorder, every
        self._layouts = outgoing.layouts()
        self._tables: dict[int, _Rows] = {}
        widths = outgoing.joints.numbers.shape[1], outgoing.contacts.numbers.shape[1]
        self._joints, self._contacts = (np.empty((self._most, 3, width)) for width in widths)
        self._moved = np.empty((self._most, 2, scene.body.contacts))

    def run(
        self,
        crawler: Crawler,
        taken: Vertices,
        tick: int,
        start_ns: int,
        ends_ns: np.ndarray,
        yields: YieldTimes | None = None,
    ) -> np.ndarray:
        """Run ticks and send their messages.

        Args:
            crawler: the crawler.
            taken: the vertices of the ticks.
            tick: number of ticks before them.
            start_ns: simulated time at the start of the first [ns].
            ends_ns: simulated time at the end of each, shape (K,) [ns].
            yields: adds up how long links are slack or stalled; None where none can be.

        Returns:
            The account of each tick, shape (K, 15).
        """
        began, used = time.monotonic_ns(), time.thread_time_ns()
        starts_ns = np.concatenate(([start_ns], ends_ns[:-1]))
        seconds = (ends_ns - starts_ns) / NS
        sent = np.arange(tick + 1, tick + 1 + ends_ns.size) % self._every == 0
        if taken.ended >= 0:
            sent[taken.ended] = True
        read = sent if yields is None else np.ones(sent.size, np.bool_)
        count = np.count_nonzero(read)
        joints, contacts, moved = self._joints[:count], self._contacts[:count], self._moved[:count]
        before, targets = crawler.actuation, self._scene.columns.target(taken.rows)
        accounts = follow_ticks(
            crawler, self._outgoing.readout, targets, taken.first, seconds, read, joints, contacts, moved
        )
        if yields is not None:
            lengths = np.vstack((before, targets[:, : before.size]))[taken.first[1:]]  # in force at the end of each
            yields.add_many(joints[:, 0, 1:], lengths[:, crawler.body.link_springs], ends_ns - starts_ns)
            joints, contacts, moved = joints[sent], contacts[sent], moved[sent]
        batch = _Batch(taken, starts_ns, ends_ns, sent)
        y, gain = np.vecdot(moved, crawler.body.share).T  # each to the bit as one product
        batch.states = {
            "joint_states": joints,
            "contact_states": contacts,
            "pose": y[:, None],
            "odom": np.stack((y, gain / seconds[sent]), axis=1)[..., None],
        }
        self._send(batch, began)
        used = time.thread_time_ns() - used
        self.ticks = max(1, min(self._most, 2 * ends_ns.size, 1 + ends_ns.size * _CALL_NS // max(used, 1)))
        return accounts

    def _send(self, batch: _Batch, began: int) -> None:
        """Record all messages, then publish them; the times of the records are spread over the time that it took."""
        recorder, outlets, ticks = self._recorder, self._outgoing.outlets, batch.read.size
        topics = (_LEDGER, *self._layouts)
        heard = {outlets[name] for name in topics if outlets[name].is_heard()}  # slicing for no listener wastes time
        if recorder is None and not heard:
            return
        if recorder is not None:
            now = recorder.now_ns()
            batch.received = now - (time.monotonic_ns() - began) * np.arange(ticks - 1, -1, -1) // ticks
            for name in topics:
                if outlets[name].channel >= 0:
                    sent = ticks if name == _LEDGER else np.count_nonzero(batch.read)
                    batch.first_on_channel[name] = recorder.number(outlets[name].channel, sent)
        # ticks whose messages have the same layout share a table; runs of them are contiguous in it
        kinds = batch.read + 2 * np.diff(batch.taken.first) if outlets[_LEDGER].wanted else batch.read.astype(np.int64)
        rank = np.empty(ticks, np.int64)
        encoded: dict[int, tuple[_Rows, memoryview]] = {}
        for kind in set(kinds.tolist()):
            which = np.flatnonzero(kinds == kind)
            rank[which] = np.arange(which.size)
            table = self._table(kind, which.size)
            self._fill(table, batch, which)
            encoded[kind] = table, table.table.data.cast("B")
        bounds = np.concatenate(([0], 1 + np.flatnonzero(kinds[1:] != kinds[:-1]), [ticks]))
        begins, sizes = bounds[:-1], bounds[1:] - bounds[:-1]
        runs = list(zip(kinds[begins].tolist(), rank[begins].tolist(), sizes.tolist(), strict=True))
        if recorder is not None:
            records = []
            for kind, first, count in runs:
                table, data = encoded[kind]
                records.append(data[first * table.size : (first + count) * table.size])
            recorder.record_all(records)
        for kind, first, count in runs if heard else ():
            table, data = encoded[kind]
            published: list[tuple[Any, int, int]] = [
                (outlet.publish, start, end) for outlet, start, end in table.slices if outlet in heard
            ]
            for place in range(first * table.size, (first + count) * table.size, table.size):
                for publish, start, end in published:
                    publish(bytes(data[place + start : place + end]))

    def _table(self, kind: int, rows: int) -> _Rows:
        """Return the table for ticks with 2 P or, if they are read, 2 P + 1 for a number: P points in the ledger."""
        table = self._tables.get(kind)
        if table is None or table.rows < rows:
            layouts = {}
            if self._outgoing.outlets[_LEDGER].wanted:
                layouts[_LEDGER] = self._outgoing.ledger.layout(kind // 2)
            if kind % 2:
                layouts |= self._layouts
            table = self._tables[kind] = _Rows(self._outgoing.outlets, layouts, rows)
        return table

    def _fill(self, table: _Rows, batch: _Batch, which: np.ndarray) -> None:
        """Fill in the messages of some ticks, one row of a table each."""
        count, taken = which.size, batch.taken
        every = count == batch.read.size  # then slices instead of copies
        ticks: Any = slice(None) if every else which
        states: Any = slice(None) if every else batch.state[which]
        for name, stamps in table.stamps.items():
            s, ns = batch.stamps[name == _LEDGER]
            stamps[:count, 0], stamps[:count, 1] = s[ticks], ns[ticks]
            if name in batch.states:
                found = batch.states[name][states]
                table.numbers[name][:count, ..., : found.shape[-1]] = found
        for name, numbers in table.numbers_on_channel.items():
            own = which if name == _LEDGER else batch.state[which]
            numbers[:count] = batch.first_on_channel[name] + own
            table.received[name][:count] = batch.received[ticks, None]
        if _LEDGER in table.times:
            points = table.times[_LEDGER].shape[1]
            vertices = taken.first[which][:, None] + np.arange(points)
            positions = taken.rows.reshape(count, points, -1) if every else taken.rows[vertices]
            table.numbers[_LEDGER][:count] = positions
            after = np.maximum(taken.due_ns[vertices] - batch.starts_ns[which][:, None], 0)
            times = table.times[_LEDGER][:count]
            times[..., 0], times[..., 1] = np.divmod(after, NS)


def compile_ticks(scene: Scene) -> None:
    """Compile the kernels of ticks, single ones and many at once, or load them.

    Args:
        scene: the scene that will run.
    """
    _skip_blas()
    prepare(scene)
    body, crawler, joints = scene.body, Crawler(scene), JointStateMessage(joint_state_names(scene.body))
    everything, readout = Readout(body, shown_contacts(body)), Readout(body, np.zeros(0, np.int64))
    everything.read(crawler, np.inf, joints.numbers, JointStateMessage(contact_names(body)).numbers)
    readout.read(crawler, np.inf, joints.numbers, JointStateMessage([]).numbers)
    CommandedPath(Vertex(0, crawler.row)).follow_many(0, np.ones(1, np.int64), crawler.row)
    if runs_in_one_call(crawler):
        n, width = body.contacts, scene.columns.index.size
        tables = [np.zeros((1, 3, joints.numbers.shape[1])), np.zeros((1, 3, 0)), np.zeros((1, 2, n))]
        nothing = np.zeros((0, width)), np.zeros(2, np.int64), np.ones(1), np.ones(1, bool)
        follow_ticks(crawler, readout, *nothing, *tables)


def _skip_blas() -> None:
    """Let numba find no BLAS: it would import scipy.linalg, a tenth of the node's start, for np.cov in kernels.

    This is done here and not where kernels are loaded, because other programs may compile functions of their own.
    """
    hidden = "scipy.linalg"
    if hidden in sys.modules:
        return
    sys.modules[hidden] = None  # type: ignore[assignment]
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        del sys.modules[hidden]
