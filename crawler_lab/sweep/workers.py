"""Distribution of runs over cores: threads if kernels dominate the time, additional processes if Python does.

The kernels run without the interpreter's lock, so threads scale well as long as scenes are assembled together. Where
each scene is built by itself, under the lock, most of the time goes there for small bodies: then each thread except the
first delegates to a Python process of its own. These are plain subprocesses: the program of the caller is neither
imported nor forked.
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

from crawler_model.crawler.crawler import prepare
from crawler_model.errors import CrawlerError
from crawler_model.scene.scene import Scene

from .vary import Variations

Chunk = tuple[np.ndarray, dict[int, str]]
"""Rows of results, and reasons for invalid rows by index."""
Run = Callable[..., Chunk]

_PROBE, _PROBE_S = 1024, 0.2
"""Upper limits of the number of runs, and of the duration, that are timed before the others are distributed."""
_THREADS_SCALE = 0.8
"""Part of the time spent in kernels above which threads scale; below it they wait for the interpreter's lock."""
_WORTH_A_PROCESS_S = 4.0
"""Remaining work that justifies starting Python processes and loading kernels, which takes a second or two."""
_CHUNK_S, _MOST_IN_A_CHUNK = 0.25, 8192
_SERVE = "from crawler_lab.sweep.workers import serve; serve()"


def available_cores() -> int:
    """Count the cores that this process may use.

    Returns:
        The number of cores.
    """
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def run_chunks(
    scenes: Sequence[Scene],
    run: Run,
    store: Callable[[int, Chunk], None],
    workers: int,
    progress: Callable[[float], None] | None = None,
) -> bool:
    """Run scenes in chunks on several cores.

    Args:
        scenes: the scenes to run.
        run: function that runs a chunk, `run(scenes, stop=...)`; it must be picklable.
        store: called with the first index and the result of each chunk, by one thread at a time.
        workers: number of simultaneous runs.
        progress: called with the completed part, in [0, 1].

    Returns:
        True if Ctrl-C stopped the runs; completed chunks are stored.
    """
    count = len(scenes)
    pool = _Pool(scenes, run, store, progress)
    try:
        if count:
            _prepare_first(scenes)
        each, inside = pool.probe()
        left = count - pool.next
        pool.size = int(min(max(_CHUNK_S / max(each, 1e-9), 1.0), _MOST_IN_A_CHUNK, max(left / (4 * workers), 1.0)))
        use_processes = inside < _THREADS_SCALE
        if use_processes and not (isinstance(scenes, Variations) and each * left > _WORTH_A_PROCESS_S):
            workers = 1
        pool.spread(min(workers, -(-left // pool.size)), use_processes)
    except KeyboardInterrupt:
        return True
    return False


def _prepare_first(scenes: Sequence[Scene]) -> None:
    """Load or compile the kernels for the first valid scene, before the workers need them."""
    for i in range(len(scenes)):
        try:
            scene = scenes[i]
        except CrawlerError:
            continue
        prepare(scene)
        return


class _Pool:
    """The remaining chunks and the threads that process them."""

    def __init__(
        self,
        scenes: Sequence[Scene],
        run: Run,
        store: Callable[[int, Chunk], None],
        progress: Callable[[float], None] | None,
    ) -> None:
        self.scenes, self.run, self.store, self.progress = scenes, run, store, progress
        self.next = self.done = 0
        self.size = 1
        self.stop = threading.Event()
        self.lock = threading.Lock()

    def probe(self) -> tuple[float, float]:
        """Run and time the first scenes in this thread, in chunks that double.

        Returns:
            Time per run [s], and the part of it spent in the kernels, of the last chunk.
        """
        each, inside, began = 0.0, 0.0, time.perf_counter()
        most = min(len(self.scenes), _PROBE)
        while self.next < most and (self.next <= 1 or time.perf_counter() - began < _PROBE_S):
            first, last = self.next, min(max(2 * self.next, self.next + 1), most)
            self.next = last
            since = time.perf_counter()
            chunk = self.run(self.scenes[first:last], stop=self.stop.is_set)
            spent = time.perf_counter() - since
            each, inside = spent / (last - first), float(chunk[0]["kernel_s"].sum()) / max(spent, 1e-9)
            self._store(first, chunk)
            if first == 0:  # the first run fills caches
                began = time.perf_counter()
        return each, inside

    def spread(self, workers: int, processes: bool) -> None:
        """Run the other scenes on several threads, and wait for them.

        Args:
            workers: number of threads.
            processes: whether each thread except the first uses a process of its own.
        """
        if not workers:
            return
        with ThreadPoolExecutor(workers, "crawler") as pool:
            try:
                works = [pool.submit(self._work, processes and k > 0) for k in range(workers)]
                while wait(works, 0.2).not_done:  # not join: after Ctrl-C it treats a running thread as ended
                    pass
            except BaseException:
                self.stop.set()
                raise
        for work in works:
            work.result()

    def _next_chunk(self) -> tuple[int, int]:
        with self.lock:
            first = self.next
            self.next = min(first + self.size, len(self.scenes))
            return first, self.next

    def _store(self, first: int, chunk: Chunk) -> None:
        with self.lock:
            self.store(first, chunk)
            self.done += chunk[0].size
            if self.progress is not None and not self.stop.is_set():
                self.progress(self.done / len(self.scenes))

    def _work(self, own_process: bool) -> None:
        helper = _Helper() if own_process else None
        try:
            while not self.stop.is_set():
                first, last = self._next_chunk()
                if first == last:
                    return
                scenes = self.scenes[first:last]
                chunk = None if helper is None else helper.run(self.run, scenes, self.stop)
                self._store(first, chunk or self.run(scenes, stop=self.stop.is_set))
        except BaseException:
            self.stop.set()
            raise
        finally:
            if helper is not None:
                helper.close()


class _Helper:
    """A Python process that runs chunks."""

    def __init__(self) -> None:
        # in a session of its own: only the parent receives Ctrl-C, and ends this process
        self.process: subprocess.Popen[bytes] | None = subprocess.Popen(
            [sys.executable, "-c", _SERVE],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)},
        )

    def run(self, run: Run, scenes: Sequence[Scene], stop: threading.Event) -> Chunk | None:
        """Run a chunk in the process.

        Args:
            run: as in `run_chunks`.
            scenes: the scenes to run.
            stop: event that ends the process.

        Returns:
            The result; None if the process has ended.
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
        except (OSError, EOFError, pickle.UnpicklingError):  # killed: the caller runs this chunk and all later ones
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
    """Read chunks from standard input and write their results to standard output, until the input ends."""
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # prints must not mix with the results
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
