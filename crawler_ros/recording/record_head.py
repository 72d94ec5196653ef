"""The heads of message records in an MCAP file. The library mcap is not loaded."""

from __future__ import annotations

import struct

MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Opcode, size, channel, number on the channel, times of reception and of publication."""
HEAD_SEQUENCE, HEAD_TIMES, HEAD_SIZE = 11, 15, MESSAGE_HEAD.size
"""In the head: place of the number on the channel (u32) and of the two times (u64); its size [bytes]."""
SIZED = 9
"""Bytes of a record not counted in its size: the opcode and the size."""
_MESSAGE = 0x05


def message_head(channel: int, sequence: int, log_ns: int, publish_ns: int, size: int) -> bytes:
    """Encode the head of a message record; its data follow.

    Args:
        channel: number of its channel.
        sequence: number of the message on its channel.
        log_ns: when it was received [ns, wall].
        publish_ns: when it was sent [ns, wall].
        size: bytes of its data.

    Returns:
        Its bytes.
    """
    return MESSAGE_HEAD.pack(_MESSAGE, HEAD_SIZE - SIZED + size, channel, sequence, log_ns, publish_ns)
