"""Modes: numbers with names."""

from __future__ import annotations

from typing import Any

__all__ = ["Mode", "modes"]


class Mode(int):
    """A mode: its number, which functions compare and return, its name, and those beside it."""

    names: tuple[str, ...]

    def __new__(cls, number: int, names: tuple[str, ...]) -> Mode:
        """Return one of the modes that are called `names`."""
        mode = super().__new__(cls, number)
        mode.names = names
        return mode

    @property
    def name(self) -> str:
        """What it is called."""
        return self.names[self]

    def __reduce__(self) -> Any:
        return Mode, (int(self), self.names)


def modes(*names: str) -> tuple[Mode, ...]:
    """Return one mode a name, numbered from 0.

    Parameters
    ----------
    *names : str

    Returns
    -------
    tuple of Mode
        Integers that know their names.

    See Also
    --------
    System, Guard

    Examples
    --------
    >>> import mems_impact as mi
    >>> FREE, HELD = mi.modes("free", "held")
    >>> HELD == 1, HELD.name
    (True, 'held')
    """
    return tuple(Mode(number, names) for number in range(len(names)))
