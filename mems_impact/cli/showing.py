"""What a command shows: text for people, or one JSON document for programs.

Commands show everything through this. With ``--json`` it is gathered and comes as one document at
the end: ``values`` and ``units`` by name, ``tables`` (each with ``units`` by column and ``rows``,
whose keys are the columns), and the ``files`` that were written. A number that is none (nan,
infinite) is null.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from mems_impact.cli.everywhere import as_json, quiet

if TYPE_CHECKING:
    import pandas as pd

_KEY = "mems_impact.document"


class Told(NamedTuple):
    """One line that a command shows.

    Attributes
    ----------
    value : object
        A number, a text, or a list of them.
    unit : str
        Empty for a pure number.
    text : str, optional
        The value in words, where it is not the number alone.
    """

    value: Any
    unit: str = ""
    text: str | None = None


@dataclass
class Document:
    """What a command has found, for programs."""

    values: dict[str, Any] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    tables: dict[str, Any] = field(default_factory=dict)
    files: list[str] = field(default_factory=list)


def _document() -> Document:
    found: Document = click.get_current_context().meta.setdefault(_KEY, Document())
    return found


def unit_of(table: pd.DataFrame, name: str) -> str:
    """Return the unit of a column with a space before it; nothing if it has none."""
    unit = table.attrs.get("units", {}).get(name, "")
    return f" {unit}" if unit else ""


def with_units_in(table: pd.DataFrame, column: str, units: Mapping[str, str]) -> pd.DataFrame:
    """Return a table in whose column names carry their units: ``omega [rad/s]``."""
    names = [f"{name} [{units[name]}]" if units.get(name) else name for name in table[column]]
    result = table.assign(**{column: names})
    result.attrs = table.attrs
    return result


def with_unit_column(table: pd.DataFrame, column: str, units: Mapping[str, str]) -> pd.DataFrame:
    """Return a table for files and programs, with the unit of what a row's column names.

    Where nothing has a unit, it is returned as it is.
    """
    if not units:
        return table
    result = table.assign(unit=[units.get(name, "") for name in table[column]])
    result.attrs = table.attrs
    return result


def show(text: str) -> None:
    """Show a text, which tells nothing that values and tables do not."""
    if not as_json() and not quiet():
        click.echo(text)


def show_text(text: str) -> None:
    """Show a long text, page by page on a terminal."""
    tell_values({"text": Told(text)})
    if not as_json() and not quiet():
        click.echo_via_pager(text)


def show_table(name: str, table: pd.DataFrame, digits: int, *, empty: str = "") -> None:
    """Show a table with its units in the headings, or the text `empty` if it has no row."""
    if as_json():
        tell_tables({name: table})
        return
    from mems_impact.tables.common import with_units

    form = f"{{:.{digits}g}}".format
    shown = with_units(table).to_string(index=False, float_format=form) if len(table) else empty
    if shown:
        show(shown + "\n")


def show_values(values: Mapping[str, Told], *, named: bool = True) -> None:
    """Show one line a value, its name and unit before it.

    Where everything is a pure number (`named` is False), units are left out.
    """
    if not named:
        values = {name: told._replace(unit="") for name, told in values.items()}
    tell_values(values)
    headings = [f"{name} [{told.unit}]" if told.unit else name for name, told in values.items()]
    width = max(map(len, headings))
    for heading, told in zip(headings, values.values(), strict=True):
        text = told.text
        if text is None:
            text = f"{told.value:.9g}" if isinstance(told.value, float) else str(told.value)
        show(f"  {heading:<{width}}  {text}")


def tell_values(values: Mapping[str, Told]) -> None:
    """Tell programs of values that people read otherwise."""
    if as_json():
        _document().values |= {name: told.value for name, told in values.items()}
        _document().units |= {name: told.unit for name, told in values.items() if told.unit}


def tell_tables(tables: Mapping[str, pd.DataFrame]) -> None:
    """Tell programs of tables; one that was told already is what it was."""
    if as_json():
        for name, table in tables.items():
            _document().tables.setdefault(name, table)


def tell_files(files: Iterable[object]) -> None:
    """Tell programs which files were written."""
    if as_json():
        _document().files += map(str, files)


def finish(ctx: click.Context) -> None:
    """Show the document of a command that has done its work, if it is to show one."""
    if not as_json():
        return
    found: Document | None = ctx.meta.get(_KEY)
    if found is not None:
        tables = {name: _of_table(table) for name, table in found.tables.items()}
        told = {"command": ctx.invoked_subcommand, **vars(found), "tables": tables}
        click.echo(json.dumps(_plain(told), ensure_ascii=False, allow_nan=False))


def _of_table(table: pd.DataFrame) -> dict[str, Any]:
    names = [str(name) for name in table.columns]
    columns = [table[name].tolist() for name in table.columns]
    rows = [dict(zip(names, row, strict=True)) for row in zip(*columns, strict=True)]
    return {"units": table.attrs.get("units", {}), "rows": rows}


def _plain(value: Any) -> Any:
    """Return a value as JSON knows it."""
    match value:
        case None | bool() | int():
            return value
        case str():
            return str(value)
        case float():
            return value if math.isfinite(value) else None
        case complex():
            return {"re": _plain(value.real), "im": _plain(value.imag)}
        case Mapping():
            return {str(name): _plain(each) for name, each in value.items()}
        case list() | tuple():
            return [_plain(each) for each in value]
    if hasattr(value, "tolist"):  # of NumPy
        return _plain(value.tolist())
    return str(value)
