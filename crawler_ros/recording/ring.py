"""The ring of shared memory between the simulator and its recording process: pipes copy their contents twice."""

from __future__ import annotations

import mmap
import os
import select
import struct
from collections.abc import Iterator

_HEAD = 4096
"""Bytes of the shared memory before the ring: they hold the number of bytes that were taken from it."""
RING_BYTES = 1 << 26
"""No more than can be written in a second."""
PIECE = struct.Struct("<QQ")
"""Of the ring: where it begins and its size [bytes]."""


class Ring:
    """The writing end of the ring; only one thread writes."""

    def __init__(self) -> None:
        """Create the memory; `fd` is its file descriptor, which the process inherits."""
        self.fd = os.memfd_create("crawler_recording")
        os.ftruncate(self.fd, _HEAD + RING_BYTES)
        shared = memoryview(mmap.mmap(self.fd, _HEAD + RING_BYTES))
        self._taken, self._memory = shared[:_HEAD].cast("Q"), shared[_HEAD:]
        self._place = self._written = 0
        self.pieces: list[tuple[int, int]] = []
        """What was written and not yet sent: where it begins and its size."""

    @property
    def used(self) -> int:
        """Bytes that the process has not taken yet."""
        return self._written - self._taken[0]

    def write(self, data: memoryview) -> int:
        """Copy all of `data` if it fits, or as much as the ring holds if it is empty.

        Args:
            data: the bytes.

        Returns:
            The number of bytes copied.
        """
        used = self.used
        if used == 0:
            self._place = 0  # the beginning is still in the processor's cache
        if used and len(data) > RING_BYTES - used:
            return 0
        left = data[:RING_BYTES]
        while left:
            size = min(len(left), RING_BYTES - self._place)
            self._memory[self._place : self._place + size] = left[:size]
            if self.pieces and sum(self.pieces[-1]) == self._place:
                begin, before = self.pieces.pop()
                self.pieces.append((begin, before + size))
            else:
                self.pieces.append((self._place, size))
            self._written += size
            self._place = (self._place + size) % RING_BYTES
            left = left[size:]
        return min(len(data), RING_BYTES)


def read_ring(ring: int, places: int, wait_s: float) -> Iterator[memoryview]:
    """Read the pieces of a ring whose places arrive, one after another.

    Args:
        ring: file descriptor of the memory; it is closed.
        places: file descriptor of the pipe through which the places arrive, until it ends.
        wait_s: time after which an empty piece is yielded where none arrives [s].

    Yields:
        The pieces, each valid until the next one.
    """
    with memoryview(mmap.mmap(ring, _HEAD + RING_BYTES)) as shared:
        os.close(ring)
        taken, memory, rest = shared[:_HEAD].cast("Q"), shared[_HEAD:], b""
        while True:
            ready, _, _ = select.select([places], [], [], wait_s)
            if not ready:
                yield memory[:0]
                continue
            found = os.read(places, 256 * PIECE.size)
            if not found:
                return
            rest += found
            whole = len(rest) - len(rest) % PIECE.size
            for place, size in PIECE.iter_unpack(rest[:whole]):
                yield memory[place : place + size]
                taken[0] += size
            rest = rest[whole:]
