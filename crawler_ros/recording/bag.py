"""Reading of recordings: bag folders, bare .mcap files, and files whose end is missing."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.records import Attachment, Channel, Schema

from crawler_model import Scene, SceneError

from .bag_folder import list_bags
from .blocks import BagError as BagError
from .blocks import Block as Block
from .blocks import Contents, read_file

if TYPE_CHECKING:
    from .bag_writer import BagWriter


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


def find_files(path: Path) -> list[Path]:
    """Find the .mcap files of a recording, in order.

    A recorder may split a recording into files NAME_0.mcap, NAME_1.mcap and so on in one folder.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        The files.

    Raises:
        BagError: when there is no .mcap file, there are several that are not parts of one recording, or one has another
            format.
    """
    if path.is_dir():
        files = sorted(path.glob("*.mcap"))
        if not files:
            inside = [p.name for p in sorted(path.iterdir()) if p.is_dir() and any(p.glob("*.mcap"))]
            hint = f"; it holds the recordings {', '.join(inside[:5])}" if inside else ""
            raise BagError(f"{path}: no .mcap file in this folder{hint}")
        if len(files) > 1:
            parts = [(file.stem.rpartition("_"), file) for file in files]
            if len({stem for (stem, _, _), _ in parts}) > 1 or not all(number.isdigit() for (_, _, number), _ in parts):
                raise BagError(f"{path}: {len(files)} .mcap files in this folder; name one of them")
            files = [file for _, file in sorted(parts, key=lambda part: int(part[0][2]))]
    elif path.is_file():
        files = [path]
    else:
        raise BagError(f"{path}: no such file or folder")
    for file in files:
        with file.open("rb") as stream:
            if not b"\x89MCAP0\r\n".startswith(stream.read(8)):  # a file that has just begun may be shorter
                scene = "; a scene is run by crawler simulate" if file.suffix in (".yaml", ".yml") else ""
                raise BagError(f"{file}: not an MCAP file{scene}")
    return files


def find_file(path: Path) -> Path:
    """Find the .mcap file of a recording; the first one of several.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        The file.

    Raises:
        BagError: as for `find_files`.
    """
    return find_files(path)[0]


@dataclass
class Bag:
    """The contents of a recording besides its messages, complete once it has been read to the end."""

    attachments: dict[str, Any]
    """Those in JSON, decoded, by name."""
    complete: bool = False
    damaged: int = 0
    """Number of chunks that could not be read and were skipped."""
    lost: int | None = None
    """Number of messages counted at the end of the files but not found in them; None when an end is missing."""
    channels: dict[int, tuple[Channel, Schema]] = field(default_factory=dict)
    """By number in the blocks."""
    attached: list[Attachment] = field(default_factory=list)
    """All attachments as recorded."""
    counts: Counter[str] = field(default_factory=Counter)
    """Number of messages by topic; counted by `examine` alone."""

    def find(self, block: Block, topic: str) -> np.ndarray:
        """Return the indices of a topic's messages in a block, shape (K,); a topic may have several channels."""
        numbers = [number for number, (channel, _) in self.channels.items() if channel.topic == topic]
        return np.flatnonzero(np.isin(block.channel, numbers))

    def _keep(self, contents: Contents) -> None:
        """Keep the attachments of a file that were read since the last call."""
        new, contents.attachments = contents.attachments, []
        self.attached += new
        for attachment in new:
            if attachment.media_type == "application/json":
                with contextlib.suppress(ValueError, RecursionError):  # not JSON, or nested too deeply
                    self.attachments[attachment.name] = json.loads(attachment.data)

    def _number(self, contents: Contents, numbers: dict[int, int]) -> None:
        """Number the channels of a file that were read since the last call; parts of a recording share channels."""
        known = {(channel.topic, schema.name): number for number, (channel, schema) in self.channels.items()}
        for local in contents.channels.keys() - numbers.keys():
            channel = contents.channels[local]
            schema = contents.schemas.get(channel.schema_id)
            if schema is not None:
                free = local if local not in self.channels else max(self.channels) + 1
                again = known.get((channel.topic, schema.name), free) if contents.part else free
                numbers[local] = again
                self.channels.setdefault(again, (channel, schema))


