"""The simulator's end of the pipe to the process that draws: it never blocks."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from crawler_model import Crawler, Scene

from .frames import FRAME_EVERY_NS, frame_of

LIVE_PORT = 9876
"""The port of the first live viewer on a machine, rerun's own; those that follow take the next ones."""
_MOST_VIEWERS = 100
_PIPE_BYTES = 1 << 20


def check_view(view: str) -> None:
    """Check where a view goes.

    Args:
        view: "live", or the path of an .rrd file that is not there yet.

    Raises:
        FileExistsError: when the file exists.
        ValueError: when it is something else.
    """
    if view == "live":
        return
    if Path(view).suffix != ".rrd":
        raise ValueError(f"view: {view!r}; it must be off, live, or a path that ends in .rrd")
    if Path(view).exists():
        raise FileExistsError(f"view: {view} exists; give a path that does not")


def is_free(port: int) -> bool:
    """Tell whether nobody listens on a port of 127.0.0.1.

    Args:
        port: its number.

    Returns:
        True when a server can be opened there.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # connections that were closed do not count
        try:
            probe.bind(("127.0.0.1", port))
            probe.listen(1)
        except OSError:
            return False
    return True


def claim_port() -> tuple[int, socket.socket]:
    """Choose the first free port from `LIVE_PORT` on, and keep it from simulators that start at the same time.

    Returns:
        The port, and what holds it: closed, or with the end of this process, the port can be chosen again.

    Raises:
        OSError: when all ports tried are taken.
    """
    last = LIVE_PORT + _MOST_VIEWERS - 1
    for port in range(LIVE_PORT, last + 1):
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0crawler live view {port}")  # a name of Linux's that no file stands for
        except OSError:
            claim.close()
            continue
        if is_free(port):
            return port, claim
        claim.close()
    raise OSError(f"view: the ports {LIVE_PORT} to {last} of 127.0.0.1 are all taken; end some viewers")


class ViewerFeed:
    """The simulator's end of the pipe to a drawing process."""

    def __init__(self, scene: Scene, view: str, say: Callable[[str], Any]) -> None:
        """Start the drawing process.

        Args:
            scene: what is drawn.
            view: "live", or the path of an .rrd file.
            say: told where to look.

        Raises:
            FileExistsError: when the file exists: nothing is overwritten.
            OSError: when no port is free.
            ValueError: when `view` is something else.
        """
        check_view(view)
        self._claim: socket.socket | None = None
        target = where = view
        if view == "live":
            port, self._claim = claim_port()
            target = f"rerun+http://127.0.0.1:{port}/proxy"
            taken = f"; port {LIVE_PORT} is taken" if port != LIVE_PORT else ""
            where = f"{target} (open it with: rerun --connect {target}{taken})"
        else:
            Path(view).parent.mkdir(parents=True, exist_ok=True)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "crawler_ros.viewer.visualizer", target],
            stdin=subprocess.PIPE,
            start_new_session=True,
        )
        assert self._process.stdin is not None
        self._pipe = self._process.stdin
        header = json.dumps(scene.document()).encode()
        self._pipe.write(struct.pack("<I", len(header)) + header)
        self._pipe.flush()
        with contextlib.suppress(OSError):  # a larger pipe is a comfort, not a need
            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self._pipe.fileno(), False)
        self._waiting = b""
        self._shown_ns: int | None = None
        self._moved: np.ndarray | None = None
        self.dropped = 0
        say(f"drawing to {where}")

    def show(self, time_ns: int, crawler: Crawler) -> None:
        """Offer a frame; at most fifty a simulated second are taken, and none waits.

        Args:
            time_ns: simulated time.
            crawler: its state is drawn.
        """
        state = crawler.contact_state
        self._moved = state if self._moved is None else np.where(state != 0, state, self._moved)
        if self._shown_ns is not None and 0 <= time_ns - self._shown_ns < FRAME_EVERY_NS:
            return
        self._shown_ns = time_ns
        frame = frame_of(crawler, time_ns, self._moved)
        self._moved = None
        if not self._push():
            self.dropped += 1
            return
        self._waiting = frame.pack()
        self._push()

    @property
    def alive(self) -> bool:
        """Whether the drawing process still runs."""
        return self._process.poll() is None

    def _push(self) -> bool:
        """Write what is waiting as far as it goes; tell whether it all went."""
        try:
            while self._waiting:
                self._waiting = self._waiting[os.write(self._pipe.fileno(), self._waiting) :]
        except BlockingIOError:
            return False
        except BrokenPipeError:
            self._waiting = b""
            return False
        return True

    def close(self) -> None:
        """Let the drawing process finish its file; give a stuck one a minute, which a busy machine may need."""
        deadline = time.monotonic() + 60.0
        while not self._push() and self.alive and time.monotonic() < deadline:
            time.sleep(0.02)
        self._pipe.close()
        try:
            self._process.wait(max(deadline - time.monotonic(), 0.1))
        except subprocess.TimeoutExpired:
            self._process.kill()
        if self._claim is not None:
            self._claim.close()
