"""CDR bytes, read and written: plain XCDR1, little-endian, with zeroed gaps where they are written."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np

from crawler_model.body.drive import NS
from crawler_model.errors import CommandError

ENCAPSULATION = b"\x00\x01\x00\x00"
HEAD = len(ENCAPSULATION)
_ENCODINGS = {  # by the second byte: byte order and largest alignment
    0: (">", 8),
    1: ("<", 8),
    6: (">", 4),
    7: ("<", 4),
}


class CdrWriter:
    """Appends primitive values with the alignment that CDR requires."""

    def __init__(self) -> None:
        """Start with the encapsulation header."""
        self.buffer = bytearray(ENCAPSULATION)

    def align(self, size: int) -> int:
        """Pad to a multiple of `size` after the header; return the position reached."""
        self.buffer.extend(bytes(-(len(self.buffer) - 4) % size))
        return len(self.buffer)

    def pack(self, code: str, value: float) -> int:
        """Append one number of a `struct` code; return its position."""
        place = self.align(struct.calcsize(code))
        self.buffer += struct.pack("<" + code, value)
        return place

    def text(self, value: str) -> None:
        """Append a string."""
        data = value.encode() + b"\0"
        self.pack("I", len(data))
        self.buffer += data

    def texts(self, values: Sequence[str]) -> None:
        """Append a sequence of strings."""
        self.pack("I", len(values))
        for value in values:
            self.text(value)

    def doubles(self, count: int) -> int:
        """Append a sequence of `count` zeros; return the position of the first."""
        self.pack("I", count)
        place = self.align(8) if count else len(self.buffer)
        self.buffer += bytes(8 * count)
        return place

    def stamp(self, ns: int) -> int:
        """Append a time or duration; return its position."""
        place = self.pack("i", ns // NS)
        self.pack("I", ns % NS)
        return place

    def header(self, frame: str) -> int:
        """Append a std_msgs/Header; return the position of its stamp."""
        place = self.stamp(0)
        self.text(frame)
        return place


class CdrReader:
    """A reading position in the bytes of a message that never moves beyond their end.

    Every method raises CommandError where the bytes are not a message.
    """

    def __init__(self, data: bytes) -> None:
        """Read the encapsulation header."""
        if len(data) < HEAD or data[0] != 0 or data[1] not in _ENCODINGS:
            raise CommandError(
                f"not a message of this type: it begins with {bytes(data[:HEAD]).hex(' ') or 'no bytes'}"
            )
        self.data, self.place = data, HEAD
        self.order, self._largest = _ENCODINGS[data[1]]
        self._count = struct.Struct(self.order + "I")
        self._stamp = struct.Struct(self.order + "iI")

    def skip(self, count: int, size: int) -> int:
        """Skip `count` items of `size` bytes; return where they begin."""
        if count:
            self.place += -(self.place - HEAD) % min(size, self._largest)
        first, self.place = self.place, self.place + count * size
        if self.place > len(self.data):
            raise CommandError(
                f"not a message of this type: it ends after {len(self.data)} bytes, in the middle of a sequence"
            )
        return first

    def count(self) -> int:
        """Read the length of a sequence."""
        return int(self._count.unpack_from(self.data, self.skip(1, 4))[0])

    def ns(self) -> int:
        """Read a time or duration [ns]."""
        first = self.skip(2, 4)
        seconds, rest = self._stamp.unpack_from(self.data, first)
        if rest >= NS:
            raise wrong_nanosec(rest)
        return int(seconds * NS + rest)

    def text(self) -> str:
        """Read a string."""
        size = self.count()
        first = self.skip(size, 1)
        return bytes(self.data[first : first + size]).rstrip(b"\0").decode(errors="replace")

    def doubles(self) -> np.ndarray:
        """Read a sequence of numbers, shape (count,), a view of the bytes."""
        size = self.count()
        first = self.skip(size, 8)
        return np.frombuffer(self.data, self.order + "f8", size, first)

    def end(self, sequences: int) -> None:
        """Refuse bytes behind the message beyond what Fast DDS leaves there: 4 a sequence that may be empty."""
        left = len(self.data) - self.place
        if left >= 8 + 4 * sequences:
            raise CommandError(f"not a message of this type: {left} more bytes follow its end at byte {self.place}")


def wrong_nanosec(value: int) -> CommandError:
    """Build the error of a time whose nanoseconds are a second or more."""
    return CommandError(f"trajectory: a time has {value} in its field nanosec; it must be below {NS}")
