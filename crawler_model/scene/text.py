"""Text files of users: UTF-8, and what other encodings look like."""

from __future__ import annotations

import codecs

_WIDE = {
    "UTF-32": (codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE),
    "UTF-16": (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE),
}
"""In this order: the mark of UTF-32 begins with the mark of UTF-16."""


def decode_text(content: bytes) -> str:
    """Decode the content of a text file, with or without a byte order mark.

    Args:
        content: the bytes.

    Returns:
        The text.

    Raises:
        ValueError: if it is not UTF-8, with its probable encoding and what to do.
    """
    wide = next((name for name, marks in _WIDE.items() if content.startswith(marks)), None)
    if wide is None and b"\0" in content[:100]:
        wide = "UTF-16"
    if wide is not None:
        raise ValueError(f"its encoding is {wide}; save it as UTF-8")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = content[error.start : error.start + 1]
        line = content[: error.start].count(b"\n") + 1
        there = byte.decode("cp1252", "replace")
        raise ValueError(
            f"byte 0x{byte.hex()} in line {line} is not UTF-8; in the encoding cp1252 (Windows) it is {there!r}: save "
            "the file as UTF-8"
        ) from None
