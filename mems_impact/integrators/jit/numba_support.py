"""Compilation by numba: options, pointers, and the cache on disk."""

from __future__ import annotations

import inspect
import itertools
import logging
import math
import re
import sys
from collections.abc import Callable, Iterable
from functools import cache
from pathlib import Path
from types import CodeType
from typing import Any

from llvmlite import ir
from llvmlite.binding import Linkage
from numba import config, njit, types
from numba.core.caching import NullCache
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.typing import Signature
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from mems_impact._util.garbage import pause_collection
from mems_impact.errors import EngineUnavailable, FileNotWritten, InvalidFile
from mems_impact.integrators.jit import machine_code

COPIES = "mems_impact.integrators.jit.closures"  # module of the copies of functions
CHECKED = "mems_impact.integrators.jit"  # module of those of users' functions

# --- Options and pointers

# Undocumented names of numba that `UnlinkedLibrary` uses.
USED = ("_raise_if_finalized", "_ensure_finalized", "_get_module_for_linking")

INLINED = 8000  # instructions, before optimization: functions that grow larger are called
_inlined: dict[str, int] = {}  # sizes of the others by their symbols


class UnlinkedLibrary(JITCodeLibrary):
    """The code of a function that only other compiled code calls.

    By default numba links, optimizes and translates every function by itself, and again within each
    caller. Here only the outermost function is, which halves the time of the first run.
    """

    largest: float = INLINED

    def add_ir_module(self, module: ir.Module) -> None:
        """Add a module; of its functions the large ones are called.

        Inlined into each caller, and these into theirs, they would grow exponentially. A rare case
        that does not end its function, such as a slice beyond an array, loses its weight: LLVM then
        selects a value without a branch, and finds equal expressions before and after it.
        """
        for function in module.functions:
            for block in function.blocks:
                end = block.terminator
                if "prof" in end.metadata and not isinstance(end.operands[1].terminator, ir.Ret):
                    del end.metadata["prof"]
            if function.blocks and "alwaysinline" in function.attributes:
                size = 0
                for each in itertools.chain(*(block.instructions for block in function.blocks)):
                    called = each.callee.name if isinstance(each, ir.CallInstr) else ""
                    size += 1 + _inlined.get(called, 0)
                if size > self.largest:
                    function.attributes.discard("alwaysinline")
                else:
                    _inlined[function.name] = size
        super().add_ir_module(module)

    def finalize(self) -> None:
        """Leave links, optimization and translation to the outermost function."""
        self._raise_if_finalized()
        for library in self._linking_libraries:
            if hasattr(library, "_reload_init"):  # of later versions
                self._reload_init.update(library._reload_init)
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.external:
                function.linkage = Linkage.linkonce_odr
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return the code of the function and of all functions that it calls.

        A function is linked only where code that calls it already is.
        """
        seen, order = {self}, []

        def visit(library: Any) -> None:
            called = library._linking_libraries if isinstance(library, UnlinkedLibrary) else ()
            for each in called:
                if each not in seen:
                    seen.add(each)
                    visit(each)
            order.append(library)

        visit(self)
        module = self._final_module.clone()
        for library in reversed(order[:-1]):
            is_part = isinstance(library, UnlinkedLibrary)
            part = library._final_module if is_part else library._get_module_for_linking()
            module.link_in(part, preserve=True)
        return module

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, since there is no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """Stand-in for the environment of the machine code."""
        return NoEnvironment


class NoEnvironment:
    """Stand-in for the environment of a function without machine code."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Do nothing."""


TANGENTS = re.compile(r"\bDual\((\d+)")  # in the names of types of dual numbers


# Passes of numba that leave a function of the package unchanged unless it has inner functions.
IDLE = {
    "WithLifting", "InlineClosureLikes", "MakeFunctionToJitFunction", "InlineInlinables",
    "FindLiterallyCalls", "LiteralUnroll", "LiteralPropagationSubPipelinePass", "InlineOverloads",
    "NopythonRewrites", "DumpParforDiagnostics",
}  # fmt: skip


class _PartCompiler(Compiler):
    def define_pipelines(self) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = UnlinkedLibrary(codegen, self.state.func_id.func_qualname)
        widths = map(int, TANGENTS.findall(str(self.state.args)))
        if max(widths, default=1) > 1:  # a call would pass the tangents over the stack
            self.state.library.largest = math.inf
        pipelines, function = super().define_pipelines(), self.state.func_id
        has_inner = any(isinstance(each, CodeType) for each in function.code.co_consts)
        if function.modname != CHECKED and not has_inner:
            for pipeline in pipelines:
                pipeline.passes = [each for each in pipeline.passes if each[0].__name__ not in IDLE]
        return pipelines


class _KernelCompiler(_PartCompiler):
    def define_pipelines(self) -> Any:
        pipelines = super().define_pipelines()
        self.state.flags.noalias = True
        self.state.library.largest = math.inf  # it has one caller
        return pipelines


