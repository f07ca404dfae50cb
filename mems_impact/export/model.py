"""A system as plain data for export: automaton, numbers, units and names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mems_impact._util.limits import UNLIMITED, Bound, Limits
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState

__all__ = ["ExportedModel", "ExportedNumber"]


@dataclass(frozen=True, kw_only=True)
class ExportedNumber:
    """A parameter or input of an exported model.

    Attributes
    ----------
    name, unit : str
    value : float
        In the system's units.
    factor : float
        The unit of the numerics, in the system's units.
    index : int or None
        Index in the parameter array; None if the array depends on it in another way, so that the
        exported model has its value as a constant.
    rate_index : int or None
        Index in the parameter array of the time derivative of an input.
    limits : Limits
        In the system's units.
    """

    name: str
    value: float
    unit: str = ""
    factor: float = 1.0
    index: int | None = None
    rate_index: int | None = None
    limits: Limits = UNLIMITED


@dataclass(frozen=True, kw_only=True)
class ExportedModel:
    """A system for export.

    Attributes
    ----------
    name : str
    automaton : Automaton
        Its functions have source text, in files or in `generated`.
    problem : Problem
        In the units of the numerics.
    initial : HybridState
        In the units of the numerics.
    numbers : tuple of ExportedNumber
    state_units, state_factors : tuple
        Units of the states, and the units of the numerics in them.
    time_unit : str
    time_factor : float
    start_time : float
        Time of the initial state in the forcing period, in the system's units.
    inputs : tuple of str
        The numbers that are inputs.
    generated : mapping of code to str
        Source texts of generated functions.
    mode_of : callable or None
        ``mode_of(mode, t, y, p)`` returns the mode of a state, in the system's units, by name.
    mode_by_switch : bool
        Whether the transition at a switch determines the mode of a state.
    period, time_scale : callable or None
        Functions of the parameters by name, in the system's units.
    switches : callable or None
        Likewise.
    rate_step_index : int or None
        Index in the parameter array of the difference step of rates.
    bounds : tuple of Bound
        Bounds of numbers by others, as functions of the parameter array.
    """

    name: str
    automaton: Automaton
    problem: Problem
    initial: HybridState
    numbers: tuple[ExportedNumber, ...]
    state_units: tuple[str, ...]
    state_factors: tuple[float, ...]
    time_unit: str = ""
    time_factor: float = 1.0
    start_time: float = 0.0
    inputs: tuple[str, ...] = ()
    generated: Mapping[Any, str] = field(default_factory=dict)
    mode_of: Callable[..., Any] | None = None
    mode_by_switch: bool = False
    period: Callable[..., Any] | None = None
    time_scale: Callable[..., Any] | None = None
    switches: Callable[..., Any] | None = None
    rate_step_index: int | None = None
    bounds: tuple[Bound, ...] = ()
