"""Reading of recordings: bag folders, bare .mcap files, and files whose end is missing."""

from __future__ import annotations

import contextlib
import itertools
import json
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk, get_chunk_data_stream

from crawler_model import CrawlerError, Scene, SceneError

_LARGEST_RECORD = 1 << 28
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_BLOCK_BYTES = 1 << 20


class BagError(CrawlerError):
    """A recording that cannot be read."""


def recorded_scene(path: Path, attachments: Mapping[str, Any]) -> Scene | None:
    """Build the scene that a recording holds.

    Args:
        path: the recording, for errors.
        attachments: attachments of the recording by name.

    Returns:
        The scene; None when the recording holds none.

    Raises:
        BagError: when the scene is not valid in this version.
    """
    if "scene" not in attachments:
        return None
    try:
        return Scene.model_validate(attachments["scene"])
    except SceneError as error:
        raise BagError(f"{path}: invalid scene in the recording: {error}") from None


@dataclass(frozen=True)
class Record:
    """One message: its topic, type, times and bytes, and its channel and schema as recorded."""

    topic: str
    type: str
    log_ns: int
    publish_ns: int
    data: bytes
    channel: Channel
    schema: Schema


def find_file(path: Path) -> Path:
    """Find the .mcap file of a bag folder, or return the file itself.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        The file.

    Raises:
        BagError: when there is no .mcap file, more than one, or the file has another format.
    """
    if path.is_dir():
        files = sorted(path.glob("*.mcap"))
        if not files:
            inside = [p.name for p in sorted(path.iterdir()) if p.is_dir() and any(p.glob("*.mcap"))]
            hint = f"; it holds the recordings {', '.join(inside[:5])}" if inside else ""
            raise BagError(f"{path}: no .mcap file in this folder{hint}")
        if len(files) > 1:
            raise BagError(f"{path}: {len(files)} .mcap files in this folder; name one of them")
        return files[0]
    if not path.is_file():
        raise BagError(f"{path}: no such file or folder")
    with path.open("rb") as stream:
        if stream.read(8) != b"\x89MCAP0\r\n":
            raise BagError(f"{path}: not an MCAP file")
    return path


@dataclass
class Bag:
    """The contents of a recording besides its messages, complete once it has been read to the end."""

    attachments: dict[str, Any]
    complete: bool = False
    damaged: int = 0
    """Number of chunks that could not be read and were skipped."""
    lost: int | None = None
    """Number of messages counted at the end of the file but not found in it; None when that end is missing."""
    channels: dict[int, tuple[Channel, Schema]] = field(default_factory=dict)
    """By number, as `read_blocks` finds them."""


def read(path: Path, bag: Bag | None = None) -> Iterator[Record]:
    """Read all messages in the order of the file, up to its end or to where it breaks off.

    Args:
        path: a bag folder or an .mcap file.
        bag: filled with the attachments as they are read, and with whether the file is complete.

    Yields:
        The messages.

    Raises:
        BagError: when the file is not a recording.
    """
    file = find_file(path)
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    found, promised = 0, -1
    with file.open("rb") as stream:
        for item in _whole_records(stream):
            if isinstance(item, Schema):
                schemas[item.id] = item
            elif isinstance(item, Channel):
                channels[item.id] = item
            elif isinstance(item, Message) and item.channel_id in channels:
                channel = channels[item.channel_id]
                if channel.schema_id in schemas:
                    schema = schemas[channel.schema_id]
                    times = item.log_time, item.publish_time
                    found += 1
                    yield Record(channel.topic, schema.name, *times, item.data, channel, schema)
            elif isinstance(item, Statistics):
                promised = item.message_count
            elif bag is not None and isinstance(item, Attachment) and item.media_type == "application/json":
                with contextlib.suppress(ValueError):
                    bag.attachments[item.name] = json.loads(item.data)
            elif bag is not None and isinstance(item, Footer):
                bag.complete = found == promised


def _whole_records(stream: IO[bytes]) -> Iterator[McapRecord]:
    """Read records, including those inside chunks; skip damaged chunks and stop at an incomplete record."""
    for record in _top_records(stream):
        try:
            inside = list(breakup_chunk(record, validate_crc=True)) if isinstance(record, Chunk) else [record]
        except Exception:  # any error of the decompressor on damaged bytes: the next chunk may be intact
            continue
        yield from inside


def _top_records(stream: IO[bytes]) -> Iterator[McapRecord]:
    """Read top-level records, without opening chunks, up to the first incomplete or damaged one."""
    records = iter(
        StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=_LARGEST_RECORD).records
    )
    while True:
        try:
            record = next(records)
        except Exception:  # any error of the parser on damaged bytes: the readable part ends here
            return
        yield record


@dataclass(frozen=True, eq=False)
class Block:
    """Many consecutive messages of a file: their bytes in one piece, and the position of each.

    Attributes:
        data: the bytes, uint8, shape (B,).
        channel: channel number of each message, shape (K,).
        first: position of its first byte, shape (K,).
        size: number of its bytes, shape (K,).
        log_ns: when it was received, shape (K,) [ns, wall].
    """

    data: np.ndarray
    channel: np.ndarray
    first: np.ndarray
    size: np.ndarray
    log_ns: np.ndarray


