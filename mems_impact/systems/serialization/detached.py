"""Systems that were loaded without their functions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import cached_property
from typing import Any, NoReturn

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.units import Scales
from mems_impact.errors import FunctionsMissing, InvalidParameter
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.definition import Typical
from mems_impact.hybrid.problem import Problem, Section
from mems_impact.integrators.options import Options
from mems_impact.systems.arguments import check_names
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.checks import Checks
from mems_impact.systems.observables import Observable
from mems_impact.systems.state import State
from mems_impact.systems.state_space import StateSpace
from mems_impact.systems.statistics import SystemStatistics
from mems_impact.systems.units import Units

COMPARED = ("states", "modes", "guards", "parameters", "observables", "units")
TIME_RTOL = 1e-12  # relative difference of equal times, computed on another machine


def describe(system: HybridSystem, functions: Mapping[str, str]) -> dict[str, Any]:
    """Return the description of a system without its functions; `functions` tells their places."""
    problem = system.problem(Options())
    automaton = system.automaton
    return {
        "name": system.name,
        "states": automaton.states,
        "modes": automaton.modes,
        "guards": [
            {"name": guard.name, "order": guard.order, "impact": guard.impact}
            for guard in automaton.guards
        ],
        "cyclic": automaton.cyclic,
        "parameters": system.parameters,
        "units": dict(system.units),
        "scales": system.units.scales,
        "typical": system.units.typical,
        "section": system.section,
        "initial": system.initial,
        "displayed_states": system.state_space.displayed,
        "sweep_statistics": system.statistics.sweep_columns,
        "observables": [
            {"name": each.name, "at": each.at, "reduce": each.reduce, "unit": each.unit}
            for each in system.observables
        ],
        "forcing_period": system.forcing_period,
        "period": problem.period,
        "switches": problem.switches,
        "time_scale": problem.time_scale,
        "functions": dict(functions),
    }


def check_same_system(system: HybridSystem, description: Mapping[str, Any], path: str) -> None:
    """Raise InvalidParameter unless a system matches a description."""
    if tuple(system.parameters) == tuple(description["parameters"]):
        system = system.restored(
            description["parameters"], description["scales"], description.get("typical")
        )
    present = describe(system, {})
    for field in COMPARED:
        values, stored = _names(present[field]), _names(description[field])
        if values != stored:
            _refuse(field, values, stored, path)
    for field in ("period", "time_scale", "switches"):
        times, others = (
            np.atleast_1d(np.array(each[field], dtype=float)) for each in (present, description)
        )
        alike = times.shape == others.shape and np.allclose(
            times, others, TIME_RTOL, 0.0, equal_nan=True
        )
        if not alike:
            _refuse(field.replace("_", " "), times.tolist(), others.tolist(), path)


def _names(items: Iterable[Any]) -> list[Any]:
    return [each["name"] if isinstance(each, Mapping) else each for each in items]


def _refuse(field: str, values: list[Any], stored: list[Any], path: str) -> NoReturn:
    listed = [", ".join(map(str, each)) or "none" for each in (values, stored)]
    remedy = "give the system of the result"
    if stored[-1:] == ["until"]:
        remedy += ", as used in its run: system.ending(until)"
    problem = f"its {field} are {listed[0]}, those of {path} are {listed[1]}; {remedy}"
    raise InvalidParameter("system", None, "", problem=problem)


def _missing_function(*arguments: Any) -> NoReturn:
    raise FunctionsMissing("the functions of the system")


class DetachedStatistics(SystemStatistics):
    """Names of the statistics of a system without its functions."""

    _system: DetachedSystem

    @property
    def recorded(self) -> NoReturn:
        """Raise FunctionsMissing."""
        self._system.refuse()

    @property
    def sweep_columns(self) -> tuple[str, ...]:
        """The statistics in the table of a sweep."""
        return self._system.description["sweep_statistics"]


class DetachedStateSpace(StateSpace):
    """The states of a system without its functions."""

    _system: DetachedSystem

    @property
    def displayed(self) -> tuple[str, ...]:
        """The states by which sweeps and branches display an orbit."""
        return self._system.description["displayed_states"]

    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> NoReturn:
        """Raise FunctionsMissing."""
        self._system.refuse()


class DetachedSystem(HybridSystem):
    """A system described in a file, without its functions.

    A detached system has names, units and numbers. Operations that need the functions raise
    `FunctionsMissing`.
    """

    def __init__(self, description: Mapping[str, Any], path: str) -> None:
        self._description, self._path, self._moved = dict(description), path, False
        check_names(
            name=[description["name"]],
            guards=[guard["name"] for guard in description["guards"]],
            observables=[each["name"] for each in description["observables"]],
            units=description["units"].values(),
            **{field: description[field] for field in ("states", "modes", "parameters")},
        )
        self.name = description["name"]
        self._parameters = dict(description["parameters"])
        observables = description["observables"]
        self.observables = tuple(
            Observable(function=_missing_function, **each) for each in observables
        )

    def _refusal(self) -> str:
        return f"{self._path} does not hold the functions of its system"

    def _key(self) -> tuple[Any, ...]:
        return self._description, self._parameters

    @property
    def description(self) -> dict[str, Any]:
        """The description of the system in the file."""
        return dict(self._description)

    @property
    def functions(self) -> dict[str, str]:
        """Where its functions were defined, as ``module:name``."""
        return dict(self._description["functions"])

    def summary(self) -> dict[str, Any]:
        """Return names and numbers, and the missing functions."""
        locations = ", ".join(dict.fromkeys(self.functions.values()))
        return {**super().summary(), "missing functions": locations}

    @property
    def automaton(self) -> Automaton:
        """States, modes and guards by name, without functions."""
        description = self._description
        return Automaton(
            states=description["states"],
            modes=description["modes"],
            guards=tuple(Guard(**each) for each in description["guards"]),
            cyclic=description["cyclic"],
            flow=_missing_function,
            margins=_missing_function,
            transition=_missing_function,
        )

    @cached_property
    def units(self) -> Units:
        """Units of states, parameters, observables and times."""
        return Units(
            self._description["units"],
            self._description["scales"],
            typical=self._description.get("typical"),
        )

    @property
    def state_space(self) -> StateSpace:
        """Its states: names, and conversion from scaled states."""
        return DetachedStateSpace(self)

    @property
    def checks(self) -> Checks:
        """No checks, since the functions are missing."""
        return Checks(self)

    @property
    def statistics(self) -> SystemStatistics:
        """Statistics by name, without functions of observables."""
        return DetachedStatistics(self, self.refuse, self.refuse)

    def refuse(self, _: Any = None) -> NoReturn:
        """Raise FunctionsMissing."""
        raise FunctionsMissing(self._refusal())

    @property
    def initial(self) -> State:
        """Initial state of runs by default."""
        return self._description["initial"]

    @property
    def section(self) -> Section | None:
        """The Poincaré section."""
        return self._description["section"]

    @property
    def forcing_period(self) -> float | None:
        """The forcing period at the parameters of the file."""
        return self._description["forcing_period"]

    def shifted(self, values: Mapping[str, float]) -> DetachedSystem:
        """Return the system at other values."""
        other: Any = self._copy()
        other._parameters = {**self._parameters, **values}
        other._moved = True
        return other

    def problem(self, options: Options) -> Problem:
        """Return the problem of the result, which cannot be integrated again."""
        if self._moved:
            raise FunctionsMissing(self._refusal())
        description = self._description
        return Problem(
            automaton=self.automaton,
            parameters=np.array(list(self._parameters.values())),
            period=description["period"],
            switches=description["switches"],
            time_scale=description["time_scale"],
            section=self.section,
            options=options,
            unavailable_reason=self._refusal(),
        )

    def restored(
        self, values: Mapping[str, float], scales: Scales, typical: Typical | None = None
    ) -> DetachedSystem:
        """Return the system at the values of a file."""
        return self.shifted(values)

    @property
    def parameters(self) -> dict[str, float]:
        """Names and values of all parameters."""
        return dict(self._parameters)

    def numbers(self, changes: Mapping[str, float] | None = None) -> NoReturn:
        """Raise FunctionsMissing: period and switches may be functions."""
        raise FunctionsMissing(self._refusal())

    def ending(self, until: Callable[..., float]) -> HybridSystem:
        """Raise FunctionsMissing."""
        raise FunctionsMissing(self._refusal())
