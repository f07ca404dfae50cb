"""Compilation by numba: options, pointers, and the cache on disk."""

from __future__ import annotations

import inspect
import logging
import sys
from collections.abc import Callable, Iterable
from functools import cache
from typing import Any

from llvmlite import ir
from numba import config, njit, types
from numba.core.caching import FunctionCache, NullCache
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.typing import Signature
from numba.extending import intrinsic
from numba.np.arrayobj import make_array, populate_array

from mems_impact.errors import EngineUnavailable

# --- What compiling with numba needs beside numba: its options, and pointers.

# What `UnlinkedLibrary` uses of numba beside what is documented.
USED = ("_raise_if_finalized", "_ensure_finalized", "_get_module_for_linking")


class UnlinkedLibrary(JITCodeLibrary):
    """The code of a function that only other compiled code calls.

    numba optimizes and translates every function by itself, and then once more within each one that
    calls it. Here it is done where all are together: half the time of the first run.
    """

    def finalize(self) -> None:
        """Put together what this function calls, and leave it at that."""
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            if hasattr(library, "_reload_init"):  # of later versions
                self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0: there is no machine code."""
        self._ensure_finalized()
        return 0

    @property
    def codegen(self) -> Any:
        """What else is asked about machine code: a place for Python's objects in it."""
        return NoEnvironment


class NoEnvironment:
    """A place for Python's objects that there is not."""

    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Do nothing."""


class _PartCompiler(Compiler):
    def define_pipelines(self) -> Any:
        codegen = self.state.targetctx.codegen()
        self.state.library = UnlinkedLibrary(codegen, self.state.func_id.func_qualname)
        return super().define_pipelines()


# Nothing here owns memory or raises, so that compiled code needs neither reference counts nor
# checks of divisors; and what only compiled code calls needs no entry from Python: it compiles
# faster.
JIT = {"_nrt": False, "error_model": "numpy"}
INNER: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
# A numba that is built in another way compiles as it likes, and takes twice as long.
if all(hasattr(JITCodeLibrary, name) for name in USED):
    INNER["pipeline_class"] = _PartCompiler
# A C function is a wrapper around the function proper, whose arrays travel over the stack and whose
# errors are looked for: a quarter of the time of a small one, unless it is inlined.
FOR_C = {**JIT, "forceinline": True}


def jit_disabled() -> bool:
    """Return whether the environment keeps numba from compiling (NUMBA_DISABLE_JIT)."""
    return bool(config.DISABLE_JIT)


def check_numba() -> None:
    """Raise EngineUnavailable where numba may not compile."""
    if jit_disabled():
        remedy = "unset NUMBA_DISABLE_JIT, or use engine='interpreted'"
        raise EngineUnavailable("NUMBA_DISABLE_JIT keeps numba from compiling", remedy)


WORD = 8  # bytes of a double


def record_at(kind: Any) -> Any:
    """Return what turns an address into the record of type `kind` there, in compiled code."""

    @intrinsic
    def view(_typing: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return builder.inttoptr(args[0], context.get_value_type(kind))

        return kind(types.int64), codegen

    return view


def _view(kind: Any, context: Any, builder: Any, data: Any, shape: list[Any]) -> Any:
    """Return an array of doubles at the address `data`, which does not own them."""
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
def matrix(_typing: Any, address: Any, size: Any) -> Any:
    """Look at `size` x `size` doubles at `address`, stored by columns, as an array."""
    kind = types.Array(types.float64, 2, "F")

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return _view(kind, context, builder, args[0], [args[1], args[1]])

    return kind(types.int64, types.int64), codegen


@intrinsic
def array(_typing: Any, address: Any, size: Any) -> Any:
    """Look at `size` doubles at `address` as an array."""
    kind = types.Array(types.float64, 1, "C")

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return _view(kind, context, builder, args[0], [args[1]])

    return kind(types.int64, types.int64), codegen


@intrinsic
def pointer(_typing: Any, address: Any) -> Any:
    """Turn an address into a pointer to double."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.int64), codegen


