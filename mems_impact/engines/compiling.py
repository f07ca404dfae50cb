"""What compiling with numba needs beside numba: pointers, plain functions, a cache that notices.

numba's cache on disk notices a change of the file in which a compiled function stands, not of the
files that it draws on. So every compiled function of this package has a `fingerprint` of all
sources in its key: as a variable that it closes over, or in the type of an argument.
"""

from __future__ import annotations

import hashlib
import importlib.util
import inspect
import secrets
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array, populate_array

# Nothing here owns memory or raises, so that compiled code needs neither reference counts nor
# checks of divisors; and what only compiled code calls needs no entry from Python: it compiles
# faster.
JIT = {"_nrt": False, "error_model": "numpy"}
INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
# A C function is a wrapper around the function proper, whose arrays travel over the stack and whose
# errors are looked for: a quarter of the time of a small one, unless it is inlined.
FOR_C = {**JIT, "forceinline": True}

WORD = 8  # bytes of a double

# Functions that numba can call already.
_compilable: set[Callable[..., Any]] = set()
_registering = threading.RLock()  # two threads may come to the same function at once


def mark_compilable(*functions: Callable[..., Any]) -> None:
    """Say that `functions` have overloads of their own."""
    _compilable.update(functions)


def make_callees_compilable(function: Callable[..., Any], **options: Any) -> None:
    """Let numba compile every plain function that `function` draws on."""
    for callee in _callees(function):
        make_compilable(callee, **options)


def make_compilable(function: Callable[..., Any], **options: Any) -> None:
    """Let numba compile `function` and every plain function that it draws on, with `options`.

    Calls of plain Python functions are not compiled by numba unless it is told to. Doing so here,
    for whatever a function names, keeps numba's decorators out of the equations.
    """
    with _registering:
        if function in _compilable:
            return
        _compilable.add(function)
        make_callees_compilable(function, **options)
        own = _under_a_name_of_its_own(function)
        overload(function, jit_options={**JIT, **INNER, **options}, strict=False)(
            lambda *_, **__: own
        )


# numba numbers the functions of a process to tell their symbols apart. Two processes give the same
# number to different functions, and a third that loads the compiled code of both from the cache on
# disk would silently take the one for the other.
_PROCESS = secrets.token_hex(8)


def _under_a_name_of_its_own(function: Callable[..., Any]) -> FunctionType:
    """Return the same function under a name that no other process gives to anything."""
    assert isinstance(function, FunctionType), function
    cells = function.__closure__
    code, names = function.__code__, function.__globals__
    own = FunctionType(code, names, function.__name__, function.__defaults__, cells)
    own.__kwdefaults__ = function.__kwdefaults__
    own.__module__ = function.__module__
    own.__qualname__ = f"{function.__qualname__}_{_PROCESS}"
    return own


def identity(functions: Iterable[Callable[..., Any]]) -> str:
    """Name `functions`, with all that they draw on, the same in every process."""
    digest = hashlib.sha256()
    for function in _drawn_on(functions):
        values = [cell.cell_contents for cell in function.__closure__ or ()]
        values += [function.__defaults__ or (), *(function.__kwdefaults__ or {}).values()]
        numbers = [value for value in values if _is_plain(value)]
        code = function.__code__
        text = (
            code.co_code.hex(),
            [str(value) for value in code.co_consts if not inspect.iscode(value)],
        )
        name = (function.__module__, function.__qualname__, text, numbers)
        digest.update(f"{name};".encode())
    return digest.hexdigest()[:16]


def _drawn_on(functions: Iterable[Callable[..., Any]]) -> Iterator[FunctionType]:
    """Yield `functions` and all that they draw on, each once."""
    seen: set[FunctionType] = set()
    waiting = list(functions)
    while waiting:
        function = waiting.pop()
        assert isinstance(function, FunctionType), function
        if function not in seen:
            seen.add(function)
            waiting += _callees(function)
            yield function


def _is_plain(value: Any) -> bool:
    """Return whether `value` reads the same in every process."""
    if isinstance(value, tuple):
        return all(_is_plain(part) for part in value)
    return isinstance(value, int | float | str)


def _callees(function: Callable[..., Any]) -> list[FunctionType]:
    """Return the plain Python functions, outside libraries, that `function` names."""
    assert isinstance(function, FunctionType), function
    code = function.__code__
    cells = function.__closure__ or ()
    named = [function.__globals__.get(name) for name in code.co_names]
    named += [cell.cell_contents for cell in cells]
    for module in [value for value in named if inspect.ismodule(value)]:
        named += [getattr(module, name, None) for name in code.co_names]
    functions = [value for value in named if isinstance(value, FunctionType)]
    libraries = ("numpy", "numba", "math")
    return [f for f in functions if (f.__module__ or "").split(".")[0] not in libraries]


def fingerprint(functions: Iterable[Callable[..., Any]] = ()) -> int:
    """Hash the state of the engine, of the loop and of all files on which `functions` draw."""
    package = Path(__file__).resolve().parents[1]
    files = {*(package / "engines").rglob("*.py"), *(package / "hybrid").glob("*.py")}
    for function in _drawn_on(functions):
        source = Path(function.__code__.co_filename)
        if source.exists():
            files.add(source.resolve())
    digest = hashlib.sha256()
    for file in sorted(files):
        stat = file.stat()
        digest.update(f"{file.name}:{stat.st_size}:{stat.st_mtime_ns};".encode())
    return int.from_bytes(digest.digest()[:7], "big")


def cacheable(*functions: Callable[..., Any]) -> bool:
    """Return whether compiled code that draws on `functions` can be found again by a new process.

    numba's cache refers to functions by the name of their module, which must be importable.
    """
    for function in functions:
        name = function.__module__
        if name in ("__main__", "__mp_main__"):
            continue  # pickled by value
        if name not in sys.modules and importlib.util.find_spec(name) is None:
            return False
        module = sys.modules.get(name)
        if module is not None and getattr(module, "__spec__", None) is None:
            return False
    return True


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
