"""How numbers are shown: each with its unit, where the device is in SI."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    import pandas as pd


def unit_of(table: pd.DataFrame, name: str) -> str:
    """Return the unit of a column with a space before it; nothing if it has none."""
    unit = table.attrs.get("units", {}).get(name, "")
    return f" {unit}" if unit else ""


def text_of(table: pd.DataFrame, digits: int) -> str:
    """Return a table as text, its units in the headings."""
    from mems_impact.tables.common import with_units

    return with_units(table).to_string(index=False, float_format=f"{{:.{digits}g}}".format)


def show_lines(lines: Mapping[str, str]) -> None:
    """Show one line a quantity, its heading before it."""
    width = max(map(len, lines))
    for heading, text in lines.items():
        click.echo(f"  {heading:<{width}}  {text}")
