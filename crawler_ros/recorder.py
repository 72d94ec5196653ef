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
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import yaml

from .interface import Topic, message_definition, offered_qos, topics, type_hash

CHUNK_SIZE = 768 * 1024
FLUSH_EVERY_S = 0.5
DISTRO = "jazzy"

_FRAME = struct.Struct("<HqqI")  # channel, log time, publish time, size of the data that follows
_PIPE_BYTES = 1 << 20
_BLOCK_BYTES = 1 << 16
_MOST_WAITING = 200_000  # messages


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
        from mcap.writer import CompressionType, Writer

        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise FileExistsError(f"{folder}: the folder is not empty")
        self.folder = folder
        self.path = folder / f"{folder.name}_0.mcap"
        self._file: IO[bytes] = self.path.open("xb")
        self._writer = Writer(self._file, chunk_size=CHUNK_SIZE, compression=CompressionType.ZSTD)
        self._writer.start(profile="ros2", library="crawler")
        self._writer.add_metadata("rosbag2", {"ROS_DISTRO": DISTRO})
        now = time.time_ns()
        for name, data in attachments.items():
            self._writer.add_attachment(now, now, name, "application/json", json.dumps(data, indent=1).encode())
        self._writer.flush()
        self._topics: dict[int, tuple[str, str, dict[str, str]]] = {}
        self._schemas: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._first_ns: int | None = None
        self._last_ns = 0

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
            self._schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", definition)
        channel = self._writer.register_channel(name, "cdr", self._schemas[type_name], metadata)
        self._topics[channel] = (name, type_name, metadata)
        self._counts[channel] = 0
        return channel

    def write(self, channel: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Append a message.

        Args:
            channel: from `add_topic`.
            log_ns: when it was received [ns, wall].
            publish_ns: when it was sent [ns, wall].
            data: its CDR bytes.
        """
        self._writer.add_message(channel, log_ns, data, publish_ns, self._counts[channel])
        self._counts[channel] += 1
        self._first_ns = log_ns if self._first_ns is None else min(self._first_ns, log_ns)
        self._last_ns = max(self._last_ns, log_ns)

    def flush(self) -> None:
        """Hand everything to the operating system: a killed process loses nothing of it."""
        self._writer.flush()

    def close(self) -> None:
        """Write the end of the file and metadata.yaml."""
        information = self._information()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": yaml.safe_dump(information, sort_keys=False)})
        self._writer.finish()
        self._file.close()
        text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
        (self.folder / "metadata.yaml").write_text(text, encoding="utf-8")

    def _information(self) -> dict[str, Any]:
        first = self._first_ns or 0
        span = {"nanoseconds": max(self._last_ns - first, 0)}
        start = {"nanoseconds_since_epoch": first}
        total = sum(self._counts.values())
        rows = [
            {
                "topic_metadata": {
                    "name": name,
                    "type": type_name,
                    "serialization_format": "cdr",
                    "offered_qos_profiles": yaml.safe_load(metadata.get("offered_qos_profiles", "[]")),
                    "type_description_hash": metadata.get("topic_type_hash", ""),
                },
                "message_count": self._counts[channel],
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
        """Make a new bag folder below `parent`, named after the crawler and the time.

        Args:
            parent: folder in which the bag folder is made.
            name: how the folder's name begins.
            attachments: name to plain data: scene, parameters, versions, start state.

        Raises:
            OSError: when the folder cannot be made.
        """
        self.folder = _new_folder(parent, name)
        self.folder.mkdir(parents=True)
        self.error: str | None = None
        self.sent = 0
        self._attachments = attachments
        self._topics: list[tuple[str, str]] = []
        self._process: subprocess.Popen[bytes] | None = None
        self._arrived: deque[bytes] = deque()  # appended to by any thread, emptied by one
        self._block = memoryview(b"")

    def add_topic(self, topic: Topic, name: str) -> int:
        """Register a topic; all of them before `start`.

        Args:
            topic: its row in the table of topics.
            name: what it is called in the graph, namespace and all.

        Returns:
            The channel to record its messages on.
        """
        self._topics.append((topic.name, name))
        return len(self._topics) - 1

    def start(self) -> None:
        """Start the recording process."""
        self._process = subprocess.Popen(
            [sys.executable, "-m", "crawler_ros.recorder"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        header = {"folder": str(self.folder), "attachments": self._attachments, "topics": self._topics}
        data = json.dumps(header).encode()
        self._fd = self._process.stdin.fileno()  # type: ignore[union-attr]
        self._arrived.appendleft(struct.pack("<I", len(data)) + data)
        with contextlib.suppress(OSError):  # a larger pipe is a comfort, not a need
            fcntl.fcntl(self._fd, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self._fd, False)

    def record(self, channel: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Take a message; from any thread. `push` hands it on.

        Args:
            channel: from `add_topic`.
            log_ns: when it was received [ns, wall].
            publish_ns: when it was sent [ns, wall].
            data: its CDR bytes.
        """
        self._arrived.append(_FRAME.pack(channel, log_ns, publish_ns, len(data)) + data)

    def push(self) -> None:
        """Hand over what has arrived, without waiting unless very much waits already; from one thread."""
        if self.error is not None:
            self._arrived.clear()
            return
        if len(self._arrived) > _MOST_WAITING:
            os.set_blocking(self._fd, True)
        try:
            while self._next_block():
                self._block = self._block[os.write(self._fd, self._block) :]
        except BlockingIOError:
            pass
        except BrokenPipeError:
            self.error = self._last_words()
        finally:
            if self.error is None:
                os.set_blocking(self._fd, False)

    def _next_block(self) -> bool:
        """Take the next messages to write, a moderate number of bytes; tell whether there are any."""
        if not self._block and self._arrived:
            pieces, size = [], 0
            while self._arrived and size < _BLOCK_BYTES:
                pieces.append(self._arrived.popleft())
                size += len(pieces[-1])
            self.sent += len(pieces)
            self._block = memoryview(b"".join(pieces))
        return len(self._block) > 0

    @property
    def waiting(self) -> int:
        """Messages taken and not yet handed over."""
        return len(self._arrived)

    def close(self) -> None:
        """Hand over the rest and let the process write the end of the file and metadata.yaml."""
        assert self._process is not None
        assert self._process.stdin is not None
        if self.error is None:
            os.set_blocking(self._fd, True)
            try:
                while self._next_block():
                    self._block = self._block[os.write(self._fd, self._block) :]
            except BrokenPipeError:
                pass
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


def _new_folder(parent: Path, name: str) -> Path:
    stem = f"{name}_{datetime.now():%Y_%m_%d-%H_%M_%S}"
    folder = parent / stem
    count = 1
    while folder.exists():
        count += 1
        folder = parent / f"{stem}_{count}"
    return folder


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
        channels = [bag.add_topic(table[topic], name) for topic, name in header["topics"]]
        _record(fd, data, bag, channels)
        bag.close()
    except OSError as error:  # a full disk: what was flushed can be recovered
        print(error)
        return 1
    return 0


def _record(fd: int, data: bytes, bag: BagWriter, channels: list[int]) -> None:
    flushed = time.monotonic()
    while True:
        place = 0
        while len(data) - place >= _FRAME.size:
            channel, log_ns, publish_ns, size = _FRAME.unpack_from(data, place)
            end = place + _FRAME.size + size
            if end > len(data):
                break
            bag.write(channels[channel], log_ns, publish_ns, data[place + _FRAME.size : end])
            place = end
        data = data[place:]
        if time.monotonic() - flushed >= FLUSH_EVERY_S:
            bag.flush()
            flushed = time.monotonic()
        ready, _, _ = select.select([fd], [], [], FLUSH_EVERY_S)
        if ready:
            block = os.read(fd, _PIPE_BYTES)
            if not block:
                return
            data += block


if __name__ == "__main__":
    sys.exit(main())
