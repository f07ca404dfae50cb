"""Copies of Python functions that call other elementary functions."""

from __future__ import annotations

import builtins
import math
from collections.abc import Callable
from types import BuiltinFunctionType, CellType, FunctionType, ModuleType
from typing import Any

import numpy as np

from mems_impact.integrators import library

LIBRARIES = ("math", "numba", "numpy")  # modules whose functions written in Python stay
SUBSTITUTED = (math, np)  # modules of the elementary functions


class Substitution:
    """Copies functions, and all functions that they call, with other elementary functions.

    `functions` and `of_library` give the function of the copies for each of Python's and of
    `mems_impact.integrators.library`; functions of the module `kept` are not copied. A copy reads
    the globals of its original, so that a change of any of them has its effect.
    """

    def __init__(
        self, functions: dict[Any, Any], of_library: dict[Any, Any], kept: str = ""
    ) -> None:
        self._functions, self._of_library = functions, of_library
        self._kept = (*LIBRARIES, kept)
        self._copies: dict[Any, tuple[FunctionType, list[Any]]] = {}
        self._modules: dict[Any, _Module] = {}

    def function(self, function: Any) -> Any:
        """Return the copy of a function."""
        function = getattr(function, "py_func", function)  # of one that numba compiled
        if not isinstance(function, FunctionType) or self._stays(function.__module__):
            return function
        contents = list(map(_content, function.__closure__ or ()))
        copy, last = self._copies.get(function, (None, []))
        code, defaults = function.__code__, function.__defaults__
        if copy and copy.__code__ is code and all(a is b for a, b in zip(contents, last)):  # noqa: B905
            return copy
        table = self._of_library if function.__module__ == library.__name__ else self._functions
        cells = tuple(CellType() for _ in contents)
        scope = _Scope(function.__globals__, lambda value: self._value(value, table))
        copy = FunctionType(code, scope, function.__name__, defaults, cells)
        copy.__kwdefaults__, copy.__module__ = function.__kwdefaults__, function.__module__
        self._copies[function] = copy, contents  # before its contents, since it may be recursive
        for cell, value in zip(cells, contents, strict=True):
            cell.cell_contents = self._value(value, table)
        return copy

    def _stays(self, module: str | None) -> bool:
        return module in self._kept or (module or "").partition(".")[0] in LIBRARIES

    def _value(self, value: Any, table: dict[Any, Any]) -> Any:
        """Return a value with copies of all functions in it."""
        if isinstance(value, BuiltinFunctionType | type | np.ufunc):
            value = table.get(value, value)
        if isinstance(value, FunctionType):
            return self.function(value)
        if isinstance(value, ModuleType):
            if value not in SUBSTITUTED and self._stays(value.__name__):
                return value
            key = value, id(table)
            if key not in self._modules:
                self._modules[key] = _Module(value, lambda each: self._value(each, table))
            return self._modules[key]
        if type(value) is tuple:
            return tuple(self._value(each, table) for each in value)
        return self.function(value) if hasattr(value, "py_func") else value


class _Scope(dict[str, Any]):
    """The globals of a copy."""

    def __init__(self, names: dict[str, Any], convert: Callable[[Any], Any]) -> None:
        super().__init__()
        self._names, self._convert = names, convert

    def __getitem__(self, name: str) -> Any:
        names = self._names if name in self._names else vars(builtins)
        return self._convert(names[name])


class _Module:
    """A module as the globals of a copy have it."""

    def __init__(self, module: ModuleType, convert: Callable[[Any], Any]) -> None:
        self._module, self._convert = module, convert

    def __getattr__(self, name: str) -> Any:
        return self._convert(getattr(self._module, name))


def _content(cell: CellType) -> Any:
    """Return the value of a closure variable; None for one that is not set yet."""
    try:
        return cell.cell_contents
    except ValueError:
        return None
