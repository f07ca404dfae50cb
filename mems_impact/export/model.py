"""A system as plain data for export: automaton, numbers, units and names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from mems_impact._util.limits import UNLIMITED, Bound, Limits
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState


@dataclass(frozen=True, kw_only=True)
class ExportedNumber:
    """A parameter or input of an exported model, in the system's units."""

    name: str
    value: float
    unit: str = ""
    factor: float = 1.0  # the unit of the numerics, in the system's units
    # Index in the parameter array; None if the array depends on it in another way, so that the
    # exported model has its value as a constant.
    index: int | None = None
    rate_index: int | None = None  # index of the time derivative of an input
    limits: Limits = UNLIMITED


@dataclass(frozen=True, kw_only=True)
class ExportedModel:
    """A system for export, in the system's units unless a comment says otherwise."""

    name: str
    automaton: Automaton  # its functions have source text, in files or in `generated`
    problem: Problem  # in the units of the numerics
    initial: HybridState  # in the units of the numerics
    numbers: tuple[ExportedNumber, ...]
    state_units: tuple[str, ...]
    state_factors: tuple[float, ...]  # the units of the numerics in `state_units`
    time_unit: str = ""
    time_factor: float = 1.0
    start_time: float = 0.0  # time of the initial state in the forcing period
    inputs: tuple[str, ...] = ()  # the numbers that are inputs
    generated: Mapping[Any, str] = field(default_factory=dict)  # source texts, by code objects
    # ``mode_of(mode, t, y, p)`` returns the mode of a state; ``p`` by name
    mode_of: Callable[..., Any] | None = None
    mode_by_switch: bool = False  # whether the transition at a switch determines the mode
    # A function of the parameters by name, as the next two.
    period: Callable[..., Any] | None = None
    time_scale: Callable[..., Any] | None = None
    switches: Callable[..., Any] | None = None
    rate_step_index: int | None = None  # of the difference step of rates
    bounds: tuple[Bound, ...] = ()  # of numbers by others, as functions of the parameter array
