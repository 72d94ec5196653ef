"""Many ticks at once: followed and read in one compiled call, their messages filled in as rows of tables.

The messages and their order are those of `Outgoing`, to the bit. Nothing is waited for between the ticks, so this is
for a simulator that runs as fast as possible, and for the ticks of a trajectory in lock-step.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene
from crawler_model.body.drive import NS
from crawler_model.crawler.ticks import follow_ticks

from ..recording.record_head import HEAD_SEQUENCE, HEAD_SIZE, HEAD_TIMES, message_head
from ..wire.messages import MessageLayout
from .intake.path import Vertices
from .outgoing import Outgoing
from .outlet import Outlet

_MOST_TICKS = 64
_MOST_CONTACTS = 16384
"""Contacts of all ticks of one call together: a call takes one or two milliseconds."""


class _Rows:
    """A table of bytes with the messages of one tick in each row, behind the heads of their records if recorded."""

    def __init__(self, outlets: Sequence[Outlet], layouts: Sequence[MessageLayout], rows: int) -> None:
        self._outlets, slices = outlets, list[tuple[int, int]]()
        model = b""
        for outlet, layout in zip(outlets, layouts, strict=True):
            if outlet.channel >= 0:
                model += message_head(outlet.channel + 1, 0, 0, 0, len(layout.data))
            slices.append((len(model), len(model) + len(layout.data)))
            model += layout.data
        self.size = len(model)
        self.published = [(o.publish, *s) for o, s in zip(outlets, slices, strict=True) if o.publish is not None]
        """The function that publishes each message, and where the message begins and ends in a row."""
        self._table = np.tile(np.frombuffer(model, np.uint8), (rows, 1))
        placed = [(a, layout) for (a, _), layout in zip(slices, layouts, strict=True)]
        self._stamps = [self._view("<u4", a + m.stamp, (2,), (4,)) for a, m in placed]
        heads = [a - HEAD_SIZE if o.channel >= 0 else 0 for o, (a, _) in zip(outlets, slices, strict=True)]
        self._numbers_on_channel = [self._view("<u4", a + HEAD_SEQUENCE, (), ()) for a in heads]
        self._received = [self._view("<u8", a + HEAD_TIMES, (2,), (8,)) for a in heads]
        self.numbers = [self._view("<f8", a + m.numbers, m.shape, m.strides) for a, m in placed]
        self.times = [
            self._view("<u4", a + m.times, (m.shape[0], 2), (m.strides[0], 4)) for a, m in placed if m.times >= 0
        ]

    def _view(self, kind: str, place: int, shape: tuple[int, ...], strides: tuple[int, ...]) -> np.ndarray:
        rows = self._table.shape[0]
        return np.ndarray((rows, *shape), kind, self._table.data, place, (self.size, *strides))

    def encode(self, stamps: np.ndarray, times: np.ndarray, recorder: Any) -> bytes:
        """Fill in the stamps [ns] and the times of the records [ns, wall] of R rows, and return their bytes."""
        count = stamps.size
        s, ns = np.divmod(stamps, NS)
        for k, outlet in enumerate(self._outlets):
            self._stamps[k][:count, 0], self._stamps[k][:count, 1] = s, ns
            if outlet.channel >= 0:
                first = recorder.number(outlet.channel, count)
                self._numbers_on_channel[k][:count] = np.arange(first, first + count)
                self._received[k][:count] = times[:, None]
        return self._table[:count].tobytes()


class Ahead:
    """Runs many ticks at once and sends their messages."""

    def __init__(self, scene: Scene, outgoing: Outgoing, recorder: Any, every: int) -> None:
        """Allocate the tables.

        Args:
            scene: the scene that runs.
            outgoing: the messages of a tick.
            recorder: the recorder, if there is one.
            every: the states are sent after each tick whose number is a multiple of this.
        """
        self.ticks = max(1, min(_MOST_TICKS, _MOST_CONTACTS // scene.body.contacts))
        """Largest number of ticks at once."""
        self._scene, self._outgoing, self._recorder, self._every = scene, outgoing, recorder, every
        layouts = outgoing.layouts()
        self._states = _Rows([outgoing.outlets[n] for n in layouts], list(layouts.values()), self.ticks)
        self._numbers = dict(zip(layouts, self._states.numbers, strict=True))
        self._ledgers: dict[int, _Rows] = {}
        widths = outgoing.joints.numbers.shape[1], outgoing.contacts.numbers.shape[1]
        self._joints, self._contacts = (np.empty((self.ticks, 3, width)) for width in widths)
        self._moved = np.empty((self.ticks, 2, scene.body.contacts))

    def run(self, crawler: Crawler, taken: Vertices, tick: int, start_ns: int, ends: Sequence[int]) -> np.ndarray:
        """Run ticks and send their messages.

        Args:
            crawler: the crawler.
            taken: the vertices of the ticks.
            tick: number of ticks before them.
            start_ns: simulated time at the start of the first [ns].
            ends: simulated time at the end of each [ns].

        Returns:
            The account of each tick, shape (K, 14).
        """
        began = time.monotonic_ns()
        ends_ns = np.array(ends, np.int64)
        starts_ns = np.concatenate(([start_ns], ends_ns[:-1]))
        seconds = (ends_ns - starts_ns) / NS
        read = np.arange(tick + 1, tick + 1 + ends_ns.size) % self._every == 0
        if taken.ended >= 0:
            read[taken.ended] = True
        count = np.count_nonzero(read)
        accounts = follow_ticks(
            crawler,
            self._outgoing.readout,
            np.array(self._scene.columns.target(taken.rows)),
            taken.first,
            seconds,
            read,
            self._joints[:count],
            self._contacts[:count],
            self._moved[:count],
        )
        y, gain = np.vecdot(self._moved[:count], crawler.body.share).T  # each to the bit as one product
        found = {
            "joint_states": self._joints[:count],
            "contact_states": self._contacts[:count],
            "pose": y[:, None],
            "odom": np.stack((y, gain / seconds[read]), axis=1)[..., None],
        }
        for name, numbers in self._numbers.items():
            if name in found:
                numbers[:count, ..., : found[name].shape[-1]] = found[name]
        self._send(taken, starts_ns, ends_ns, read, began)
        return accounts

    def _send(self, taken: Vertices, starts_ns: np.ndarray, ends_ns: np.ndarray, read: np.ndarray, began: int) -> None:
        """Record all messages, then publish them; the times of the records are spread over the time that it took."""
        recorder = self._recorder
        ticks, times = starts_ns.size, np.zeros(starts_ns.size, np.int64)
        if recorder is not None:
            now = recorder.now_ns()
            times = now - (time.monotonic_ns() - began) * np.arange(ticks - 1, -1, -1) // ticks
        rows: list[list[tuple[_Rows, bytes, int]]] = [[] for _ in range(ticks)]
        if self._outgoing.outlets["applied_commands"].wanted:
            self._encode_ledger(taken, starts_ns, times, rows)
        if read.any():
            states = self._states.encode(ends_ns[read], times[read], recorder)
            for row, tick in enumerate(np.flatnonzero(read).tolist()):
                rows[tick].append((self._states, states, row))
        if recorder is not None:
            recorder.record_all(
                [memoryview(data)[k * r.size : (k + 1) * r.size] for tick in rows for r, data, k in tick]
            )
        for sent in rows:
            for table, data, row in sent:
                place = row * table.size
                for publish, first, last in table.published:
                    publish(data[place + first : place + last])

    def _encode_ledger(
        self, taken: Vertices, starts_ns: np.ndarray, times: np.ndarray, rows: list[list[tuple[_Rows, bytes, int]]]
    ) -> None:
        points = np.diff(taken.first)
        for size in np.unique(points).tolist():
            which = np.flatnonzero(points == size)
            table = self._ledgers.get(size)
            if table is None:
                outlet, layout = self._outgoing.outlets["applied_commands"], self._outgoing.ledger.layout(size)
                table = self._ledgers[size] = _Rows([outlet], [layout], len(self._moved))
            if size:
                vertices = taken.first[which][:, None] + np.arange(size)
                table.numbers[0][: which.size] = taken.rows[vertices]
                after = np.maximum(taken.due_ns[vertices] - starts_ns[which][:, None], 0)
                times_of = table.times[0][: which.size]
                times_of[..., 0], times_of[..., 1] = np.divmod(after, NS)
            data = table.encode(starts_ns[which], times[which], self._recorder)
            for row, tick in enumerate(which.tolist()):
                rows[tick].append((table, data, row))
