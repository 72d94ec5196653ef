"""The cache of compiled kernels on disk, and its folder."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import io
import os
import pickle
import shutil
import sys
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.runtime.nrt import rtsys

from .compiler import keeping_half_done

_DAY = 86_400.0
_SOURCES = ("*.py", "body/**/*.py", "crawler/**/*.py", "derivative/**/*.py", "motion/**/*.py")
"""The files of this package that hold kernels, or that files with kernels import; a test keeps the list complete."""
_KEPT = 8
"""Number of source versions whose kernels stay in the cache; older ones are deleted when unused for a day."""


@functools.cache
def _print_once(reason: str) -> None:
    print(f"crawler: {reason}", file=sys.stderr, flush=True)


_PATIENCE_S, _POLL_S = 120.0, 0.05
"""How long to wait for another process that compiles the same kernel, which may have stopped; how often to look."""

report: Callable[[str], None] = _print_once
"""Called where a kernel cannot be kept; the kernel itself is compiled and stays in memory."""


class _Locator(_CacheLocator):  # type: ignore[misc]
    """Finds the folder for the kernels of a module in the cache of the user."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._py_file = function.__code__.co_filename
        self._folder = str(folder_of_kernels() / function.__module__)
        self._stamp = _sources_hash() + _folder_hash(Path(function.__code__.co_filename).parent)
        self._line = str(function.__code__.co_firstlineno)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Locator | None:
        """Locate a function; None if it was not read from a file."""
        return cls(py_func) if Path(py_file).exists() else None

    def get_cache_path(self) -> str:
        """Return the folder."""
        return self._folder

    def get_source_stamp(self) -> str:
        """Return a hash of the contents of all files that the function may be built from."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Return what tells functions of one name in one file apart."""
        return self._line

    def ensure_cache_path(self) -> None:
        """Create the folder; whether it is writable will show."""
        os.makedirs(self._folder, exist_ok=True)


class _Implementation(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes: list[type[object]] = [_Locator]  # noqa: RUF012 (as in numba)


class _Files(IndexDataCacheFile):  # type: ignore[misc]
    """The index and the data of a kernel. A file that is not whole counts as missing, and is overwritten.

    numba unpickles and runs whatever it finds, but a crash of the machine or a full disk leaves files that are empty or
    torn. Each file therefore begins with a digest of its contents and of the kernel's name. Data hold their key,
    because two processes may give data of different types the same name at once.
    """

    def load(self, key: Any) -> Any:
        """Load the data of a key; None if there are none."""
        held = super().load(key)  # type: ignore[no-untyped-call]
        return held[1] if held is not None and held[0] == key else None

    def save(self, key: Any, data: Any) -> None:
        """Save the data of a key."""
        super().save(key, (key, data))  # type: ignore[no-untyped-call]

    def _load_index(self) -> Any:
        return self._read(self._index_path) or {}

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, overloads)

    def _load_data(self, name: str) -> Any:
        return self._read(self._data_path(name))  # type: ignore[no-untyped-call]

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)  # type: ignore[no-untyped-call]

    def _read(self, path: str) -> Any:
        try:
            content = Path(path).read_bytes()
        except OSError:
            return None
        digest = self._digest(memoryview(content)[_DIGEST:])
        return pickle.loads(memoryview(content)[_DIGEST:]) if content[:_DIGEST] == digest else None

    def _write(self, path: str, data: Any) -> None:
        content = self._dump(data)  # type: ignore[no-untyped-call]
        Path(path).parent.mkdir(parents=True, exist_ok=True)  # the folder may be removed at any time
        with self._open_for_write(path) as file:  # type: ignore[no-untyped-call]
            file.write(self._digest(content))
            file.write(content)

    def _digest(self, content: bytes | memoryview) -> bytes:
        digest = hashlib.sha256(f"{self._version} {self._source_stamp} {self._index_name} ".encode())
        digest.update(content)
        return digest.digest()


_DIGEST = hashlib.sha256().digest_size