# Compiled code owns no memory and does not raise, so it needs neither reference counts nor checks
# of divisors; inner functions need no entry from Python. Both reduce compile time.
JIT = {"_nrt": False, "error_model": "numpy"}
INNER: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
DISJOINT = INNER.copy()  # for arrays that do not overlap: no write changes what was read
# A version of numba with other internals uses its own compiler, which takes twice as long.
if all(hasattr(JITCodeLibrary, name) for name in USED):
    INNER["pipeline_class"] = _PartCompiler
    DISJOINT["pipeline_class"] = _KernelCompiler
# A C function is a wrapper that passes arrays over the stack and checks for errors, which takes a
# quarter of the time of a small function unless the function is inlined.
FOR_C = {**JIT, "forceinline": True}


def jit_disabled() -> bool:
    """Return whether the environment disables numba (NUMBA_DISABLE_JIT)."""
    return bool(config.DISABLE_JIT)


def check_numba() -> None:
    """Raise EngineUnavailable if numba is disabled."""
    if jit_disabled():
        remedy = "unset NUMBA_DISABLE_JIT, or use engine 'interpreted'"
        raise EngineUnavailable("NUMBA_DISABLE_JIT disables numba", remedy)


WORD = 8  # bytes of a double


def record_at(kind: Any) -> Any:
    """Return an intrinsic that converts an address to a record of type `kind`."""

    @intrinsic
    def view(_typing: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(kind))

        return kind(types.int64), codegen

    return view


VECTOR = types.Array(types.float64, 1, "C")
MATRIX = types.Array(types.float64, 2, "F")


def view(kind: Any, context: Any, builder: Any, data: Any, shape: list[Any]) -> Any:
    """Return an array of doubles at the address `data`, without ownership."""
    view = make_array(kind)(context, builder)
    word = ir.Constant(context.get_value_type(types.intp), WORD)
    strides, stride = [], word
    for size in shape if kind.layout == "F" else reversed(shape):
        strides.append(stride)
        stride = builder.mul(stride, size)
    populate_array(
        view,
        data=builder.inttoptr(data, view.data.type),
        shape=shape,
        strides=strides if kind.layout == "F" else strides[::-1],
        itemsize=word,
        meminfo=None,
    )
    return view._getvalue()


@intrinsic
def as_reals(_typing: Any, values: Any) -> Any:
    """Convert a tuple of numbers to one of doubles, or of numbers with tangents."""
    kinds = [each for each in values if not isinstance(each, types.Number | types.Boolean)]

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.cast(builder, args[0], values, signature.return_type)

    return types.UniTuple(kinds[0] if kinds else types.float64, len(values))(values), codegen


@intrinsic
def pointer(_typing: Any, address: Any) -> Any:
    """Convert an address to a pointer to double."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), codegen


@intrinsic
def integers(_typing: Any, address: Any) -> Any:
    """Convert an address to a pointer to int32."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], ir.IntType(32).as_pointer())

    return types.CPointer(types.int32)(types.int64), codegen


