"""Recordings as `ros2 bag record -s mcap` writes them, with everything inside that is needed to run them again."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import select
import struct
import subprocess
import sys
import time
from collections import deque
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import yaml

from .bag_folder import make_folder
from .interface import Topic, message_definition, offered_qos, topics, type_hash
from .mcap_file import McapFile, message_head

CHUNK_SIZE = 768 * 1024
FLUSH_EVERY_S = 0.5
DISTRO = "jazzy"

_PIPE_BYTES = 1 << 20
_PUSH_EVERY_NS = 2_000_000
_MOST_WAITING = 1 << 26
"""Bytes. What waits is lost when the simulator is killed: no more than can be written in a second."""


class BagWriter:
    """One bag folder: an .mcap file and its metadata.yaml. Not for several threads."""

    def __init__(self, folder: Path, attachments: dict[str, Any]) -> None:
        """Open the recording in a new folder, or in an empty one.

        Args:
            folder: made where it does not exist, with its parents.
            attachments: name to plain data, stored as JSON before the first message.

        Raises:
            FileExistsError: when something is in the folder: a recording never overwrites another.
        """
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise FileExistsError(f"{folder}: the folder is not empty")
        self.folder = folder
        self.path = folder / f"{folder.name}_0.mcap"
        self._file: IO[bytes] = self.path.open("xb")
        self._writer = McapFile(self._file, "ros2", "crawler", CHUNK_SIZE)
        self._writer.add_metadata("rosbag2", {"ROS_DISTRO": DISTRO})
        now = time.time_ns()
        for name, data in attachments.items():
            self._writer.add_attachment(now, name, "application/json", json.dumps(data, indent=1).encode())
        self._writer.flush()
        self._topics: dict[int, tuple[str, str, dict[str, str]]] = {}
        self._schemas: dict[str, int] = {}
        self._sequences: dict[int, int] = {}

    def add_topic(self, topic: Topic, name: str) -> int:
        """Register a topic.

        Args:
            topic: its row in the table of topics.
            name: what it is called in the graph, namespace and all.

        Returns:
            The channel to write its messages to.
        """
        qos = yaml.safe_dump(offered_qos(topic), sort_keys=False)
        metadata = {"offered_qos_profiles": qos, "topic_type_hash": type_hash(topic.type)}
        return self.add_channel(name, topic.type, message_definition(topic.type).encode(), metadata)

    def add_channel(self, name: str, type_name: str, definition: bytes, metadata: dict[str, str]) -> int:
        """Register a channel.

        Args:
            name: the topic's name in the graph.
            type_name: its type.
            definition: the type's definition and those of all that it contains.
            metadata: offered_qos_profiles and topic_type_hash.

        Returns:
            The channel to write its messages to.
        """
        if type_name not in self._schemas:
            self._schemas[type_name] = self._writer.add_schema(type_name, "ros2msg", definition)
        channel = self._writer.add_channel(name, "cdr", self._schemas[type_name], metadata)
        self._topics[channel] = (name, type_name, metadata)
        self._sequences[channel] = 0
        return channel

    def write(self, channel: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Append a message.

        Args:
            channel: from `add_topic`.
            log_ns: when it was received [ns, wall].
            publish_ns: when it was sent [ns, wall].
            data: its CDR bytes.
        """
        self._writer.add_messages(message_head(channel, self._sequences[channel], log_ns, publish_ns, len(data)) + data)
        self._sequences[channel] += 1

    def write_records(self, data: memoryview) -> int:
        """Append messages that are MCAP records already.

        Args:
            data: message records, the last of which may be torn.

        Returns:
            The bytes of the whole ones, which are taken.
        """
        return self._writer.add_messages(data)

    def flush(self) -> None:
        """Hand everything to the operating system: a killed process loses nothing of it."""
        self._writer.flush()

    def close(self) -> None:
        """Write the end of the file and metadata.yaml."""
        self._writer.flush()
        information = self._information()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": yaml.safe_dump(information, sort_keys=False)})
        self._writer.finish()
        self._file.close()
        text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
        (self.folder / "metadata.yaml").write_text(text, encoding="utf-8")

    def _information(self) -> dict[str, Any]:
        first, counts = self._writer.first_ns or 0, self._writer.counts
        span = {"nanoseconds": max(self._writer.last_ns - first, 0)}
        start = {"nanoseconds_since_epoch": first}
        total = sum(counts.values())
        rows = [
            {
                "topic_metadata": {
                    "name": name,
                    "type": type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": yaml.safe_load(metadata.get("offered_qos_profiles", "[]")),
                    "type_description_hash": metadata.get("topic_type_hash", ""),
                },
                "message_count": counts.get(channel, 0),
            }
            for channel, (name, type_name, metadata) in self._topics.items()
        ]
        return {
            "version": 9,
            "storage_identifier": "mcap",
            "duration": dict(span),
            "starting_time": dict(start),
            "message_count": total,
            "topics_with_message_count": rows,
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self.path.name],
            "files": [
                {
                    "path": self.path.name,
                    "starting_time": dict(start),
                    "duration": dict(span),
                    "message_count": total,
                }
            ],
            "custom_data": None,
            "ros_distro": DISTRO,
        }