class KernelCache(FunctionCache):  # type: ignore[misc]
    """The cache of one kernel, keyed by the contents of all files that kernels are built from.

    numba reuses a cached function as long as its own file is unchanged, even if a function or a constant from another
    file that was compiled into it has changed; and it compiles again for each copy of the sources. This cache is never
    stale, and equal copies of the sources share it. Of processes that need a kernel at once, one compiles it and the
    others wait: environments, workers and nodes begin together.
    """

    _impl_class = _Implementation

    def __init__(
        self, function: Callable[..., Any], measure: Callable[[], contextlib.AbstractContextManager[Any]]
    ) -> None:
        """Locate the cache of a kernel.

        Args:
            function: the kernel.
            measure: what measures how long loading it takes.
        """
        super().__init__(function)  # type: ignore[no-untyped-call]
        self._measure = measure
        self._turn: IO[str] = io.StringIO()
        """The file that is locked while the kernel is compiled."""
        self._cache_file = _Files(
            self._cache_path,
            self._impl.filename_base,
            self._impl.locator.get_source_stamp(),
        )  # type: ignore[no-untyped-call]

    @keeping_half_done()
    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a compiled kernel without first importing all that numba can compile: a third of a second less.

        Args:
            sig: the types of its arguments.
            target_context: what numba compiles for.

        Returns:
            The kernel; None if the cache does not hold it.
        """
        if not hasattr(self, "_load_overload"):  # another version of numba
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        rtsys.initialize(target_context)
        # an error, as of a module that is no longer there, whatever it is: compile again
        with self._measure(), contextlib.suppress(Exception):
            found = self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
            if found is None:
                self._wait_for_others(sig)  # of whom one may have ended since
                found = self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]
            if found is not None:
                self._turn.close()
            return found
        return None

    def _wait_for_others(self, sig: Any) -> None:
        """Wait while another process compiles the kernel, then keep others waiting."""
        try:
            import fcntl
        except ModuleNotFoundError:  # on Windows each process compiles
            return
        name = hashlib.sha256(f"{self._impl.filename_base} {sig}".encode()).hexdigest()[:24]
        self._impl.locator.ensure_cache_path()
        self._turn = Path(self._cache_path, f"{name}.lock").open("w")  # noqa: SIM115 (until the kernel is saved)
        for _ in range(round(_PATIENCE_S / _POLL_S)):
            try:
                fcntl.flock(self._turn, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except BlockingIOError:
                time.sleep(_POLL_S)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save a compiled kernel; where that is impossible, report so: it stays in memory.

        Args:
            sig: the types of its arguments.
            data: what numba has compiled.
        """
        try:
            super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except OSError as error:
            report(
                f"compiled kernels cannot be kept in {folder_of_kernels()}: {error.strerror or error}; every run "
                "compiles them again until that folder is writable and has room, or NUMBA_CACHE_DIR names another one"
            )
        finally:
            self._turn.close()


@functools.cache
def _sources_hash() -> str:
    """Hash the names and contents of the files that kernels are built from."""
    return _hash_files(Path(__file__).parent, _SOURCES)


@functools.cache
def _folder_hash(folder: Path) -> str:
    """Hash the files next to a kernel of another package, which may use only them and this package; else empty."""
    return "" if Path(__file__).parent in (folder, *folder.parents) else _hash_files(folder, ("*.py",))


def _hash_files(folder: Path, patterns: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for file in sorted({file for pattern in patterns for file in folder.glob(pattern)}):
        content = file.read_bytes()
        digest.update(f"{file.relative_to(folder)} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()[:24]


@functools.cache
def folder_of_kernels() -> Path:
    """Create the folder for all kernels of these sources and delete folders of old ones, if it is possible.

    Returns:
        The folder, which may be missing or not writable.
    """
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or _home() / ".cache"
    kernels = Path(base) / "crawler" / "kernels"
    folder = kernels / _sources_hash()
    with contextlib.suppress(OSError):  # it is reported when there is a kernel to save
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)  # marks it as used
        _drop_old(kernels)
    return folder


def _home() -> Path:
    try:
        return Path.home()
    except RuntimeError:  # a user without a name, as in containers, which have this one as their home
        return Path("/")


def _drop_old(kernels: Path) -> None:
    by_use = sorted(((f.stat().st_mtime, f) for f in kernels.iterdir()), reverse=True)
    for used, folder in by_use[_KEPT:]:
        if used < time.time() - _DAY:
            shutil.rmtree(folder, ignore_errors=True)
