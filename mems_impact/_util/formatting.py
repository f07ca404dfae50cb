"""Names and values in one-line messages and HTML."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

__all__ = ["html_table", "label", "shown"]

# Longest value and name in a message, in characters.
_LONGEST_VALUE = 60
_LONGEST_NAME = 300


def label(name: str) -> str:
    """Return a name, quoted if it is empty or not printable."""
    return _cut(name if name and name.isprintable() else repr(name), _LONGEST_NAME)


def shown(value: object) -> str:
    """Return an invalid value as text for a one-line message."""
    try:
        # str() of a NumPy scalar omits its type.
        text = repr(value) if isinstance(value, str) else str(value)
    except (ValueError, RecursionError):
        # Python does not print integers of more than 4300 digits, and deeply nested lists.
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
