"""The simulator's end of the pipe to the process that draws: it never blocks."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
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
            ValueError: when `view` is something else.
        """
        check_view(view)
        if view != "live":
            Path(view).parent.mkdir(parents=True, exist_ok=True)
        self._process = subprocess.Popen(
            [sys.executable, "-m", "crawler_ros.visualizer", view], stdin=subprocess.PIPE, start_new_session=True
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
        where = f"rerun+http://127.0.0.1:{LIVE_PORT}/proxy (open it with: rerun --connect)" if view == "live" else view
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
