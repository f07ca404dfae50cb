"""Studies in files and on the command line: conversion to arguments of Python functions.

An entry of the table ``[study]`` is an argument of the verb of its kind, with the same default.
Arguments other than plain values have a reader here; an options object, such as
`RecurrenceOptions`, is a table of its non-default values.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, is_dataclass, replace
from functools import partial
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.quantities import has_unit
from mems_impact.analysis.orbit import ORBIT_OPTIONS, Orbit, find_orbit
from mems_impact.errors import InvalidParameter
from mems_impact.integrators.options import Options
from mems_impact.studies.engine import EXECUTORS
from mems_impact.studies.engine.executors import cores
from mems_impact.studies.optimize import (
    Bounds,
    Limits,
    Optimum,
    ParetoFront,
    optimize,
    pareto_front,
)
from mems_impact.studies.sampling import DISTRIBUTIONS_ALLOWED, Interval, distribution_named
from mems_impact.studies.sensitivity import Sensitivity, sensitivity
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.observables import Quantity
from mems_impact.systems.state import State, is_number, state_from

# --- Sensitivities and optima of an orbit, from study files

TRANSIENT = 300  # forcing periods before the search for an orbit


def orbit_from(
    system: HybridSystem,
    *,
    initial: State | Mapping[str, float] | None = None,
    transient: float = TRANSIENT,
    periods: int | None = None,
    options: Options = ORBIT_OPTIONS,
) -> Orbit:
    """Return the orbit to which a run leads.

    Parameters
    ----------
    system : System
    initial : State or mapping of str to float, optional
        Initial state of the run.
    transient : float, optional
        Forcing periods simulated before the search for the orbit.
    periods : int, optional
        Period of the orbit in forcing periods; recognized by default.
    options : Options, optional
    """
    return find_orbit(system, guess=initial, periods=periods, transient=transient, options=options)


def orbit_sensitivity_study(
    system: HybridSystem,
    *,
    over: Sequence[str] | None = None,
    quantities: Sequence[str | Quantity] | None = None,
    initial: State | Mapping[str, float] | None = None,
    transient: float = TRANSIENT,
    periods: int | None = None,
    options: Options = ORBIT_OPTIONS,
) -> Sensitivity:
    """Return the `sensitivity` of the orbit to which a run leads.

    Parameters
    ----------
    system : System
    over : sequence of str, optional
        Parameter of the table; all by default.
    quantities : sequence of str or Quantity, optional
        As for `sensitivity`.
    initial : State or mapping of str to float, optional
        Initial state of the run.
    transient : float, optional
        Forcing periods simulated before the search for the orbit.
    periods : int, optional
        Period of the orbit in forcing periods; recognized by default.
    options : Options, optional
    """
    orbit = orbit_from(
        system, initial=initial, transient=transient, periods=periods, options=options
    )
    return sensitivity(orbit, over, quantities)


def optimize_from(
    system: HybridSystem,
    *,
    maximize: str | Sequence[str] = (),
    minimize: str | Sequence[str] = (),
    over: Bounds,
    subject_to: Limits | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    points: int = 9,
    initial: State | Mapping[str, float] | None = None,
    transient: float = TRANSIENT,
    periods: int | None = None,
    options: Options = ORBIT_OPTIONS,
    progress: bool | Callable[[float], None] = False,
) -> Optimum | ParetoFront:
    """Optimize the orbit to which a run leads; with two objectives compute the Pareto front.

    Parameters
    ----------
    system : System
    maximize, minimize : str or sequence of str
        Quantity of the orbit, such as 'mean speed' or 'standard deviation of mean speed'; two in
        all give a Pareto front.
    over : mapping of str to (float, float)
        Parameter to vary and its bounds.
    subject_to : mapping of str to (float, float), optional
        Constraint: bounds of a quantity such as 'largest multiplier'; one bound may be omitted.
    tolerances : mapping of str to float or str, optional
        Standard deviation of a parameter, or in per cent of its value.
    points : int
        Number of points of a Pareto front.
    initial : State or mapping of str to float, optional
        Initial state of the run.
    transient : float, optional
        Forcing periods simulated before the search for the orbit.
    periods : int, optional
        Period of the orbit in forcing periods; recognized by default.
    options : Options, optional
    progress : bool or callable, optional
    """
    names = [*_several(maximize), *_several(minimize)]
    if not 1 <= len(names) <= 2 or len(set(names)) != len(names):
        allowed = "one quantity, maximize or minimize, or two for a front"
        raise InvalidParameter("maximize", maximize or None, allowed)
    aims: dict[str, Any] = dict.fromkeys(_several(maximize), "maximize")
    aims |= dict.fromkeys(_several(minimize), "minimize")
    orbit = orbit_from(
        system, initial=initial, transient=transient, periods=periods, options=options
    )
    arguments: dict[str, Any] = {"over": over, "subject_to": subject_to, "tolerances": tolerances}
    if len(aims) == 2:
        return pareto_front(orbit, aims, points=points, progress=progress, **arguments)
    arguments[aims[names[0]]] = names[0]
    return optimize(orbit, progress=progress, **arguments)


def _several(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


# --- Arguments of studies

STUDY_KINDS = {
    "map": "mems_impact.studies.operating_map:operating_map",
    "basins": "mems_impact.studies.basins:basins",
    "tolerances": "mems_impact.studies.uncertainty:tolerance_analysis",
    "sensitivity": "mems_impact.studies.engine.config:orbit_sensitivity_study",
    "optimize": "mems_impact.studies.engine.config:optimize_from",
}
"""Verbs by the kind of study."""

_AXIS = '["NAME", START, STOP, POINTS] or ["NAME", [VALUE, …]]'


def verb_of(kind: Any) -> Callable[..., Any]:
    """Return the verb that runs studies of a kind; InvalidParameter if there is none."""
    if not isinstance(kind, str) or kind not in STUDY_KINDS:
        problem = f"missing, must be one of {', '.join(STUDY_KINDS)}" if kind is None else None
        raise InvalidParameter("kind", kind, f"one of {', '.join(STUDY_KINDS)}", problem=problem)
    return resolve_name(STUDY_KINDS[kind])


def verb_arguments(kind: Any, table: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Return the arguments of the verb of a kind; see `arguments_from`."""
    return arguments_from(verb_of(kind), table, folder)


