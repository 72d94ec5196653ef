"""The compiler of kernels: numba's, with passes of our own and without passes that kernels do not need."""

from __future__ import annotations

import functools
import gc
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Any

import llvmlite.binding as llvm
from numba.core import codegen, ir, types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import CompilerBase, DefaultPassBuilder
from numba.core.compiler_lock import require_global_compiler_lock
from numba.core.compiler_machinery import FunctionPass, register_pass
from numba.core.lowering import Lower
from numba.core.typed_passes import NativeLowering, NoPythonSupportedFeatureValidation

_GARBAGE = 50_000
"""Objects that are made before garbage is looked for while functions are compiled; at most 10 MB more are in use."""

_DATA = 4
"""Where numba passes the pointer to the elements among the values of an array."""


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
    """The code of a function that only other kernels call: LLVM optimizes and translates it as a part of them.

    numba optimizes and translates each function together with all that it calls, and again in each function that calls
    it: in a chain of calls as long as the kernels' this takes twice as long. This code is linked as it is. The process
    loads only the address of the environment, which numba sets for every function.
    """

    def finalize(self) -> None:
        """Link what the function calls, and keep all of it for its callers."""
        require_global_compiler_lock()  # type: ignore[no-untyped-call]
        self._raise_if_finalized()  # type: ignore[no-untyped-call]
        code = self._final_module
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            code.link_in(library._get_module_for_linking(), preserve=True)
        for function in code.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"  # its callers copy it
        environments = [str(each) for each in code.global_variables if each.name.startswith("_ZN08NumbaEnv")]
        empty = str(self._codegen._create_empty_module(self.name))  # type: ignore[no-untyped-call]
        self._shared_module = code
        self._final_module = llvm.parse_assembly("\n".join([empty, *environments]))
        self._finalize_final_module()  # type: ignore[no-untyped-call]


def _build_passes(machine: Any, opt: Any, **_: Any) -> Any:
    """Build passes of LLVM that neither vectorize nor unroll loops: most are over a few contacts or fields.

    It took a tenth of the time of compiling, and made ticks longer. Loops of constant length, as over two components,
    were unrolled when numba optimized the function.
    """
    options = llvm.create_pipeline_tuning_options(opt)
    options.loop_vectorization = options.loop_unrolling = False
    return llvm.create_pass_builder(machine, options)


class _Whole(JITCodeLibrary):  # type: ignore[misc]
    """The code of a function that Python calls, and of all that it calls.

    Nothing else calls these copies. So LLVM puts functions with one caller there, and passes to others only what they
    use: a call copied some eighty numbers otherwise, a fifth of the time of a tick of two contacts.
    """

    def _optimize_final_module(self) -> None:
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.linkonce_odr:
                function.linkage = "internal"
        backend: Any = codegen
        theirs, backend.create_pass_builder = backend.create_pass_builder, _build_passes
        try:
            super()._optimize_final_module()  # type: ignore[no-untyped-call]
        finally:
            backend.create_pass_builder = theirs


@register_pass(mutates_CFG=False, analysis_only=False)  # type: ignore[no-untyped-call]
class _ChooseLibrary(FunctionPass):  # type: ignore[misc]
    """Keep functions that Python does not call as parts of their callers."""

    _name = "crawler_choose_library"

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]

    def run_pass(self, state: Any) -> bool:
        """Choose where the code goes."""
        kind = _Part if state.flags.no_cpython_wrapper else _Whole
        state.library = kind(state.targetctx.codegen(), state.func_id.func_qualname)  # type: ignore[no-untyped-call]
        state.library.enable_object_caching()
        return False


def _records_of(kind: Any, value: Any) -> list[tuple[Any, Any]]:
    """List the types of the records in an argument, and the values that point to them."""
    if isinstance(kind, types.BaseTuple):
        members: Any = kind
        return [each for pair in zip(members, value, strict=True) for each in _records_of(*pair)]
    if isinstance(kind, types.Record):
        return [(kind, value)]
    if isinstance(kind, types.Array) and isinstance(kind.dtype, types.Record):
        return [(kind.dtype, value[_DATA])]
    return []


