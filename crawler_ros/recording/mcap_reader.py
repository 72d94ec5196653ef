"""The chunks of an MCAP file as blocks of messages, without an object for each message.

A file may come from anywhere. What its chunks and messages expand to is bounded before and while they are decompressed,
and damaged chunks and records are passed over. Statistics, summary, indices, chunks and checksums are optional in MCAP,
so that a file without them is as whole as one with them.
"""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import IO, Any
from zlib import crc32

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, ChunkIndex, Footer, Schema, Statistics

from crawler_model import CrawlerError

LARGEST_CHUNK = 1 << 27
"""Bytes that a chunk may expand to; writers end theirs after the message that fills 1 to 4 MiB."""
MOST_EXPANSION, ALWAYS_EXPANDED = 2_000, 1 << 28
"""Bytes that all chunks may expand to: so many for each byte of the file, or so many in all. A recording at rest
expands 10 to 110 times, because each of its messages has 16 bytes of index outside the chunk."""
_LARGEST_RECORD = 1 << 28
_MOST_DEFINITIONS = 1 << 17
"""Records of schemas and channels that are read of one file; there are 65 536 numbers of each."""
_BLOCK_BYTES = 1 << 20
_RECORD = struct.Struct("<BQ")
_MAGIC_BYTES = 8
_FOOTER_BYTES = _RECORD.size + 20 + _MAGIC_BYTES
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
"""The beginning of what zstd has compressed; a message in CDR begins with 0."""


class BagError(CrawlerError):
    """A recording that cannot be read."""


@dataclass(frozen=True, eq=False)
class Block:
    """Many messages of a recording: their bytes in one piece, and the position of each.

    Attributes:
        source: the recording, or the file of it, for errors.
        data: the bytes, uint8, shape (B,).
        channel: channel number of each message, shape (K,).
        sequence: its number on the channel, shape (K,).
        first: position of its first byte, shape (K,).
        size: number of its bytes, shape (K,).
        log_ns: when it was received, shape (K,) [ns, wall].
        publish_ns: when it was sent, shape (K,) [ns, wall].
        begin: where the records of a block begin that was read from a file.
    """

    source: Path
    data: np.ndarray
    channel: np.ndarray
    sequence: np.ndarray
    first: np.ndarray
    size: np.ndarray
    log_ns: np.ndarray
    publish_ns: np.ndarray
    begin: int = 0

    def select(self, which: np.ndarray | slice) -> Block:
        """Select messages, in the order of their indices `which`; the bytes stay."""
        columns = ("channel", "sequence", "first", "size", "log_ns", "publish_ns")
        return replace(self, **{name: getattr(self, name)[which] for name in columns})


@dataclass
class Contents:
    """What a file holds besides its messages, complete once it has been read to the end."""

    part: int = 0
    """Which file of its recording it is."""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    attachments: list[Attachment] = field(default_factory=list)
    damaged: int = 0
    """Number of chunks and compressed messages that could not be read and were skipped."""
    promised: int | None = None
    """Number of messages that the end of the file states; None when it states none."""
    chunks: int = 0
    """Number of chunks, damaged ones included."""
    indexed: set[int] = field(default_factory=set)
    """Where chunks begin, as the end of the file lists them."""
    ended: bool = False
    """Whether the file has its end."""
    definitions: int = 0
    """Number of schemas and channels read so far."""
    copy: IO[bytes] | None = None
    """Handle of a temporary copy, which exists as long as what refers to this."""

    def keep_record(self, record: Any) -> None:
        """Keep a record other than a message or a chunk."""
        if isinstance(record, Schema | Channel):
            self.definitions += 1
            if self.definitions <= _MOST_DEFINITIONS:
                kept: dict[int, Any] = self.schemas if isinstance(record, Schema) else self.channels
                kept[record.id] = record
        elif isinstance(record, Statistics):
            self.promised = record.message_count
        elif isinstance(record, ChunkIndex):
            self.indexed.add(record.chunk_start_offset)
        elif isinstance(record, Attachment):
            self.attachments.append(record)
        self.ended = isinstance(record, Footer)


