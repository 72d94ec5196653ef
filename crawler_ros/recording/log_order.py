"""The messages of a recording in the order of their reception, whatever the order in which its files store them.

MCAP fixes no order: topics may be stored one after another, and tools that merge, filter or recover recordings write as
they like. A first pass notes in which stretch of log time each block of a file lies; blocks are then loaded as late as
their first message allows, and merged. Where too many overlap to be kept in memory at once, they are sorted in larger
groups to a temporary file first: an external merge sort. Indices in the file are not trusted, as the messages decide.
"""

from __future__ import annotations

import heapq
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from .mcap_reader import Block

_MOST_WAITING = 1 << 24
"""Bytes of blocks that overlap in log time and are merged in memory."""
_SORTED_AT_ONCE, _SORTED_PIECE = 1 << 23, 1 << 18
"""Bytes that are sorted in memory on the way to the temporary file, and of its pieces, one of which waits per sort."""
_COLUMNS = ("channel", "sequence", "first", "size", "log_ns", "publish_ns")


@dataclass(frozen=True, eq=False)
class Piece:
    """A block that can be loaded.

    Attributes:
        first_ns: when its first message was received [ns, wall].
        last_ns: the same of its last one.
        size: bytes in memory.
        load: loads it; its messages may be in any order.
    """

    first_ns: int
    last_ns: int
    size: int
    load: Callable[[], Block]


def piece_of(block: Block, load: Callable[[], Block]) -> Piece:
    """Note the stretch of log time of a block.

    Args:
        block: the block, with a message at least.
        load: loads it again.

    Returns:
        The piece.
    """
    size = block.data.size + sum(getattr(block, name).nbytes for name in _COLUMNS)
    return Piece(int(block.log_ns.min()), int(block.log_ns.max()), size, load)


def bound_memory(pieces: Sequence[Piece], ranks: np.ndarray) -> list[Piece]:
    """Put pieces in order of their first messages; if too many overlap, use the pieces of a temporary file instead.

    Args:
        pieces: all pieces of a recording.
        ranks: order of the channels, by their numbers, among messages received at the same time.

    Returns:
        The pieces to merge.

    Raises:
        OSError: when the disk of the temporary file is full.
    """
    pieces = sorted(pieces, key=lambda piece: piece.first_ns)
    open_until: list[tuple[int, int]] = []
    waiting = most = 0
    for piece in pieces:
        while open_until and open_until[0][0] < piece.first_ns:
            waiting -= heapq.heappop(open_until)[1]
        heapq.heappush(open_until, (piece.last_ns, piece.size))
        waiting += piece.size
        most = max(most, waiting)
    return pieces if most <= _MOST_WAITING else _sort_to_disk(pieces, ranks)


def _sort_to_disk(pieces: Sequence[Piece], ranks: np.ndarray) -> list[Piece]:
    stream = tempfile.TemporaryFile(prefix="crawler_")  # noqa: SIM115  # it is deleted with the last piece
    made: list[Piece] = []
    group: list[Block] = []
    filled = 0
    for k, piece in enumerate(pieces):
        group.append(piece.load())
        filled += piece.size
        if filled >= _SORTED_AT_ONCE or k + 1 == len(pieces):
            block = _sorted(_join(group), ranks)
            cuts = np.searchsorted(np.cumsum(block.size), np.arange(_SORTED_PIECE, block.data.size, _SORTED_PIECE))
            made += [_store(stream, block.select(at)) for at in np.split(np.arange(block.size.size), cuts) if at.size]
            group, filled = [], 0
    return sorted(made, key=lambda piece: piece.first_ns)


