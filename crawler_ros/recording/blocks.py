"""The chunks of an MCAP file as blocks of messages, without an object for each message.

A file may come from anywhere. What its chunks expand to is bounded before and while they are decompressed, and damaged
chunks and records are passed over.
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any
from zlib import crc32

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Message, Schema, Statistics

from crawler_model import CrawlerError

from .record_head import message_head

LARGEST_CHUNK = 1 << 27
"""Bytes that a chunk may expand to; writers end theirs after the message that fills 1 to 4 MiB."""
MOST_EXPANSION, ALWAYS_EXPANDED = 2_000, 1 << 28
"""Bytes that all chunks may expand to: so many for each byte of the file, or so many in all. A recording at rest
expands 10 to 110 times, because each of its messages has 16 bytes of index beside the chunk."""
_LARGEST_RECORD = 1 << 28
_MOST_DEFINITIONS = 1 << 17
"""Records of schemas and channels that are read of one file; there are 65 536 numbers of each."""
_BLOCK_BYTES = 1 << 20
_RECORD = struct.Struct("<BQ")
_MAGIC_BYTES = 8
_FOOTER_BYTES = _RECORD.size + 20 + _MAGIC_BYTES


class BagError(CrawlerError):
    """A recording that cannot be read."""


@dataclass(frozen=True, eq=False)
class Block:
    """Many consecutive messages of a file: their bytes in one piece, and the position of each.

    Attributes:
        data: the bytes, uint8, shape (B,).
        channel: channel number of each message, shape (K,).
        sequence: its number on the channel, shape (K,).
        first: position of its first byte, shape (K,).
        size: number of its bytes, shape (K,).
        log_ns: when it was received, shape (K,) [ns, wall].
        publish_ns: when it was sent, shape (K,) [ns, wall].
    """

    data: np.ndarray
    channel: np.ndarray
    sequence: np.ndarray
    first: np.ndarray
    size: np.ndarray
    log_ns: np.ndarray
    publish_ns: np.ndarray


@dataclass
class Contents:
    """What a file holds besides its messages, complete once it has been read to the end."""

    part: int = 0
    """Which file of its recording it is."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    attachments: list[Attachment] = field(default_factory=list)
    damaged: int = 0
    """Number of chunks that could not be read and were skipped."""
    promised: int = -1
    """Number of messages that the end of the file states."""
    ended: bool = False
    """Whether the file has its end."""
    definitions: int = 0
    """Number of schemas and channels read so far."""

    def add(self, record: Any) -> None:
        """Keep a record other than a message or a chunk."""
        if isinstance(record, Schema | Channel):
            self.definitions += 1
            if self.definitions <= _MOST_DEFINITIONS:
                kept: dict[int, Any] = self.schemas if isinstance(record, Schema) else self.channels
                kept[record.id] = record
        elif isinstance(record, Statistics):
            self.promised = record.message_count
        elif isinstance(record, Attachment):
            self.attachments.append(record)
        self.ended = isinstance(record, Footer)


def read_file(file: Path, contents: Contents, progress: Callable[[float], None] | None = None) -> Iterator[Block]:
    """Read the messages of a file, a chunk or many small ones at a time.

    Args:
        file: the .mcap file.
        contents: filled as records are read; a channel is there before the block with its first message.
        progress: called with the fraction read, in [0, 1].

    Yields:
        The messages in the order of the file, up to its end or to where it breaks off.

    Raises:
        BagError: when the chunks expand to more than any recording does.
    """
    size = file.stat().st_size
    room = most = max(ALWAYS_EXPANDED, MOST_EXPANSION * size)
    pending = bytearray()
    with file.open("rb") as stream:
        for record in _records(stream, _find_summary(stream, size)):  # the first chunk has them, too: it may be damaged
            if isinstance(record, Schema | Channel):
                contents.add(record)
        for record in _records(stream, _MAGIC_BYTES):
            if isinstance(record, Chunk):
                data = _expand(record)
                room -= len(data)
                if len(data) > LARGEST_CHUNK or room < 0:
                    raise BagError(
                        f"{file}: its {size} bytes expand to more than {LARGEST_CHUNK} in one chunk or {most} in all; "
                        "no recording does: the file is damaged or made to fill the memory"
                    )
                if len(data) == record.uncompressed_size and record.uncompressed_crc in (0, crc32(data)):
                    pending += data
                else:
                    contents.damaged += 1
            elif isinstance(record, Message):
                data = record.data
                pending += message_head(
                    record.channel_id, record.sequence, record.log_time, record.publish_time, len(data)
                )
                pending += data
            else:
                contents.add(record)
            if len(pending) >= _BLOCK_BYTES:
                if progress is not None:
                    progress(stream.tell() / size)
                yield _scan(pending, contents)
                pending = bytearray()
    if pending:
        ended = contents.ended
        yield _scan(pending, contents)
        contents.ended = ended


