"""Sweeps on a Dask cluster: chunks of variations as tasks, collected when done, repeated when a worker dies."""

from __future__ import annotations

import asyncio
import logging
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from typing import Any

import distributed
import numpy as np

from crawler_model import CrawlerError, ManyRuns, Variations
from crawler_model.sweep.many import Settings, run_chunk
from crawler_model.sweep.results import gather
from crawler_model.sweep.rows import ROW

PATIENCE_S = 8.0
"""Longest wait for the scheduler's answer, and for a first worker [s]."""
_RETRIES = 10
_CHUNKS_A_THREAD, _MOST_IN_A_CHUNK = 8, 512


def simulate_on_cluster(
    address: str, variations: Variations, settings: Settings, progress: Callable[[float], None] | None = None
) -> ManyRuns:
    """Run variations on the workers of a Dask scheduler; they need this package installed.

    Scenes are sent as documents and numbers, so that workers need no files of this machine.

    Args:
        address: address of the scheduler, tcp://host:port.
        variations: the variations to run.
        settings: settings of each run.
        progress: called with the fraction done, in [0, 1].

    Returns:
        The results of `simulate_many`, identical to the bit on equal processors.

    Raises:
        CrawlerError: when there is no scheduler or no worker, or a worker cannot run the variations.
    """
    began = time.perf_counter()
    settings.check()
    with _quiet(), _connect(address) as client:
        threads = _count_threads(client, address)
        rows, reasons, interrupted = _gather_tasks(client, threads, variations, settings, progress)
    return gather(rows, reasons, interrupted, time.perf_counter() - began)


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


def _gather_tasks(
    client: distributed.Client,
    threads: int,
    variations: Variations,
    settings: Settings,
    progress: Callable[[float], None] | None,
) -> tuple[np.ndarray, dict[int, str], bool]:
    count = len(variations)
    size = max(min(count // (_CHUNKS_A_THREAD * threads), _MOST_IN_A_CHUNK), 1)
    rows, reasons = np.zeros(count, ROW), {}
    places: dict[Any, int] = {}
    done = 0
    try:
        for first in range(0, count, size):
            task = client.submit(run_chunk, variations[first : first + size], settings, pure=False, retries=_RETRIES)
            places[task] = first
        waiting = distributed.as_completed(list(places), loop=client.loop)
        for task in waiting:
            first = places.pop(task)
            some, why = _result(task)
            rows[first : first + some.size] = some
            reasons.update({first + i: text for i, text in why.items()})
            done += some.size
            if progress is not None:
                progress(done / count)
    except KeyboardInterrupt:
        client.cancel(list(places), force=True)
        return rows, reasons, True
    except CancelledError:
        print("crawler: --scheduler: the scheduler has ended; the remaining variations are not run", file=sys.stderr)
        return rows, reasons, True
    return rows, reasons, False


def _result(task: distributed.Future) -> tuple[np.ndarray, dict[int, str]]:
    try:
        return task.result()
    except ModuleNotFoundError as error:
        raise CrawlerError(f"--scheduler: a worker lacks {error.name}; install crawler-ros there") from None
    except distributed.KilledWorker:
        raise CrawlerError("--scheduler: the workers died one after another; they may have run out of memory") from None
