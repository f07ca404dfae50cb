"""Kinds of values in C, and expressions of a kind."""

from __future__ import annotations

import math
import operator
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Scalar:
    """A number, or nothing."""

    ctype: str


REAL, INTEGER, BOOLEAN = Scalar("double"), Scalar("int64_t"), Scalar("bool")
NOTHING = Scalar("void")
RANKS = {BOOLEAN: 0, INTEGER: 1, REAL: 2}


@dataclass(frozen=True)
class Array:
    """A pointer to reals; `shape` has the known lengths, None if the only one is unknown."""

    shape: tuple[int, ...] | None = None

    @property
    def ctype(self) -> str:
        """The C type."""
        return "double *"

    @property
    def length(self) -> int | None:
        """The first length, if known."""
        return None if self.shape is None else self.shape[0]


@dataclass(frozen=True)
class Tuple:
    """A structure of the kinds of its items, with names for a named tuple."""

    items: tuple[Any, ...]
    names: tuple[str, ...] = ()

    @property
    def ctype(self) -> str:
        """The C type."""
        return "tuple_" + "".join(_mangled(item) for item in self.items)


@dataclass(frozen=True)
class Structure:
    """A pointer to a C structure with these scalar fields."""

    name: str
    fields: tuple[tuple[str, Scalar], ...]

    @property
    def ctype(self) -> str:
        """The C type."""
        return f"{self.name} *"


class Fixed:
    """A constant: a function, module, number, tuple or array of Python."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Fixed):
            return NotImplemented
        mine, yours = self.value, other.value
        if mine is yours:
            return True
        if type(mine) is not type(yours):
            return False
        if isinstance(mine, tuple):
            return len(mine) == len(yours) and all(
                map(operator.eq, map(Fixed, mine), map(Fixed, yours))
            )
        scalar_types = (bool, int, float, str)
        return isinstance(mine, scalar_types) and repr(mine) == repr(yours)  # 0.0 is not -0.0

    def __hash__(self) -> int:
        return hash(type(self.value))


Kind = Scalar | Array | Tuple | Structure | Fixed


def _mangled(kind: Any) -> str:
    if isinstance(kind, Scalar):
        return kind.ctype[0]
    if isinstance(kind, Array):
        return "a" + "x".join(map(str, kind.shape or ()))
    if isinstance(kind, Tuple):
        return f"t{len(kind.items)}" + "".join(_mangled(item) for item in kind.items)
    return "r" + kind.name if isinstance(kind, Structure) else "f"


@dataclass(frozen=True)
class Expression:
    """A C expression of a kind; the items of a tuple that is written out."""

    kind: Any
    code: str = ""
    items: tuple[Expression, ...] | None = None

    @property
    def fixed(self) -> bool:
        """Whether it is a constant."""
        return isinstance(self.kind, Fixed)


def constant(value: Any) -> Expression:
    """Return a constant."""
    return Expression(Fixed(value))


def literal(value: Any) -> str:
    """Return a number as C source."""
    if isinstance(value, bool | np.bool_):
        return "true" if value else "false"
    if isinstance(value, int | np.integer) and abs(int(value)) < 2**63:
        text = str(int(value))
        return _signed(f"INT64_C({text})" if abs(int(value)) >= 2**31 else text)
    number = float(value)
    if math.isnan(number):
        return "NAN"
    if math.isinf(number):
        return "INFINITY" if number > 0 else "(-INFINITY)"
    return _signed(repr(number))


def _signed(text: str) -> str:
    return f"({text})" if text.startswith("-") else text


def identifier(name: str) -> str:
    """Return a name as an identifier of C."""
    return "".join(c if c.isascii() and (c.isalnum() or c == "_") else f"u{ord(c):x}" for c in name)