def read_blocks(path: Path, bag: Bag, progress: Callable[[float], None] | None = None) -> Iterator[Block]:
    """Read all messages, a chunk at a time and without an object for each message.

    Args:
        path: a bag folder or an .mcap file.
        bag: filled with attachments and channels as they are read, and with whether the recording is complete.
        progress: called with the fraction read, in [0, 1].

    Yields:
        The messages in the order of the files, up to their end or to where one breaks off.

    Raises:
        BagError: when the file is not a recording.
    """
    files = find_files(path)
    found = promised = 0
    ended = True
    for part, file in enumerate(files):
        contents, numbers = Contents(part=part), dict[int, int]()
        done = None if progress is None else lambda share, part=part: progress((part + share) / len(files))
        for block in read_file(file, contents, done):
            bag._keep(contents)
            bag._number(contents, numbers)
            found += int(np.isin(block.channel, list(contents.channels)).sum())
            yield block if part == 0 else _renumbered(block, numbers)
        bag._keep(contents)
        bag.damaged += contents.damaged
        promised += contents.promised
        ended = ended and contents.ended
    bag.complete = ended and found == promised
    bag.lost = promised - found if ended else None


def _renumbered(block: Block, numbers: Mapping[int, int]) -> Block:
    """Replace the channel numbers of a file by those of its recording; -1 where nothing describes the channel."""
    table = np.full(1 << 16, -1)
    table[list(numbers)] = list(numbers.values())
    return dataclasses.replace(block, channel=table[block.channel])


class Record(NamedTuple):
    """One message: its topic, type, times and bytes, its channel and schema as recorded, and its numbers."""

    topic: str
    type: str
    log_ns: int
    publish_ns: int
    data: bytes
    channel: Channel
    schema: Schema
    number: int
    """Of the channel in the recording."""
    sequence: int
    """Of the message in the channel."""


def read(path: Path, bag: Bag | None = None) -> Iterator[Record]:
    """Read all messages in the order of the files, up to their end or to where one breaks off.

    Args:
        path: a bag folder or an .mcap file.
        bag: filled with the attachments as they are read, and with whether the recording is complete.

    Yields:
        The messages whose channel is described.

    Raises:
        BagError: when the file is not a recording.
    """
    bag = Bag({}) if bag is None else bag
    for block in read_blocks(path, bag):
        columns = (block.channel, block.sequence, block.first, block.size, block.log_ns, block.publish_ns)
        for number, sequence, first, size, log_ns, publish_ns in zip(*(c.tolist() for c in columns), strict=True):
            if number in bag.channels:
                channel, schema = bag.channels[number]
                data = block.data[first : first + size].tobytes()
                yield Record(channel.topic, schema.name, log_ns, publish_ns, data, channel, schema, number, sequence)


def read_head(path: Path) -> Bag:
    """Read the attachments of a recording that precede its first message.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        The contents found up to there.

    Raises:
        BagError: when the file is not a recording.
    """
    bag = Bag({})
    next(iter(read(path, bag)), None)
    return bag


def examine(path: Path) -> Bag:
    """Read a recording to its end, for what it holds besides its messages.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        Its contents, with the number of messages by topic.

    Raises:
        BagError: when the file is not a recording.
    """
    bag = Bag({})
    for block in read_blocks(path, bag):
        for number, count in Counter(block.channel.tolist()).items():
            if number in bag.channels:
                bag.counts[bag.channels[number][0].topic] += count
    return bag


def newest(path: Path) -> Path:
    """Choose the newest recording in a folder.

    Args:
        path: a recording, or a folder of recordings.

    Returns:
        The path itself if it is a recording, else the newest recording in the folder.
    """
    bags = list_bags(path)
    return path if bags == [path] else max(bags, key=lambda bag: max(f.stat().st_mtime_ns for f in bag.glob("*.mcap")))


def recover(path: Path, folder: Path) -> int:
    """Write the readable part of a damaged recording as a complete one, marked as recovered.

    Args:
        path: a bag folder or an .mcap file.
        folder: the bag folder to create; it must not exist.

    Returns:
        The number of messages recovered.

    Raises:
        BagError: when the file is not a recording, or no message can be read.
        FileExistsError: when the folder exists.
        OSError: when the disk is full; the folder is removed whenever the recovery does not end.
    """
    from .bag_writer import BagWriter

    bag = examine(path)  # an attachment may follow the messages
    existed = folder.exists()
    try:
        writer = BagWriter(folder, {"recovered": {"from": path.name}})
        count = _copy(path, bag, writer)
        writer.close()
        if count == 0:
            raise BagError(f"{path}: no message can be read; nothing was recovered")
    except BaseException:  # a part of a recovery would pass for a recording
        if not existed:
            shutil.rmtree(folder, ignore_errors=True)
        raise
    return count


def _copy(path: Path, bag: Bag, writer: BagWriter) -> int:
    """Copy what can be read of a recording; return the number of messages."""
    for attachment in bag.attached:
        writer.add_attachment(attachment)
    channels: dict[int, int] = {}
    count = 0
    for record in read(path):
        if record.number not in channels:
            channels[record.number] = writer.add_channel(
                record.topic, record.type, record.schema.data, record.channel.metadata
            )
        writer.write(channels[record.number], record.log_ns, record.publish_ns, record.data, record.sequence)
        count += 1
    return count
