"""The simulator's end of a recording: the memory and the pipes that it shares with the process that writes the file.

The simulator copies records into a ring of shared memory and sends the process (`recording_process.py`), through a
pipe, where they are: the contents of a pipe would be copied twice more.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import time
from collections import deque
from pathlib import Path
from typing import Any

import numpy as np

from ..wire.topics import Topic
from .bag_folder import make_folder
from .bag_writer import describe_channel
from .record_head import message_head
from .ring import PIECE, RING_BYTES, Ring

RECORDING_PROCESS = "crawler_ros.recording.recording_process"
"""The module that `python -m` runs."""
_PUSH_EVERY_NS = 2_000_000
_LISTEN_EVERY_NS = 200_000_000
_LOOK_EVERY_S = 0.001
_LONGEST_OPENING_S = 10.0
_JOINED_BYTES = 1 << 12
"""Items smaller than this on average are joined before they are copied into the ring."""


class Recorder:
    """The simulator's end of the memory and the pipes that it shares with a recording process.

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
        self._attachments = attachments
        self._names: dict[str, str] = {}
        self._channels: list[tuple[str, str, str, dict[str, str]]] = []
        self.numbers = np.zeros(0, np.int64)
        """The number of the next message on each channel."""
        self._process: subprocess.Popen[bytes] | None = None
        self._arrived: list[bytes | memoryview] = []  # any thread appends, one empties it
        self._blocks: deque[memoryview] = deque()  # for which the ring had no room
        self._kept = 0  # bytes of these
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
        self.numbers = np.zeros(len(self._channels), np.int64)
        return len(self._channels) - 1

    def start(self) -> None:
        """Create a bag folder, named after the crawler and the time, and start the process, which opens the file.

        What is recorded before the file is open would be lost if both processes were killed.

        Raises:
            OSError: when the folder cannot be created.
        """
        self.folder = make_folder(self.folder, self._name)
        self._ring = Ring()
        self._process = subprocess.Popen(
            [sys.executable, "-m", RECORDING_PROCESS, str(self._ring.fd)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            pass_fds=(self._ring.fd,),
            start_new_session=True,
        )
        os.close(self._ring.fd)
        attachments = self._attachments | {"topics": self._names}  # replay finds them by these names, remapped or not
        header = {"folder": str(self.folder), "attachments": attachments, "channels": self._channels}
        self._fd = self._process.stdin.fileno()  # type: ignore[union-attr]
        self._ring.write(memoryview(json.dumps(header).encode()))
        with contextlib.suppress(BrokenPipeError):  # `push` finds out why
            self._send_pieces()  # by itself, so that the process knows where it ends
        self._reports = self._process.stdout.fileno()  # type: ignore[union-attr]
        os.set_blocking(self._fd, False)
        os.set_blocking(self._reports, False)
        select.select([self._reports], [], [], _LONGEST_OPENING_S)  # `push` reads what is reported

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
        number = int(self.numbers[channel])
        self.numbers[channel] = number + 1
        # one call, so that another thread's message comes before or after but never between; channels count from 1
        self._arrived.extend((message_head(channel + 1, number, log_ns, publish_ns, len(data)), data))

    def record_all(self, records: memoryview) -> None:
        """Accept message records, complete with their heads and counted in `numbers`; call it as `record`.

        Args:
            records: any number of them, which nobody changes any more.
        """
        if self.error is None:
            self._arrived.append(records)

    @property
    def messages(self) -> int:
        """Number of messages accepted."""
        return int(self.numbers.sum())

    def push(self, now_ns: int) -> None:
        """Hand over accepted messages from time to time; block only if very many wait; call from one thread.

        Args:
            now_ns: time of a steady clock [ns].
        """
        if now_ns < self._next_push_ns:  # a tick's few messages are not worth a system call
            return
        self._next_push_ns = now_ns + _PUSH_EVERY_NS
        if self.error is None:
            self._hand_over()
        if self.error is None and now_ns >= self._next_listen_ns:
            self._next_listen_ns = now_ns + _LISTEN_EVERY_NS
            self._read_reports()

    @property
    def problem(self) -> str:
        """The problem of the recording, whether it has stopped or continues; "" when nothing is."""
        return self.error or self.trouble

    @property
    def waiting(self) -> int:
        """Bytes that the process has not taken yet."""
        return self._ring.used + self._kept if self.error is None else 0

    @property
    def is_behind(self) -> bool:
        """Whether so much waits for the process that `push` may have to block soon."""
        return self.waiting > RING_BYTES // 2

    def _read_reports(self) -> None:
        """Read the lines of the process: each names a problem; an empty one means that there is none, or none now."""
        output = self._process.stdout.read()  # type: ignore[union-attr]
        if output == b"":  # it has ended unexpectedly
            self._fail(self._wait_for_error() or "recording stopped: the process has ended")
        elif output is not None:
            self._output += output
            lines = self._output.split(b"\n")
            if len(lines) > 1:
                self.trouble = f"recording in trouble: {lines[-2].decode()}" if lines[-2] else ""
            self._output = lines[-1]

    def _keep(self, block: memoryview) -> None:
        if block:
            self._blocks.append(block)
            self._kept += len(block)

    def _fill_ring(self) -> None:
        """Copy accepted messages into the ring, as many as it has room for."""
        arrived, blocks = self._arrived, self._blocks
        if arrived:
            taken = arrived[:]
            del arrived[: len(taken)]  # messages that arrived meanwhile stay
            joined = sum(map(len, taken)) < len(taken) * _JOINED_BYTES
            for data in [b"".join(taken)] if joined else taken:
                self._keep(memoryview(data))
        while blocks:
            written = self._ring.write(blocks[0])
            if written == 0:
                return
            block = blocks.popleft()
            self._kept -= written
            if written < len(block):
                blocks.appendleft(block[written:])

    def _hand_over(self) -> None:
        """Copy all accepted messages into the ring, waiting until there is room, and send the process their places."""
        try:
            while True:
                self._fill_ring()
                self._send_pieces()
                if not self._blocks:
                    return
                select.select([self._reports], [], [], _LOOK_EVERY_S)
                self._read_reports()
                if self.error is not None:
                    return
        except BrokenPipeError:
            self._fail(self._wait_for_error())

    def _send_pieces(self) -> None:
        pieces = self._ring.pieces
        try:
            while pieces:
                os.write(self._fd, PIECE.pack(*pieces[0]))
                del pieces[0]
        except BlockingIOError:  # they are sent later
            pass

    def _fail(self, error: str | None) -> None:
        self.error = error
        self._blocks.clear()

    def close(self) -> None:
        """Hand over the rest and let the process write the end of the file and metadata.yaml."""
        assert self._process is not None
        assert self._process.stdin is not None
        if self.error is None:
            os.set_blocking(self._fd, True)
            self._hand_over()
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
