"""Snapshots of functions with their dependencies, and errors of their compilation.

Compiled code of numba contains the values of all dependencies of a function: globals, closure
variables, defaults, attributes of modules, and the functions that it calls, with their
dependencies. So the name of compiled code, on disk and within a process, must cover them all, and a
change of any of them requires compilation. `take_snapshot` reads the dependencies whenever an
engine is created; equal snapshots have the same compiled code.
"""

from __future__ import annotations

import builtins
import hashlib
import math
import operator
import re
import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from dis import EXTENDED_ARG, opmap
from enum import Enum, EnumMeta
from functools import cache, partial
from pathlib import Path
from types import BuiltinFunctionType, CellType, CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic
from numba.extending import overload

from mems_impact.integrators import dual_numbers, library
from mems_impact.integrators.jit import (
    trigonometry,
    unset_variables,  # noqa: F401  # registers a rewrite
)
from mems_impact.integrators.jit.numba_support import CHECKED, COPIES, INNER, JIT, as_reals

# --- Snapshots

# numba has its own implementations for these, and their constants do not change.
LIBRARIES = ("math", "numba", "numpy")

# Functions of compiled code by those of Python.
SUBSTITUTES = {**trigonometry.SUBSTITUTES, **library.FUNCTIONS}
UNTRUE = (type, hasattr)  # whose compiled results differ
SUBSTITUTED = (math, np)  # modules of these functions
BUILTINS = {float, *UNTRUE, *SUBSTITUTES}  # functions that are not among the globals
MIXED = (types.Tuple, types.NamedTuple)  # tuples over which numba does not iterate

LOAD_GLOBAL = opmap["LOAD_GLOBAL"]

_registration_lock = threading.Lock()  # numba's registries are not thread-safe

# Functions with overloads of their own.
_overloads: set[Callable[..., Any]] = {*trigonometry.SUBSTITUTES.values()}


def mark_overloaded(*functions: Callable[..., Any]) -> None:
    """Declare that `functions` have overloads of their own, and are not copied."""
    _overloads.update(functions)


@dataclass(frozen=True)
class Snapshot:
    """Functions and their dependencies at one instant.

    `name`, a digest of the functions with their dependencies and of the sources of the engine, is
    equal for equal compiled code. It is not valid in other processes (`lasting`) if a function
    depends on an object that is identified by its address only.
    """

    name: str
    lasting: bool
    functions: tuple[FunctionType, ...] = field(compare=False)
    _objects: tuple[Any, ...] = field(compare=False, repr=False)  # identified by address

    @property
    def volatile_dependencies(self) -> tuple[Any, ...]:
        """Dependencies that are different objects in every process."""
        return self._objects

    def frozen(self, **options: Any) -> list[Any]:
        """Return copies of the functions, and of all functions that they call, for numba.

        `options` are additional options of numba for the called functions.

        numba compiles calls of plain Python functions only after registration, which happens here,
        so that equations need no decorators. Copies are necessary because numba compiles a function
        once per process, even if its dependencies change. Snapshots with the same function, with
        the same dependencies, share its copy, so that numba compiles it once.
        """
        copier = Copier(**options)
        with _registration_lock:
            return [copier.function(function) for function in self.functions]


# Dependencies read for a snapshot: getter, name, value.
_Reads = list[tuple[Callable[[str], Any], str, Any]]
# The last snapshot of some functions, with its distinct dependencies as three columns, which every
# run of a compiled engine compares without a Python loop.
_Columns = tuple[tuple[Callable[[str], Any], ...], tuple[str, ...], tuple[Any, ...]]
_snapshots: dict[tuple[Callable[..., Any], ...], tuple[Snapshot, _Columns]] = {}


