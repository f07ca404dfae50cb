"""Snapshots of functions with all they refer to, and errors of their compilation.

numba builds into compiled code whatever a function reads from elsewhere: globals, variables that it
closes over, defaults, attributes of modules, and the functions that it calls, with what these read.
So the name of compiled code, on disk as within a process, must cover all of that, and where any of
it has changed, the functions must be compiled anew. `take_snapshot` reads it, every time that an
engine is made; a `Snapshot` says whether two readings are the same.
"""

from __future__ import annotations

import builtins
import hashlib
import operator
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from dis import get_instructions
from enum import Enum, EnumMeta
from functools import cache
from pathlib import Path
from types import BuiltinFunctionType, CellType, CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.core.dispatcher import Dispatcher
from numba.extending import overload

from mems_impact.integrators.jit.numba_support import INNER, JIT

__all__ = ["compiling"]

# --- Functions with all that they draw on, as they are at one instant: named, and frozen.

# numba has its own text for what these define, and their numbers do not change.
LIBRARIES = ("math", "numba", "numpy")

_registering = threading.Lock()  # numba's registries know nothing of threads

# Functions that numba can call already.
_overloaded: set[Callable[..., Any]] = set()


def mark_overloaded(*functions: Callable[..., Any]) -> None:
    """Say that `functions` have overloads of their own: they are taken as they are."""
    _overloaded.update(functions)


@dataclass(frozen=True)
class Snapshot:
    """What functions draw on, at one instant.

    Attributes
    ----------
    name : str
        A digest of the functions and all that they draw on, and of the engine's own sources. What
        has the same name compiles to the same code.
    lasting : bool
        Whether the name means the same in another process. It does not if a function draws on an
        object that can be told by its place in memory only.
    functions : tuple of callable
    """

    name: str
    lasting: bool
    functions: tuple[FunctionType, ...] = field(compare=False)
    _kept: tuple[Any, ...] = field(compare=False, repr=False)  # told by their place in memory

    @property
    def passing(self) -> tuple[Any, ...]:
        """What its functions draw on that is another object in every process."""
        return self._kept

    def frozen(self, **options: Any) -> list[Any]:
        """Return copies of the functions, and of all functions that they call, for numba.

        `options` are those of numba with which what they call is compiled, beside our own.

        Calls of plain Python functions are not compiled by numba unless it is told to. Doing so
        here keeps numba's decorators out of the equations. They are copies, since numba compiles a
        function once in a process, whatever happens to the numbers that it reads.
        """
        copier = _Copier(self.name, options)
        with _registering:
            return [copier.function(function) for function in self.functions]


# What was read for a snapshot: where, by which name, what.
_Reads = list[tuple[Callable[[str], Any], str, Any]]
# The last snapshot of some functions, with what was read for it as three columns, each thing once:
# every run of a compiled engine looks at all of them again, without a loop of Python's.
_Columns = tuple[tuple[Callable[[str], Any], ...], tuple[str, ...], tuple[Any, ...]]
_taken: dict[tuple[Callable[..., Any], ...], tuple[Snapshot, _Columns]] = {}


def take_snapshot(*functions: Callable[..., Any]) -> Snapshot:
    """Read what `functions` draw on, now."""
    if functions in _taken:
        snapshot, (gets, names, values) = _taken[functions]
        if all(map(operator.is_, map(operator.call, gets, names), values)):
            return snapshot
    reader = _Reader()
    reader.put(sources())
    plain = tuple(_plain(function) for function in functions)
    for function in plain:
        assert isinstance(function, FunctionType), function
        reader.value(function)
    snapshot = Snapshot(reader.name(), not reader.kept, plain, tuple(reader.kept))
    if not reader.arrays:  # whose contents may change, though they are the same objects
        once = {(get, name): value for get, name, value in reader.reads}
        gets, names = zip(*once, strict=True) if once else ((), ())
        _taken[functions] = snapshot, (gets, names, tuple(once.values()))
    return snapshot


def digest(*functions: Callable[..., Any]) -> str:
    """Return a digest of functions and all that they draw on, the engine's own sources left out."""
    reader = _Reader()
    for function in functions:
        reader.value(_plain(function))
    return reader.name()


@cache
def sources() -> str:
    """Return a digest of the sources of the engine and of the loop."""
    package = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256()
    for room in ("integrators", "hybrid"):
        for file in sorted((package / room).rglob("*.py")):
            digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def _plain(value: Any) -> Any:
    """Return the Python function within one that numba compiled; anything else as it is."""
    return value.py_func if isinstance(value, Dispatcher) else value


def _is_library(name: str | None) -> bool:
    return (name or "").partition(".")[0] in LIBRARIES


def _is_taken_as_it_is(function: FunctionType) -> bool:
    return function in _overloaded or _is_library(function.__module__)


@cache
def _names(code: CodeType) -> tuple[str, ...]:
    """Return all names of globals and of attributes in `code`, and in what is defined within."""
    inner = [name for part in code.co_consts if isinstance(part, CodeType) for name in _names(part)]
    return tuple(sorted({*code.co_names, *inner}))


