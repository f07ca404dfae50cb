"""How one-line messages show names and values."""

from __future__ import annotations

__all__ = ["label", "shown"]

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