class Recorder:
    """The simulator's end of a pipe to a recording process.

    The process outlives a killed simulator and finishes the file; a slow or full disk does not stall the loop.
    """

    def __init__(self, parent: Path, name: str, attachments: dict[str, Any]) -> None:
        """Note what is to be recorded; nothing is made before `start`.

        Args:
            parent: folder in which the bag folder is made.
            name: how the folder's name begins.
            attachments: name to plain data: scene, parameters, versions, start state.
        """
        self.folder = parent
        """The bag folder, once it is made by `start`."""
        self._name = name
        self._ahead_ns = time.time_ns() - time.monotonic_ns()
        self.error: str | None = None
        self.waiting = 0
        """Bytes taken up by `push` and not yet handed over."""
        self._attachments = attachments
        self._topics: list[tuple[str, str, dict[str, Any]]] = []
        self._sequences: list[int] = []
        self._process: subprocess.Popen[bytes] | None = None
        self._arrived: list[bytes] = []  # appended to by any thread, emptied by one
        self._blocks: deque[memoryview] = deque()
        self._next_push_ns = 0

    def add_topic(self, topic: Topic, name: str) -> int:
        """Register a topic; all of them before `start`.

        Args:
            topic: its row in the table of topics, with the QoS that is offered.
            name: what it is called in the graph, namespace and all.

        Returns:
            The channel to record its messages on.
        """
        self._topics.append((topic.name, name, topic.qos))
        self._sequences.append(0)
        return len(self._topics) - 1

    def start(self) -> None:
        """Make a new bag folder, named after the crawler and the time, and start the recording process.

        Raises:
            OSError: when the folder cannot be made.
        """
        self.folder = make_folder(self.folder, self._name)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "crawler_ros.recorder"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        header = {"folder": str(self.folder), "attachments": self._attachments, "topics": self._topics}
        data = json.dumps(header).encode()
        self._fd = self._process.stdin.fileno()  # type: ignore[union-attr]
        self._take(struct.pack("<I", len(data)) + data)
        with contextlib.suppress(OSError):  # a larger pipe is a comfort, not a need
            fcntl.fcntl(self._fd, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self._fd, False)

    def now_ns(self) -> int:
        """Tell the time for the messages of a recording [ns, wall].

        It is the wall clock's when the recording began, and goes on steadily: readers play messages in the order of
        their times, and a wall clock that is set meanwhile would bring them out of order.
        """
        return self._ahead_ns + time.monotonic_ns()

    def record(self, channel: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Take a message; from any thread, each channel from one at a time. `push` hands it on.

        Args:
            channel: from `add_topic`.
            log_ns: when it was received [ns, wall].
            publish_ns: when it was sent [ns, wall].
            data: its CDR bytes.
        """
        if self.error is not None:
            return
        sequence = self._sequences[channel]
        self._sequences[channel] = sequence + 1
        # one call, so that another thread's message comes before or behind and never between; channels count from 1
        self._arrived.extend((message_head(channel + 1, sequence, log_ns, publish_ns, len(data)), data))

    @property
    def messages(self) -> int:
        """Messages taken."""
        return sum(self._sequences)

    def push(self, now_ns: int) -> None:
        """Hand over what has arrived, now and then; waits only while very much waits already; from one thread.

        Args:
            now_ns: a steady clock's time [ns].
        """
        if now_ns < self._next_push_ns:  # a tick's few messages are not worth a call of the system
            return
        self._next_push_ns = now_ns + _PUSH_EVERY_NS
        if self.error is None:
            self._hand_over(_MOST_WAITING)

    def _take(self, block: bytes) -> None:
        self._blocks.append(memoryview(block))
        self.waiting += len(block)

    def _hand_over(self, most: int) -> None:
        """Write what the pipe takes, and wait until no more than `most` bytes are left."""
        arrived = self._arrived
        if arrived:
            count = len(arrived)
            self._take(b"".join(arrived[:count]))
            del arrived[:count]  # what came meanwhile stands behind
        blocks, patient = self._blocks, False
        try:
            while blocks:
                if patient != (self.waiting > most):
                    patient = not patient
                    os.set_blocking(self._fd, patient)
                block = blocks.popleft()
                try:
                    written = os.write(self._fd, block[:_PIPE_BYTES])
                except BlockingIOError:
                    blocks.appendleft(block)
                    return
                self.waiting -= written
                if written < len(block):
                    blocks.appendleft(block[written:])
        except BrokenPipeError:
            self.error = self._last_words()
            blocks.clear()
            self.waiting = 0
        finally:
            if patient:
                os.set_blocking(self._fd, False)

    def close(self) -> None:
        """Hand over the rest and let the process write the end of the file and metadata.yaml."""
        assert self._process is not None
        assert self._process.stdin is not None
        if self.error is None:
            self._hand_over(0)
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self.error = self.error or self._last_words()

    def _last_words(self) -> str | None:
        """Wait for the process and say what went wrong, if anything did."""
        assert self._process is not None
        said = self._process.stdout.read()  # type: ignore[union-attr]
        self._process.wait()
        if self._process.returncode == 0:
            return None
        return f"recording stopped: {said.decode().strip() or f'the process ended with {self._process.returncode}'}"


def main() -> int:
    """Record the messages that arrive on standard input until it ends."""
    fd = sys.stdin.fileno()
    data = b""
    while len(data) < 4 or len(data) < 4 + struct.unpack_from("<I", data)[0]:
        block = os.read(fd, _PIPE_BYTES)
        if not block:
            return 0
        data += block
    size = 4 + struct.unpack_from("<I", data)[0]
    header, data = json.loads(data[4:size]), data[size:]
    try:
        bag = BagWriter(Path(header["folder"]), header["attachments"])
        table = topics()
        for topic, name, qos in header["topics"]:
            bag.add_topic(replace(table[topic], qos=qos), name)
        _record(fd, data, bag)
        bag.close()
    except OSError as error:  # a full disk: what was flushed can be recovered
        print(error)
        return 1
    return 0


def _record(fd: int, data: bytes, bag: BagWriter) -> None:
    """Write the message records that come behind `data`, flushing twice a second."""
    buffer = bytearray(2 * _PIPE_BYTES)
    filled = len(data)
    buffer[:filled] = data
    flushed = time.monotonic()
    while True:
        with memoryview(buffer) as view:
            taken = bag.write_records(view[:filled])
            view[: filled - taken] = view[taken:filled]
            filled -= taken
        if filled > len(buffer) - _PIPE_BYTES:  # a message larger than any before
            buffer += bytes(len(buffer))
        if time.monotonic() - flushed >= FLUSH_EVERY_S:
            bag.flush()
            flushed = time.monotonic()
        ready, _, _ = select.select([fd], [], [], FLUSH_EVERY_S)
        if ready:
            with memoryview(buffer) as view:
                count = os.readv(fd, [view[filled:]])
            if count == 0:
                return
            filled += count


if __name__ == "__main__":
    sys.exit(main())
