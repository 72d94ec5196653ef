"""Recordings by the hundred: one partitioned Parquet data set, made on all cores or on a Dask cluster."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import sys
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from crawler_model import CrawlerError, Scene
from crawler_ros.recording.bag import BagError, find_file

from ..jobs.cores import WorkerEndedError, run_on_cores
from .rows import (
    IDENTITY,
    TABLES,
    Identity,
    Outcome,
    describe_files,
    describe_settings,
    digest_of,
    tabulate,
    text_of,
)

_UNFINISHED = ".unfinished"
"""Folder in a data set for files that are being written."""
_LONGEST_NAME = 200


@dataclass(frozen=True)
class Batch:
    """Recordings to be analysed, and the data set to which they are added.

    Attributes:
        folder: the data set.
        bags: for each run its bag folder or .mcap file.
        names: for each run the name of its file or bag folder, as for people.
        finished: number of recordings that the data set holds already.
        skipped: why files or folders are skipped, by their names.
        scene: document of `--scene`.
        namespace: of `--namespace`.
    """

    folder: Path
    bags: Mapping[str, Path]
    names: Mapping[str, str]
    finished: int
    skipped: Mapping[str, str]
    scene: Mapping[str, Any] | None
    namespace: str | None


@dataclass
class Report:
    """What became of a batch.

    Attributes:
        finished: number of recordings that the data set held already.
        done: number of recordings that were added.
        unhealthy: number of recordings in which the analysis found problems.
        skipped: why files or folders were skipped, by their names.
        left: number of recordings that were not begun or not finished, after Ctrl-C.
    """

    finished: int = 0
    done: int = 0
    unhealthy: int = 0
    skipped: dict[str, str] = field(default_factory=dict)
    left: int = 0

    def as_plain(self, folder: Path) -> dict[str, Any]:
        """Convert to what `crawler replay --json` prints for several recordings.

        Args:
            folder: the data set.

        Returns:
            Plain numbers, lists and text; schema 1.
        """
        skipped = [{"recording": name, "reason": reason} for name, reason in self.skipped.items()]
        return {"schema": 1, "data_set": str(folder), **asdict(self), "skipped": skipped}

    def describe(self, folder: Path) -> str:
        """Describe the result in a line.

        Args:
            folder: the data set.

        Returns:
            The line.
        """
        parts = [f"{self.done} recording(s) added to {folder}"]
        parts += [f"{self.unhealthy} of them with problems (column problems of runs)"] if self.unhealthy else []
        parts += [f"{self.finished} there already"] if self.finished else []
        parts += [f"{len(self.skipped)} skipped"] if self.skipped else []
        parts += [f"stopped: {self.left} left for --resume"] if self.left else []
        return "; ".join(parts)


def plan_batch(
    recordings: Sequence[Path], folder: Path, resume: bool, scene: Scene | None, namespace: str | None
) -> Batch:
    """Find the recordings and what is left to do.

    Args:
        recordings: .mcap files, bag folders, and folders of them at any depth.
        folder: the data set, new or, to resume, of an earlier call.
        resume: whether to leave out the recordings that the data set holds, unless they have changed since.
        scene: the scene that ran, for recordings that do not hold it.
        namespace: namespace of the crawler, where several were recorded.

    Returns:
        The batch.

    Raises:
        CrawlerError: when there is no such recording, or the folder is not a data set.
    """
    for path in recordings:
        if not path.exists():
            raise CrawlerError(f"{path}: no such file or folder")
    _check_folder(folder, resume)
    document = None if scene is None else scene.document()
    settings = describe_settings(document, namespace)
    known = {identity.recording: (run, identity) for run, identity in _finished(folder)}
    moved = [(run, identity) for run, identity in known.values() if not Path(identity.recording).exists()]
    taken, skipped = {run for run, _ in known.values()}, {}
    left: dict[str, Path] = {}
    names: dict[str, str] = {}
    seen: set[Path] = set()
    finished = 0
    for name, found in _find_recordings(recordings):
        if isinstance(found, BagError):
            skipped[name] = str(found).removeprefix(f"{name}: ")
            continue
        file = find_file(found).resolve()
        if file in seen:
            continue
        seen.add(file)
        run, identity = known.get(text_of(file), ("", None))
        same = [
            name
            for name, old in (moved if identity is None else [(run, identity)])
            if old.settings == settings and _is_unchanged(found, old)
        ]
        if same and identity is not None:
            finished += 1
            continue
        run = run or (same[0] if same else _new_name(file, taken))
        moved = [one for one in moved if one[0] != run]  # its rows are replaced, as they name the file
        taken.add(run)
        left[run], names[run] = found, name
    return Batch(folder, left, names, finished, skipped, document, namespace)


def run_batch(batch: Batch, workers: int | None, scheduler: str | None, progress: Callable[[float], None]) -> Report:
    """Analyse the recordings of a batch and add them to its data set.

    Args:
        batch: the batch.
        workers: number of processes on this machine; None for one per core.
        scheduler: address of a Dask scheduler whose workers are used instead; None for this machine.
        progress: called with the fraction done, in [0, 1].

    Returns:
        What became of it; after Ctrl-C, the recordings finished until then.

    Raises:
        CrawlerError: when a worker ends, the cluster cannot be used, or another process writes to the data set; the
            recordings finished until then are kept.
    """
    with _only_writer(batch.folder):
        return _run_alone(batch, workers, scheduler, progress)


def _run_alone(batch: Batch, workers: int | None, scheduler: str | None, progress: Callable[[float], None]) -> Report:
    _remove_halves(batch.folder)
    runs, bags = list(batch.bags), list(batch.bags.values())
    sizes = [find_file(bag).stat().st_size + 1 for bag in bags]
    report = Report(batch.finished, skipped=dict(batch.skipped), left=len(runs))
    through = 0
    try:
        with closing(_outcomes(batch, bags, workers, scheduler)) as outcomes:
            for k, outcome in outcomes:
                with _interrupts_held():
                    _add(batch.folder, runs[k], outcome)
                    report.left -= 1
                    if outcome.reason:
                        report.skipped[batch.names[runs[k]]] = outcome.reason
                    else:
                        report.done += 1
                        report.unhealthy += not outcome.healthy
                through += sizes[k]
                progress(through / sum(sizes))
    except KeyboardInterrupt:
        pass
    finally:
        _align_columns(batch.folder)
        shutil.rmtree(batch.folder / _UNFINISHED, ignore_errors=True)
    return report


def _outcomes(
    batch: Batch, bags: Sequence[Path], workers: int | None, scheduler: str | None
) -> Generator[tuple[int, Outcome], None, None]:
    """Analyse recordings, and yield the number of each with its outcome, in the order in which they finish."""
    jobs = [(str(bag), batch.scene, batch.namespace) for bag in bags]
    if scheduler is not None:
        from ..jobs.cluster import connect

        with connect(scheduler) as cluster:
            yield from cluster.run_jobs(tabulate, jobs)
        return
    try:
        yield from run_on_cores(tabulate, jobs, min(workers or os.cpu_count() or 1, max(len(jobs), 1)))
    except WorkerEndedError as error:
        names = ", ".join(list(batch.names.values())[k] for k in error.jobs)
        raise CrawlerError(
            f"a process ended while it analysed one of {names}, perhaps out of memory; "
            "fewer --workers need less; continue with --resume"
        ) from None


def _check_folder(folder: Path, resume: bool) -> None:
    if not folder.absolute().parent.is_dir():
        raise CrawlerError(f"--parquet: the folder {folder.absolute().parent} does not exist")
    if folder.exists() and not folder.is_dir():
        raise CrawlerError(f"--parquet: {folder} is not a folder")
    inside = {path.name for path in folder.iterdir()} if folder.exists() else set()
    if inside and not resume:
        raise CrawlerError(f"--parquet: {folder} exists already; choose a new folder, or continue it with --resume")
    if not inside <= {*TABLES, _UNFINISHED}:
        raise CrawlerError(f"--parquet: {folder} is not a data set of recordings: it holds {min(inside - {*TABLES})}")


def _finished(folder: Path) -> Iterator[tuple[str, Identity]]:
    """Find the runs that a data set holds."""
    for part in _parts(folder):
        about = parquet.read_schema(part).metadata or {}
        if IDENTITY in about:
            yield part.parent.name.removeprefix("run="), Identity(**json.loads(about[IDENTITY]))


def _parts(folder: Path) -> list[Path]:
    return sorted((folder / "runs").glob("run=*/part.parquet"))


def _find_recordings(paths: Sequence[Path]) -> Iterator[tuple[str, Path | BagError]]:
    """Find bag folders and .mcap files, in folders of them too; or why there are none."""
    for path in paths:
        inside = _bags_in(path) if path.is_dir() else [path]
        for bag in inside or [path]:
            try:
                find_file(bag)
                yield str(bag), bag.resolve()
            except BagError as error:
                yield str(bag), error


def _bags_in(folder: Path) -> list[Path]:
    """List bag folders and other .mcap files in a folder, at any depth."""
    found: list[Path] = []
    for place, inner, files in os.walk(folder):
        inner.sort()
        if "metadata.yaml" in files:
            found.append(Path(place))
        else:
            found += [Path(place, name) for name in sorted(files) if name.endswith((".mcap", ".mcap.zstd"))]
    return found


def _is_unchanged(bag: Path, before: Identity) -> bool:
    """Return whether a recording is the one that was analysed; its contents decide where the times differ."""
    recording, size, modified_ns = describe_files(bag)
    same_times = recording == before.recording and modified_ns == before.modified_ns
    return size == before.size and (same_times or digest_of(bag) == before.digest)


def _new_name(file: Path, taken: set[str]) -> str:
    """Name a run after its bag folder, or its file; readers of partitions must not take the name for a number."""
    name = file.parent.name if (file.parent / "metadata.yaml").exists() else file.stem
    name = re.sub(r"[^\w.-]", "_", name, flags=re.ASCII)[:_LONGEST_NAME]
    if not name[:1].isalpha():
        name = f"run_{name}"
    names = (name if k == 1 else f"{name}_{k}" for k in count(1))
    return next(name for name in names if name not in taken)


def _add(folder: Path, run: str, outcome: Outcome) -> None:
    """Add a run to all tables, the row of `runs` last; remove what an earlier version of a skipped file left there."""
    places = {table: folder / table / f"run={run}" for table in TABLES}
    if outcome.reason:
        for place in reversed(places.values()):
            shutil.rmtree(place, ignore_errors=True)
        return
    unfinished = _unfinished(folder)
    for table, place in places.items():
        (unfinished / table).write_bytes(outcome.tables[table])
        place.mkdir(parents=True, exist_ok=True)
    for table, place in places.items():
        (unfinished / table).replace(place / "part.parquet")


def _unfinished(folder: Path) -> Path:
    unfinished = folder / _UNFINISHED
    unfinished.mkdir(parents=True, exist_ok=True)
    return unfinished


@contextmanager
def _only_writer(folder: Path) -> Iterator[None]:
    """Lock a data set, which is created if it does not exist, and removed if it is empty in the end."""
    folder.mkdir(exist_ok=True)
    try:
        with _lock(folder):
            yield
    finally:
        with suppress(OSError):  # it is not empty
            folder.rmdir()


@contextmanager
def _lock(folder: Path) -> Iterator[None]:
    try:
        import fcntl
    except ModuleNotFoundError:  # Windows cannot lock a folder
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # of a file system without locks
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise CrawlerError(f"--parquet: another process is writing to {folder}") from None
        yield
    finally:
        os.close(handle)


def _remove_halves(folder: Path) -> None:
    """Remove runs without a row of `runs`, which a process left that was killed."""
    for table in TABLES[:-1]:
        for place in (folder / table).glob("run=*"):
            if not (folder / "runs" / place.name / "part.parquet").exists():
                shutil.rmtree(place)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold Ctrl-C back until the end of the block."""
    caught: list[int] = []
    before = signal.signal(signal.SIGINT, lambda number, _: caught.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if caught and callable(before):
        before(signal.SIGINT, None)


def _align_columns(folder: Path) -> None:
    """Let all rows of `runs` have a column for every number of any scene, so that every reader sees one table."""
    schemas = {part: parquet.read_schema(part) for part in _parts(folder)}
    fields: dict[str, pa.Field] = {}
    for schema in schemas.values():
        fields |= {f.name: f for f in schema if f.name not in fields}
    own = [name for name in fields if "." not in name]
    names = [*own, *sorted(name for name in fields if "." in name)]
    for part, schema in schemas.items():
        if schema.names == names:
            continue
        row = parquet.ParquetFile(part).read()
        columns = [row[name] if name in schema.names else pa.nulls(1, fields[name].type) for name in names]
        target = pa.schema([fields[name] for name in names], metadata=schema.metadata)
        file = _unfinished(folder) / part.parent.name
        parquet.write_table(pa.Table.from_arrays(columns, schema=target), file, compression="zstd")
        file.replace(part)


def print_skipped(report: Report) -> None:
    """Print a line on standard error for each recording that was skipped.

    Args:
        report: what became of a batch.
    """
    for name, reason in report.skipped.items():
        print(f"crawler: skipped {name}: {' '.join(reason.split())}", file=sys.stderr)
