"""Compilation of kernels with numba, and the cache of compiled kernels on disk."""

from __future__ import annotations

import contextlib
import functools
import gc
import hashlib
import os
import resource
import shutil
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import numba
from numba.core import event, ir, types
from numba.core.caching import FunctionCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import require_global_compiler_lock
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.lowering import Lower
from numba.core.runtime.nrt import rtsys
from numba.core.typed_passes import NativeLowering, NoPythonSupportedFeatureValidation

from .announce import Announcer
from .errors import CrawlerError

_DAY = 86_400.0
_SOURCES = ("*.py", "body/**/*.py", "crawler/**/*.py", "derivative/**/*.py", "motion/**/*.py")
"""The files of this package that hold kernels, or that files with kernels import; a test keeps the list complete."""
_COMPILER_BYTES = 512 << 20
"""Address space that compiling takes."""
_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of numba for functions that Python does not call."""
_GARBAGE = 50_000
"""Objects that are made before garbage is looked for while functions are compiled; at most 10 MB more are in use."""
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


@register_pass(mutates_CFG=False, analysis_only=False)  # type: ignore[no-untyped-call]
class _UnsignedIndices(FunctionPass):  # type: ignore[misc]
    """Treat integers that index arrays as unsigned.

    Python counts a negative index from the end of the array. No kernel may use that: to look for it at each access
    takes an eighth of the time of a tick. Compiled with NUMBA_BOUNDSCHECK=1, kernels raise IndexError instead.
    """

    _name = "crawler_unsigned_indices"

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]

    def run_pass(self, state: Any) -> bool:
        """Replace the signature of each access to an element of an array; lowering converts the index."""
        state.calltypes = {node: _index_unsigned(node, call) for node, call in state.calltypes.items()}
        return True


def _index_unsigned(node: Any, call: Any) -> Any:
    is_access = isinstance(node, ir.SetItem) or (isinstance(node, ir.Expr) and node.op == "getitem")
    if not (is_access and isinstance(call.args[0], types.Array)):
        return call
    return call.replace(args=(call.args[0], _unsigned(call.args[1]), *call.args[2:]))


def _unsigned(index: Any) -> Any:
    if isinstance(index, types.BaseTuple):
        parts: Any = index
        return types.BaseTuple.from_types([_unsigned(part) for part in parts])  # type: ignore[no-untyped-call]
    return types.uintp if isinstance(index, types.Integer) else index


class _Part(JITCodeLibrary):  # type: ignore[misc]
    """The code of a function that other kernels alone call: LLVM optimizes and translates it as a part of them.

    numba optimizes and translates each function together with all that it calls, and again in each function that calls
    it: in a chain of calls as long as the kernels' this takes twice as long. This code is linked as it is. What the
    process loads is the address of the environment alone, which numba sets for every function.
    """

    def finalize(self) -> None:
        """Link what the function calls, and keep all of it for those that call the function."""
        require_global_compiler_lock()  # type: ignore[no-untyped-call]
        self._raise_if_finalized()  # type: ignore[no-untyped-call]
        code = self._final_module
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            code.link_in(library._get_module_for_linking(), preserve=True)
        for function in code.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"  # those who call it copy it
        environments = [str(each) for each in code.global_variables if each.name.startswith("_ZN08NumbaEnv")]
        empty = str(self._codegen._create_empty_module(self.name))  # type: ignore[no-untyped-call]
        self._shared_module = code
        self._final_module = llvm.parse_assembly("\n".join([empty, *environments]))
        self._finalize_final_module()  # type: ignore[no-untyped-call]


@register_pass(mutates_CFG=False, analysis_only=False)  # type: ignore[no-untyped-call]
class _KeepParts(FunctionPass):  # type: ignore[misc]
    """Keep functions that Python does not call as parts of those that call them."""

    _name = "crawler_keep_parts"

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]

    def run_pass(self, state: Any) -> bool:
        """Choose where the code goes."""
        if state.flags.no_cpython_wrapper:
            state.library = _Part(state.targetctx.codegen(), state.func_id.func_qualname)  # type: ignore[no-untyped-call]
            state.library.enable_object_caching()
        return False


class _Borrower(Lower):  # type: ignore[misc]
    """Translates a function that borrows its arguments: their caller holds them until it returns.

    numba counts a reference to each array among the arguments of a call, and to all that a tuple holds. Instructions
    that count lock the counter for other threads: they took a quarter of the time of a ramp in the plane.
    """

    _borrowed: frozenset[str] = frozenset()
    _borrows = False

    def lower_assign(self, ty: Any, inst: Any) -> Any:
        """Translate an assignment, of an argument without counting it."""
        if isinstance(inst.value, ir.Arg):
            self._borrowed |= {inst.target.name}
            self._borrows = True
        value = super().lower_assign(ty, inst)  # type: ignore[no-untyped-call]
        self._borrows = False
        return value

    def incref(self, typ: Any, val: Any) -> None:
        """Count a reference, unless an argument is being assigned."""
        if not self._borrows:
            super().incref(typ, val)  # type: ignore[no-untyped-call]

    def delvar(self, name: str) -> None:
        """Delete a variable, unless it is an argument."""
        if name not in self._borrowed:
            super().delvar(name)  # type: ignore[no-untyped-call]


@register_pass(mutates_CFG=True, analysis_only=False)  # type: ignore[no-untyped-call]
class _Lowering(NativeLowering):  # type: ignore[misc]
    """Translate functions by `_Borrower`."""

    _name = "crawler_lowering"

    @property
    def lowering_class(self) -> type[Lower]:
        """The class that does it."""
        return _Borrower


_IDLE = {
    "WithLifting",
    "InlineClosureLikes",
    "RewriteDynamicRaises",
    "MakeFunctionToJitFunction",
    "InlineInlinables",
    "FindLiterallyCalls",
    "LiteralUnroll",
    "LiteralPropagationSubPipelinePass",
    "InlineOverloads",
    "NopythonRewrites",
}
"""Passes for what no kernel contains: `with` blocks, closures, inlining before LLVM's, expressions of whole arrays."""


