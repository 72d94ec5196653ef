"""Reading of recordings: bag folders, bare .mcap files, and files whose end is missing."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import functools
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

from .bag_files import Held, compare_with_promises, expand, list_files, read_promises
from .bag_files import find_file as find_file
from .bag_files import find_files as find_files
from .bag_folder import list_bags
from .log_order import Piece, bound_memory, merge, piece_of
from .mcap_reader import BagError as BagError
from .mcap_reader import Block as Block
from .mcap_reader import Contents, read_file

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


@dataclass
class Bag:
    """The contents of a recording besides its messages."""

    attachments: dict[str, Any]
    """Those in JSON, decoded, by name."""
    complete: bool = False
    """Whether the files have their ends and all messages counted there, and metadata.yaml lists exactly these files."""
    damaged: int = 0
    """Number of chunks, and of compressed messages, that could not be read and were skipped."""
    lost: int | None = None
    """Number of messages counted at the end of the files but not found in them; None when an end is missing, or when
    something is damaged and nothing is counted."""
    ended: bool = False
    """Whether all files have their ends."""
    missing: tuple[str, ...] = ()
    """A line for each file that is not there, has no end, or holds other messages than are counted."""
    channels: dict[int, tuple[Channel, Schema]] = field(default_factory=dict)
    """By number in the blocks."""
    attached: list[Attachment] = field(default_factory=list)
    """All attachments as recorded."""
    counts: Counter[str] = field(default_factory=Counter)
    """Number of messages by topic."""

    def find(self, block: Block, topic: str) -> np.ndarray:
        """Return the indices of a topic's messages in a block, shape (K,); a topic may have several channels."""
        numbers = [number for number, (channel, _) in self.channels.items() if channel.topic == topic]
        return np.flatnonzero(np.isin(block.channel, numbers))

    def _keep(self, contents: Contents) -> None:
        """Keep the attachments of a file."""
        self.attached += contents.attachments
        for attachment in contents.attachments:
            if attachment.media_type == "application/json":
                with contextlib.suppress(ValueError, RecursionError):  # not JSON, or nested too deeply
                    self.attachments[attachment.name] = json.loads(attachment.data)

    def _number(self, contents: Contents, part: int, numbers: np.ndarray) -> None:
        """Number the channels of a file that were read since the last call; parts of a recording share channels."""
        known = {(channel.topic, schema.name): number for number, (channel, schema) in self.channels.items()}
        for local, channel in contents.channels.items():
            schema = contents.schemas.get(channel.schema_id)
            if numbers[local] < 0 and schema is not None:
                free = local if local not in self.channels else max(self.channels) + 1
                again = known.get((channel.topic, schema.name), free) if part else free
                numbers[local] = again
                self.channels.setdefault(again, (channel, schema))


def read_blocks(path: Path, bag: Bag, progress: Callable[[float], None] | None = None) -> Iterator[Block]:
    """Read all messages in the order of their reception, many at a time and without an object for each message.

    Args:
        path: a bag folder or an .mcap file.
        bag: filled with all that the recording holds besides, before the first block.
        progress: called with the fraction read, in [0, 1].

    Yields:
        The messages of described channels, up to where the last readable file breaks off.

    Raises:
        BagError: when the file is not a recording.
    """
    known, pieces, ranks = _survey(path)
    for entry in dataclasses.fields(Bag):
        setattr(bag, entry.name, copy.copy(getattr(known, entry.name)))
    yield from merge(pieces, ranks, progress)


def _survey(path: Path) -> tuple[Bag, list[Piece], np.ndarray]:
    """Read a recording once for all but its messages, and for where in log time these lie."""
    files = find_files(path)
    about = [file.stat() for file in files]
    return _survey_files(path, tuple(files), tuple((one.st_size, one.st_mtime_ns) for one in about))


