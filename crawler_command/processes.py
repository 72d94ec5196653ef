"""Processes that a verb starts, each in a session of its own: Ctrl-C reaches the verb, which ends them in order."""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence


def node_command(module: str, **parameters: str | float | bool) -> list[str]:
    """Build the command line of a node.

    Args:
        module: the module that runs it.
        **parameters: its ROS parameters.

    Returns:
        The words.
    """
    words = [
        word
        for name, value in parameters.items()
        for word in ("-p", f"{name}:={json.dumps(value, ensure_ascii=False)}")
    ]
    return [sys.executable, "-m", module, "--ros-args", *words]


class Process:
    """A process, and the lines that it prints."""

    def __init__(self, command: Sequence[str], environment: Mapping[str, str], read: bool = True) -> None:
        """Start it.

        Args:
            command: its words.
            environment: its environment.
            read: whether its output is read here; otherwise it goes where the output of this process goes.
        """
        self.process = subprocess.Popen(
            command,
            env=environment,
            stdout=subprocess.PIPE if read else None,
            stderr=subprocess.STDOUT if read else None,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        self._lines: queue.Queue[str] = queue.Queue()
        self._last = "(no output)"
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            if line.strip():
                self._last = line.strip()
                self._lines.put(line.strip())

    @property
    def status(self) -> int | None:
        """The exit status as a shell counts it, 128 + n after signal n; None while the process runs."""
        status = self.process.poll()
        return status if status is None or status >= 0 else 128 - status

    def new_lines(self) -> list[str]:
        """Return the lines that it printed since the last call."""
        lines = []
        while not self._lines.empty():
            lines.append(self._lines.get())
        return lines

    def last_line(self) -> str:
        """Return the last line of a process that has ended."""
        self._thread.join(1.0)
        return self._last

    def end(self, patience_s: float = 20.0) -> None:
        """Ask its whole session to end as Ctrl-C does, and end it if it does not.

        Args:
            patience_s: time from SIGINT to SIGTERM, and from there to SIGKILL [s].
        """
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            if self.process.poll() is not None:
                break
            os.killpg(self.process.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self.process.wait(None if number == signal.SIGKILL else patience_s)
