"""The simulator's end of the pipe to the drawing process: it never blocks."""

from __future__ import annotations

import contextlib
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
from crawler_model.run.trajectory import TimedJump

from .frames import FRAME_EVERY_NS, frame_of

LIVE_PORT = 9876
"""The port of the first live viewer on a machine, rerun's default; later viewers use the next ones."""
_MOST_VIEWERS = 100
_PIPE_BYTES = 1 << 20
_MOST_JUMPS = 1000


def check_view(view: str) -> None:
    """Check the target of a view.

    Args:
        view: "live", or the path of an .rrd file that does not exist yet.

    Raises:
        FileExistsError: when the file exists.
        ValueError: when it is neither.
    """
    if view == "live":
        return
    if Path(view).suffix != ".rrd":
        raise ValueError(f"view: {view!r}; it must be off, live, or a path that ends in .rrd")
    if Path(view).exists():
        raise FileExistsError(f"view: {view} exists; choose a path that does not")


def is_free(port: int) -> bool:
    """Return whether a port of 127.0.0.1 is free.

    Args:
        port: its number.

    Returns:
        True when a server can be opened on it.
    """
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # closed connections do not count
        try:
            probe.bind(("127.0.0.1", port))
            probe.listen(1)
        except OSError:
            return False
    return True


def _claim_port() -> tuple[int, socket.socket]:
    """Choose the first free port from `LIVE_PORT` on, and reserve it by a socket until that is closed."""
    last = LIVE_PORT + _MOST_VIEWERS - 1
    for port in range(LIVE_PORT, last + 1):
        claim = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            claim.bind(f"\0crawler live view {port}")  # an abstract name of Linux, without a file
        except OSError:
            claim.close()
            continue
        if is_free(port):
            return port, claim
        claim.close()
    raise OSError(f"view: the ports {LIVE_PORT} to {last} of 127.0.0.1 are all taken; end some viewers")


class ViewerFeed:
    """The simulator's end of the pipe to a drawing process."""

    def __init__(self, scene: Scene, view: str, log: Callable[[str], Any]) -> None:
        """Start the drawing process.

        Args:
            scene: the scene to draw.
            view: "live", or the path of an .rrd file.
            log: function that logs where the view is.

        Raises:
            FileExistsError: when the file exists: nothing is overwritten.
            OSError: when no port is free.
            ValueError: when `view` is neither.
        """
        check_view(view)
        self._claim: socket.socket | None = None
        target = where = view
        if view == "live":
            port, self._claim = _claim_port()
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
        with contextlib.suppress(OSError, ImportError, AttributeError):  # a larger pipe, of Linux, is not essential
            import fcntl

            fcntl.fcntl(self._pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(self._pipe.fileno(), False)
        self._waiting = b""
        self._shown_ns: int | None = None
        self._moved: np.ndarray | None = None
        self._jumps: tuple[TimedJump, ...] = ()
        self.dropped = 0
        log(f"drawing to {where}")

    def show(self, time_ns: int, crawler: Crawler, jumps: tuple[TimedJump, ...] = ()) -> None:
        """Send a frame without waiting; at most fifty per simulated second are sent.

        Args:
            time_ns: simulated time [ns].
            crawler: the crawler to draw.
            jumps: its jumps in this tick; they wait for a frame that is sent, at most the last thousand.
        """
        if jumps:
            self._jumps = (*self._jumps, *jumps)[-_MOST_JUMPS:]
        state = crawler.contact_state
        self._moved = state if self._moved is None else np.where(state != 0, state, self._moved)
        if self._shown_ns is not None and 0 <= time_ns - self._shown_ns < FRAME_EVERY_NS:
            return
        self._shown_ns = time_ns
        moved, self._moved = self._moved, None
        if not self._push():
            self.dropped += 1
            return
        self._waiting = frame_of(crawler, time_ns, moved, self._jumps).pack()
        self._jumps = ()
        self._push()

    @property
    def alive(self) -> bool:
        """Whether the drawing process is still running."""
        return self._process.poll() is None

    def _push(self) -> bool:
        """Write waiting bytes as far as the pipe accepts them; return whether all were written."""
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
        """Let the drawing process finish its file; end it after a minute, which a busy machine may need."""
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