def read_blocks(path: Path, bag: Bag, progress: Callable[[float], None] | None = None) -> Iterator[Block]:
    """Read all messages as `read` does, but a chunk at a time and without an object for each message.

    Args:
        path: a bag folder or an .mcap file.
        bag: filled with attachments and channels as they are read, and with whether the file is complete.
        progress: called with the fraction read, in [0, 1].

    Yields:
        The messages in the order of the file.

    Raises:
        BagError: when the file is not a recording.
    """
    file = find_file(path)
    size = max(file.stat().st_size, 1)
    schemas: dict[int, Schema] = {}
    channels: dict[int, Channel] = {}
    pending = bytearray()  # small chunks, and messages outside chunks, make one block
    found, promised, ended = 0, -1, False

    def scanned() -> Block:
        nonlocal found
        block = _scan(bytes(pending), schemas, channels)
        pending.clear()
        bag.channels |= {k: (c, schemas[c.schema_id]) for k, c in channels.items() if c.schema_id in schemas}
        found += block.channel.size
        return block

    with file.open("rb") as stream:
        for record in _large_records(stream):
            if isinstance(record, Chunk):
                data = _decompressed(record)
                if data is None:
                    bag.damaged += 1
                else:
                    pending += data
            elif isinstance(record, Message):
                head = _MESSAGE.pack(record.channel_id, record.sequence, record.log_time, record.publish_time)
                pending += _RECORD.pack(Opcode.MESSAGE, len(head) + len(record.data)) + head + record.data
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Statistics):
                promised = record.message_count
            elif isinstance(record, Attachment) and record.media_type == "application/json":
                with contextlib.suppress(ValueError):
                    bag.attachments[record.name] = json.loads(record.data)
            ended = isinstance(record, Footer)
            if len(pending) >= _BLOCK_BYTES:
                if progress is not None:
                    progress(stream.tell() / size)
                yield scanned()
    if pending:
        yield scanned()
    bag.complete = ended and found == promised
    bag.lost = promised - found if ended else None


_READERS: dict[int, Callable[[ReadDataStream], McapRecord]] = {
    int(Opcode.SCHEMA): Schema.read,
    int(Opcode.CHANNEL): Channel.read,
    int(Opcode.CHUNK): Chunk.read,
    int(Opcode.ATTACHMENT): Attachment.read,
    int(Opcode.STATISTICS): Statistics.read,
    int(Opcode.FOOTER): Footer.read,
}


def _large_records(stream: IO[bytes]) -> Iterator[McapRecord]:
    """Read records as `_top_records` does, but skip message indices, which take longer to read than the messages."""
    stream.seek(8)  # the magic
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


def _decompressed(chunk: Chunk) -> bytes | None:
    """Decompress a chunk; return None when its bytes are damaged, whatever error that causes."""
    try:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        return stream.read(size)
    except Exception:
        return None


def _scan(data: bytes, schemas: dict[int, Schema], channels: dict[int, Channel]) -> Block:
    """Find the messages, schemas and channels in the bytes of a chunk."""
    rows: list[tuple[int, int, int, int]] = []
    place, end = 0, len(data)
    read_head, read_message = _RECORD.unpack_from, _MESSAGE.unpack_from
    while place + _RECORD.size <= end:
        opcode, length = read_head(data, place)
        place += _RECORD.size
        if place + length > end:
            break
        if opcode == 0x05:  # a message
            channel, _, log_ns, _ = read_message(data, place)
            rows.append((channel, place + _MESSAGE.size, length - _MESSAGE.size, log_ns))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            stream = ReadDataStream(BytesIO(data[place : place + length]))
            if opcode == Opcode.SCHEMA:
                schema = Schema.read(stream)
                schemas[schema.id] = schema
            else:
                made = Channel.read(stream)
                channels[made.id] = made
        place += length
    table = np.array(rows, dtype=np.int64).reshape(-1, 4)
    return Block(np.frombuffer(data, np.uint8), *(np.ascontiguousarray(column) for column in table.T))


@dataclass(frozen=True)
class Health:
    """The number of messages on each topic of a recording, and whether the file is complete."""

    complete: bool
    counts: dict[str, int]
    types: dict[str, str]
    first_ns: int
    last_ns: int


def examine(path: Path) -> Health:
    """Count the messages of a recording and check that it is complete.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        The counts, types and times found.

    Raises:
        BagError: when the file is not a recording.
    """
    bag = Bag({})
    counts: dict[str, int] = {}
    types: dict[str, str] = {}
    first, last = 0, 0
    for record in read(path, bag):
        counts[record.topic] = counts.get(record.topic, 0) + 1
        types[record.topic] = record.type
        first = min(first or record.log_ns, record.log_ns)
        last = max(last, record.log_ns)
    return Health(bag.complete, counts, types, first, last)


def newest(path: Path) -> Path:
    """Choose the newest recording in a folder.

    Args:
        path: a recording, or a folder of recordings.

    Returns:
        The path itself if it is a recording, else the newest recording in the folder.
    """
    if not path.is_dir() or any(path.glob("*.mcap")):
        return path
    inside = [file for file in path.glob("*/*.mcap") if file.is_file()]
    return max(inside, key=lambda file: file.stat().st_mtime_ns).parent if inside else path


def recover(path: Path, folder: Path) -> int:
    """Write the readable part of a damaged recording as a complete one, marked as recovered.

    Args:
        path: a bag folder or an .mcap file.
        folder: the bag folder to create; it must not exist.

    Returns:
        The number of messages recovered.

    Raises:
        BagError: when the file is not a recording.
        FileExistsError: when the folder exists.
    """
    from .bag_writer import BagWriter

    bag = Bag({})
    records = read(path, bag)
    first = list(itertools.islice(records, 1))  # attachments precede the first message
    writer = BagWriter(folder, {**bag.attachments, "recovered": {"from": path.name}})
    channels: dict[int, int] = {}
    count = 0
    for record in itertools.chain(first, records):
        if record.channel.id not in channels:
            added = writer.add_channel(record.topic, record.type, record.schema.data, record.channel.metadata)
            channels[record.channel.id] = added
        writer.write(channels[record.channel.id], record.log_ns, record.publish_ns, record.data)
        count += 1
    writer.close()
    return count
