"""What an engine integrates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

__all__ = ["Equations"]


@dataclass(frozen=True, kw_only=True)
class Equations:
    """The functions of an automaton with all their numbers.

    Parameters
    ----------
    flow, margins, transition, jacobian : callable
        See `mems_impact.hybrid.automaton.Automaton`.
    n, m, modes : int
        Number of states, of guards and of modes.
    parameters : array_like of float
    section : tuple (component, level, direction), optional
        Crossings of ``y[component] = level`` that are reported as the last root function.
    bounds : bool, optional
        Whether compiled functions are kept from reading and writing beyond their arrays.
    """

    flow: Callable[..., Any]
    margins: Callable[..., Any]
    transition: Callable[..., Any]
    n: int
    m: int
    parameters: Any
    jacobian: Callable[..., Any] | None = None
    section: tuple[int, float, int] | None = None
    bounds: bool = True
    modes: int = 1

    @property
    def crossing(self) -> tuple[int, float, int]:
        """The section, with component -1 where there is none."""
        return (-1, 0.0, 0) if self.section is None else self.section
