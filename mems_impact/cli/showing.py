"""How numbers are shown: each with its unit, where the device is in SI."""

from __future__ import annotations

from collections.abc import Mapping

import click


def unit_of(heading: str) -> str:
    """Return the unit of a heading with a space before it; nothing if it has none.

    Examples
    --------
    >>> unit_of("amplitude [V]"), unit_of("amplitude")
    (' V', '')
    """
    _, _, unit = heading.partition(" [")
    return f" {unit.removesuffix(']')}" if unit else ""


def show_lines(lines: Mapping[str, str]) -> None:
    """Show one line a quantity, its heading before it."""
    width = max(map(len, lines))
    for heading, text in lines.items():
        click.echo(f"  {heading:<{width}}  {text}")
