"""Compilation of kernels with numba, and the cache of compiled kernels on disk."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import shutil
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numba
from numba.core import event, types
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys

from .announce import Announcer
from .compiler import Compiler
from .errors import CrawlerError

_DAY = 86_400.0
_SOURCES = ("*.py", "body/**/*.py", "crawler/**/*.py", "derivative/**/*.py", "motion/**/*.py")
"""The files of this package that hold kernels, or that files with kernels import; a test keeps the list complete."""
_COMPILER_BYTES = 512 << 20
"""Address space that compiling takes."""
_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of numba for functions that Python does not call."""
_KEPT = 8
"""Number of source versions whose kernels stay in the cache; older ones are deleted when unused for a day."""


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function with numba: it runs without the interpreter's lock and is cached on disk if possible.

    numba reuses a cached function as long as its own file is unchanged, even if a function or a constant from another
    file that was compiled into it has changed; and it compiles again for each copy of the sources. Here the cache is
    keyed by the contents of all files that kernels are built from, so it is never stale, and equal copies share it.

    Args:
        function: the function to compile.

    Returns:
        The compiled function.
    """
    return _compile(function, _nrt=True)


def entry(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function that allocates and returns no arrays, like `compiled`, but without counting references.

    A function counts references to each array that is passed to it or sliced in it, with instructions that lock the
    counter for other threads. In small functions this takes longer than the rest.

    Args:
        function: the function to compile.

    Returns:
        The compiled function.
    """
    return _compile(function, _nrt=False)


def inner(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function like `compiled`, to be called by other kernels alone: it becomes a part of them.

    Args:
        function: the function to compile.

    Returns:
        The compiled function.
    """
    return _compile(function, _nrt=True, **_INNER)


def lean(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function like `entry`, to be called by other kernels alone: it becomes a part of them.

    Args:
        function: the function to compile.

    Returns:
        The compiled function.
    """
    return _compile(function, _nrt=False, **_INNER)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function like `lean`, and copy it to where it is called.

    A call copies seven to nine numbers for each array and for each array in each tuple that it passes. In small
    functions of many arrays, and in those that are called at a single place, this takes longer than the rest. Large
    ones take longer to compile so.

    Args:
        function: the function to compile.

    Returns:
        The compiled function.
    """
    return _compile(function, _nrt=False, forceinline=True, **_INNER)


class _Cache(FunctionCache):  # type: ignore[misc]
    """The cache of one kernel, keyed by the contents of all files that kernels are built from."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)  # type: ignore[no-untyped-call]
        stamp = _sources_hash() + _folder_hash(Path(function.__code__.co_filename).parent)
        self._cache_file._source_stamp = stamp
        folder = _kernel_folder(function.__module__)
        if folder is not None:
            self._cache_file = type(self._cache_file)(str(folder), self._impl.filename_base, stamp)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load a compiled kernel without first importing all that numba can compile: a third of a second less."""
        if not hasattr(self, "_load_overload"):  # another version of numba
            return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        rtsys.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)  # type: ignore[no-untyped-call]


def _compile(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    dispatcher: Any = numba.njit(nogil=True, error_model="numpy", pipeline_class=Compiler, **more)(function)
    if hasattr(dispatcher, "_cache"):  # it is a plain function where kernels are interpreted
        dispatcher._compiler.fold_argument_types = _with_plain_integers(dispatcher._compiler.fold_argument_types)
        # RuntimeError: "no locator available": read-only, without a home to write to; or another version of numba
        with contextlib.suppress(RuntimeError, AttributeError):
            dispatcher._cache = _Cache(function)
    return dispatcher


def _with_plain_integers(fold: Callable[..., Any]) -> Callable[..., Any]:
    """Type integers among the arguments of a call alike: numba compiles a function again for each constant and size."""

    def fold_plain(args: Any, kws: Any) -> Any:
        signature, folded = fold(args, kws)
        return signature, tuple(map(_plain, folded))

    return fold_plain


def _plain(kind: Any) -> Any:
    kind = types.unliteral(kind)  # type: ignore[no-untyped-call]
    return types.int64 if isinstance(kind, types.Integer) else kind


@functools.cache
def _sources_hash() -> str:
    """Hash the names and contents of the files that kernels are built from."""
    return _hash_files(Path(__file__).parent, _SOURCES)


@functools.cache
def _folder_hash(folder: Path) -> str:
    """Hash the files beside a kernel of another package, which may use them and this package alone; else empty."""
    return "" if Path(__file__).parent in (folder, *folder.parents) else _hash_files(folder, ("*.py",))


def _hash_files(folder: Path, patterns: Iterable[str]) -> str:
    digest = hashlib.sha256()
    for file in sorted({file for pattern in patterns for file in folder.glob(pattern)}):
        content = file.read_bytes()
        digest.update(f"{file.relative_to(folder)} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()[:24]


@functools.cache
def _kernel_folder(module: str) -> Path | None:
    """Create the folder for a module's kernels in the user's cache; None if it is not writable."""
    try:
        folder = folder_of_kernels() / module
        folder.mkdir(exist_ok=True)
    except (OSError, RuntimeError):  # RuntimeError: no home directory
        return None
    return folder if os.access(folder, os.W_OK) else None


@functools.cache
def folder_of_kernels() -> Path:
    """Create the folder for all kernels of these sources, and delete those of old ones."""
    base = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    kernels = Path(base) / "crawler" / "kernels"
    folder = kernels / _sources_hash()
    folder.mkdir(parents=True, exist_ok=True)
    os.utime(folder)  # marks it as used
    _drop_old(kernels)
    return folder


def _drop_old(kernels: Path) -> None:
    by_use = sorted(((f.stat().st_mtime, f) for f in kernels.iterdir()), reverse=True)
    for used, folder in by_use[_KEPT:]:
        if used < time.time() - _DAY:
            shutil.rmtree(folder, ignore_errors=True)


def _check_address_space() -> None:
    """Refuse to compile where a limit of the address space would end the process without a word.

    Raises:
        CrawlerError: when less is left than compiling takes.
    """
    try:
        import resource
    except ModuleNotFoundError:  # Windows has no such limits
        return
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    statm = Path("/proc/self/statm")  # of Linux
    if most == resource.RLIM_INFINITY or not statm.exists():
        return
    left = most - int(statm.read_text("ascii").split()[0]) * resource.getpagesize()
    if left < _COMPILER_BYTES:
        raise CrawlerError(
            f"the address space is limited and has {left >> 20} MiB left; compiling the kernels takes "
            f"{_COMPILER_BYTES >> 20} MiB: raise the limit (ulimit -v) until the first run has compiled them"
        )


announcer = Announcer(_check_address_space)
event.register("numba:compile", announcer)  # type: ignore[no-untyped-call]


def clock() -> float:
    """Read a clock that stops while kernels are compiled, which takes longer than most time limits.

    Returns:
        The time [s].
    """
    return time.monotonic() - announcer.spent()
