"""The files of a recording: which there are, which metadata.yaml promises, and which are compressed as a whole."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import yaml

from crawler_model.body.drive import NS

from .bag_folder import PATTERNS
from .mcap_reader import BagError, largest_expansion

_LARGEST_METADATA = 1 << 24
_COPIED = 1 << 20
_OPEN_FILES = Path("/proc/self/fd")
"""Folder of Linux with a name for each file that the process has open."""
_MCAP, _ZSTD, _SQLITE = b"\x89MCAP0\r\n", b"\x28\xb5\x2f\xfd", b"SQLite format 3\0"


def list_files(folder: Path) -> list[Path]:
    """List the files of recordings in a folder, by name; for one that is there compressed and not, the latter.

    Args:
        folder: the folder.

    Returns:
        The files.
    """
    found = [file for pattern in PATTERNS for file in folder.glob(pattern)]
    return sorted({_plain_name(file.name): file for file in reversed(found)}.values())


def _plain_name(name: str) -> str:
    return name.removesuffix(".zstd")


def find_files(path: Path) -> list[Path]:
    """Find the .mcap files of a recording, in order.

    A recorder may split a recording into files NAME_0.mcap, NAME_1.mcap and so on in one folder, and compress each to
    NAME_0.mcap.zstd.

    Args:
        path: a bag folder or an .mcap file.

    Returns:
        The files.

    Raises:
        BagError: when there is no .mcap file, there are several that are not parts of one recording, or one has another
            format.
    """
    if path.is_dir():
        files = list_files(path)
        promised = [part.name for part in read_promises(path)]
        if not files:
            _refuse(path, promised)
        if len(files) > 1:
            files = _in_order(path, files, promised)
    elif path.is_file():
        files = [path]
    else:
        raise BagError(f"{path}: no such file or folder")
    for file in files:
        with file.open("rb") as stream:
            head = stream.read(16)
        if head.startswith(_SQLITE):
            raise BagError(_advise_conversion(path))
        if not (head.startswith(_ZSTD) or _MCAP.startswith(head[:8])):  # a file that has just begun may be shorter
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


def _refuse(folder: Path, promised: Sequence[str]) -> None:
    """Raise a BagError that tells what a folder without .mcap files holds."""
    if any(folder.glob("*.db3")) or any(folder.glob("*.db3.zstd")):
        raise BagError(_advise_conversion(folder))
    inside = [p.name for p in sorted(folder.iterdir()) if p.is_dir() and list_files(p)]
    hint = f"; it holds the recordings {', '.join(inside[:5])}" if inside else ""
    hint = f"; metadata.yaml lists {', '.join(promised[:5])}" if promised else hint
    raise BagError(f"{folder}: no .mcap file in this folder{hint}")


def _advise_conversion(path: Path) -> str:
    out = f"{{uri: {path.stem}_mcap, storage_id: mcap, all: true}}"
    return (
        f"{path}: an sqlite3 bag, and only MCAP is read; convert it with "
        f"echo 'output_bags: [{out}]' > convert.yaml && ros2 bag convert -i {path} -o convert.yaml, or without "
        f"ROS 2 by pip install rosbags && rosbags-convert --src {path} --dst {path.stem}_mcap --dst-storage mcap"
    )


def _in_order(folder: Path, files: Sequence[Path], promised: Sequence[str]) -> list[Path]:
    """Put the parts of a recording in order: as metadata.yaml lists them, else by their numbers."""
    listed = {_plain_name(name): place for place, name in enumerate(promised)}
    if all(_plain_name(file.name) in listed for file in files):
        return sorted(files, key=lambda file: listed[_plain_name(file.name)])
    parts = [(Path(_plain_name(file.name)).stem.rpartition("_"), file) for file in files]
    if len({stem for (stem, _, _), _ in parts}) > 1 or not all(number.isdigit() for (_, _, number), _ in parts):
        raise BagError(f"{folder}: {len(files)} .mcap files in this folder; name one of them")
    return [file for _, file in sorted(parts, key=lambda part: int(part[0][2]))]


def expand(file: Path) -> tuple[Path, IO[bytes] | None]:
    """Provide a file as an .mcap file: itself, or a temporary copy of it without its compression.

    Args:
        file: an .mcap file, or one that was compressed by zstd as a whole; if damaged, the copy ends at the damage.

    Returns:
        The path, and the handle of the copy, with which it is deleted; None for the file itself.

    Raises:
        BagError: when it expands to more than any recording does.
    """
    with file.open("rb") as stream:
        if stream.read(len(_ZSTD)) != _ZSTD:
            return file, None
        stream.seek(0)
        path, copy = _open_copy()
        _decompress(file, stream, copy)
    return path, copy


def _open_copy() -> tuple[Path, IO[bytes]]:
    """Open a temporary file, where possible one without a name of its own: nothing is left of it after a kill."""
    if _OPEN_FILES.exists():
        copy = tempfile.TemporaryFile()  # noqa: SIM115
        return Path(_OPEN_FILES, str(copy.fileno())), copy
    named = tempfile.NamedTemporaryFile(prefix="crawler_")  # noqa: SIM115
    return Path(named.name), named


def _decompress(file: Path, stream: IO[bytes], copy: IO[bytes]) -> None:
    """Decompress a file up to its damage."""
    import zstandard

    size = file.stat().st_size
    left = most = largest_expansion(size)
    reader = zstandard.ZstdDecompressor().stream_reader(stream, read_across_frames=True)
    while piece := _read(reader):
        left -= len(piece)
        if left < 0:
            raise BagError(
                f"{file}: its {size} bytes expand to more than {most}; no recording does: the file is damaged or "
                "made to fill the disk"
            )
        copy.write(piece)
    copy.flush()


def _read(reader: Any) -> bytes:
    import zstandard

    try:
        return bytes(reader.read(_COPIED))
    except zstandard.ZstdError:
        return b""


@dataclass(frozen=True)
class Promise:
    """A file that metadata.yaml lists.

    Attributes:
        name: its name.
        count: number of its messages; None where it is not stated.
        first_ns: when its first message was received [ns, wall]; None where it is not stated.
        last_ns: the same of its last one.
    """

    name: str
    count: int | None
    first_ns: int | None
    last_ns: int | None


def read_promises(folder: Path) -> list[Promise]:
    """Read which files metadata.yaml lists.

    Args:
        folder: a bag folder.

    Returns:
        The files in order; none when there is no metadata.yaml, or nobody can read it.
    """
    file = folder / "metadata.yaml"
    try:
        if file.stat().st_size > _LARGEST_METADATA:
            return []
        # all scalars stay text: numbers are read where they are expected, whatever else the file holds
        document = yaml.load(file.read_bytes(), getattr(yaml, "CBaseLoader", yaml.BaseLoader))
    except (OSError, ValueError, RecursionError, yaml.YAMLError):
        return []
    bag = _entry(document, "rosbag2_bagfile_information")
    rows = [part for part in _entries(_entry(bag, "files")) if isinstance(_entry(part, "path"), str)]
    found = {_name(_entry(part, "path")): _promise(_name(_entry(part, "path")), part) for part in rows}
    listed = [_name(path) for path in _entries(_entry(bag, "relative_file_paths")) if isinstance(path, str)]
    whole = len(listed) == 1  # older versions state times and counts of all files together
    for name in listed:
        found.setdefault(name, _promise(name, bag) if whole else Promise(name, None, None, None))
    return list(found.values())


def _promise(name: str, stated: Any) -> Promise:
    count = _number(_entry(stated, "message_count"))
    first = _number(_entry(_entry(stated, "starting_time"), "nanoseconds_since_epoch"))
    length = _number(_entry(_entry(stated, "duration"), "nanoseconds"))
    return Promise(name, count, first, None if first is None or length is None else first + length)


def _name(path: str) -> str:
    return path.replace("\\", "/").rpartition("/")[2]


def _entry(table: Any, key: str) -> Any:
    return table.get(key) if isinstance(table, dict) else None


def _entries(rows: Any) -> list[Any]:
    return rows if isinstance(rows, list) else []


def _number(text: Any) -> int | None:
    return int(text) if isinstance(text, str) and text.isascii() and text.isdigit() and len(text) < 20 else None


@dataclass(frozen=True)
class Held:
    """What a file of a recording holds.

    Attributes:
        file: the file.
        count: number of its messages.
        first_ns: when the first was received [ns, wall]; None without messages.
        last_ns: the same of the last.
    """

    file: Path
    count: int
    first_ns: int | None
    last_ns: int | None


def compare_with_promises(promises: Sequence[Promise], held: Sequence[Held]) -> list[str]:
    """Compare the files of a recording with the list in metadata.yaml.

    Args:
        promises: the files that it lists.
        held: what the files that are there hold.

    Returns:
        A line for each file that is missing or holds fewer messages than promised.
    """
    there = {_plain_name(part.file.name): part for part in held}
    begins = [p.first_ns for p in promises if p.first_ns is not None] + [
        h.first_ns for h in held if h.first_ns is not None
    ]
    lines, before = [], None
    for place, promise in enumerate(promises):
        part = there.get(_plain_name(promise.name))
        if part is not None:
            before = part.last_ns if part.last_ns is not None else before
            if promise.count is not None and part.count < promise.count:
                lines.append(
                    f"{part.file.name} has {part.count} message(s), but metadata.yaml counts {promise.count} in it"
                )
            continue
        later = (there.get(_plain_name(other.name)) for other in promises[place + 1 :])
        after = next((other.first_ns for other in later if other is not None and other.first_ns is not None), None)
        # some writers state the times of the whole recording for each file: the neighbouring files are nearer
        first = max((ns for ns in (promise.first_ns, before) if ns is not None), default=None)
        last = min((ns for ns in (promise.last_ns, after) if ns is not None), default=None)
        lines.append(f"{promise.name} is missing{_describe(promise.count, first, last, min(begins, default=0))}")
    return lines


def _describe(count: int | None, first: int | None, last: int | None, begin: int) -> str:
    counted = "" if count is None else f" with its {count} message(s)"
    if first is None and last is None:
        return f"{counted}; metadata.yaml lists it"
    since = "the beginning" if first is None else f"{(first - begin) / NS:.6g} s"
    until = "the end" if last is None else f"{(last - begin) / NS:.6g} s"
    return f"{counted}; it held {since} to {until} after the start of the recording"