def _store(stream: IO[bytes], block: Block) -> Piece:
    """Write a block to a stream."""
    block = _compact(block)
    place = stream.seek(0, 2)
    table = np.array([getattr(block, name) for name in _COLUMNS])
    stream.write(table.tobytes())
    stream.write(block.data.tobytes())
    source, shape, length = block.source, table.shape, block.data.size

    def load() -> Block:
        stream.seek(place)
        columns = np.frombuffer(stream.read(8 * shape[0] * shape[1]), np.int64).reshape(shape)
        return _build(source, np.frombuffer(stream.read(length), np.uint8), columns)

    return piece_of(block, load)


def merge(
    pieces: Sequence[Piece], ranks: np.ndarray, progress: Callable[[float], None] | None = None
) -> Iterator[Block]:
    """Merge pieces.

    Args:
        pieces: in the order of their first messages.
        ranks: order of the channels, by their numbers, among messages received at the same time.
        progress: called with the fraction done, in [0, 1].

    Yields:
        The messages in log order. Messages received at the same time are in one block: in the order of their channels,
        on a channel in the order of their stamps, then of their numbers.
    """
    waiting: list[Block] = []
    for k, piece in enumerate(pieces):
        waiting.append(_sorted(piece.load(), ranks))
        until = pieces[k + 1].first_ns if k + 1 < len(pieces) else None
        ready, kept = [], []
        for block in waiting:
            count = block.log_ns.size if until is None else int(np.searchsorted(block.log_ns, until))
            if count:
                ready.append(block.select(slice(count)))
            if count < block.log_ns.size:
                kept.append(block.select(slice(count, None)))
        waiting = kept
        if ready:
            if progress is not None:
                progress(k / len(pieces))
            yield ready[0] if len(ready) == 1 else _sorted(_join(ready), ranks)


def _sorted(block: Block, ranks: np.ndarray) -> Block:
    """Sort the messages of a block."""
    log_ns = block.log_ns
    if (np.diff(log_ns) > 0).all():
        return block
    rank = ranks[block.channel]
    order = np.lexsort((rank, log_ns))
    again = (np.diff(log_ns[order]) == 0) & (np.diff(rank[order]) == 0)
    if again.any():  # on one channel at the same time: as a writer with coarse clocks leaves them
        order = np.lexsort((block.sequence, block.publish_ns, _stamps(block), rank, log_ns))
    return block.select(order)


def _stamps(block: Block) -> np.ndarray:
    """Read the stamps with which most messages begin, shape (K,) [s and ns in turn]; for short messages 0."""
    stamps = np.zeros(block.size.size, np.uint64)
    long = np.flatnonzero(block.size >= 12)
    words = block.data[block.first[long][:, None] + np.arange(4, 12)].copy().view("<u4").astype(np.uint64)
    stamps[long] = words[:, 0] << np.uint64(32) | words[:, 1]
    return stamps


def _join(blocks: Sequence[Block]) -> Block:
    """Join blocks to one."""
    blocks = [_compact(block) for block in blocks]
    shifts = np.cumsum([0, *(block.data.size for block in blocks)])
    blocks = [replace(b, first=b.first + shift) for b, shift in zip(blocks, shifts, strict=False)]
    data, *columns = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("data", *_COLUMNS))
    return _build(blocks[0].source, data, columns)


def _build(source: Path, data: np.ndarray, columns: Iterable[np.ndarray]) -> Block:
    channel, sequence, first, size, log_ns, publish_ns = columns
    return Block(source, data, channel, sequence, first, size, log_ns, publish_ns)


def _compact(block: Block) -> Block:
    """Leave out the bytes of other messages where there are many."""
    first, last = int(block.first.min()), int((block.first + block.size).max())
    if last - first <= 2 * int(block.size.sum()) + (1 << 12):
        return replace(block, data=block.data[first:last], first=block.first - first)
    data, size = memoryview(block.data), block.size  # type: ignore[arg-type]
    bytes_of = zip(block.first.tolist(), size.tolist(), strict=True)
    packed = b"".join([data[a : a + n] for a, n in bytes_of])
    return replace(block, data=np.frombuffer(packed, np.uint8), first=np.cumsum(size) - size)
