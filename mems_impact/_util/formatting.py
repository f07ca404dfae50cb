"""Names and values in one-line messages and HTML."""

from __future__ import annotations

import html
import re
from collections.abc import Mapping
from os import PathLike
from pathlib import PurePath
from typing import Any

# Longest value and name in a message, in characters.
_LONGEST_VALUE = 60
_LONGEST_NAME = 300

_STABILITY_NAMES = {True: "stable", False: "unstable", None: "neutral"}

# Characters that neither XML nor TOML can hold.
_FORBIDDEN = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff]")


def class_name(kind: str) -> str:
    """Return the name of the class of a kind: "pulse-and-hold" and "pulse_and_hold" alike.

    >>> class_name("pulse-and-hold")
    'PulseAndHold'
    """
    return "".join(word.capitalize() for word in kind.replace("-", "_").split("_"))


def stability_name(stable: bool | None) -> str:
    """Return the name of a stability."""
    return _STABILITY_NAMES[stable]


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


def printable(text: str) -> str:
    """Return a text that any file can hold, without control characters and lone surrogates."""
    return _FORBIDDEN.sub("\N{REPLACEMENT CHARACTER}", text)


def stem(path: str | PathLike[str]) -> str:
    """Return the name of a file without its suffix, as a title."""
    return printable(PurePath(path).stem)


def escape(text: str) -> str:
    """Return a text as HTML or XML."""
    return html.escape(printable(text))


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
