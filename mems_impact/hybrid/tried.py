"""The functions of a system, tried out: called interpreted, on values that watch over them.

What a function must return or write, `Tried` asks of every call. What is wrong comes back as one
sentence, a `FunctionError` with the function, the line and the remedy; as `Undefined` where only
these values may be to blame: a logarithm of a negative number, a table that ends.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from numbers import Integral, Real
from typing import Any, NamedTuple

from mems_impact.errors import FunctionError
from mems_impact.hybrid.blaming import Function, told
from mems_impact.hybrid.guarded import GuardedMatrix, GuardedVector, Misuse
from mems_impact.hybrid.record import ENDS, NO_FIT
from mems_impact.hybrid.written import Definition, named, writes_into_arrays

__all__ = ["Place", "Tried", "Undefined"]

SHOWN = 8  # components of a state in a message


class Place(NamedTuple):
    """Where a function is called; `mode` as the function gets it."""

    mode: Any
    t: float
    y: list[float]


class Undefined(Exception):
    """A function has no value somewhere; `error` says it as a sentence."""

    def __init__(self, error: FunctionError) -> None:
        super().__init__(str(error))
        self.error = error


class Tried:
    """The functions of a definition at some values of its parameters.

    Parameters
    ----------
    definition : Definition
    parameters : sequence of float
        Those of the user, without what is hidden behind them.
    """

    def __init__(self, definition: Definition, parameters: Sequence[float]) -> None:
        self.definition = definition
        self.states, self.n = definition.states, len(definition.states)
        self.by_array = writes_into_arrays(definition.flow)
        self.p = named("Parameters", definition.parameters)(*parameters)
        self._twice: set[Any] = set()  # what has been called twice at one point

    def state(self, y: Sequence[float]) -> Any:
        """Return a state as functions get it."""
        return list(y) if self.by_array else named("State", self.states)(*y)

    def flow(self, at: Place) -> list[float]:
        """Return the slope."""
        function = Function("flow", self.definition.flow)
        if not self.by_array:
            return self._tuple(function, self._call(function, at), at)
        slope: list[Any] = [None] * self.n
        self._call(function, at, slope)
        if None in slope:
            problem = f"does not write dy[{slope.index(None)}] in mode {self._mode(at)}"
            remedy = "write every component, 0.0 for a state that does not change"
            raise function.error(problem, remedy)
        return self._finite(function, slope, at)

    def margin(self, i: int, at: Place) -> float:
        """Return the margin of guard `i`."""
        return self._scalar("margin", i, at)

    def constraint(self, i: int, at: Place) -> float:
        """Return what a constraint comes to, which is zero where it holds."""
        return self._number(Function("constraint", self.definition.constraints[i][1]), at)

    def rate(self, i: int, at: Place) -> float:
        """Return the rate that is given of the margin of guard `i`."""
        return self._scalar("rate", i, at)

    def transition(self, kind: str, i: int | None, at: Place) -> tuple[int, list[float]]:
        """Return mode and state after the "transition" or "rest" of guard `i`, or "settle"."""
        guard = None if i is None else self.definition.guards[i]
        call = getattr(guard or self.definition, kind)
        if call is None:
            return at.mode, at.y
        function = Function(kind, call, guard.name if guard else "")
        if self.by_array:
            new: list[Any] = list(at.y)
            mode = self._call(function, at, new)
            return self._existing(function, mode), self._finite(function, new, at)
        result = self._call(function, at)
        if not (isinstance(result, tuple) and len(result) == 2):
            problem = f"returns {told(result)} in mode {self._mode(at)}"
            remedy = "return the new mode and the new state on every path: mode, (…)"
            raise function.error(problem, remedy)
        mode, state = result
        return self._existing(function, mode), self._tuple(function, state, at)

    def jacobian(self, at: Place) -> list[list[float]]:
        """Return the Jacobian that is given."""
        assert self.definition.jacobian is not None
        function = Function("jacobian", self.definition.jacobian)
        entries = GuardedMatrix("J", self.n)
        self._call(function, at, entries)
        rows = [[entries[i, j] for j in range(self.n)] for i in range(self.n)]
        return [self._finite(function, row, at) for row in rows]

    def _scalar(self, kind: str, i: int, at: Place) -> float:
        guard = self.definition.guards[i]
        return self._number(Function(kind, getattr(guard, kind), guard.name), at)

    def _number(self, function: Function, at: Place) -> float:
        value = self._call(function, at)
        if not isinstance(value, Real | complex):
            problem = f"returns {told(value)} in mode {self._mode(at)}"
            raise function.error(problem, "return one number on every path")
        if isinstance(value, complex) or math.isnan(value):
            raise self._undefined(function, value, "", at)
        return float(value)

    def _call(self, function: Function, at: Place, *out: Any) -> Any:
        """Call a function as the engine does; twice where it has not been called in this mode."""
        call = getattr(function.call, "py_func", function.call)  # of one that numba compiled
        mode, t, y = at
        state = self.state(y)
        fresh = [GuardedMatrix("J", self.n) if not isinstance(a, list) else list(a) for a in out]
        try:
            result = call(mode, t, state, self.p, *out)
            if self.by_array and any(a is not b for a, b in zip(state, y, strict=True)):
                raise Misuse("writes into y", "leave it as it is, and write into the last argument")
        except Exception as error:
            raise self._blamed(function, error, at, fresh) from error
        if (call, mode) not in self._twice:
            self._twice.add((call, mode))
            try:
                again = call(mode, t, state, self.p, *fresh)
            except Exception as error:
                again = error
            if not same((result, *map(list, out)), (again, *map(list, fresh))):
                problem = "gives two results for the same mode, time and state"
                remedy = "let it depend on its arguments alone: no random numbers, no counters"
                raise function.error(problem, remedy)
        return result

    def _blamed(
        self, function: Function, error: Exception, at: Place, out: Sequence[Any]
    ) -> FunctionError | Undefined:
        """Return the sentence about an exception, after a call that watches more closely."""
        if self.by_array and not isinstance(error, Misuse):
            name = "dy" if function.kind == "flow" else "new"
            watched = [GuardedVector(name, a) if isinstance(a, list) else a for a in out]
            try:
                function.call(at.mode, at.t, GuardedVector("y", at.y, fixed=True), self.p, *watched)
            except Exception as closer:
                error = closer
        found, always = function.blamed(error)
        if always:
            return found
        problem = f"{found.problem} {self.place(at)}"
        return Undefined(FunctionError(found.role, problem, found.remedy, found.file, found.line))

    def _tuple(self, function: Function, values: Any, at: Place) -> list[float]:
        """Return a tuple of one number for each state as a list."""
        names = ", ".join(self.states[:SHOWN]) + (", …" if self.n > SHOWN else "")
        remedy = f"return a tuple of {self.n}, for {names}, on every path"
        if not isinstance(values, tuple):
            raise function.error(f"returns {told(values)} in mode {self._mode(at)}", remedy)
        if len(values) != self.n:
            problem = f"returns {len(values)} numbers for {self.n} states in mode {self._mode(at)}"
            raise function.error(problem, remedy)
        return self._finite(function, values, at)

    def _finite(self, function: Function, values: Sequence[Any], at: Place) -> list[float]:
        for name, value in zip(self.states, values, strict=True):
            if isinstance(value, float | int) and math.isfinite(value):
                continue
            if not isinstance(value, Real | complex):
                raise function.error(f"gives {told(value)} for {name}", "let it be a number")
            if isinstance(value, complex) or not math.isfinite(value):
                raise self._undefined(function, value, f" for {name}", at)
        return [float(value) for value in values]

    def _existing(self, function: Function, mode: Any) -> int:
        """Return a mode that there is."""
        modes = self.definition.modes
        if isinstance(mode, Integral) and int(mode) in (ENDS, NO_FIT, *range(len(modes))):
            return int(mode)
        what = f"mode {mode}" if isinstance(mode, Real) else told(mode)
        known = ", ".join(f"{i} ({name})" for i, name in enumerate(modes))
        raise function.error(f"returns {what}", f"return one of the modes {known}")

    def _undefined(self, function: Function, value: Any, what: str, at: Place) -> Undefined:
        problem = f"gives {value}{what} {self.place(at)}"
        return Undefined(function.error(problem, "treat this case apart, or start elsewhere"))

    def place(self, at: Place) -> str:
        """Return where a point is, worded to follow what is wrong there."""
        *sizes, time = self.definition.sizes or [1.0] * (self.n + 1)
        told = list(zip(self.states, at.y, sizes, strict=True))
        numbers = [f"{name} = {value * size:.6g}" for name, value, size in told[:SHOWN]]
        numbers += ["…"] if self.n > SHOWN else []
        return f"at {', '.join(numbers)}, t = {at.t * time:.6g}, mode {self._mode(at)}"

    def _mode(self, at: Place) -> str:
        modes = self.definition.modes
        known = isinstance(at.mode, int) and 0 <= at.mode < len(modes)
        return modes[at.mode] if known else str(at.mode)


def same(one: Any, other: Any) -> bool:
    """Return whether two results are the same, nan for nan."""
    if isinstance(one, tuple | list) and isinstance(other, tuple | list):
        return len(one) == len(other) and all(map(same, one, other))
    try:
        return bool(one == other) or bool(one != one and other != other)
    except ValueError:  # arrays, about which more is said elsewhere
        return True