@dataclass
class _Room:
    """What the chunks and messages of a file may still expand to."""

    file: Path
    size: int
    left: int

    def count_expanded(self, count: int) -> None:
        """Count expanded bytes; raise a BagError when they are more than any recording has."""
        self.left -= count
        if count > LARGEST_CHUNK or self.left < 0:
            most = largest_expansion(self.size)
            raise BagError(
                f"{self.file}: its {self.size} bytes expand to more than {LARGEST_CHUNK} in one chunk or {most} in "
                "all; no recording does: the file is damaged or made to fill the memory"
            )


def largest_expansion(size: int) -> int:
    """Return the number of bytes to which a file may expand.

    Args:
        size: its own number of bytes.

    Returns:
        The bound.
    """
    return max(ALWAYS_EXPANDED, MOST_EXPANSION * size)


def read_file(file: Path, contents: Contents, begin: int = 0) -> Iterator[Block]:
    """Read the messages of a file, a chunk or many small ones at a time.

    Args:
        file: the .mcap file.
        contents: filled as records are read; a channel is there before the block with its first message.
        begin: where the first block begins, as a block read before states it; 0 for the whole file.

    Yields:
        The messages in the order of the file, up to its end or to where it breaks off.

    Raises:
        BagError: when the chunks expand to more than any recording does.
    """
    size = file.stat().st_size
    room = _Room(file, size, largest_expansion(size))
    pending, ends = bytearray(), list[int]()  # records of messages, and where each chunk of them ends
    with file.open("rb") as stream:
        if begin == 0:
            begin = _MAGIC_BYTES
            for record in _records(stream, _find_summary(stream, size)):  # chunks have them, too, but may be damaged
                if isinstance(record, Schema | Channel):
                    contents.keep_record(record)
        for record in _records(stream, begin):
            if isinstance(record, Chunk):
                contents.chunks += 1
                data = _expand(record)
                room.count_expanded(len(data))
                if len(data) == record.uncompressed_size and record.uncompressed_crc in (0, crc32(data)):
                    pending += data
                    ends.append(len(pending))
                else:
                    contents.damaged += 1
            elif isinstance(record, bytes):
                pending += record
                ends.append(len(pending))
            else:
                contents.keep_record(record)
            if len(pending) >= _BLOCK_BYTES:
                yield replace(_scan(pending, ends, contents, room), begin=begin)
                pending, ends, begin = bytearray(), [], stream.tell()
    if pending:
        ended = contents.ended
        yield replace(_scan(pending, ends, contents, room), begin=begin)
        contents.ended = ended


_READERS: dict[int, Callable[[ReadDataStream], Any]] = {
    int(Opcode.SCHEMA): Schema.read,
    int(Opcode.CHANNEL): Channel.read,
    int(Opcode.CHUNK): Chunk.read,
    int(Opcode.ATTACHMENT): Attachment.read,
    int(Opcode.STATISTICS): Statistics.read,
    int(Opcode.CHUNK_INDEX): ChunkIndex.read,
    int(Opcode.FOOTER): Footer.read,
}


def _find_summary(stream: IO[bytes], size: int) -> int:
    """Find where the summary of a file begins, or return its size where it has none."""
    footer = next(_records(stream, max(size - _FOOTER_BYTES, 0)), None)
    return min(footer.summary_start, size) if isinstance(footer, Footer) and footer.summary_start else size