def caller(signature: Any) -> Any:
    """Return an intrinsic that calls a C function by address, with a tuple of arguments.

    Of arrays and pointers it passes the address.
    """

    @intrinsic
    def call(_typing: Any, function: Any, arguments: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            values = []
            for i, (argument_type, parameter_type) in enumerate(
                zip(arguments, signature.args, strict=True)
            ):
                value = builder.extract_value(args[1], i)
                if isinstance(argument_type, types.Array | types.CPointer):
                    values.append(_data(argument_type, context, builder, value))
                else:
                    values.append(context.cast(builder, value, argument_type, parameter_type))
            kinds = [context.get_value_type(kind) for kind in signature.args]
            is_void = signature.return_type == types.void
            return_type = (
                ir.VoidType() if is_void else context.get_value_type(signature.return_type)
            )
            pointer = ir.FunctionType(return_type, kinds).as_pointer()
            result = builder.call(builder.inttoptr(args[0], pointer), values)
            return context.get_dummy_value() if is_void else result

        return signature.return_type(types.int64, arguments), codegen

    return call


@intrinsic
def data(_typing: Any, vector: Any) -> Any:
    """Return the address of the data of an array, or a pointer or an address."""

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return _data(vector, context, builder, args[0])

    return types.int64(vector), codegen


def _data(vector: Any, context: Any, builder: Any, value: Any) -> Any:
    if isinstance(vector, types.Array):
        value = make_array(vector)(context, builder, value).data
    if isinstance(value.type, ir.IntType):
        return value
    return builder.ptrtoint(value, ir.IntType(64))


@intrinsic
def address(_typing: Any, handle: Any) -> Any:
    """Convert a HANDLE to its address."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.ptrtoint(args[0], ir.IntType(64))

    return types.int64(handle), codegen


# --- Compilation, and machine code on disk

_log = logging.getLogger("mems_impact")

LOOP_NOTICE = "compiling the event loop, some 10 s, once per installation"
SYSTEM_NOTICE = "compiling the functions of a system, some seconds"


class _Cache(NullCache):
    """Machine code of a function on disk, for numba.

    numba's own cache detects changes of the function's file and closure, but neither those of the
    dependencies of called functions nor damaged files. Code without a name is not kept.
    """

    def __init__(
        self, function: Callable[..., Any], name: str | None, library_only: bool = False
    ) -> None:
        self._function, self._name, self._library_only = function, name, library_only

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return compiled code of the installation or from the cache, or None.

        Only compilation requires numba's implementations of functions, so they are not imported
        here, unlike in numba's own method.
        """
        for file in self._files(sig):
            try:
                content = machine_code.read(file)
                if content is not None:
                    machine_code.touch(file)
                    if self._library_only:
                        return target_context.codegen().unserialize_library(content)
                    return CompileResult._rebuild(target_context, *content)
            except Exception as error:  # of another build of the same version of numba
                _log.info("compiled code in %s cannot be read (%s)", file, error)
        announce(SYSTEM_NOTICE if self._library_only else LOOP_NOTICE)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code if the folder is writable, as code of the installation if recorded."""
        library = data if self._library_only else data.library
        if self._name is None or library.has_dynamic_globals:
            return
        content = data.serialize_using_object_code() if self._library_only else data._reduce()
        is_shipped = machine_code.is_recording() and not self._library_only
        find = machine_code.recorded_file if is_shipped else machine_code.cache_file
        file = find(self._function, self._name, sig)
        if file is None:
            return
        try:
            machine_code.write(file, content)
            if not is_shipped:
                machine_code.prune(file.parent)
        except (OSError, InvalidFile, FileNotWritten) as error:
            _log.info("compiled code cannot be kept in %s (%s)", file.parent, error)

    def _files(self, sig: Any) -> list[Path]:
        """Return the files that may contain the code, the best first."""
        if self._name is None:
            return []
        key = self._function, self._name, sig
        shipped = [] if self._library_only else machine_code.shipped_files(*key)
        file = machine_code.cache_file(*key)
        return shipped if file is None else [*shipped, file]


def library_cache(name: str, lasting: bool) -> Any:
    """Return the cache of the code with a name, in which nothing is kept unless it is `lasting`."""

    def location() -> None:
        """Give the file its name."""

    location.__qualname__ = name
    return _Cache(location, name if lasting else None, library_only=True)


def compile_callback(
    function: Callable[..., Any], signature: Signature, name: str | None, **options: Any
) -> Any:
    """Compile `function` to a C function, with additional `options` of numba.

    `name` identifies the function and its dependencies in every process, so that compiled code is
    cached on disk; None if that is impossible.
    """
    compiled: Any = CFunc(
        function, (signature.args, signature.return_type), {}, {**FOR_C, **options}
    )
    compiled._cache = _Cache(function, name)
    with pause_collection():
        compiled.compile()
    return compiled


def compile_loop(
    function: Callable[..., Any], name: str | None, engine_at: Any
) -> Callable[..., Any]:
    """Compile `function` for the types of its arguments at the first call; it releases the GIL.

    The first argument of the result is an address, which `engine_at` converts to an engine: numba
    takes 2 us to find the type of a record. Other parameters are as in `compile_callback`.
    """
    # numba compiles a function for each set of options of its callers; with an inner function all
    # callers have the same options.
    space = {"inner": njit(**JIT, **INNER)(function), "engine_at": engine_at}
    # With named arguments, since a C function cannot take a tuple.
    first, *others = inspect.signature(function).parameters
    names, given = ", ".join([first, *others]), ", ".join([f"engine_at({first})", *others])
    exec(compile(f"def entry({names}):\n    return inner({given})", __file__, "exec"), space)
    entry: Any = space["entry"]
    entry.__qualname__ = function.__qualname__
    entry.__module__ = __name__
    compiled: Any = njit(nogil=True, **JIT)(entry)
    compiled._cache = _Cache(function, name)
    result: Callable[..., Any] = compiled
    return result


@cache
def announce(notice: str) -> None:
    """Announce compilation by a notice, once per process.

    The message goes to a terminal, or else to the log ``mems_impact``.
    """
    if notice == LOOP_NOTICE and machine_code.is_installed():
        notice += (
            "; the code compiled at installation is for other sources, or for another version of "
            "Python, numba or llvmlite"
        )
    _report(notice)


def announce_uncached(objects: Iterable[Any]) -> None:
    """Report that compiled code cannot be cached on disk because of `objects`."""
    kinds = ", ".join(sorted({type(each).__name__ for each in objects}))
    _report(
        "the compiled code of this system is not kept: its functions depend on objects that differ "
        f"between processes ({kinds}); use numbers in their place"
    )


def _report(text: str) -> None:
    if sys.stderr is not None and sys.stderr.isatty():
        sys.stderr.write(f"mems-impact: {text}\n")
    else:
        _log.info(text)