@cache
def _global_names(code: CodeType) -> tuple[str, ...]:
    """Return the names of the globals that `code` reads, or what is defined within.

    Not those of attributes: ``p.e`` has nothing to do with a global ``e``.
    """
    inner = [
        name
        for part in code.co_consts
        if isinstance(part, CodeType)
        for name in _global_names(part)
    ]
    own = [step.argval for step in get_instructions(code) if step.opname == "LOAD_GLOBAL"]
    return tuple(sorted({*own, *inner}))


def _globals(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the globals that `function` may read."""
    for name in _global_names(function.__code__):
        if name in function.__globals__:
            yield name, function.__globals__[name]


def _attributes(module: ModuleType, names: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield the attributes among `names` that a module has."""
    for name in names:
        if hasattr(module, name):
            yield name, getattr(module, name)


def _contents(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the variables that `function` closes over; one not set yet reads as None."""
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            yield name, cell.cell_contents
        except ValueError:
            yield name, None


@cache
def _text(code: CodeType) -> bytes:
    """Return a digest of what `code` does, wherever it stands."""
    reader = _Reader()
    reader.put(code.co_code.hex(), code.co_names, code.co_varnames, code.co_freevars)
    reader.put(code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            reader.put(_text(constant))
        elif isinstance(constant, frozenset):
            reader.put(*sorted(map(repr, constant)))
        else:
            reader.value(constant)
    return reader.name().encode()


class _Reader:
    """A digest in the making. Every value goes in with its kind, so that 1 is not 1.0."""

    def __init__(self) -> None:
        self._digest = hashlib.sha256()
        self._numbers: dict[FunctionType, int] = {}
        self._inside: list[ModuleType] = []
        self.kept: list[Any] = []  # what can be told by its place in memory only
        self.arrays = False  # whether there were any
        self.reads: _Reads = []

    def name(self) -> str:
        return self._digest.hexdigest()[:32]

    def put(self, *parts: Any) -> None:
        self._digest.update(f"{parts!r};".encode())

    def value(self, value: Any, names: tuple[str, ...] = ()) -> None:
        """Take a value in; of a module, the attributes among `names`."""
        value = _plain(value)
        kind = f"{type(value).__module__}.{type(value).__qualname__}"
        if isinstance(value, FunctionType):
            self._function(value)
        elif isinstance(value, ModuleType):
            self._module(value, names)
        elif isinstance(value, Enum):
            self.put(kind, value.name)
            self.value(value.value)
        elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
            self.arrays = self.arrays or isinstance(value, np.ndarray | np.void)
            self.put(kind, str(value.dtype), value.shape, hashlib.sha256(value.tobytes()).digest())
        elif (
            value is None or value is ... or isinstance(value, int | float | complex | str | bytes)
        ):
            self.put(kind, value)
        elif isinstance(value, tuple):
            self.put(kind, getattr(value, "_fields", ()), len(value))
            for part in value:
                self.value(part)
        elif isinstance(value, type | BuiltinFunctionType | np.ufunc):
            self.put(kind, getattr(value, "__module__", ""), getattr(value, "__qualname__", ""))
            self.put(value.__name__, getattr(value, "_fields", ()))
            if isinstance(value, EnumMeta):
                self.value(tuple(value.__members__.values()))
        elif isinstance(value, types.Type):
            self.put(kind, str(value))
        else:
            # An object lives for as long as it is kept, and so nothing else gets its place.
            self.kept.append(value)
            self.put(kind, id(value))

    def _function(self, function: FunctionType) -> None:
        if function in self._numbers:
            self.put("again", self._numbers[function])
            return
        self._numbers[function] = len(self._numbers)
        if _is_taken_as_it_is(function):
            self.put(function.__module__, function.__qualname__)
            return
        names = _names(function.__code__)
        self.put(function.__qualname__, _text(function.__code__))
        for name in ("__code__", "__defaults__", "__kwdefaults__"):
            self.reads.append((function.__getattribute__, name, getattr(function, name)))
        scope, read = function.__globals__, _global_names(function.__code__)
        self.reads += [(scope.get, name, scope.get(name)) for name in read]
        for cell, (_, value) in zip(function.__closure__ or (), _contents(function), strict=True):
            if value is not None:
                self.reads.append((cell.__getattribute__, "cell_contents", value))
        for name, value in (*_contents(function), *_globals(function)):
            self.put(name)
            self.value(value, names)
        self.value(function.__defaults__)
        for name, value in sorted((function.__kwdefaults__ or {}).items()):
            self.put(name)
            self.value(value)

    def _module(self, module: ModuleType, names: tuple[str, ...]) -> None:
        self.put(module.__name__)
        if module in self._inside or _is_library(module.__name__):
            return
        self._inside.append(module)
        self.reads += [(vars(module).get, name, getattr(module, name, None)) for name in names]
        for name, value in _attributes(module, names):
            self.put(name)
            self.value(value, names)
        self._inside.pop()


class _Copier:
    """Copies of functions that no later change reaches.

    numba numbers the functions of a process to tell their symbols apart, and the numbers of two
    processes coincide. A process that loads the compiled code of both from the cache on disk would
    silently take the one for the other. So each copy has a name that nothing else has.
    """

    def __init__(self, name: str, options: dict[str, Any]) -> None:
        self._name = name
        self._options = {**JIT, **INNER, **options}
        self._copies: dict[FunctionType, FunctionType] = {}
        self._modules: dict[tuple[ModuleType, tuple[str, ...]], ModuleType] = {}

    def value(self, value: Any, names: tuple[str, ...]) -> Any:
        """Return a value with copies of all functions in it."""
        value = _plain(value)
        if isinstance(value, FunctionType):
            return self.function(value)
        if isinstance(value, ModuleType) and not _is_library(value.__name__):
            return self._module(value, names)
        if type(value) is tuple:
            parts = [self.value(part, names) for part in value]
            # numba calls functions out of a tuple only where they are compiled ones.
            return tuple(njit(**JIT)(p) if isinstance(p, FunctionType) else p for p in parts)
        return value

    def function(self, function: FunctionType) -> FunctionType:
        if _is_taken_as_it_is(function):
            return function
        if function in self._copies:
            return self._copies[function]
        code, names = function.__code__, _names(function.__code__)
        cells = tuple(CellType() for _ in function.__closure__ or ())
        # numba looks for the module of a function when it loads it again: this one it finds.
        space = {"__builtins__": builtins, "__name__": __name__}
        copy = FunctionType(code, space, function.__name__, function.__defaults__, cells)
        copy.__kwdefaults__ = function.__kwdefaults__
        copy.__module__ = __name__
        copy.__qualname__ = f"{function.__qualname__}_{self._name}_{len(self._copies)}"
        self._copies[function] = copy  # before what it reads: it may call itself
        for cell, (_, value) in zip(cells, _contents(function), strict=True):
            cell.cell_contents = self.value(value, names)
        for name, value in _globals(function):
            space[name] = self.value(value, names)
        overload(copy, jit_options=self._options, strict=False)(lambda *_, **__: copy)
        return copy

    def _module(self, module: ModuleType, names: tuple[str, ...]) -> ModuleType:
        key = (module, names)
        if key not in self._modules:
            self._modules[key] = copy = ModuleType(module.__name__)
            for name, value in _attributes(module, names):
                setattr(copy, name, self.value(value, names))
        return self._modules[key]


# --- Why numba cannot compile a function, in one sentence.

# numba's words for what it lacks where nothing may own memory, and ours.
_OWNING = ("NRT required", "Only accept returning of array", "NRT", "reflected list")
_PLACE = re.compile(r'File "(?P<a>[^"]+)", line (?P<i>\d+)|at (?P<b>\S+) \((?P<j>\d+)\)')
_FRAME = ("Failed in", "File ", "During", "raised from", ">>>", "There are", "- Of which")


class CompileOutcome(NamedTuple):
    """What became of compiling a function.

    Attributes
    ----------
    problem : str
        Why it cannot be compiled; empty if it can.
    line : int
        The line of the function's file where that is, 0 if numba does not tell.
    returned : numba type or None
        What it returns, where it can be compiled.
    """

    problem: str
    line: int = 0
    returned: Any = None


def compiling(function: Callable[..., Any], arguments: tuple[Any, ...]) -> CompileOutcome:
    """Compile a function by itself, for arguments of these types of numba's."""
    from numba import njit

    file = function.__code__.co_filename
    try:
        (frozen,) = take_snapshot(function).frozen()
        compiled = njit(**JIT)(frozen)
        compiled.compile(arguments)
    except Exception as error:  # numba raises what it likes
        message = str(error) or type(error).__name__
        return CompileOutcome(summarize_numba_error(message), _line(message, file))
    return CompileOutcome("", 0, compiled.overloads[arguments].signature.return_type)


def summarize_numba_error(message: str) -> str:
    """Return what numba's message says is wrong, without its pages of context.

    That is the innermost of its reports, which stands after the last of the headings.
    """
    if any(words in message for words in _OWNING):
        return "it makes a list, an array or a text while it runs"
    last = message.rpartition("Failed in nopython mode pipeline")[2].partition("\n")
    lines = [line.strip() for line in (last[2] or message).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(_FRAME)]
    text = (telling or lines or ["no reason given"])[0]
    text = re.sub(r"<function (\w+?)_[0-9a-f]{32}_\d+ at 0x[0-9a-f]+>", r"\1", text)
    return re.sub(r"_[0-9a-f]{32}_\d+", "", text)[:200].rstrip(" .")


def _line(message: str, file: str) -> int:
    """Return the first line of `file` that a message names: the innermost."""
    name = file.replace("\\", "/").rpartition("/")[2]
    for found in _PLACE.finditer(message):
        if (found["a"] or found["b"]).replace("\\", "/").rpartition("/")[2] == name:
            return int(found["i"] or found["j"])
    return 0
