"""One recording as other programs would have written it: MCAP leaves the order and most records to the writer."""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml
import zstandard
from mcap.writer import CompressionType, IndexType, Writer

from crawler_ros.recording import bag


@dataclass(frozen=True)
class Held:
    """All that a recording holds."""

    records: tuple[bag.Record, ...]
    attached: tuple[Any, ...]


@dataclass(frozen=True)
class Variant:
    """How a recording is written.

    Attributes:
        order: puts the messages of each file in order.
        parts: number of files.
        options: of mcap's writer.
        compressed: "", "file" or "message", by rosbag2.
        attach_last: whether the attachments follow the messages.
        channels: number of channels a topic.
        log: changes the time of reception of a message.
    """

    order: Callable[[list[bag.Record]], list[bag.Record]] = list
    parts: int = 1
    options: dict[str, Any] = field(default_factory=dict)
    compressed: str = ""
    attach_last: bool = False
    channels: int = 1
    log: Callable[[bag.Record], int] = lambda record: record.log_ns


def by_topic(records: list[bag.Record]) -> list[bag.Record]:
    return sorted(records, key=lambda r: r.topic)


def shuffled(records: list[bag.Record]) -> list[bag.Record]:
    return random.Random(1).sample(records, len(records))


def swapped(records: list[bag.Record]) -> list[bag.Record]:
    """Two neighbours in the ledger, in the middle."""
    ledger = [k for k, r in enumerate(records) if r.topic == "/applied_commands"]
    one, other = ledger[len(ledger) // 4 : len(ledger) // 4 + 2]
    changed = list(records)
    changed[one], changed[other] = changed[other], changed[one]
    return changed


def latency(record: bag.Record) -> int:
    """Receive the ledger later than the states of some ticks after it."""
    return record.log_ns + 10_000 * (record.topic == "/applied_commands")


def coarse(record: bag.Record) -> int:
    """Receive by a clock that does not tell neighbours apart."""
    return record.log_ns // 50 * 50


BARE = {"use_statistics": False, "use_summary_offsets": False, "index_types": IndexType.NONE}
VARIANTS = {
    "as_recorded": Variant(),
    "topics_one_after_another": Variant(by_topic),
    "reversed": Variant(lambda records: records[::-1]),
    "shuffled": Variant(shuffled, options={"chunk_size": 20_000}),
    "two_ledger_messages_swapped": Variant(swapped),
    "without_statistics": Variant(options={"use_statistics": False}),
    "without_indexes": Variant(options={"index_types": IndexType.NONE}),
    "without_summary": Variant(options={**BARE, "repeat_channels": False, "repeat_schemas": False}),
    "without_chunks": Variant(options={"use_chunking": False}),
    "without_chunks_shuffled_and_bare": Variant(shuffled, options={"use_chunking": False, **BARE}),
    "without_checksums": Variant(options={"enable_crcs": False}),
    "lz4": Variant(options={"compression": CompressionType.LZ4}),
    "zstd": Variant(options={"compression": CompressionType.ZSTD}),
    "small_chunks": Variant(options={"chunk_size": 1_000}),
    "attachments_last": Variant(attach_last=True),
    "three_channels_a_topic": Variant(channels=3),
    "in_parts": Variant(parts=4),
    "in_parts_each_shuffled": Variant(shuffled, parts=3),
    "files_compressed": Variant(compressed="file"),
    "files_in_parts_compressed": Variant(by_topic, parts=2, compressed="file"),
    "messages_compressed": Variant(compressed="message"),
    "messages_compressed_and_shuffled": Variant(shuffled, compressed="message", options={"use_chunking": False}),
    "ledger_received_late": Variant(log=latency),
    "coarse_clock": Variant(shuffled, log=coarse),
}


def hold(source: Path) -> Held:
    """Read all of a recording."""
    head = bag.Bag({})
    records = tuple(bag.read(source, head))
    return Held(records, tuple(head.attached))


def write_variant(held: Held, folder: Path, variant: Variant) -> Path:
    """Write a recording as a bag folder."""
    folder.mkdir(parents=True)
    records = sorted((r._replace(log_ns=variant.log(r)) for r in held.records), key=lambda r: r.log_ns)
    rows = []
    for part in range(variant.parts):
        here = records[part * len(records) // variant.parts : (part + 1) * len(records) // variant.parts]
        file = folder / f"{folder.name}_{part}.mcap"
        _write_file(file, variant.order(here), held.attached if part == 0 else (), variant)
        if variant.compressed == "file":
            packed = file.with_name(file.name + ".zstd")
            packed.write_bytes(zstandard.ZstdCompressor().compress(file.read_bytes()))
            file.unlink()
            file = packed
        rows.append(_describe(file, here))
    text = {
        "version": 9,
        "storage_identifier": "mcap",
        "message_count": len(records),
        "compression_format": "zstd" if variant.compressed else "",
        "compression_mode": variant.compressed,
        "relative_file_paths": [row["path"] for row in rows],
        "files": rows,
    }
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": text}))
    return folder


def _write_file(file: Path, records: Sequence[bag.Record], attached: Sequence[Any], variant: Variant) -> None:
    options = {"compression": CompressionType.NONE, **variant.options}
    with file.open("wb") as stream:
        writer = Writer(stream, **options)
        writer.start("ros2", "test")

        def attach() -> None:
            for a in attached:
                writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)

        if not variant.attach_last:
            attach()
        schemas: dict[str, int] = {}
        channels: dict[tuple[str, int], int] = {}
        compress = zstandard.ZstdCompressor().compress if variant.compressed == "message" else bytes
        for k, r in enumerate(records):
            if r.type not in schemas:
                schemas[r.type] = writer.register_schema(r.type, "ros2msg", r.schema.data)
            key = r.topic, k % variant.channels
            if key not in channels:
                channels[key] = writer.register_channel(r.topic, "cdr", schemas[r.type], dict(r.channel.metadata))
            writer.add_message(channels[key], r.log_ns, compress(r.data), r.publish_ns)
        if variant.attach_last:
            attach()
        writer.finish()


def _describe(file: Path, records: Sequence[bag.Record]) -> dict[str, Any]:
    times = [r.log_ns for r in records]
    return {
        "path": file.name,
        "starting_time": {"nanoseconds_since_epoch": min(times)},
        "duration": {"nanoseconds": max(times) - min(times)},
        "message_count": len(records),
    }


def change_effort(held: Held, topic: str, after_ns: int, by: int) -> Held:
    """Change a bit of the last number of each state on a topic from a stamp on, in the run after the first reset."""
    from crawler_ros.wire.messages import read_stamp

    def changed(r: bag.Record) -> bag.Record:
        if r.topic != topic or read_stamp(r.data) < after_ns:
            return r
        data = bytearray(r.data)
        data[-2] ^= by
        return r._replace(data=bytes(data))

    return replace(held, records=tuple(changed(r) for r in held.records))