class _Borrower(Lower):  # type: ignore[misc]
    """Translates a function that borrows its arguments: their caller holds them until it returns.

    numba counts a reference to each array among the arguments of a call, and to all that a tuple holds. Instructions
    that count lock the counter for other threads: they took a quarter of the time of a ramp in the plane.
    """

    _borrowed: frozenset[str] = frozenset()
    _borrows = False

    def setup_function(self, fndesc: Any) -> None:
        """Declare a function; records of different types among its arguments share no memory: kernels get no fields.

        What was read of one then stays known while another is written: 4 % of the time of a tick.
        """
        super().setup_function(fndesc)  # type: ignore[no-untyped-call]
        packer = self.call_conv._get_arg_packer(fndesc.argtypes)
        values = packer._unflattener.unflatten(self.call_conv.get_arguments(self.function))
        records = [each for pair in zip(fndesc.argtypes, values, strict=True) for each in _records_of(*pair)]
        count = Counter(kind for kind, _ in records)
        for kind, pointer in records:
            if count[kind] == 1:
                pointer.add_attribute("noalias")

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


def _resolve_once(resolve: Callable[..., Any]) -> Callable[..., Any]:
    """Remember the signature that numba finds for a function and the types of its arguments, as of a sum of floats.

    To try all candidates at each call took a tenth of the time.
    """
    known: dict[tuple[Any, ...], Any] = {}

    def look_up(function: Any, context: Any, args: Any, kws: Any) -> Any:
        if kws:
            return resolve(function, context, args, kws)
        call = function, context, args
        if call not in known:
            known[call] = resolve(function, context, args, kws)
        return known[call]

    return look_up


_Function: Any = types.functions.BaseFunction
_SHORTCUTS: tuple[tuple[Any, str, Any], ...] = (
    # numba describes the arguments anew in each pass: to list all fields of records took 7 % of the time
    (types.Record, "__repr__", functools.cache(types.Record.__repr__)),
    (_Function, "get_call_type", _resolve_once(_Function.get_call_type)),
    # calls of Python around each call of LLVM, which took a tenth of the time
    (llvm.ffi.lib._lock, "_cblist", []),
)
"""What stands in for parts of numba while a kernel is compiled: object, attribute and value."""


@contextmanager
def _shortcuts() -> Iterator[None]:
    """Let the shortcuts stand in for parts of numba, and look for garbage rarely; numba's lock keeps others waiting."""
    theirs = [getattr(owner, name) for owner, name, _ in _SHORTCUTS]
    threshold = gc.get_threshold()
    gc.set_threshold(_GARBAGE)
    for owner, name, ours in _SHORTCUTS:
        setattr(owner, name, ours)
    try:
        yield
    finally:
        gc.set_threshold(*threshold)
        for (owner, name, _), value in zip(_SHORTCUTS, theirs, strict=True):
            setattr(owner, name, value)


_HALF_DONE: list[TracebackType | None] = []


@contextmanager
def keeping_half_done() -> Iterator[None]:
    """Keep what an interrupt leaves half done: freeing a module that LLVM has just linked into another is a crash.

    llvmlite notes only after the call of LLVM that a module belongs to another object. Frames hold such modules; they
    are kept until the process exits, when llvmlite frees nothing.

    Yields:
        Nothing: around what may be interrupted.

    Raises:
        KeyboardInterrupt: when it is.
        SystemExit: likewise.
    """
    try:
        yield
    except (KeyboardInterrupt, SystemExit) as interrupt:
        _HALF_DONE.append(interrupt.__traceback__)
        raise


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
    "AnnotateTypes",
}
"""Passes for what no kernel contains: `with` blocks, closures, inlining before LLVM's, expressions of whole arrays. The
last one prepares a listing of types, which nothing reads."""


class Compiler(CompilerBase):  # type: ignore[misc]
    """The compiler of numba with two more passes, without idle ones, and with functions that borrow their arguments."""

    @keeping_half_done()
    def compile_extra(self, func: Any) -> Any:
        """Compile a function.

        Args:
            func: the function.

        Returns:
            What numba makes of it.
        """
        with _shortcuts():
            return super().compile_extra(func)  # type: ignore[no-untyped-call]

    def define_pipelines(self) -> list[Any]:
        """List the passes.

        Returns:
            The only pipeline.
        """
        passes: Any = DefaultPassBuilder.define_nopython_pipeline(self.state)  # type: ignore[no-untyped-call]
        passes.add_pass_after(_UnsignedIndices, NoPythonSupportedFeatureValidation)
        passes.add_pass_after(_ChooseLibrary, _UnsignedIndices)
        passes.passes = [
            (_Lowering if one is NativeLowering else one, text)
            for one, text in passes.passes
            if not (isinstance(one, type) and one.__name__ in _IDLE)
        ]
        passes.finalize()
        return [passes]
