"""Runs spread over the cores: threads where the kernels take the time, further processes where Python does.

The kernels run without the interpreter's lock, so threads share big bodies well. Of small bodies most of the time goes
into making the scenes, under the lock: there each thread but the first hands its share to a Python process of its own.
Those are plain subprocesses: nothing of the caller's program is imported or forked in them.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import numpy as np

from ..crawler.crawler import prepare
from ..errors import CrawlerError
from ..scene.scene import Scene
from .vary import Variations

Chunk = tuple[np.ndarray, dict[int, str]]
"""Rows of results, and why some are invalid, by their place."""
Run = Callable[..., Chunk]

_PROBE, _PROBE_S = 64, 0.2
"""How many runs, and for how long, are timed before the others are spread."""
_THREADS_SCALE = 0.8
"""Part of the time in the kernels from which on threads share the work: below it they wait for each other's lock."""
_WORTH_A_PROCESS_S = 4.0
"""Work that outweighs the start of a Python process and its kernels, a second or two."""
_CHUNK_S, _MOST_IN_A_CHUNK = 0.25, 2048
_SERVE = "from crawler_model.sweep.workers import serve; serve()"


def available_cores() -> int:
    """Count the cores that this process may use.

    Returns:
        How many.
    """
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_chunks(
    scenes: Sequence[Scene],
    run: Run,
    keep: Callable[[int, Chunk], None],
    workers: int,
    progress: Callable[[float], None] | None = None,
) -> bool:
    """Run scenes chunk by chunk on several cores.

    Args:
        scenes: what to run.
        run: runs a few of them in turn: `run(scenes, stop=...)`; it can be pickled.
        keep: called with the first place of each chunk and what came of it, by one thread at a time.
        workers: how many runs go at the same time.
        progress: called with the part done, in [0, 1].

    Returns:
        True when Ctrl-C stopped it; what is done is kept.
    """
    count = len(scenes)
    pool = _Pool(scenes, run, keep, progress)
    try:
        if count:
            _prepare_first(scenes)
        each, inside = pool.probe()
        left = count - pool.next
        pool.size = int(min(max(_CHUNK_S / max(each, 1e-9), 1.0), _MOST_IN_A_CHUNK, max(left / (4 * workers), 1.0)))
        apart = inside < _THREADS_SCALE
        if apart and not (isinstance(scenes, Variations) and each * left > _WORTH_A_PROCESS_S):
            workers = 1
        pool.spread(min(workers, -(-left // pool.size)), apart)
    except KeyboardInterrupt:
        return True
    return False


def _prepare_first(scenes: Sequence[Scene]) -> None:
    """Load or compile the kernels before they are waited for by many."""
    for i in range(len(scenes)):
        try:
            scene = scenes[i]
        except CrawlerError:
            continue
        prepare(scene)
        return


class _Pool:
    """The work that is left, and the threads at it."""

    def __init__(
        self,
        scenes: Sequence[Scene],
        run: Run,
        keep: Callable[[int, Chunk], None],
        progress: Callable[[float], None] | None,
    ) -> None:
        self.scenes, self.run, self.keep, self.progress = scenes, run, keep, progress
        self.next = self.done = 0
        self.size = 1
        self.stop = threading.Event()
        self.lock = threading.Lock()

    def probe(self) -> tuple[float, float]:
        """Run the first few here.

        Returns:
            How long one takes [s], and which part of it goes into the kernels.
        """
        began, inside = 0.0, 0.0
        while self.next < min(len(self.scenes), _PROBE):
            if self.next <= 1:  # the first run fills caches
                began, inside = time.perf_counter(), 0.0
            elif time.perf_counter() - began > _PROBE_S:
                break
            self.next += 1
            chunk = self.run(self.scenes[self.next - 1 : self.next], stop=self.stop.is_set)
            inside += float(chunk[0]["kernel_s"].sum())
            self._keep(self.next - 1, chunk)
        spent = time.perf_counter() - began
        return spent / max(self.next - 1, 1), inside / max(spent, 1e-9)

    def spread(self, workers: int, processes: bool) -> None:
        """Run the others on as many threads, and wait for them.

        Args:
            workers: number of threads.
            processes: whether all but the first have a process each.
        """
        if not workers:
            return
        with ThreadPoolExecutor(workers, "crawler") as pool:
            try:
                works = [pool.submit(self._work, processes and k > 0) for k in range(workers)]
                while wait(works, 0.2).not_done:  # not a join: one that Ctrl-C breaks takes a running thread for ended
                    pass
            except BaseException:
                self.stop.set()
                raise
        for work in works:
            work.result()

    def _take(self) -> tuple[int, int]:
        with self.lock:
            first = self.next
            self.next = min(first + self.size, len(self.scenes))
            return first, self.next

    def _keep(self, first: int, chunk: Chunk) -> None:
        with self.lock:
            self.keep(first, chunk)
            self.done += chunk[0].size
            if self.progress is not None and not self.stop.is_set():
                self.progress(self.done / len(self.scenes))

    def _work(self, apart: bool) -> None:
        helper = _Helper() if apart else None
        try:
            while not self.stop.is_set():
                first, last = self._take()
                if first == last:
                    return
                some = self.scenes[first:last]
                chunk = None if helper is None else helper.run(self.run, some, self.stop)
                self._keep(first, chunk or self.run(some, stop=self.stop.is_set))
        except BaseException:
            self.stop.set()
            raise
        finally:
            if helper is not None:
                helper.close()


class _Helper:
    """A Python process that runs chunks handed to it."""

    def __init__(self) -> None:
        # in a session of its own: Ctrl-C is for the parent, which tells it to end
        self.process: subprocess.Popen[bytes] | None = subprocess.Popen(
            [sys.executable, "-c", _SERVE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
        )

    def run(self, run: Run, scenes: Sequence[Scene], stop: threading.Event) -> Chunk | None:
        """Have a chunk run.

        Args:
            run: as for `run_chunks`.
            scenes: what to run.
            stop: ends the process when it is set.

        Returns:
            What came of it; None when the process is gone, or was ended.
        """
        if self.process is None:
            return None
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        watch = threading.Thread(target=self._end_when, args=(stop, over := threading.Event()), daemon=True)
        watch.start()
        try:
            pickle.dump((run, scenes), self.process.stdin)
            self.process.stdin.flush()
            answer: Any = pickle.load(self.process.stdout)
        except (OSError, EOFError, pickle.UnpicklingError):  # killed: its chunk is run here, and all that follow
            self.close()
            return None
        finally:
            over.set()
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def _end_when(self, stop: threading.Event, over: threading.Event) -> None:
        while not over.wait(0.1):
            if stop.is_set() and self.process is not None:
                self.process.kill()
                return

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            process, self.process = self.process, None
            process.kill()
            process.communicate()


def serve() -> None:
    """Answer chunks on standard input with their results on standard output, until it ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever prints must not come between the answers
    while True:
        answer: Any
        try:
            run, scenes = pickle.load(sys.stdin.buffer)
            answer = run(scenes)
        except EOFError:
            return
        except BaseException as error:
            answer = error
        pickle.dump(answer, answers)
        answers.flush()
