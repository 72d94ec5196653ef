"""Bag folders as `ros2 bag record -s mcap` writes them: an .mcap file and metadata.yaml. ROS is not loaded."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import yaml

from ..wire.definitions import message_definition, type_hash
from ..wire.topics import Topic, offered_qos
from .mcap_writer import McapFile
from .record_head import message_head

if TYPE_CHECKING:
    from mcap.records import Attachment

CHUNK_SIZE = 3 << 20
"""Bytes. The names in a topic's first message in a chunk are not repetitions, which costs time and space: a chunk of
768 KiB, the default of rosbag2, holds only four ticks of a thousand contacts."""
DISTRO = "jazzy"


def describe_channel(topic: Topic) -> tuple[str, bytes, dict[str, str]]:
    """Collect the type, definition and metadata that the file holds for a topic.

    Args:
        topic: its row in the table of topics, with the offered QoS.

    Returns:
        The type, its definition with the definitions of all types that it contains, and the channel's metadata.

    Raises:
        FileNotFoundError: when the definition of the type is not installed.
    """
    qos = yaml.safe_dump(offered_qos(topic), sort_keys=False)
    metadata = {"offered_qos_profiles": qos, "topic_type_hash": type_hash(topic.type)}
    return topic.type, message_definition(topic.type).encode(), metadata


class BagWriter:
    """One bag folder: an .mcap file and its metadata.yaml. Not thread-safe."""

    def __init__(self, folder: Path, attachments: dict[str, Any]) -> None:
        """Open the recording in a new folder, or in an empty one.

        Args:
            folder: the folder; it is created with its parents if it does not exist.
            attachments: plain data by name, stored as JSON before the first message.

        Raises:
            FileExistsError: when the folder is not empty: a recording never overwrites another.
        """
        folder.mkdir(parents=True, exist_ok=True)
        if any(folder.iterdir()):
            raise FileExistsError(f"{folder}: the folder is not empty")
        self.folder = folder
        self._place: int | None = None
        if os.rename in os.supports_dir_fd:  # not on Windows
            self._place = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)  # the folder itself, even if it is moved
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
            name: its full name in the ROS graph.

        Returns:
            The channel to write its messages to.
        """
        return self.add_channel(name, *describe_channel(topic))

    def add_channel(self, name: str, type_name: str, definition: bytes, metadata: dict[str, str]) -> int:
        """Register a channel.

        Args:
            name: full name of the topic in the ROS graph.
            type_name: its type.
            definition: definition of the type and of all types that it contains.
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

    def add_attachment(self, attachment: Attachment) -> None:
        """Copy an attachment of another recording.

        Args:
            attachment: as it was read.
        """
        self._writer.add_attachment(attachment.log_time, attachment.name, attachment.media_type, attachment.data)

    def write(self, channel: int, log_ns: int, publish_ns: int, data: bytes, sequence: int | None = None) -> None:
        """Append a message.

        Args:
            channel: from `add_topic`.
            log_ns: when it was received [ns, wall].
            publish_ns: when it was sent [ns, wall].
            data: its CDR bytes.
            sequence: its number on the channel; None to count from 0.
        """
        if sequence is None:
            sequence = self._sequences[channel]
            self._sequences[channel] += 1
        self._writer.add_messages(message_head(channel, sequence, log_ns, publish_ns, len(data)) + data)

    def write_records(self, data: memoryview) -> int:
        """Append messages that are MCAP records already.

        Args:
            data: message records, the last of which may be incomplete.

        Returns:
            The number of bytes of the complete records, which are written.
        """
        return self._writer.add_messages(data)

    def flush(self) -> None:
        """Pass everything to the operating system, so that a killed process loses none of it."""
        self._writer.flush()

    def find_trouble(self) -> str:
        """Check that the recording is still in its original place and can be finished there.

        Returns:
            A description of what is wrong while messages can still be written; "" when nothing is.

        Raises:
            FileNotFoundError: when the file was deleted, so that nothing written to it can be read.
        """
        held = os.fstat(self._file.fileno())
        if held.st_nlink == 0:
            raise FileNotFoundError(f"{self.path} was deleted while it was recorded")
        try:
            there = os.path.samestat(os.stat(self.path), held)
        except OSError:
            there = False
        if not there:
            return f"{self.path} was moved or cannot be reached; the recording continues in the moved file"
        if not os.access(self.folder, os.W_OK | os.X_OK):
            return (
                f"{self.folder} is no longer writable; messages are still recorded, but metadata.yaml cannot be written"
            )
        return ""

    def close(self) -> None:
        """Write the end of the file and metadata.yaml, which appears when it is complete."""
        self._writer.flush()
        information = self._information()
        self._writer.add_metadata("rosbag2", {"serialized_metadata": yaml.safe_dump(information, sort_keys=False)})
        self._writer.finish()
        self._file.close()
        text = yaml.safe_dump({"rosbag2_bagfile_information": information}, sort_keys=False)
        new = os.O_WRONLY | os.O_CREAT | os.O_EXCL
        folder = self.folder if self._place is None else Path()
        part, whole = folder / ".metadata.yaml", folder / "metadata.yaml"
        try:
            with os.fdopen(os.open(part, new, 0o666, dir_fd=self._place), "w", encoding="utf-8") as file:
                file.write(text)
            os.rename(part, whole, src_dir_fd=self._place, dst_dir_fd=self._place)
        except OSError as error:
            raise OSError(error.errno, error.strerror, str(self.folder / "metadata.yaml")) from None
        finally:
            if self._place is not None:
                os.close(self._place)

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
                    "offered_qos_profiles": _read_profiles(metadata.get("offered_qos_profiles", "[]")),
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


def _read_profiles(text: str) -> Any:
    """Read the QoS profiles of a channel; none where a damaged recording is recovered and they are not YAML."""
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return []