def take_snapshot(*functions: Callable[..., Any]) -> Snapshot:
    """Take a snapshot of `functions`."""
    if functions in _snapshots:
        snapshot, (getters, names, values) = _snapshots[functions]
        if all(map(operator.is_, map(operator.call, getters, names), values)):
            return snapshot
    reader = _Reader()
    reader.put(sources())
    originals = tuple(_python_function(function) for function in functions)
    for function in originals:
        assert isinstance(function, FunctionType), function
        reader.value(function)
    snapshot = Snapshot(reader.name(), not reader.objects, originals, tuple(reader.objects))
    if not reader.arrays:  # whose contents may change in place
        unique_reads = {(get, name): value for get, name, value in reader.reads}
        getters, names = zip(*unique_reads, strict=True) if unique_reads else ((), ())
        _snapshots[functions] = snapshot, (getters, names, tuple(unique_reads.values()))
    return snapshot


def digest(*functions: Callable[..., Any]) -> str:
    """Return a digest of functions with their dependencies, without the sources of the engine."""
    reader = _Reader()
    for function in functions:
        reader.value(_python_function(function))
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


def _python_function(value: Any) -> Any:
    """Return the Python function of a numba dispatcher; any other value unchanged."""
    return value.py_func if isinstance(value, Dispatcher) else value


def _is_library(name: str | None) -> bool:
    return (name or "").partition(".")[0] in LIBRARIES


def _is_own(function: FunctionType) -> bool:
    """Return whether a function is of the package, so that its integers are small."""
    module = function.__module__ or ""
    return module.partition(".")[0] == "mems_impact" and module != library.__name__


def _is_external(function: FunctionType) -> bool:
    return (
        function in _overloads
        or _is_library(function.__module__)
        or function.__module__ == dual_numbers.__name__
    )


@cache
def _names(code: CodeType) -> tuple[str, ...]:
    """Return all names of globals and attributes in `code` and its nested functions."""
    nested = [
        name
        for constant in code.co_consts
        if isinstance(constant, CodeType)
        for name in _names(constant)
    ]
    return tuple(sorted({*code.co_names, *nested}))


@cache
def _global_names(code: CodeType) -> tuple[str, ...]:
    """Return the names of the globals that `code` and its nested functions read.

    Attribute names are excluded: ``p.e`` does not read a global ``e``.
    """
    nested = [
        name
        for constant in code.co_consts
        if isinstance(constant, CodeType)
        for name in _global_names(constant)
    ]
    return tuple(sorted({*_names_of_globals(code), *nested}))


def _names_of_globals(code: CodeType) -> Iterator[str]:
    """Yield the names that LOAD_GLOBAL reads; `dis` takes ten times as long."""
    prefix = 0
    for operation, argument in zip(code.co_code[::2], code.co_code[1::2], strict=True):
        argument |= prefix << 8
        if operation == LOAD_GLOBAL:
            yield code.co_names[argument >> 1]  # the last bit requests a NULL on the stack
        prefix = argument if operation == EXTENDED_ARG else 0