def arguments_from(
    verb: Callable[..., Any], table: Mapping[str, Any], folder: Path
) -> dict[str, Any]:
    """Return the arguments of a verb from a table of TOML values by name.

    Relative paths start at `folder`. Raises InvalidParameter if an argument is unknown, missing or
    of the wrong kind.
    """
    parameters = dict(islice(inspect.signature(verb).parameters.items(), 1, None))
    for name in table:
        if name not in parameters:
            raise _unknown(name, table[name], parameters)
    for name, parameter in parameters.items():
        by_name = parameter.kind is inspect.Parameter.KEYWORD_ONLY
        if by_name and parameter.default is inspect.Parameter.empty and name not in table:
            allowed = _AXIS if _READERS.get(name) is _axis else "given"
            raise InvalidParameter(name, None, allowed, problem=f"missing, must be {allowed}")
    arguments = {name: _argument(parameters[name], value) for name, value in table.items()}
    if "store" in arguments:
        arguments["store"] = folder / arguments["store"]
    if "executor" in arguments:
        arguments["executor"] = executor_named(arguments["executor"], arguments.get("workers"))
    return arguments


def range_axis(
    name: str, start: float | str, stop: float | str, points: int
) -> tuple[str, Floats | Interval]:
    """Return an axis of evenly spaced values, ends included; ends may have units."""
    if is_number(start) and is_number(stop):
        return name, np.linspace(float(start), float(stop), points)
    return name, Interval(start, stop, points)


def executor_named(name: str, workers: int | None) -> Any:
    """Return the argument `executor` of studies for the executor of that name."""
    if name not in EXECUTORS:
        raise InvalidParameter("executor", name, f"one of {', '.join(EXECUTORS)}")
    if name == "threads":
        return None
    return partial(ProcessPoolExecutor, workers or cores(), get_context("spawn"))


def _argument(parameter: inspect.Parameter, value: Any) -> Any:
    name, default = parameter.name, parameter.default
    reader = _TYPE_READERS.get(parameter.annotation, _READERS.get(name))
    if reader is not None:
        return reader(name, value)
    if is_dataclass(default) and not isinstance(default, type):
        return _options(name, value, default)
    return value