_READERS: dict[int, Callable[[ReadDataStream], Any]] = {
    int(Opcode.SCHEMA): Schema.read,
    int(Opcode.CHANNEL): Channel.read,
    int(Opcode.CHUNK): Chunk.read,
    int(Opcode.ATTACHMENT): Attachment.read,
    int(Opcode.STATISTICS): Statistics.read,
    int(Opcode.FOOTER): Footer.read,
}


def _find_summary(stream: IO[bytes], size: int) -> int:
    """Find where the summary of a file begins, or return its size where it has none."""
    footer = next(_records(stream, max(size - _FOOTER_BYTES, 0)), None)
    return min(footer.summary_start, size) if isinstance(footer, Footer) and footer.summary_start else size


def _records(stream: IO[bytes], first: int) -> Iterator[Any]:
    """Read top-level records from a place on, without opening chunks, up to the first incomplete or damaged one.

    Message indices are skipped: to read them takes longer than to read the messages.
    """
    stream.seek(first)
    while True:
        head = stream.read(_RECORD.size)
        if len(head) < _RECORD.size:
            return
        opcode, length = _RECORD.unpack(head)
        if length > _LARGEST_RECORD:
            return
        data = stream.read(length)
        if len(data) < length:
            return
        try:
            if opcode == Opcode.MESSAGE:
                yield Message.read(ReadDataStream(BytesIO(data)), length)
            elif opcode in _READERS:
                yield _READERS[opcode](ReadDataStream(BytesIO(data)))
        except Exception:  # any error of the parser on damaged bytes: the readable part ends here
            return
        if opcode == Opcode.FOOTER:
            return


def _expand(chunk: Chunk) -> bytes:
    """Decompress a chunk, up to a byte more than it states or than is read at most; damaged bytes are none."""
    most = min(chunk.uncompressed_size, LARGEST_CHUNK) + 1
    try:
        if chunk.compression == "zstd":
            import zstandard

            return bytes(zstandard.ZstdDecompressor().stream_reader(BytesIO(chunk.data)).read(most))
        if chunk.compression == "lz4":
            import lz4.frame

            with lz4.frame.open(BytesIO(chunk.data)) as stream:
                return bytes(stream.read(most))
    except Exception:  # any error of the decompressor on damaged bytes: the next chunk may be intact
        return b""
    return chunk.data[:most] if chunk.compression == "" else b""


def _find_records(data, rows):  # type: ignore[no-untyped-def]
    """Find the records in the bytes of chunks; compiled, as a hostile chunk holds millions of them.

    Args:
        data: the bytes, uint8, shape (B,).
        rows: output: opcode, first byte, size, and of a message its channel, number, and times of reception and of
            publication, of each message, schema and channel, int64, shape (K, 7), or no rows to count them only.

    Returns:
        Their number. Messages with times of 2^63 ns and more are passed over.
    """
    place, count, end = np.int64(0), 0, data.shape[0]
    while place + 9 <= end:
        opcode = data[place]
        size = np.uint64(0)
        for k in range(8):
            size |= np.uint64(data[place + 1 + k]) << np.uint64(8 * k)
        place += 9
        if size > np.uint64(end - place):
            break
        length = np.int64(size)
        is_message = opcode == 5 and length >= 22 and data[place + 13] < 128 and data[place + 21] < 128
        if is_message or opcode == 3 or opcode == 4:
            if count < rows.shape[0]:
                row = rows[count]
                row[0], row[1], row[2] = opcode, place, length
                if is_message:
                    row[1], row[2] = place + 22, length - 22
                    first = place
                    for j, width in ((3, 2), (4, 4), (5, 8), (6, 8)):
                        value = np.int64(0)
                        for k in range(width):
                            value |= np.int64(data[first + k]) << np.int64(8 * k)
                        row[j] = value
                        first += width
            count += 1
        place += length
    return count


@functools.cache
def compile_search() -> Callable[[np.ndarray, np.ndarray], int]:
    """Compile the search for records in the bytes of chunks, or load it.

    Returns:
        `_find_records`, compiled.
    """
    from crawler_model.compiled import compiled

    find: Callable[[np.ndarray, np.ndarray], int] = compiled(_find_records)
    find(np.zeros(0, np.uint8), np.zeros((0, 7), np.int64))
    return find


def _scan(pending: bytearray, contents: Contents) -> Block:
    """Find the messages in the bytes of chunks, and keep the schemas and channels."""
    data = np.frombuffer(pending, np.uint8)
    find = compile_search()
    rows = np.zeros((find(data, np.zeros((0, 7), np.int64)), 7), np.int64)
    find(data, rows)
    is_message = rows[:, 0] == Opcode.MESSAGE
    for opcode, first, size in rows[~is_message, :3][: _MOST_DEFINITIONS + 1].tolist():
        try:
            contents.add(_READERS[opcode](ReadDataStream(BytesIO(pending[first : first + size]))))
        except Exception:  # any error of the parser on damaged bytes, such as a name that is not UTF-8
            continue
    _, first, size, channel, sequence, log_ns, publish_ns = np.ascontiguousarray(rows[is_message].T)
    return Block(data, channel, sequence, first, size, log_ns, publish_ns)