@functools.lru_cache(maxsize=2)  # a verb reads a recording several times
def _survey_files(
    path: Path, files: tuple[Path, ...], _states: tuple[tuple[int, int], ...]
) -> tuple[Bag, list[Piece], np.ndarray]:
    bag, pieces = Bag({}, ended=True, lost=0), list[Piece]()
    held, missing = list[Held](), list[str]()
    for part, file in enumerate(files):
        contents, numbers = Contents(), np.full(1 << 16, -1)
        begin, found = len(pieces), 0
        plain, contents.copy = expand(file)
        for block in read_file(plain, contents):
            bag._number(contents, part, numbers)
            block = _described(block, path, numbers)
            if block.size.size:
                pieces.append(piece_of(block, functools.partial(_load, plain, block.begin, contents, path, numbers)))
                found += block.size.size
                for number, count in zip(*np.unique(block.channel, return_counts=True), strict=True):
                    bag.counts[bag.channels[int(number)][0].topic] += int(count)
        bag._keep(contents)
        contents.attachments = []
        first = min((piece.first_ns for piece in pieces[begin:]), default=None)
        held.append(Held(file, found, first, max((piece.last_ns for piece in pieces[begin:]), default=None)))
        bag.damaged += contents.damaged
        bag.ended = bag.ended and contents.ended
        if not contents.ended:
            bag.lost = None
            missing += [f"the end of {file.name} is missing"] * (len(files) > 1)
        elif contents.promised is None:
            gone = len(contents.indexed) - contents.chunks
            missing += [f"{file.name} has {contents.chunks} chunk(s), and lists {gone} more"] * (gone > 0)
            bag.lost = None if contents.damaged else bag.lost
        elif bag.lost is not None:
            bag.lost += max(contents.promised - found, 0)
            if found > contents.promised:
                missing.append(f"{file.name} counts {contents.promised} message(s) at its end, but holds {found}")
    if path.is_dir():
        missing += compare_with_promises(read_promises(path), held)
    bag.missing = tuple(missing)
    bag.complete = bag.lost == 0 and not missing
    topics = sorted({channel.topic for channel, _ in bag.channels.values()})
    ranks = np.zeros(max(bag.channels, default=0) + 1, np.int64)
    for number, (channel, _) in bag.channels.items():
        ranks[number] = topics.index(channel.topic)
    return bag, bound_memory(pieces, ranks), ranks


def _load(file: Path, begin: int, contents: Contents, source: Path, numbers: np.ndarray) -> Block:
    """Read a block of a file again."""
    again = Contents(schemas=dict(contents.schemas), channels=dict(contents.channels))
    block = next(read_file(file, again, begin), None)
    if block is None:
        raise BagError(f"{source}: the file was changed while it was read")
    return _described(block, source, numbers)


def _described(block: Block, source: Path, numbers: np.ndarray) -> Block:
    """Replace the channel numbers of a file by the recording's; leave out what nothing describes."""
    block = dataclasses.replace(block, source=source, channel=numbers[block.channel])
    return block if (block.channel >= 0).all() else block.select(np.flatnonzero(block.channel >= 0))


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
    """Read all messages in the order of their reception.

    Args:
        path: a bag folder or an .mcap file.
        bag: filled with all that the recording holds besides, before the first message.

    Yields:
        The messages of described channels.

    Raises:
        BagError: when the file is not a recording.
    """
    bag = Bag({}) if bag is None else bag
    for block in read_blocks(path, bag):
        columns = (block.channel, block.sequence, block.first, block.size, block.log_ns, block.publish_ns)
        for number, sequence, first, size, log_ns, publish_ns in zip(*(c.tolist() for c in columns), strict=True):
            channel, schema = bag.channels[number]
            data = block.data[first : first + size].tobytes()
            yield Record(channel.topic, schema.name, log_ns, publish_ns, data, channel, schema, number, sequence)


def examine(path: Path) -> Bag:
    """Read a recording for what it holds besides its messages.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        Its contents, with the number of messages by topic.

    Raises:
        BagError: when the file is not a recording.
    """
    bag = Bag({})
    next(read_blocks(path, bag), None)
    return bag


def newest(path: Path) -> Path:
    """Choose the newest recording in a folder.

    Args:
        path: a recording, or a folder of recordings.

    Returns:
        The path itself if it is a recording, else the newest recording in the folder.
    """
    bags = list_bags(path)
    return path if bags == [path] else max(bags, key=lambda bag: max(f.stat().st_mtime_ns for f in list_files(bag)))


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
