"""Base classes of results."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import cache
from numbers import Number
from os import PathLike
from pathlib import Path
from types import FunctionType, MappingProxyType, UnionType
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mems_impact._util.files import replacing
from mems_impact._util.formatting import html_table
from mems_impact.errors import InvalidParameter, MemsImpactError
from mems_impact.hybrid.pickling import same_function
from mems_impact.tables import to_xarray

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

SAVED_TABLES_FIELD = "_attached"  # tables of a result loaded without its system's functions


def check_kind(value: object, field: str, kind: type | UnionType, allowed: str) -> None:
    """Raise InvalidParameter unless `value` is an instance of `kind`."""
    if not isinstance(value, kind):
        raise InvalidParameter(field, value, allowed)


class SummaryRepr:
    """A small table in notebooks; in Python one line, without the system."""

    _si_units: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Units of its numbers if its field `si` is true: those of a device in SI."""

    def summary(self) -> dict[str, Any]:
        """Return the main results by name, for a table: numbers and strings by default."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}  # type: ignore[arg-type]
        return {name: each for name, each in values.items() if isinstance(each, Number | str)}

    def __repr__(self) -> str:
        lines = (
            f"{name}={f'{value:.6g}' if isinstance(value, float) else repr(value)} "
            f"{self._si_unit(name)}".rstrip()
            for name, value in self.summary().items()
            if name not in ("si", "system")
        )
        return f"{type(self).__name__}({', '.join(lines)})"

    def _si_unit(self, name: str) -> str:
        return self._si_units.get(name, "") if getattr(self, "si", False) else ""

    def _repr_html_(self) -> str:
        rows = {
            f"{name} [{self._si_unit(name)}]" if self._si_unit(name) else name: value
            for name, value in self.summary().items()
            if name != "si"
        }
        return html_table(type(self).__name__, rows)


class Result(SummaryRepr):
    """Base class of results: comparison, copies and files.

    Two results are equal if they have the same class and equal systems, options and arrays. They
    have no hash, since arrays have none. A copy or a pickle holds the data of the result; its
    tables are computed again on access.
    """

    _stored: ClassVar[tuple[str, ...]] = ()
    """Attributes that need the system's functions, saved if a file cannot hold these."""

    def __eq__(self, other: object) -> bool:
        if type(self) is not type(other):
            return NotImplemented
        return _same_fields(self, other)

    __hash__ = None  # type: ignore[assignment]

    def __getstate__(self) -> dict[str, Any]:
        brought = vars(self).get(SAVED_TABLES_FIELD, ())
        return {
            **{each.name: getattr(self, each.name) for each in fields(self)},  # type: ignore[arg-type]
            **{name: vars(self)[name] for name in (*brought, SAVED_TABLES_FIELD) if brought},
        }

    def save(self, path: str | PathLike[str]) -> None:
        """Save the result in one file, to be loaded by `mems_impact.load`.

        The file is a zip archive of arrays (``.npy``) and one ``header.json``: all numbers exactly,
        the system's definition and options, versions. It names your own functions but does not
        contain them: see `mems_impact.load`.

        Parameters
        ----------
        path : str or os.PathLike
            An existing file is replaced once the new one is complete.

        Raises
        ------
        InvalidFile
            If `path` cannot be a file.
        FileNotWritten
            If the file cannot be written, for example because the disk is full.

        Examples
        --------
        >>> run.save("run.zip")
        >>> mi.load("run.zip") == run
        True
        """
        from mems_impact.systems.serialization.archive import save  # runs do not need it

        save(self, path)

    def tables(self) -> dict[str, pd.DataFrame]:
        """Return the tables of the result, by the names of the attributes that hold them.

        A table that the result does not have is omitted, such as the events of a run that kept
        none.
        """
        found: dict[str, pd.DataFrame] = {}
        kind: Any = type(self)
        for name in _table_names(kind):
            with suppress(MemsImpactError):
                found[name] = getattr(self, name)
        return {name: table for name, table in found.items() if table is not None}

    def to_xarray(self) -> xr.DataTree:
        """Return the tables as labelled arrays with units, one group per table."""
        groups = {name: to_xarray(table) for name, table in self.tables().items()}
        from xarray import DataTree

        return DataTree.from_dict(groups)

    def to_parquet(self, folder: str | PathLike[str]) -> None:
        """Write each table to a Parquet file in a folder, to be read by `pandas.read_parquet`.

        Units are in the ``attrs`` of the tables. The files are a view: `save` keeps the result.

        Parameters
        ----------
        folder : str or os.PathLike
            Made if it does not exist.
        """
        Path(folder).mkdir(parents=True, exist_ok=True)
        for name, table in self.tables().items():
            with replacing(Path(folder, f"{name}.parquet")) as path:
                table.to_parquet(path)

    def _attach(self, tables: Mapping[str, Any]) -> None:
        """Attach the saved tables, which cannot be computed without functions."""
        vars(self).update(tables)
        vars(self)[SAVED_TABLES_FIELD] = tuple(tables)


@cache
def _table_names(kind: Any) -> tuple[str, ...]:
    """Return the public attributes whose annotation is a DataFrame."""
    hints = {each.name: str(each.type) for each in fields(kind)}
    for name, member in inspect.getmembers_static(kind):
        getter = getattr(member, "fget", getattr(member, "func", None))
        if getter is not None:
            hints[name] = str(getattr(getter, "__annotations__", {}).get("return", ""))
    return tuple(n for n, hint in hints.items() if n[0] != "_" and hint.startswith("pd.DataFrame"))


def deep_equal(one: Any, other: Any) -> bool:
    """Return whether two values are deeply equal: arrays, numbers, functions."""
    if one is other:
        return True
    if isinstance(one, FunctionType) and isinstance(other, FunctionType):
        return same_function(one, other)
    if isinstance(one, Number) and isinstance(other, Number):
        return bool(one == other or (one != one and other != other))
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        numeric = one.dtype.kind in "fc" and other.dtype.kind in "fc"
        return np.array_equal(one, other, equal_nan=numeric)
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(
            deep_equal(one[name], other[name]) for name in one
        )
    if type(one) is not type(other):
        return False
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(map(deep_equal, one, other))
    if is_dataclass(one):
        return _same_fields(one, other)
    if hasattr(one, "equals"):  # a table, whose == is elementwise
        return bool(one.equals(other))
    return bool(one == other)


def _same_fields(one: Any, other: Any) -> bool:
    names = [each.name for each in fields(one) if each.compare]
    return all(deep_equal(getattr(one, name), getattr(other, name)) for name in names)