def _records(stream: IO[bytes], first: int) -> Iterator[Any]:
    """Read top-level records from a place on, without opening chunks, up to the first incomplete or damaged one.

    Messages stay bytes. Message indices are skipped: to read them takes longer than to read the messages.
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
                yield head + data
            elif opcode in _READERS:
                yield _READERS[opcode](ReadDataStream(BytesIO(data)))
        except Exception:  # any error of the parser on damaged bytes: the readable part ends here
            return
        if opcode == Opcode.FOOTER:
            return


def _expand(chunk: Chunk) -> bytes:
    """Decompress a chunk, up to a byte more than it states or than is read at most; damaged bytes are none."""
    most = min(chunk.uncompressed_size, LARGEST_CHUNK) + 1
    if chunk.compression == "zstd":
        return _expand_zstd(chunk.data, most)
    try:
        if chunk.compression == "lz4":
            import lz4.frame

            with lz4.frame.open(BytesIO(chunk.data)) as stream:
                return bytes(stream.read(most))
    except Exception:  # any error of the decompressor on damaged bytes: the next chunk may be intact
        return b""
    return chunk.data[:most] if chunk.compression == "" else b""


def _expand_zstd(data: bytes, most: int) -> bytes:
    """Decompress at most so many bytes; damaged or cut ones are none."""
    import zstandard

    try:
        plain = bytes(zstandard.ZstdDecompressor().stream_reader(BytesIO(data)).read(most))
        return plain if zstandard.frame_content_size(data) in (-1, len(plain)) or len(plain) == most else b""
    except zstandard.ZstdError:
        return b""


def _find_records(data, ends, rows):  # type: ignore[no-untyped-def]
    """Find the records in the bytes of chunks; compiled, as a hostile chunk holds millions of them.

    Args:
        data: the bytes, uint8, shape (B,).
        ends: where each chunk ends, shape (C,); a record that goes beyond ends only the reading of its chunk.
        rows: output: opcode, first byte, size, and of a message its channel, number, and times of reception and of
            publication, of each message, schema and channel, int64, shape (K, 7), or no rows to count them only.

    Returns:
        Their number, and the number of chunks that end within a record. Messages with times of 2^63 ns and more are
        passed over.
    """
    place, count, broken = np.int64(0), 0, 0
    for end in ends:
        while place + 9 <= end:
            opcode = data[place]
            size = np.uint64(0)
            for k in range(8):
                size |= np.uint64(data[place + 1 + k]) << np.uint64(8 * k)
            if size > np.uint64(end - place - 9):
                break
            place += 9
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
        broken += place != end
        place = end
    return count, broken


@functools.cache
def compile_search() -> Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[int, int]]:
    """Compile the search for records in the bytes of chunks, or load it.

    Returns:
        `_find_records`, compiled.
    """
    from crawler_model.compiled import compiled

    find: Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[int, int]] = compiled(_find_records)
    find(np.zeros(0, np.uint8), np.zeros(0, np.int64), np.zeros((0, 7), np.int64))
    return find


def _scan(pending: bytearray, ends: Sequence[int], contents: Contents, room: _Room) -> Block:
    """Find the messages in the bytes of chunks, and keep the schemas and channels."""
    data, cuts = np.frombuffer(pending, np.uint8), np.array(ends, np.int64)
    find = compile_search()
    count, broken = find(data, cuts, np.zeros((0, 7), np.int64))
    contents.damaged += broken
    rows = np.zeros((count, 7), np.int64)
    find(data, cuts, rows)
    is_message = rows[:, 0] == Opcode.MESSAGE
    for opcode, first, size in rows[~is_message, :3][: _MOST_DEFINITIONS + 1].tolist():
        try:
            contents.keep_record(_READERS[opcode](ReadDataStream(BytesIO(pending[first : first + size]))))
        except Exception:  # any error of the parser on damaged bytes, such as a name that is not UTF-8
            continue
    _, first, size, channel, sequence, log_ns, publish_ns = np.ascontiguousarray(rows[is_message].T)
    block = Block(room.file, data, channel, sequence, first, size, log_ns, publish_ns)
    return _expand_messages(block, contents, room)


def _expand_messages(block: Block, contents: Contents, room: _Room) -> Block:
    """Decompress the messages that rosbag2 compressed one by one; damaged ones are left out."""
    filled = np.flatnonzero(block.size >= len(_ZSTD_MAGIC))
    suspects = filled[block.data[block.first[filled]] == _ZSTD_MAGIC[0]]
    cdr = [number for number, channel in contents.channels.items() if channel.message_encoding == "cdr"]
    suspects = suspects[np.isin(block.channel[suspects], cdr)]
    if suspects.size == 0:
        return block
    parts, total, kept = [block.data], block.data.size, np.ones(block.size.size, bool)
    first, size = block.first.copy(), block.size.copy()
    for k in suspects.tolist():
        data = block.data[first[k] : first[k] + size[k]].tobytes()
        if not data.startswith(_ZSTD_MAGIC):
            continue
        plain = _expand_zstd(data, LARGEST_CHUNK + 1)
        room.count_expanded(len(plain))
        contents.damaged += not plain
        kept[k] = bool(plain)
        parts.append(np.frombuffer(plain, np.uint8))
        first[k], size[k] = total, len(plain)
        total += len(plain)
    return replace(block, data=np.concatenate(parts), first=first, size=size).select(np.flatnonzero(kept))
