"""Events of users on branches: functions of orbits and equilibria, and values of columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import Any, Self

from mems_impact.analysis.solution import Solution, quantities, solution_of
from mems_impact.continuation.user_test_functions import FunctionTest
from mems_impact.errors import FunctionError, InvalidParameter
from mems_impact.hybrid.pickling import portable
from mems_impact.orbits.equilibrium import EquilibriumEquations, make_equilibrium
from mems_impact.orbits.periodic_orbit import make_orbit
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.state import is_number

Events = Mapping[str, Callable[[Any], float] | tuple[str, float]]
"""Events by name: a function of a solution, or a column of the branch's table and its value."""

REMEDY = "return a finite number, or NaN where the function is undefined"
LOADED_REMEDY = "continue the branch again with events="


@dataclass(frozen=True, eq=False)
class EventFunction:
    """A function of the solutions of a branch in the user's units, zero at an event."""

    name: str
    system: HybridSystem
    parameter: str  # of the branch
    column: str = ""  # of the table; empty if `function` is given
    level: float = 0.0  # value of the column, or of the function, at the event
    # Missing in a result that was loaded.
    function: Callable[[Any], float] | None = field(default=None, compare=False)

    def __call__(self, equations: Any, point: Any) -> float:
        """Return the value at a point, minus the level."""
        make: Any = make_equilibrium if isinstance(equations, EquilibriumEquations) else make_orbit
        return self.of(solution_of(self.system, make(equations, point))) - self.level

    def of(self, solution: Solution) -> float:
        """Return the value at an orbit or an equilibrium; NaN if it has no value in the column.

        Raises FunctionError if the function is missing, raises, or returns no number.
        """
        if self.column:
            value = quantities(solution, self.parameter).get(self.column)
            return math.nan if value is None else float(value())
        role = f"event {self.name!r}"
        if self.function is None:
            raise FunctionError(role, "is not in the file of the branch", LOADED_REMEDY)
        try:
            result = self.function(solution)
        except Exception as error:  # any exception of the user's function
            problem = f"raises {type(error).__name__}: {error}"
            raise FunctionError(role, problem, REMEDY) from error
        if isinstance(result, bool) or not isinstance(result, Real):
            raise FunctionError(role, f"returns {result!r}, not a number", REMEDY)
        return float(result)

    def __getstate__(self) -> dict[str, Any]:
        return {**vars(self), "function": portable(self.function)}

    @classmethod
    def tests(
        cls, events: Events | None, solution: Solution, parameter: str, kinds: Collection[str]
    ) -> tuple[FunctionTest, ...]:
        """Return the test functions of the events of a branch, tested at its first solution.

        `kinds` are the names of other special points. Raises InvalidParameter if an event is
        neither a function nor a column with a value, or its name is taken, FunctionError if a
        function fails at the first solution.
        """
        if events is None:
            return ()
        if not isinstance(events, Mapping):
            raise InvalidParameter("events", events, "a mapping of names to events")
        for name in events:
            if not isinstance(name, str) or not name:
                raise InvalidParameter("events", name, "named by text")
            if name in kinds:
                problem = "is another kind of special point; choose another name"
                raise InvalidParameter("events", name, "", problem=problem)
        return tuple(
            FunctionTest(name, cls.checked(name, event, solution, parameter))
            for name, event in events.items()
        )

    @classmethod
    def checked(cls, name: str, event: Any, solution: Solution, parameter: str) -> Self:
        """Return the function of an event; InvalidParameter unless it is one."""
        function: Self
        if callable(event):
            function = cls(name, solution.system, parameter, function=event)
            function.of(solution)
            return function
        field = f"events[{name!r}]"
        pair = isinstance(event, tuple | list) and len(event) == 2
        if pair and isinstance(event[0], str):
            event = event[0], solution.system.units.parse(event[0], event[1], field)
        if not (pair and isinstance(event[0], str) and is_number(event[1])):
            allowed = 'a function of the orbit, or a column of the table and its value: ("v", 0.3)'
            raise InvalidParameter(field, event, allowed)
        function = cls(name, solution.system, parameter, event[0], float(event[1]))
        function.check_column(solution, field)
        return function

    def check_column(self, solution: Solution, field: str) -> None:
        """Raise InvalidParameter unless the table has the column."""
        columns = quantities(solution, self.parameter)
        if self.column not in columns:
            allowed = f"a column of the table: {', '.join(columns)}"
            raise InvalidParameter(field, self.column, allowed)
