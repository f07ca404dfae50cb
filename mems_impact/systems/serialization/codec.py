"""Conversion of objects to JSON and arrays, and back.

In JSON, numbers, text, true, false and null stand for themselves (Python writes the shortest
decimal that is read as the very same float), and a list for a tuple. Everything else is an object
of one entry that says what it is, ``float`` (nan, inf, -inf), ``list``, ``dict``, ``table`` or
``array``, or of an entry ``is`` with the short name of a class, beside the parts of the object. An
array of more than `MAX_INLINE_NUMBERS` numbers is a member of the file by itself, whose name stands
there. An object that occurs again is a reference, ``same``, to the number ``#`` of the first one.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from itertools import count
from typing import Any

import numpy as np
import pandas as pd

from mems_impact.errors import InvalidParameter

__all__ = ["CorruptFile", "Reader", "Writer", "register"]

MAX_INLINE_NUMBERS = 64  # numbers of an array that stand in the JSON text itself


class CorruptFile(Exception):
    """What was read is not what `Writer` writes."""


Parts = Callable[[Any], Mapping[str, Any]]
Whole = Callable[..., Any]


@dataclass(frozen=True)
class StorableClass:
    """How the objects of one class are stored."""

    name: str
    parts: Parts
    whole: Callable[[dict[str, Any], Reader], Any]


_by_type: dict[type, StorableClass] = {}
_by_name: dict[str, StorableClass] = {}


def register(
    kind: type,
    name: str = "",
    *,
    parts: Parts | None = None,
    whole: Whole | None = None,
    reading: Callable[[dict[str, Any], Reader], Any] | None = None,
) -> None:
    """Let the objects of a class be stored.

    Parameters
    ----------
    kind : type
    name : str, optional
        Short name in the file; that of the class by default.
    parts : callable, optional
        ``parts(value)`` returns what it is made of, by name; the fields of a dataclass by default,
        or of a named tuple.
    whole : callable, optional
        ``whole(**parts)`` makes it again; the class by default.
    reading : callable, optional
        ``reading(parts, reader)`` instead, where it depends on the file.
    """
    if parts is None:
        names = getattr(kind, "_fields", None) or [each.name for each in fields(kind)]
        parts = lambda value: {each: getattr(value, each) for each in names}  # noqa: E731
    make = whole or kind
    entry = StorableClass(name or kind.__name__, parts, reading or (lambda found, _: make(**found)))
    _by_type[kind] = _by_name[entry.name] = entry


class Writer:
    """Turns objects into JSON; the larger arrays gather in `members`, by name."""

    def __init__(self) -> None:
        self.members: dict[str, np.ndarray] = {}
        self._known: dict[int, tuple[Any, dict[str, Any]]] = {}
        self._numbers: Iterator[int] = count(1)

    def node(self, value: Any, place: str) -> Any:
        """Return what stands for `value` in JSON; `place` names it."""
        kind = _by_type.get(type(value))
        if kind is not None:
            return self._object(kind, value, place)
        if isinstance(value, np.generic):
            value = value.item()
        if value is None or isinstance(value, bool | int | str):
            return value
        if isinstance(value, float):
            return value if math.isfinite(value) else {"float": repr(value)}
        if isinstance(value, np.ndarray):
            return self._array(value, place)
        if isinstance(value, tuple):
            return [self.node(part, f"{place}.{i}") for i, part in enumerate(value)]
        if isinstance(value, list):
            return {"list": [self.node(part, f"{place}.{i}") for i, part in enumerate(value)]}
        if isinstance(value, Mapping):
            return {"dict": self._named(value, place)}
        if isinstance(value, pd.DataFrame):
            return {"table": self._columns(value, place), "attrs": self.node(value.attrs, place)}
        allowed = "of a class that is stored, or numbers, text, arrays and tables"
        raise InvalidParameter(place, type(value).__name__, allowed)

    def _named(self, parts: Mapping[str, Any], place: str) -> dict[str, Any]:
        return {str(name): self.node(part, f"{place}.{name}") for name, part in parts.items()}

    def _object(self, kind: StorableClass, value: Any, place: str) -> Any:
        if id(value) in self._known:
            node = self._known[id(value)][1]
            node.setdefault("#", next(self._numbers))
            return {"same": node["#"]}
        node = {"is": kind.name}
        self._known[id(value)] = value, node  # the value too, lest its id be another's
        node.update(self._named(kind.parts(value), place))
        return node

    def _array(self, value: np.ndarray, place: str) -> Any:
        if value.size > MAX_INLINE_NUMBERS:
            self.members[place] = value
            return {"array": place}
        numbers = value.ravel()
        if value.dtype.kind == "c":
            numbers = numbers.view(np.float64)
        listed = [self.node(number, place) for number in numbers.tolist()]
        return {"array": listed, "dtype": value.dtype.name, "shape": list(value.shape)}

    def _columns(self, table: pd.DataFrame, place: str) -> dict[str, Any]:
        columns = {}
        for name, column in table.items():
            if isinstance(column.dtype, pd.CategoricalDtype):
                codes = column.cat.codes.to_numpy().astype(np.int64)
                values: Any = {"codes": codes, "categories": tuple(column.cat.categories)}
            elif column.dtype.kind in "biufc":
                values = column.to_numpy()
            else:
                values = tuple(column)
            columns[str(name)] = self.node(values, f"{place}.{name}")
        return columns


class Reader:
    """Turns what `Writer` wrote into objects again.

    Parameters
    ----------
    members : mapping of str to array
    path : str
        Of the file.
    system : System, optional
        What stands for the systems of the file, given by the user.
    """

    def __init__(self, members: Mapping[str, np.ndarray], path: str, system: Any = None) -> None:
        self.members, self.path, self.system = members, path, system
        self._known: dict[int, Any] = {}

    def value(self, node: Any) -> Any:
        """Return the object that a node stands for."""
        if isinstance(node, list):
            return tuple(self.value(part) for part in node)
        if not isinstance(node, dict):
            return node
        if "is" in node:
            return self._object(node)
        if "same" in node:
            return self._known[node["same"]]
        if "array" in node:
            return self._array(node)
        if "float" in node:
            return float(node["float"])
        if "list" in node:
            return [self.value(part) for part in node["list"]]
        if "dict" in node:
            return {name: self.value(part) for name, part in node["dict"].items()}
        if "table" in node:
            return self._table(node)
        raise CorruptFile(f"an object of {', '.join(node)}")

    def _object(self, node: dict[str, Any]) -> Any:
        if node["is"] not in _by_name:
            raise CorruptFile(f"it holds a {node['is']!r}, which is not known here")
        parts = {name: self.value(part) for name, part in node.items() if name not in ("is", "#")}
        found = _by_name[node["is"]].whole(parts, self)
        if "#" in node:
            self._known[node["#"]] = found
        return found

    def _array(self, node: dict[str, Any]) -> np.ndarray:
        listed = node["array"]
        if isinstance(listed, str):
            return self.members[listed]
        dtype = np.dtype(node["dtype"])
        if dtype.kind in "fc":
            numbers = [part if type(part) is float else self.value(part) for part in listed]
            return np.array(numbers, dtype=float).view(dtype).reshape(node["shape"])
        return np.array(listed, dtype=dtype).reshape(node["shape"])

    def _table(self, node: dict[str, Any]) -> pd.DataFrame:
        columns = {}
        for name, part in node["table"].items():
            column = self.value(part)
            if isinstance(column, dict):
                column = pd.Categorical.from_codes(column["codes"], list(column["categories"]))
            columns[name] = list(column) if isinstance(column, tuple) else column
        table = pd.DataFrame(columns)
        table.attrs = self.value(node["attrs"])
        return table
