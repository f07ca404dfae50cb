"""Names and values in one-line messages and HTML."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

__all__ = ["html_table", "label", "shown"]

# What a message shows of a wrong value and of a name, in characters.
_LONGEST_VALUE = 60
_LONGEST_NAME = 300


def label(name: str) -> str:
    """Return a name as it stands, or quoted where it is empty or would break the line."""
    return _cut(name if name and name.isprintable() else repr(name), _LONGEST_NAME)


def shown(value: object) -> str:
    """Return a wrong value in a form that fits into a one-line message."""
    try:
        # str() of a NumPy number is the number alone, without its type.
        text = repr(value) if isinstance(value, str) else str(value)
    except (ValueError, RecursionError):
        # Python refuses to print integers of more than 4300 digits, and lists within lists.
        text = f"a huge {type(value).__name__}"
    if isinstance(value, float):
        text = text.removesuffix(".0")
    return _cut(" ".join(text.split()), _LONGEST_VALUE)


def _cut(text: str, longest: int) -> str:
    return text if len(text) <= longest else text[: longest - 1] + "…"


def html_table(caption: str, rows: Mapping[str, Any]) -> str:
    """Return names and values as HTML."""
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(str(name))}</th>"
        f"<td style='text-align:left'>{escape(_short(value))}</td></tr>"
        for name, value in rows.items()
    )
    return f"<table><caption>{escape(caption)}</caption>{cells}</table>"


def _short(value: Any) -> str:
    return f"{value:.9g}" if isinstance(value, float) else str(value)