class _Compiler(CompilerBase):  # type: ignore[misc]
    """The compiler of numba with two more passes, without idle ones, and with functions that borrow their arguments."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function; garbage is looked for less often meanwhile, which took a tenth of the time."""
        kept = gc.get_threshold()
        gc.set_threshold(_GARBAGE)
        try:
            return super().compile_extra(func)  # type: ignore[no-untyped-call]
        finally:
            gc.set_threshold(*kept)

    def define_pipelines(self) -> list[Any]:
        """List the passes."""
        passes: Any = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]
        passes.add_pass_after(_UnsignedIndices, NoPythonSupportedFeatureValidation)
        passes.add_pass_after(_KeepParts, _UnsignedIndices)
        passes.passes = [
            (_Lowering if one is NativeLowering else one, text)
            for one, text in passes.passes
            if not (isinstance(one, type) and one.__name__ in _IDLE)
        ]
        passes.finalize()
        return [passes]


def _compile(function: Callable[..., Any], **more: Any) -> Callable[..., Any]:
    dispatcher: Any = numba.njit(nogil=True, error_model="numpy", pipeline_class=_Compiler, **more)(function)
    if hasattr(dispatcher, "_cache"):  # it is a plain function where kernels are interpreted
        dispatcher._compiler.fold_argument_types = _without_literals(dispatcher._compiler.fold_argument_types)
        # RuntimeError: "no locator available": read-only, without a home to write to; or another version of numba
        with contextlib.suppress(RuntimeError, AttributeError):
            dispatcher._cache = _Cache(function)
    return dispatcher


def _without_literals(fold: Callable[..., Any]) -> Callable[..., Any]:
    """Type constants among the arguments of a call as variables: numba compiles a function again for each of them."""

    def fold_plain(args: Any, kws: Any) -> Any:
        signature, folded = fold(args, kws)
        return signature, tuple(types.unliteral(each) for each in folded)  # type: ignore[no-untyped-call]

    return fold_plain


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
    most = resource.getrlimit(resource.RLIMIT_AS)[0]
    statm = Path("/proc/self/statm")
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