def _globals(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the globals that `function` may read, and builtin functions with substitutes."""
    for name in _global_names(function.__code__):
        if name in function.__globals__:
            yield name, function.__globals__[name]
        elif getattr(builtins, name, None) in BUILTINS:
            yield name, getattr(builtins, name)


def _attributes(module: ModuleType, names: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    """Yield the attributes among `names` that a module has."""
    for name in names:
        if hasattr(module, name):
            yield name, getattr(module, name)


def _contents(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the closure variables of `function`."""
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, _content(cell)


def _content(cell: CellType, _name: str = "") -> Any:
    """Return the value of a closure variable; None for one that is not set yet."""
    try:
        return cell.cell_contents
    except ValueError:
        return None


@cache
def _code_digest(code: CodeType) -> bytes:
    """Return a digest of `code`, independent of its location."""
    reader = _Reader()
    reader.put(code.co_code.hex(), code.co_names, code.co_varnames, code.co_freevars)
    reader.put(code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            reader.put(_code_digest(constant))
        elif isinstance(constant, frozenset):
            reader.put(*sorted(map(repr, constant)))
        else:
            reader.value(constant)
    return reader.name().encode()


class _Reader:
    """Computes a digest. Values enter with their type, so that 1 and 1.0 differ."""

    def __init__(self) -> None:
        self._digest = hashlib.sha256()
        self._numbers: dict[FunctionType, int] = {}
        self._modules: list[ModuleType] = []
        self._containers: list[Any] = []  # mutable objects whose parts are being added
        self.objects: list[Any] = []  # objects identified by address only
        self.arrays = False  # whether arrays, lists or dicts are among the dependencies
        self.reads: _Reads = []

    def name(self) -> str:
        return self._digest.hexdigest()[:32]

    def put(self, *parts: Any) -> None:
        self._digest.update(f"{parts!r};".encode())

    def value(self, value: Any, names: tuple[str, ...] = ()) -> None:
        """Add a value to the digest; of a module, the attributes among `names`."""
        value = _python_function(value)
        kind = f"{type(value).__module__}.{type(value).__qualname__}"
        if isinstance(value, FunctionType):
            self._function(value)
        elif isinstance(value, _Intrinsic):
            self.put(kind)
            self._function(value._defn)
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
                self.value(part, names)
        elif isinstance(value, type | BuiltinFunctionType | np.ufunc):
            self.put(kind, getattr(value, "__module__", ""), getattr(value, "__qualname__", ""))
            self.put(value.__name__, getattr(value, "_fields", ()))
            if isinstance(value, EnumMeta):
                self.value(tuple(value.__members__.values()))
        elif isinstance(value, types.Type | ir.Type):
            self.put(kind, str(value))
        elif isinstance(value, list | dict):
            self.arrays = True
            self.put(kind, len(value))
            self._parts(value, value.items() if isinstance(value, dict) else value, names)
        else:
            # The reference keeps the object alive, so that its address stays unique.
            self.objects.append(value)
            self.put(kind, id(value))
            attributes = getattr(value, "__dict__", {})
            self._parts(
                value, [(name, attributes[name]) for name in names if name in attributes], names
            )

    def _parts(self, container: Any, parts: Iterable[Any], names: tuple[str, ...]) -> None:
        """Add the parts of a mutable object, which may contain itself."""
        if any(container is other for other in self._containers):
            return
        self._containers.append(container)
        for part in parts:
            self.value(part, names)
        self._containers.pop()

    def _function(self, function: FunctionType) -> None:
        if function in self._numbers:
            self.put("again", self._numbers[function])
            return
        self._numbers[function] = len(self._numbers)
        if _is_external(function):
            self.put(function.__module__, function.__qualname__)
            return
        names = _names(function.__code__)
        self.put(function.__qualname__, _code_digest(function.__code__))
        for name in ("__code__", "__defaults__", "__kwdefaults__"):
            self.reads.append((function.__getattribute__, name, getattr(function, name)))
        scope, global_names = function.__globals__, _global_names(function.__code__)
        self.reads += [(scope.get, name, scope.get(name)) for name in global_names]
        self.reads += [
            (partial(_content, cell), name, value)
            for cell, (name, value) in zip(
                function.__closure__ or (), _contents(function), strict=True
            )
        ]
        # These change in place.
        keywords = function.__kwdefaults__ or {}
        self.reads += [(keywords.get, name, value) for name, value in keywords.items()]
        for name, value in (*_contents(function), *_globals(function)):
            self.put(name)
            self.value(value, names)
        self.value(function.__defaults__)
        for name, value in sorted((function.__kwdefaults__ or {}).items()):
            self.put(name)
            self.value(value)

    def _module(self, module: ModuleType, names: tuple[str, ...]) -> None:
        self.put(module.__name__)
        if module in self._modules or _is_library(module.__name__):
            return
        self._modules.append(module)
        self.reads += [(vars(module).get, name, getattr(module, name, None)) for name in names]
        for name, value in _attributes(module, names):
            self.put(name)
            self.value(value, names)
        self._modules.pop()


# Copies of functions by digest and options of numba, with the objects that only an address
# identifies, which keeps these addresses unique.
_copies: dict[str, tuple[FunctionType, list[Any]]] = {}


def forget_copies() -> None:
    """Let later snapshots make new copies: numba keeps the error of one that it cannot compile."""
    with _registration_lock:
        _copies.clear()


class Copier:
    """Copies functions with all functions that they call, so that later changes do not affect them.

    numba distinguishes symbols by function numbers within a process, and the numbers of two
    processes coincide. A process that loads the compiled code of both from the cache on disk would
    silently confuse them. So the name of each copy contains a digest of its dependencies.
    """

    def __init__(self, **options: Any) -> None:
        self._options = {**JIT, **INNER, **options}
        self._label = repr(sorted(options.items()))
        self._copied: dict[FunctionType, FunctionType] = {}
        self._modules: dict[tuple[ModuleType, tuple[str, ...], bool], ModuleType] = {}

    def function(self, function: FunctionType) -> FunctionType:
        """Return the copy of a function."""
        if _is_external(function):
            return function
        if function not in self._copied:
            reader = _Reader()
            reader.put(sources(), self._label)
            reader.value(function)
            name = reader.name()
            if name not in _copies:
                _copies[name] = self._copy(function, name), reader.objects
            self._copied[function] = _copies[name][0]
        return self._copied[function]

    def _value(self, value: Any, names: tuple[str, ...], library: bool = False) -> Any:
        """Return a value with copies of all functions in it."""
        value = _python_function(value)
        if any(value is each for each in UNTRUE):
            raise TypeError(f"No implementation of function Function({value!r})")
        if isinstance(value, BuiltinFunctionType | type | np.ufunc) and not library:
            value = SUBSTITUTES.get(value, value)
        if isinstance(value, FunctionType):
            return self.function(value)
        if isinstance(value, ModuleType):
            is_copied = value in SUBSTITUTED or not _is_library(value.__name__)
            return self._module(value, names, library) if is_copied else value
        if type(value) is tuple:
            parts = (self._value(part, names, library) for part in value)
            # numba calls functions in a tuple only if they are compiled.
            return tuple(
                njit(**JIT)(part) if isinstance(part, FunctionType) else part for part in parts
            )
        return value

    def _copy(self, function: FunctionType, name: str) -> FunctionType:
        names = _names(function.__code__)
        cells = tuple(CellType() for _ in function.__closure__ or ())
        # numba imports the module of a function when it loads it from the cache.
        space = {"__builtins__": builtins, "__name__": __name__}
        is_of_library = function.__module__ == library.__name__
        code, defaults = _without_keyword_only(function)
        copy = FunctionType(code, space, function.__name__, defaults, cells)
        copy.__module__ = COPIES if _is_own(function) else CHECKED
        copy.__qualname__ = f"{function.__qualname__}_{name}"
        self._copied[function] = copy  # before its dependencies, since it may be recursive
        for cell, (_, value) in zip(cells, _contents(function), strict=True):
            cell.cell_contents = self._value(value, names)
        for name, value in _globals(function):
            # The functions of `library` call those of numba.
            stays = is_of_library and not isinstance(value, FunctionType)
            space[name] = value if stays else self._value(value, names, is_of_library)

        @overload(copy, jit_options=self._options, strict=False)
        def implementation(*kinds: Any, **_: Any) -> Any:
            if is_of_library and type(next(iter(kinds), None)) in MIXED:
                return lambda values, *rest: copy(as_reals(values), *rest)
            return copy

        return copy

    def _module(self, module: ModuleType, names: tuple[str, ...], library: bool) -> ModuleType:
        key = (module, names, library)
        if key not in self._modules:
            self._modules[key] = copy = ModuleType(module.__name__)
            for name, value in _attributes(module, names):
                setattr(copy, name, self._value(value, names, library))
        return self._modules[key]


def _without_keyword_only(function: FunctionType) -> tuple[CodeType, tuple[Any, ...] | None]:
    """Return code and defaults with ordinary arguments for keyword-only ones, unknown to numba."""
    code, defaults = function.__code__, function.__defaults__
    count, keyword_count = code.co_argcount, code.co_kwonlyargcount
    if keyword_count == 0:
        return code, defaults
    keyword_defaults = function.__kwdefaults__ or {}
    # An argument that every call gives may follow arguments with defaults; None does not compile.
    extra_defaults = tuple(
        keyword_defaults.get(name) for name in code.co_varnames[count : count + keyword_count]
    )
    code = code.replace(co_argcount=count + keyword_count, co_kwonlyargcount=0)
    return code, (*(defaults or ()), *extra_defaults)


# --- Errors of numba

# Messages of numba, and their meaning.
_WITHOUT = "has no compiled form"
_REASONS = (
    (r"Untyped global name '(\w+)'.*<class '(?:.*\.)?(\w+)'>", "it reads {0}, of type {1}"),
    (r"\(List\(.*\n.* = freevar\((\w+): ", "it reads {0}, of type list"),
    (r"reflected (\w+)\(.* to variable '(\w+)' in globals", "it reads {1}, of type {0}"),
    (r"(it has an integer beyond 64 bits among integers)", "{0}"),
    (
        r"NRT|Only accept returning of array|reflected list",
        "it creates a list, an array or a string at run time",
    ),
    (r"yield in a closure", "it has a generator expression in place of a loop"),
    (r"exception_match|unsupported opcode", f"it has a statement that {_WITHOUT}"),
    (r"resolve_getattr", f"it reads an attribute that {_WITHOUT}"),
    (r"Type of variable '", "the type of a value cannot be determined"),
    (r"getiter", "it loops over a value that is no range, array or tuple of numbers"),
    (
        r"No implementation of function Function\(<(?:built-in |function |class |ufunc )*'?(\w+)",
        f"{{0}} {_WITHOUT} for these arguments",
    ),
    (r"Unknown attribute '(\w+)' of type Module\(<module '([\w.]+)'", f"{{1}}.{{0}} {_WITHOUT}"),
    (r"Unknown attribute '(\w+)'", "it reads the attribute '{0}' of a value without it"),
    (r"NumPy function '([\w.]+)'", f"{{0}} {_WITHOUT}"),
    (r"Cannot unify", "a variable or a result has values of several types"),
    (r"", f"it has an expression that {_WITHOUT}"),
)
_LOCATION = re.compile(r'File "(?P<a>[^"]+)", line (?P<i>\d+)|at (?P<b>\S+) \((?P<j>\d+)\)')


class CompileOutcome(NamedTuple):
    """Result of compiling a function."""

    problem: str  # why the function cannot be compiled, or ""
    line: int = 0  # of the error in the function's file, 0 if unknown
    returned: Any = None  # numba's type of the returned value


def try_compile(function: Callable[..., Any], arguments: tuple[Any, ...]) -> CompileOutcome:
    """Compile a single function for arguments of the given numba types."""
    file = function.__code__.co_filename
    forget_copies()  # which may be of an equal function at another line
    try:
        (copy,) = take_snapshot(function).frozen()
        dispatcher = njit(**JIT)(copy)
        dispatcher.compile(arguments)
    except Exception as error:  # numba raises various exceptions
        message = str(error) or type(error).__name__
        return CompileOutcome(summarize_numba_error(message), _line(message, file))
    return CompileOutcome("", 0, dispatcher.overloads[arguments].signature.return_type)


def compiled_exception(
    function: Callable[..., Any], arguments: tuple[Any, ...]
) -> Exception | None:
    """Return the exception that a compiled function raises, or None."""
    (copy,) = take_snapshot(function).frozen()
    try:
        njit(**JIT)(copy)(*arguments)
    except Exception as error:
        return error
    return None


def summarize_numba_error(message: str) -> str:
    """Return the problem in numba's message, in words of Python."""
    message = re.sub(r"_[0-9a-f]{32}", "", message)
    innermost = message.rpartition("Failed in nopython mode pipeline")[2]
    matches = (
        (reason, re.search(pattern, innermost) or re.search(pattern, message))
        for pattern, reason in _REASONS
    )
    return next(reason.format(*match.groups()) for reason, match in matches if match)


def _line(message: str, file: str) -> int:
    """Return the first (innermost) line of `file` in a message."""
    name = file.replace("\\", "/").rpartition("/")[2]
    for match in _LOCATION.finditer(message):
        if (match["a"] or match["b"]).replace("\\", "/").rpartition("/")[2] == name:
            return int(match["i"] or match["j"])
    return 0
