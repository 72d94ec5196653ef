"""The recording process, and the simulator's end of the pipe to it.

`python -m crawler_ros.recording.recorder` writes the file.
"""

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
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..wire.topics import Topic
from .bag_folder import make_folder
from .bag_writer import BagWriter, describe_channel
from .record_head import message_head

FLUSH_EVERY_S = 0.5

_PIPE_BYTES = 1 << 20
_JOINED_BYTES = 1 << 15
"""Items smaller than this on average are copied together: a system call costs as much as copying them."""
_PUSH_EVERY_NS = 2_000_000
_LISTEN_EVERY_NS = 200_000_000
_MOST_WAITING = 1 << 26
"""Bytes. Waiting data is lost when the simulator is killed: no more than can be written in a second."""


class Recorder:
    """The simulator's end of a pipe to a recording process.

    The process outlives a killed simulator and finishes the file; a slow or full disk does not stall the loop.
    """

    def __init__(self, parent: Path, name: str, attachments: dict[str, Any]) -> None:
        """Store what is to be recorded; nothing is created before `start`.

        Args:
            parent: folder in which the bag folder is created.
            name: beginning of the folder's name.
            attachments: plain data by name: scene, parameters, versions, start state.
        """
        self.folder = parent
        """The bag folder, once `start` has created it."""
        self._name = name
        self._ahead_ns = time.time_ns() - time.monotonic_ns()
        self.error: str | None = None
        """The reason why recording has stopped."""
        self.trouble = ""
        """A problem during which the recording continues."""
        self.waiting = 0
        """Bytes collected by `push` and not yet written to the pipe."""
        self._attachments = attachments
        self._names: dict[str, str] = {}
        self._channels: list[tuple[str, str, str, dict[str, str]]] = []
        self._sequences: list[int] = []
        self._process: subprocess.Popen[bytes] | None = None
        self._arrived: list[bytes | memoryview] = []  # any thread appends, one empties it
        self._blocks: deque[memoryview] = deque()
        self._next_push_ns = self._next_listen_ns = 0
        self._output = b""

    def add_topic(self, topic: Topic, name: str) -> int:
        """Register a topic; call it before `start`.

        Args:
            topic: its row in the table of topics, with the offered QoS.
            name: its full name in the ROS graph.

        Returns:
            The channel to record its messages on.

        Raises:
            FileNotFoundError: when the definition of its type is not installed.
        """
        type_name, definition, metadata = describe_channel(topic)
        self._channels.append((name, type_name, definition.decode(), metadata))
        self._names[topic.name] = name
        self._sequences.append(0)
        return len(self._channels) - 1

    def start(self) -> None:
        """Create a bag folder, named after the crawler and the time, and start the recording process.

        Raises:
            OSError: when the folder cannot be created.
        """
        self.folder = make_folder(self.folder, self._name)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "crawler_ros.recording.recorder"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        attachments = self._attachments | {"topics": self._names}  # replay finds them by these names, remapped or not
        header = {"folder": str(self.folder), "attachments": attachments, "channels": self._channels}
        data = json.dumps(header).encode()
        self._fd = self._process.stdin.fileno()  # type: ignore[union-attr]
        self._arrived.append(struct.pack("<I", len(data)) + data)
        with contextlib.suppress(OSError):  # a larger pipe is not essential
            fcntl.fcntl(self._fd, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self._fd, False)
        os.set_blocking(self._process.stdout.fileno(), False)  # type: ignore[union-attr]

    def now_ns(self) -> int:
        """Return the time for the messages of a recording [ns, wall].

        It starts from the wall clock's time at the start of the recording and advances with a steady clock: readers
        play messages in the order of their times, and setting the wall clock meanwhile would change that order.
        """
        return self._ahead_ns + time.monotonic_ns()

    def record(self, channel: int, log_ns: int, publish_ns: int, data: bytes) -> None:
        """Accept a message, from any thread but for each channel from one at a time. `push` passes it on.

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
        # one call, so that another thread's message comes before or after but never between; channels count from 1
        self._arrived.extend((message_head(channel + 1, sequence, log_ns, publish_ns, len(data)), data))

    def number(self, channel: int, count: int) -> int:
        """Reserve the numbers of messages that `record_all` will accept; call it as `record`.

        Args:
            channel: from `add_topic`.
            count: number of messages.

        Returns:
            The number of the first.
        """
        first = self._sequences[channel]
        self._sequences[channel] = first + count
        return first

    def record_all(self, records: Sequence[bytes | memoryview]) -> None:
        """Accept message records, complete with their heads, as `record` accepts a message.

        Args:
            records: the records; each item holds any number of them.
        """
        if self.error is None:
            self._arrived.extend(records)

    @property
    def messages(self) -> int:
        """Number of messages accepted."""
        return sum(self._sequences)

    def push(self, now_ns: int) -> None:
        """Write accepted messages to the pipe from time to time; block only if very many wait; call from one thread.

        Args:
            now_ns: time of a steady clock [ns].
        """
        if now_ns < self._next_push_ns:  # a tick's few messages are not worth a system call
            return
        self._next_push_ns = now_ns + _PUSH_EVERY_NS
        if self.error is None:
            self._write_pipe(_MOST_WAITING)
        if self.error is None and now_ns >= self._next_listen_ns:
            self._next_listen_ns = now_ns + _LISTEN_EVERY_NS
            self._read_reports()

    @property
    def problem(self) -> str:
        """The problem of the recording, whether it has stopped or continues; "" when nothing is."""
        return self.error or self.trouble

    @property
    def is_behind(self) -> bool:
        """Whether so much waits for the pipe that `push` may have to block soon."""
        return self.waiting > _MOST_WAITING // 2

    def _read_reports(self) -> None:
        """Read the lines of the process: each names a problem, and an empty one means that it is over."""
        output = self._process.stdout.read()  # type: ignore[union-attr]
        if output == b"":  # it has ended unexpectedly
            self.error = self._wait_for_error() or "recording stopped: the process has ended"
        elif output is not None:
            self._output += output
            lines = self._output.split(b"\n")
            if len(lines) > 1:
                self.trouble = f"recording in trouble: {lines[-2].decode()}" if lines[-2] else ""
            self._output = lines[-1]

    def _write_pipe(self, most: int) -> None:
        """Write as much as the pipe accepts, and wait until no more than `most` bytes are left."""
        arrived = self._arrived
        if arrived:
            taken = arrived[:]
            del arrived[: len(taken)]  # messages that arrived meanwhile stay
            size = sum(map(len, taken))
            self._blocks.extend(map(memoryview, [b"".join(taken)] if size < len(taken) * _JOINED_BYTES else taken))
            self.waiting += size
        blocks, blocking = self._blocks, False
        try:
            while blocks:
                if blocking != (self.waiting > most):
                    blocking = not blocking
                    os.set_blocking(self._fd, blocking)
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
            self.error = self._wait_for_error()
            blocks.clear()
            self.waiting = 0
        finally:
            if blocking:
                os.set_blocking(self._fd, False)

    def close(self) -> None:
        """Write the rest to the pipe and let the process write the end of the file and metadata.yaml."""
        assert self._process is not None
        assert self._process.stdin is not None
        if self.error is None:
            self._write_pipe(0)
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        self.error = self.error or self._wait_for_error()

    def _wait_for_error(self) -> str | None:
        """Wait for the process to end; return its error, None when there was none."""
        assert self._process is not None
        assert self._process.stdout is not None
        os.set_blocking(self._process.stdout.fileno(), True)
        output = (self._output + self._process.stdout.read()).decode().strip()
        self._process.wait()
        if self._process.returncode == 0:
            return None
        last = output.rpartition("\n")[2] or self.trouble.removeprefix("recording in trouble: ")
        return f"recording stopped: {last or f'the process ended with status {self._process.returncode}'}"


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
        for name, type_name, definition, metadata in header["channels"]:
            bag.add_channel(name, type_name, definition.encode(), metadata)
        _record(fd, data, bag)
        trouble = bag.find_trouble()
        bag.close()
    except OSError as error:  # such as a full disk: flushed messages can be recovered
        _report(str(error))
        return 1
    if trouble:
        _report(trouble)
    return 1 if trouble else 0


def _report(text: str) -> None:
    """Send the simulator, which may have been killed, a line with the problem; "" when it is over."""
    with contextlib.suppress(OSError):
        os.write(sys.stdout.fileno(), f"{' '.join(text.split())}\n".encode())


def _record(fd: int, data: bytes, bag: BagWriter) -> None:
    """Write `data` and the message records that follow it, flushing twice a second."""
    buffer = bytearray(2 * _PIPE_BYTES)
    filled = len(data)
    buffer[:filled] = data
    flushed, trouble = time.monotonic(), ""
    while True:
        with memoryview(buffer) as view:
            taken = bag.write_records(view[:filled])
            view[: filled - taken] = view[taken:filled]
            filled -= taken
        if filled > len(buffer) - _PIPE_BYTES:  # for a message larger than any before
            buffer += bytes(len(buffer))
        if time.monotonic() - flushed >= FLUSH_EVERY_S:
            bag.flush()
            flushed, before, trouble = time.monotonic(), trouble, bag.find_trouble()
            if trouble != before:
                _report(trouble)
        ready, _, _ = select.select([fd], [], [], FLUSH_EVERY_S)
        if ready:
            with memoryview(buffer) as view:
                count = os.readv(fd, [view[filled:]])
            if count == 0:
                return
            filled += count


if __name__ == "__main__":
    sys.exit(main())