def _axis(name: str, value: Any) -> tuple[str, Any]:
    match value:
        case [str(parameter), list(values)]:
            return parameter, values
        case [str(parameter), start, stop, points] if _is_amount(start) and _is_amount(stop):
            if isinstance(points, int) and points > 0:
                return range_axis(parameter, start, stop, points)
    raise InvalidParameter(name, value, _AXIS)


def _names(name: str, value: Any) -> list[str]:
    if not (isinstance(value, list) and value and all(isinstance(each, str) for each in value)):
        raise InvalidParameter(name, value, "a list of names")
    return value


def distributions(name: str, value: Any) -> dict[str, Any]:
    """Return distributions, each written as its name in scipy.stats and its arguments."""
    if not isinstance(value, dict):
        raise InvalidParameter(name, value, DISTRIBUTIONS_ALLOWED)
    return {
        parameter: _distribution(f"{name}.{parameter}", entry) for parameter, entry in value.items()
    }


def _distribution(field: str, entry: Any) -> Any:
    """Return a distribution; words with units, or relative to a parameter's value, unchanged."""
    if isinstance(entry, str) or (isinstance(entry, list) and any(map(has_unit, entry))):
        return entry
    if not (isinstance(entry, list) and entry):
        raise InvalidParameter(field, entry, DISTRIBUTIONS_ALLOWED)
    return distribution_named(field, entry, lambda number: number)


def _state(name: str, value: Any) -> State | dict[str, Any]:
    """Return a state; components with units as they are."""
    if not isinstance(value, dict):
        raise InvalidParameter(name, value, "a table of components of the state: {x2 = 0.1}")
    return value if any(map(has_unit, value.values())) else state_from(value)


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str) or not value:
        raise InvalidParameter(name, value, "a text")
    return value


def _options(name: str, value: Any, default: Any) -> Any:
    names = [each.name for each in fields(default)]
    if not isinstance(value, dict):
        raise InvalidParameter(name, value, f"a table of some of {', '.join(names)}")
    for word in value:
        if word not in names:
            raise _unknown(f"{name}.{word}", value[word], names)
    try:
        return replace(default, **value)
    except InvalidParameter as error:
        raise error.located(owner=name) from None


def _unknown(name: str, value: Any, names: Any) -> InvalidParameter:
    allowed = f"one of {', '.join(names)}"
    return InvalidParameter(name, value, allowed, problem=f"unknown name, must be {allowed}")


def _ranges(name: str, value: Any) -> dict[str, tuple[float | None, float | None]]:
    """Return lowest and highest values by name; None for infinite ones."""
    allowed = "pairs of numbers by name: {amplitude = [0.2, 0.3]}, one of which may be inf"
    if not isinstance(value, dict):
        raise InvalidParameter(name, value, allowed)
    ranges = {}
    for word, pair in value.items():
        two = isinstance(pair, list) and len(pair) == 2
        if not (two and all(end is None or _is_real(end) or has_unit(end) for end in pair)):
            raise InvalidParameter(f"{name}.{word}", pair, allowed)
        low, high = (_bound(end) for end in pair)
        ranges[word] = low, high
    return ranges


def _bound(end: Any) -> Any:
    """Return a bound, None if it is infinite; None and a text with a unit unchanged."""
    if end is None or has_unit(end):
        return end
    return float(end) if math.isfinite(end) else None


def _is_real(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and value == value


def _is_amount(value: Any) -> bool:
    return is_number(value) or has_unit(value)


_Reader = Callable[[str, Any], Any]
_READERS: dict[str, _Reader] = {
    "x": _axis,
    "y": _axis,
    "curves": _axis,
    "initial": _state,
    "over": distributions,
    "store": _text,
    "executor": _text,
}
_TYPE_READERS: dict[str, _Reader] = {
    "Sequence[str]": _names,
    "Sequence[str] | None": _names,
    **dict.fromkeys(
        (
            *("Bounds", "Bounds | None", "Limits | None", "Specification | None"),
            "Mapping[str, tuple[float | str, float | str]] | None",
        ),
        _ranges,
    ),
}
"""Readers by annotation, which precede those by name."""
