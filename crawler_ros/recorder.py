"""Recordings as `ros2 bag record -s mcap` writes them, with everything inside that is needed to run them again."""

from __future__ import annotations

import json
import queue
import threading
import time
from datetime import datetime
from pathlib import Path
from typing import IO, Any

import yaml
from mcap.writer import CompressionType, Writer

from .interface import Topic, message_definition, offered_qos, type_hash

CHUNK_SIZE = 768 * 1024
FLUSH_EVERY_S = 0.5
DISTRO = "jazzy"

_QUEUE_LIMIT = 200_000


class BagWriter:
    """One bag folder: an .mcap file and its metadata.yaml. Not for several threads."""

    def __init__(self, folder: Path, attachments: dict[str, Any]) -> None:
        """Create the folder and open the recording.

        Args:
            folder: must not exist; its parents are made.
            attachments: name to plain data, stored as JSON before the first message.

        Raises:
            FileExistsError: when the folder exists: a recording never overwrites another.
        """
        folder.mkdir(parents=True)
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
    """Records in a thread of its own, so that a slow disk does not stall the loop."""

    def __init__(self, parent: Path, name: str, attachments: dict[str, Any]) -> None:
        """Open a new bag folder below `parent`, named after the crawler and the time.

        Args:
            parent: folder in which the bag folder is made.
            name: how the folder's name begins.
            attachments: name to plain data: scene, parameters, versions, start state.

        Raises:
            OSError: when the folder cannot be made.
        """
        self._bag = BagWriter(_new_folder(parent, name), attachments)
        self._queue: queue.Queue[tuple[int, int, int, bytes] | None] = queue.Queue(_QUEUE_LIMIT)
        self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
        self.error: str | None = None
        self.written = 0
        self._started = False

    @property
    def folder(self) -> Path:
        """The bag folder."""
        return self._bag.folder

    def add_topic(self, topic: Topic, name: str) -> int:
        """Register a topic; all of them before the first message."""
        return self._bag.add_topic(topic, name)

    def record(self, channel: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Hand a message over; waits only when the disk is two hundred thousand messages behind."""
        if not self._started:
            self._started = True
            self._thread.start()
        if self.error is None:
            self._queue.put((channel, log_ns, publish_ns, data))

    @property
    def waiting(self) -> int:
        """Messages handed over and not yet written."""
        return self._queue.qsize()

    def close(self) -> None:
        """Write what is waiting, the end of the file and metadata.yaml."""
        if self._started:
            self._queue.put(None)
            self._thread.join()
        if self.error is None:
            self._bag.close()

    def _work(self) -> None:
        flushed = time.monotonic()
        while True:
            wait = max(flushed + FLUSH_EVERY_S - time.monotonic(), 0.0)
            try:
                item = self._queue.get(timeout=wait) if wait > 0.0 else self._queue.get_nowait()
            except queue.Empty:
                item = ()
            try:
                if item is None:
                    return
                if item:
                    self._bag.write(*item)
                    self.written += 1
                if time.monotonic() - flushed >= FLUSH_EVERY_S:
                    self._bag.flush()
                    flushed = time.monotonic()
            except OSError as error:  # a full disk: keep what is written, let the crawler go on
                self.error = f"recording stopped: {error}"
                while self._queue.get() is not None:
                    pass
                return


def _new_folder(parent: Path, name: str) -> Path:
    stem = f"{name}_{datetime.now():%Y_%m_%d-%H_%M_%S}"
    folder = parent / stem
    count = 1
    while folder.exists():
        count += 1
        folder = parent / f"{stem}_{count}"
    return folder
