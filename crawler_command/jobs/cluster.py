"""Jobs on a Dask cluster: collected when done, repeated when a worker dies."""

from __future__ import annotations

import asyncio
import logging
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any

import distributed

from crawler_model import CrawlerError

PATIENCE_S = 8.0
"""Longest wait for the scheduler's answer, and for a first worker [s]."""
_RETRIES = 10


class SchedulerEndedError(CrawlerError):
    """The scheduler ended before all jobs were done."""


class Cluster:
    """The workers of a Dask scheduler."""

    def __init__(self, client: distributed.Client, threads: int) -> None:
        """Store the connection.

        Args:
            client: the connection.
            threads: number of threads of all workers.
        """
        self._client = client
        self.threads = threads
        """Number of threads of all workers."""

    def run_jobs(self, function: Callable[..., Any], jobs: Iterable[tuple[Any, ...]]) -> Iterator[tuple[int, Any]]:
        """Run jobs; the jobs of a worker that dies are repeated on another.

        Args:
            function: a function of an installed module; workers import it.
            jobs: its arguments, job by job.

        Yields:
            The number of a job and its result, in the order in which they finish. All others are cancelled when the
            caller stops.

        Raises:
            SchedulerEndedError: when the scheduler ends.
            CrawlerError: when a worker cannot run the jobs.
        """
        places: dict[Any, int] = {}
        try:
            for k, job in enumerate(jobs):
                places[self._client.submit(function, *job, pure=False, retries=_RETRIES)] = k
            for task in distributed.as_completed(list(places), loop=self._client.loop):
                yield places.pop(task), _result(task)
        except CancelledError:
            raise SchedulerEndedError("--scheduler: the scheduler has ended") from None
        except BaseException:
            self._client.cancel(list(places), force=True)
            raise


@contextmanager
def connect(address: str) -> Iterator[Cluster]:
    """Connect to a Dask scheduler.

    Args:
        address: address of the scheduler, tcp://host:port.

    Yields:
        Its workers.

    Raises:
        CrawlerError: when there is no scheduler or no worker.
    """
    with _quiet(), _connect(address) as client:
        yield Cluster(client, _count_threads(client, address))


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the logging of Dask; errors that matter are reported in one line."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def _connect(address: str) -> distributed.Client:
    if not re.fullmatch(r"[a-z]+://[^/\s]+:\d+", address):
        raise CrawlerError(f"--scheduler: {address!r}; write tcp://host:port")
    try:
        return distributed.Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, asyncio.TimeoutError):  # a class of its own before Python 3.11
        raise CrawlerError(f"--scheduler: no Dask scheduler answers at {address}") from None


def _count_threads(client: distributed.Client, address: str) -> int:
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except (OSError, asyncio.TimeoutError):  # a class of its own before Python 3.11
        raise CrawlerError(f"--scheduler: {address} has no workers; start one: dask worker {address}") from None
    return sum(client.nthreads().values()) or 1


def _result(task: distributed.Future) -> Any:
    try:
        return task.result()
    except ModuleNotFoundError as error:
        raise CrawlerError(f"--scheduler: a worker lacks {error.name}; install crawler-ros there") from None
    except distributed.KilledWorker:
        raise CrawlerError("--scheduler: the workers died one after another; they may have run out of memory") from None
