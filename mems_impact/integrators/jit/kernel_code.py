"""C functions around compiled functions of an automaton, as LLVM instructions.

Every function of an automaton needs the same code around it: views of the arrays at the addresses,
the call, and the record of a fault. numba would compile this code from Python for each function,
which takes as long as the function itself, since every instruction in ``try`` and ``except`` is a
block of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, NamedTuple

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.compiler_lock import global_compiler_lock
from numba.core.errors import TypingError
from numba.core.registry import cpu_target

from mems_impact._util.garbage import pause_collection
from mems_impact.integrators.jit.closures import forget_copies
from mems_impact.integrators.jit.numba_support import (
    DISJOINT,
    JIT,
    MATRIX,
    VECTOR,
    WORD,
    library_cache,
    view,
)
from mems_impact.integrators.python_functions import HEAD

_WORD, _REAL = ir.IntType(64), ir.DoubleType()
# Common signature of all functions of an automaton, with arrays as addresses:
# kernel(mode, code, t, y, parameters, number of parameters, out) -> mode
KERNEL = ir.FunctionType(_WORD, [_WORD, _WORD, _REAL, _WORD, _WORD, _WORD, _WORD])


class KernelCode:
    """The body of a C function, to which each method adds instructions, of LLVM values."""

    def __init__(self, builder: ir.IRBuilder, function: Any) -> None:
        self._builder, self._function = builder, function
        self._context = cpu_target.target_context
        arguments = builder.function.args
        self.mode, self.code, self.t, self.y, self.parameters, self.size, self.out = arguments

    @staticmethod
    def count(value: int) -> ir.Constant:
        """Return an integer."""
        return ir.Constant(_WORD, value)

    def vector(self, address: Any, size: Any) -> Any:
        """Return `size` doubles at `address` as an array."""
        return view(VECTOR, self._context, self._builder, address, [size])

    def matrix(self, address: Any, size: int) -> Any:
        """Return `size` x `size` doubles at `address` as an array, stored by columns."""
        sizes = [self.count(size)] * 2
        return view(MATRIX, self._context, self._builder, address, sizes)

    def after(self, address: Any, size: Any) -> Any:
        """Return the address after `size` doubles at `address`."""
        return self._builder.add(address, self._builder.mul(size, self.count(WORD)))

    def scratch(self, size: int) -> Any:
        """Return the address of `size` doubles on the stack."""
        memory = cgutils.alloca_once(self._builder, _REAL, self.count(size))
        return self._builder.ptrtoint(memory, _WORD)

    def fill(self, address: Any, size: int, value: float) -> None:
        """Set `size` doubles at `address` to `value`."""
        pointer = self._pointer(address)
        with cgutils.for_range(self._builder, self.count(size), intp=_WORD) as loop:
            self._builder.store(ir.Constant(_REAL, value), self._builder.gep(pointer, [loop.index]))

    def copy(self, target: Any, source: Any, size: int) -> None:
        """Copy `size` doubles from one address to another."""
        pointers = self._pointer(target), self._pointer(source)
        cgutils.raw_memcpy(self._builder, *pointers, self.count(size), WORD)

    def is_first_fault(self) -> Any:
        """Return whether no fault is recorded after the parameters."""
        record = self._pointer(self.after(self.parameters, self.size))
        zero = ir.Constant(_REAL, 0.0)
        return self._builder.fcmp_ordered("==", self._builder.load(record), zero)

    def only_if(self, condition: Any, likely: bool = False) -> Any:
        """Return a context manager; instructions within it are executed under a condition."""
        return self._builder.if_then(condition, likely=likely)

    def record_fault(self, role: int, n: int) -> None:
        """Record a failed call after the parameters, if it is the first."""
        builder, record = self._builder, self.after(self.parameters, self.size)
        with self.only_if(self.is_first_fault()):
            head = [
                ir.Constant(_REAL, float(role)),
                builder.sitofp(self.mode, _REAL),
                builder.sitofp(self.code, _REAL),
                self.t,
            ]
            for i, value in enumerate(head):
                builder.store(value, builder.gep(self._pointer(record), [self.count(i)]))
            self.copy(self.after(record, self.count(HEAD)), self.y, n)

    @contextmanager
    def call(self, *arguments: Any) -> Iterator[None]:
        """Call the user's function; the instructions of the ``with`` are executed if it fails."""
        compiled = self._function
        self._status, self._result = self._context.call_internal_no_propagate(
            self._builder, compiled.fndesc, compiled.signature, arguments
        )
        with self.only_if(self._status.is_error):
            yield

    def is_fault(self) -> Any:
        """Return whether the user's function has failed for another reason than its domain."""
        return self._builder.not_(self._status.is_stop_iteration)

    def result(self, if_failed: int) -> Any:
        """Return the integer that the function has returned, or `if_failed`."""
        kind, typing = self._function.signature.return_type, cpu_target.typing_context
        if isinstance(kind, types.Optional) or typing.can_convert(kind, types.int64) is None:
            raise TypingError(f"{kind} is returned where an integer is required")
        value = self._context.cast(self._builder, self._result, kind, types.int64)
        return self._builder.select(self._status.is_error, self.count(if_failed), value)

    def either(self, if_failed: int, if_successful: int) -> Any:
        """Return one of two integers."""
        return self._builder.select(
            self._status.is_error, self.count(if_failed), self.count(if_successful)
        )

    def _pointer(self, address: Any) -> Any:
        return self._builder.inttoptr(address, _REAL.as_pointer())


class Kernel(NamedTuple):
    """A C function, with a reference to its machine code, which keeps the address valid."""

    address: int
    library: Any


def compile_kernel(
    function: Callable[[], Any],
    arguments: Sequence[Any],
    body: Callable[[KernelCode], Any],
    name: str,
    lasting: bool,
    boundscheck: bool,
) -> Kernel:
    """Compile a function of an automaton to a C function, or load it from the cache.

    `function` returns the function for numba, and is called unless the cache has the C function.
    ``body(code)`` writes the C function and returns its LLVM value. The symbol `name` identifies
    function, dependencies and `body`; the code is kept on disk if the name is `lasting`.
    """
    with global_compiler_lock, pause_collection():
        cache = library_cache(name, lasting)
        library = cache.load_overload(name, cpu_target.target_context)
        if library is None:
            try:
                library = _link(function(), tuple(arguments), body, name, boundscheck)
            except Exception:
                forget_copies()
                raise
            cache.save_overload(name, library)
        return Kernel(library.get_pointer_to_function(name), library)


@lru_cache(maxsize=64)
def _inline_function(function: Callable[..., Any], boundscheck: bool) -> Any:
    """Return the numba function, one for all sizes: its translation takes most of the time."""
    # The calling convention of an array is a quarter of the time of a small function.
    return njit(**JIT, **DISJOINT, forceinline=True, boundscheck=boundscheck)(function)


def _link(
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
    body: Callable[[KernelCode], Any],
    name: str,
    boundscheck: bool,
) -> Any:
    compiled = _inline_function(function, boundscheck)
    compiled.compile(arguments)
    result = compiled.overloads[arguments]
    library = cpu_target.target_context.codegen().create_library(name)
    library.enable_object_caching()
    module = library.create_ir_module(name)
    builder = ir.IRBuilder(ir.Function(module, KERNEL, name).append_basic_block())
    builder.ret(body(KernelCode(builder, result)))
    library.add_linking_library(result.library)
    library.add_ir_module(module)
    library.finalize()
    return library
