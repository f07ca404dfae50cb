"""Conversion of objects to JSON and arrays, and back.

In JSON, numbers, strings, true, false and null represent themselves (Python writes the shortest
decimal that reads back as the same float), and a list represents a tuple. Any other value is an
object with one entry that names its kind, ``float`` (nan, inf, -inf), ``list``, ``dict``, ``table``
or ``array``, or with an entry ``is`` that holds the short name of a class, next to the parts of the
object. An array of more than `MAX_INLINE_NUMBERS` numbers is a separate member of the file,
referred to by name. A repeated object is a reference, ``same``, to the number ``#`` of its first
occurrence.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from itertools import count
from typing import Any

import numpy as np
import pandas as pd

from mems_impact.errors import InvalidParameter

MAX_INLINE_NUMBERS = 64  # of an array within the JSON text


Parts = Callable[[Any], Mapping[str, Any]]
Constructor = Callable[..., Any]


@dataclass(frozen=True)
class StorableClass:
    """Conversion of the objects of one class."""

    name: str
    parts: Parts
    constructor: Callable[[dict[str, Any], Reader], Any]


_by_type: dict[type, StorableClass] = {}
_by_name: dict[str, StorableClass] = {}


def register(
    kind: type,
    name: str = "",
    *,
    parts: Parts | None = None,
    constructor: Constructor | None = None,
    reading: Callable[[dict[str, Any], Reader], Any] | None = None,
) -> None:
    """Register a class whose objects can be stored, in the file by a short name.

    ``parts(value)`` returns the stored values by name; by default the items of a named tuple, or
    the fields of a dataclass that its class takes as arguments. ``constructor(**parts)`` restores
    the object, by default the class; ``reading(parts, reader)`` an object that depends on the file.
    """
    if parts is None:
        names = getattr(kind, "_fields", None) or [each.name for each in fields(kind) if each.init]
        parts = lambda value: {each: getattr(value, each) for each in names}  # noqa: E731
    make = constructor or kind
    typed = fields(kind) if is_dataclass(kind) and constructor is None else ()
    integers = [each.name for each in typed if each.type in ("int", int)]

    def restored(found: dict[str, Any], _: Reader) -> Any:
        for each in integers:
            if type(found.get(each, 0)) is not int:
                raise ValueError(f"{each} of {kind.__name__} is {found[each]!r}, no integer")
        return make(**found)

    entry = StorableClass(name or kind.__name__, parts, reading or restored)
    _by_type[kind] = _by_name[entry.name] = entry


class Writer:
    """Converts objects to JSON; large arrays are collected in `members`, by name."""

    def __init__(self) -> None:
        self.members: dict[str, np.ndarray] = {}
        self._known: dict[int, tuple[Any, dict[str, Any]]] = {}
        self._numbers: Iterator[int] = count(1)

    def node(self, value: Any, path: str) -> Any:
        """Return the JSON representation of `value`, which errors name by its path."""
        kind = _by_type.get(type(value))
        if kind is not None:
            return self._object(kind, value, path)
        if isinstance(value, np.generic):
            value = value.item()
        if value is None or isinstance(value, bool | int | str):
            return value
        if isinstance(value, float):
            return value if math.isfinite(value) else {"float": repr(value)}
        if isinstance(value, np.ndarray):
            return self._array(value, path)
        if isinstance(value, tuple):
            return [self.node(part, f"{path}.{i}") for i, part in enumerate(value)]
        if isinstance(value, list):
            return {"list": [self.node(part, f"{path}.{i}") for i, part in enumerate(value)]}
        if isinstance(value, Mapping):
            return {"dict": self._named(value, path)}
        if isinstance(value, pd.DataFrame):
            return {"table": self._columns(value, path), "attrs": self.node(value.attrs, path)}
        allowed = "of a storable class, or numbers, text, arrays and tables"
        raise InvalidParameter(path, type(value).__name__, allowed)

    def _named(self, items: Mapping[str, Any], path: str) -> dict[str, Any]:
        return {str(name): self.node(part, f"{path}.{name}") for name, part in items.items()}

    def _object(self, kind: StorableClass, value: Any, path: str) -> Any:
        if id(value) in self._known:
            node = self._known[id(value)][1]
            node.setdefault("#", next(self._numbers))
            return {"same": node["#"]}
        node = {"is": kind.name}
        self._known[id(value)] = value, node  # keep the value alive, so that its id stays unique
        node.update(self._named(kind.parts(value), path))
        return node

    def _array(self, value: np.ndarray, path: str) -> Any:
        if value.size > MAX_INLINE_NUMBERS:
            self.members[path] = value
            return {"array": path}
        numbers = value.ravel()
        if value.dtype.kind == "c":
            numbers = numbers.view(np.float64)
        listed = [self.node(number, path) for number in numbers.tolist()]
        return {"array": listed, "dtype": value.dtype.name, "shape": list(value.shape)}

    def _columns(self, table: pd.DataFrame, path: str) -> dict[str, Any]:
        columns = {}
        for name, column in table.items():
            if isinstance(column.dtype, pd.CategoricalDtype):
                codes = column.cat.codes.to_numpy().astype(np.int64)
                values: Any = {"codes": codes, "categories": tuple(column.cat.categories)}
            elif isinstance(column.dtype, pd.BooleanDtype):
                flags = tuple(None if pd.isna(each) else bool(each) for each in column)
                values = {"flags": flags}
            elif column.dtype.kind in "biufc":
                values = column.to_numpy()
            else:
                values = tuple(column)
            columns[str(name)] = self.node(values, f"{path}.{name}")
        return columns


class Reader:
    """Restores objects from the output of `Writer`.

    `path` is that of the file; a system given by the user takes the place of the systems of the
    file.
    """

    def __init__(self, members: Mapping[str, np.ndarray], path: str, system: Any = None) -> None:
        self.members, self.path, self.system = members, path, system
        self._known: dict[int, Any] = {}

    def value(self, node: Any) -> Any:
        """Return the object that a node represents."""
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
        raise ValueError(f"an object of {', '.join(node)}")

    def _object(self, node: dict[str, Any]) -> Any:
        if node["is"] not in _by_name:
            raise ValueError(f"it holds an object of unknown class {node['is']!r}")
        items = {name: self.value(part) for name, part in node.items() if name not in ("is", "#")}
        value = _by_name[node["is"]].constructor(items, self)
        if "#" in node:
            self._known[node["#"]] = value
        return value

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
            if isinstance(column, dict) and "flags" in column:
                column = pd.array(list(column["flags"]), dtype="boolean")
            elif isinstance(column, dict):
                column = pd.Categorical.from_codes(column["codes"], list(column["categories"]))
            elif isinstance(column, tuple):  # texts
                column = list(column) or np.empty(0, str)
            columns[name] = column
        table = pd.DataFrame(columns)
        table.attrs = self.value(node["attrs"])
        return table
