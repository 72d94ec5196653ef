"""Reading recordings: bag folders, bare .mcap files, and files whose end is missing."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Schema, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk

from crawler_model import CrawlerError

_LARGEST_RECORD = 1 << 28


class BagError(CrawlerError):
    """A recording that cannot be read."""


@dataclass(frozen=True)
class Record:
    """One message: where it was heard, what it is, when, and its bytes; and its channel and schema as recorded."""

    topic: str
    type: str
    log_ns: int
    publish_ns: int
    data: bytes
    channel: Channel
    schema: Schema


def find_file(path: Path) -> Path:
    """Find the .mcap file of a bag folder, or take the file itself.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        The file.

    Raises:
        BagError: when there is none, or it is something else.
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
    """What a recording holds besides messages, known once it has been read to the end."""

    attachments: dict[str, Any]
    complete: bool = False


def read(path: Path, bag: Bag | None = None) -> Iterator[Record]:
    """Read all messages in the order of the file, up to its end or to where it breaks off.

    Args:
        path: a bag folder or an .mcap file.
        bag: filled with the attachments as they come, and with whether the file is whole.

    Yields:
        The messages.

    Raises:
        BagError: when it is no recording at all.
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
    """Read records, those inside chunks too, up to the first that is torn or damaged."""
    records = iter(
        StreamReader(stream, emit_chunks=True, validate_crcs=True, record_size_limit=_LARGEST_RECORD).records
    )
    while True:
        try:
            record = next(records)
            inside = list(breakup_chunk(record, validate_crc=True)) if isinstance(record, Chunk) else [record]
        except Exception:  # whatever the parser or the decompressor makes of damaged bytes: here the readable part ends
            return
        yield from inside


@dataclass(frozen=True)
class Health:
    """What a look through a whole recording finds."""

    complete: bool
    counts: dict[str, int]
    types: dict[str, str]
    first_ns: int
    last_ns: int


def examine(path: Path) -> Health:
    """Count a recording's messages and tell whether it is whole.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        What was found.

    Raises:
        BagError: when it is no recording at all.
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


def recover(path: Path, folder: Path) -> int:
    """Write what can be read of a torn recording as a whole one.

    Args:
        path: a bag folder or an .mcap file.
        folder: the bag folder to make; it must not exist.

    Returns:
        The number of messages recovered.

    Raises:
        BagError: when it is no recording at all.
        FileExistsError: when the folder exists.
    """
    from .recorder import BagWriter

    bag = Bag({})
    records = read(path, bag)
    record = next(records, None)  # attachments stand before the first message
    writer = BagWriter(folder, bag.attachments)
    channels: dict[int, int] = {}
    count = 0
    while record is not None:
        if record.channel.id not in channels:
            channels[record.channel.id] = writer.add_channel(
                record.topic, record.type, record.schema.data, record.channel.metadata
            )
        writer.write(channels[record.channel.id], record.log_ns, record.publish_ns, record.data)
        count += 1
        record = next(records, None)
    writer.close()
    return count
