"""Writing of an MCAP file from complete message records, many at once.

The bytes equal what `mcap.writer.Writer` writes; the record classes of mcap write all but the messages. These
arrive as records already, so that building a chunk means copying them and reading the head of each, instead of a dozen
calls per message.
"""

from __future__ import annotations

import struct
from array import array
from collections.abc import Mapping
from typing import IO, Any

import zstandard
from mcap import records as mcap_records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from .record_head import MESSAGE_HEAD, SIZED

try:
    from isal.isal_zlib import crc32  # ten times as fast
except ImportError:
    from zlib import crc32

COMPRESSION = zstandard.ZstdCompressionParameters.from_level(-1, window_log=22, hash_log=14)
"""Of chunks. On repeating names and changing numbers, level -1 compresses to a tenth more than the default level in
half the time; window and table fit a large chunk, so that the earlier messages of long topics are found."""
_INDEX_HEAD = struct.Struct("<BQHI")
_MAGIC = b"\x89MCAP0\r\n"


class McapFile:
    """Writes one file: zstd chunks with message indices, and a summary. Not thread-safe."""

    def __init__(self, stream: IO[bytes], profile: str, library: str, chunk_size: int) -> None:
        """Write the head of the file.

        Args:
            stream: stream to write to; it is not closed here.
            profile: profile in the header.
            library: library in the header.
            chunk_size: a chunk ends with the message that takes it beyond this size [bytes].
        """
        self._stream = stream
        self._chunk_size = chunk_size
        self._chunk = memoryview(bytearray(2 * chunk_size))  # kept: new memory for each chunk costs as much as copying
        self._filled = 0
        self._compress = zstandard.ZstdCompressor(compression_params=COMPRESSION).compress
        self._indices: dict[int, array[int]] = {}  # log time and offset in the chunk of each message, by channel
        self._schemas: list[mcap_records.Schema] = []
        self._channels: list[mcap_records.Channel] = []
        self._chunk_indices: list[mcap_records.ChunkIndex] = []
        self._attachment_indices: list[mcap_records.AttachmentIndex] = []
        self._metadata_indices: list[mcap_records.MetadataIndex] = []
        self.counts: dict[int, int] = {}
        """Messages in finished chunks, by channel."""
        self.first_ns: int | None = None
        self.last_ns = 0
        stream.write(_MAGIC)
        self._write(mcap_records.Header(profile, library))

    def _write(self, record: Any) -> tuple[int, int]:
        """Write a record outside chunks; return where it begins and its length."""
        place, data = self._stream.tell(), _bytes(record)
        self._stream.write(data)
        return place, len(data)

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Register a schema; return its number."""
        self._schemas.append(mcap_records.Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data))
        self._append(_bytes(self._schemas[-1]))
        return len(self._schemas)

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: dict[str, str]) -> int:
        """Register a channel; return its number: 1, 2, ... in the order of registration."""
        number = len(self._channels) + 1
        channel = mcap_records.Channel(
            id=number, topic=topic, message_encoding=encoding, schema_id=schema, metadata=metadata
        )
        self._channels.append(channel)
        self._append(_bytes(channel))
        return number

    def _append(self, data: bytes | memoryview) -> None:
        """Append records to the chunk."""
        end = self._filled + len(data)
        if end > len(self._chunk):
            self._chunk = memoryview(bytearray(self._chunk) + bytes(2 * end - len(self._chunk)))
        self._chunk[self._filled : end] = data
        self._filled = end

    def add_attachment(self, time_ns: int, name: str, media_type: str, data: bytes) -> None:
        """Write an attachment."""
        attachment = mcap_records.Attachment(
            create_time=time_ns, log_time=time_ns, name=name, media_type=media_type, data=data
        )
        place, length = self._write(attachment)
        index = mcap_records.AttachmentIndex(place, length, time_ns, time_ns, len(data), name, media_type)
        self._attachment_indices.append(index)

    def add_metadata(self, name: str, data: dict[str, str]) -> None:
        """Write a table of names and values."""
        place, length = self._write(mcap_records.Metadata(name=name, metadata=data))
        self._metadata_indices.append(mcap_records.MetadataIndex(offset=place, length=length, name=name))

    def add_messages(self, data: bytes | bytearray | memoryview) -> int:
        """Append message records of registered channels.

        Args:
            data: records; the last may be incomplete.

        Returns:
            The number of bytes of the complete records, which are written.
        """
        view, unpack, indices, total = memoryview(data), MESSAGE_HEAD.unpack_from, self._indices, len(data)
        begin = place = 0  # start of the data not yet in the chunk; start of the record
        shift = self._filled
        while total - place >= MESSAGE_HEAD.size:
            _, size, channel, _, log_ns, _ = unpack(view, place)
            end = place + SIZED + size
            if end > total:
                break
            if channel not in indices:
                indices[channel] = array("Q")
            indices[channel].extend((log_ns, shift + place))
            place = end
            if shift + place > self._chunk_size:
                self._append(view[begin:place])
                self._finish_chunk()
                begin, shift = place, -place
        self._append(view[begin:place])
        return place

    def _finish_chunk(self) -> None:
        if not self._indices:  # schemas and channels wait for the first message
            return
        first = min(min(index[::2]) for index in self._indices.values())
        last = max(max(index[::2]) for index in self._indices.values())
        records = self._chunk[: self._filled]
        data = self._compress(records)
        place, length = self._write(
            mcap_records.Chunk(
                compression="zstd",
                data=data,
                message_start_time=first,
                message_end_time=last,
                uncompressed_crc=crc32(records),
                uncompressed_size=self._filled,
            )
        )
        after = place + length
        offsets = {}
        for channel, index in self._indices.items():
            offsets[channel] = self._stream.tell()
            size = 8 * len(index)
            self._stream.write(_INDEX_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size))
            self._stream.write(index.tobytes())
            self.counts[channel] = self.counts.get(channel, 0) + len(index) // 2
        self._chunk_indices.append(
            mcap_records.ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=place,
                chunk_length=length,
                message_index_offsets=offsets,
                message_index_length=self._stream.tell() - after,
                compression="zstd",
                compressed_size=len(data),
                uncompressed_size=self._filled,
            )
        )
        self.first_ns = first if self.first_ns is None else min(self.first_ns, first)
        self.last_ns = max(self.last_ns, last)
        self._filled = 0
        self._indices.clear()

    def flush(self) -> None:
        """End the chunk and pass everything to the operating system, so that a killed process loses none of it."""
        self._finish_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the summary and the end of the file."""
        self._finish_chunk()
        self._write(mcap_records.DataEnd(0))
        statistics = mcap_records.Statistics(
            attachment_count=len(self._attachment_indices),
            channel_count=len(self._channels),
            channel_message_counts=self.counts,
            chunk_count=len(self._chunk_indices),
            message_count=sum(self.counts.values()),
            metadata_count=len(self._metadata_indices),
            message_start_time=self.first_ns or 0,
            message_end_time=self.last_ns,
            schema_count=len(self._schemas),
        )
        groups: Mapping[Opcode, list[Any]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [statistics],
            Opcode.CHUNK_INDEX: self._chunk_indices,
            Opcode.ATTACHMENT_INDEX: self._attachment_indices,
            Opcode.METADATA_INDEX: self._metadata_indices,
        }
        start = self._stream.tell()
        summary, offsets = b"", b""
        for opcode, records in groups.items():
            group = b"".join(map(_bytes, records))
            offsets += _bytes(mcap_records.SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        footer = mcap_records.Footer(start, start + len(summary), 0)
        without_crc = _bytes(footer)[:-4]
        footer.summary_crc = crc32(summary + offsets + without_crc)
        self._stream.write(summary + offsets)
        self._write(footer)
        self._stream.write(_MAGIC)


def _bytes(record: Any) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())