@intrinsic
def integers(_typing: Any, address: Any) -> Any:
    """Turn an address into a pointer to int32."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], ir.IntType(32).as_pointer())

    return types.CPointer(types.int32)(types.int64), codegen


def caller(signature: Any) -> Any:
    """Return what calls a C function of `signature`, in compiled code: by address, with a tuple."""

    @intrinsic
    def call(_typing: Any, function: Any, arguments: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            values = [builder.extract_value(args[1], i) for i in range(len(signature.args))]
            kinds = [context.get_value_type(kind) for kind in signature.args]
            void = signature.return_type == types.void
            result = ir.VoidType() if void else context.get_value_type(signature.return_type)
            pointer = ir.FunctionType(result, kinds).as_pointer()
            answer = builder.call(builder.inttoptr(args[0], pointer), values)
            return context.get_dummy_value() if void else answer

        return signature.return_type(types.int64, types.Tuple(signature.args)), codegen

    return call


@intrinsic
def data(_typing: Any, vector: Any) -> Any:
    """Return the address of the numbers of an array, or of those that a pointer leads to."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        first = args[0]
        if isinstance(vector, types.Array):
            first = make_array(vector)(context, builder, first).data
        return builder.ptrtoint(first, ir.IntType(64))

    return types.int64(vector), codegen


@intrinsic
def address(_typing: Any, handle: Any) -> Any:
    """Turn a HANDLE into its address."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.ptrtoint(args[0], ir.IntType(64))

    return types.int64(handle), codegen


# --- Compiling, and numba's cache on disk under keys of our own.

_log = logging.getLogger("mems_impact")


class _Cache(FunctionCache):
    """A cache whose key is a name given, and which a bad file or directory does not stop.

    numba itself notices a change of the file in which a function stands and of its closure, not of
    what the functions draw on that it calls.
    """

    def __init__(self, function: Callable[..., Any], name: str) -> None:
        super().__init__(function)
        self._name_of_ours = name

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        return sig, codegen.magic_tuple(), self._name_of_ours

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return compiled code, or None where there is none that can be read."""
        try:
            found = super().load_overload(sig, target_context)
        except Exception as error:  # what unpickling half a file raises may be anything
            _log.info("compiled code in %s cannot be read (%s)", self.cache_path, error)
            found = None
            self._discard()
        if found is None:
            announce()
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled code if the directory lets us."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            _log.info("compiled code cannot be kept in %s (%s)", self.cache_path, error)

    def _discard(self) -> None:
        try:
            self.flush()
        except OSError as error:
            _log.info("%s cannot be written (%s)", self.cache_path, error)


class _NoCache(NullCache):
    def load_overload(self, sig: Any, target_context: Any) -> None:
        announce()


def _cache_of(function: Callable[..., Any], name: str | None) -> Any:
    if name is None:
        return _NoCache()
    try:
        return _Cache(function, name)
    except RuntimeError as error:  # no directory can be written
        _log.info("compiled code is not kept: %s", error)
        return _NoCache()


def compile_callback(
    function: Callable[..., Any], signature: Signature, name: str | None, **options: Any
) -> Any:
    """Compile `function` to a C function.

    Parameters
    ----------
    function : callable
    signature : numba signature
    name : str or None
        Names the function and all that it draws on, the same in every process; None if that can't
        be told. Compiled code that has a name is kept on disk.
    options
        Of numba, beside our own.
    """
    compiled: Any = CFunc(
        function, (signature.args, signature.return_type), {}, {**FOR_C, **options}
    )
    compiled._cache = _cache_of(function, name)
    compiled.compile()
    return compiled


def compile_loop(function: Callable[..., Any], name: str | None) -> Callable[..., Any]:
    """Have `function` compiled for what it is called with; it releases the GIL.

    The parameters are those of `compile_callback`.
    """
    # numba compiles a function anew for each set of options of its callers. So they are those of an
    # inner function from here on.
    space = {"inner": njit(**JIT, **INNER)(function)}
    # By name, not by star: as a C function it could not take a tuple.
    names = ", ".join(inspect.signature(function).parameters)
    exec(compile(f"def entry({names}):\n    return inner({names})", __file__, "exec"), space)
    entry: Any = space["entry"]
    entry.__qualname__ = function.__qualname__
    entry.__module__ = __name__
    compiled: Any = njit(nogil=True, **JIT)(entry)
    compiled._cache = _cache_of(function, name)
    result: Callable[..., Any] = compiled
    return result


@cache
def announce() -> None:
    """Announce the compilation, once per process.

    The message goes to a terminal, where somebody waits, or else to the log ``mems_impact``.
    """
    _say("compiling, about 7 s, once per installation and once per new system")


def announce_unkept(things: Iterable[Any]) -> None:
    """Say that compiled code cannot be kept on disk, since it draws on `things`."""
    kinds = ", ".join(sorted({type(thing).__name__ for thing in things}))
    _say(
        "the compiled code of this system is not kept: its functions draw on objects that are "
        f"others in every process ({kinds}); let them draw on numbers"
    )


def _say(text: str) -> None:
    if sys.stderr is not None and sys.stderr.isatty():
        sys.stderr.write(f"mems-impact: {text}\n")
    else:
        _log.info(text)
