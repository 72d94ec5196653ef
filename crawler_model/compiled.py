"""Compilation of kernels with numba."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
from numba.core import event, types

from .announce import Announcer
from .compiler import Compiler
from .errors import CrawlerError
from .kernel_cache import KernelCache

_COMPILER_BYTES = 512 << 20
"""Address space that compiling takes."""
_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of numba for functions that Python does not call."""


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function with numba: it runs without the interpreter's lock and is cached on disk if possible.

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
    """Compile a function like `compiled`, to be called only by other kernels: it becomes a part of them.

    Args:
        function: the function to compile.

    Returns:
        The compiled function.
    """
    return _compile(function, _nrt=True, **_INNER)


def lean(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function like `entry`, to be called only by other kernels: it becomes a part of them.

    Args:
        function: the function to compile.

    Returns:
        The compiled function.
    """
    return _compile(function, _nrt=False, **_INNER)


def inlined(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a function like `lean`, and copy it to where it is called.

    A call copies seven to nine numbers for each array and for each array in each tuple that it passes. In small
    functions of many arrays, and in functions that are called at a single place, this takes longer than the rest. Large
    ones take longer to compile so.

    Args:
        function: the function to compile.

    Returns:
        The compiled function.
    """
    return _compile(function, _nrt=False, forceinline=True, **_INNER)


def _compile(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    # numba hands a `forceinline` on to callees that do not set it: for gradual ground it took four times as long
    options: dict[str, Any] = {
        "nogil": True,
        "error_model": "numpy",
        "pipeline_class": Compiler,
        "forceinline": False,
    } | more
    dispatcher: Any = numba.njit(**options)(function)
    if hasattr(dispatcher, "_cache"):  # it is a plain function where kernels are interpreted
        dispatcher._compiler.fold_argument_types = _with_plain_integers(dispatcher._compiler.fold_argument_types)
        # RuntimeError: "no locator available": it was not read from a file; AttributeError: another version of numba
        with contextlib.suppress(RuntimeError, AttributeError):
            dispatcher._cache = KernelCache(function, announcer.loading)
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
    """Read a clock that stops while kernels are compiled or loaded, which takes longer than most time limits.

    Returns:
        The time [s].
    """
    return time.monotonic() - announcer.spent()
