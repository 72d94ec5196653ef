"""Jobs on the cores of this machine, in processes that never outlive the command, however it ends."""

from __future__ import annotations

import itertools
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any


class WorkerEndedError(Exception):
    """A worker process ended in the middle of a job.

    Attributes:
        jobs: numbers of the jobs that were not finished, in increasing order; one of them was running in the process.
    """

    def __init__(self, jobs: Iterable[int]) -> None:
        """Store the jobs.

        Args:
            jobs: numbers of the jobs that were not finished.
        """
        super().__init__()
        self.jobs = tuple(sorted(jobs))


def run_on_cores(
    function: Callable[..., Any], jobs: Iterable[tuple[Any, ...]], workers: int
) -> Iterator[tuple[int, Any]]:
    """Run jobs in processes, or in this one if one is enough.

    Args:
        function: a function of a module; the processes import it.
        jobs: its arguments, job by job; read as processes become free.
        workers: number of processes.

    Yields:
        The number of a job and its result, in the order in which they finish. The processes are ended when the caller
        stops.

    Raises:
        WorkerEndedError: when a process ends in the middle of a job.
    """
    left = enumerate(jobs)
    if workers == 1:
        for k, job in left:
            yield k, function(*job)
        return
    running: dict[Future[Any], int] = {}
    with ProcessPoolExecutor(workers, multiprocessing.get_context("spawn"), _begin_worker) as pool:
        try:
            while True:
                with _interrupts_blocked():  # the processes inherit this
                    for k, job in itertools.islice(left, workers + 1 - len(running)):
                        running[pool.submit(function, *job)] = k
                if not running:
                    return
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    result = future.result()
                    yield running.pop(future), result
        except BrokenProcessPool:
            raise WorkerEndedError(running.values()) from None
        except BaseException:
            for process in multiprocessing.active_children():
                process.terminate()
            raise


@contextmanager
def _interrupts_blocked() -> Iterator[None]:
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_worker() -> None:
    """End this process when the command ends, even if that is killed."""

    def watch() -> None:
        parent = multiprocessing.parent_process()
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
