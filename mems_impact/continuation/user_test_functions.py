"""Test functions of users: functions of an orbit or an equilibrium, and their zeros."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.continuation.arclength import PredictorStep
from mems_impact.continuation.test_functions import DefiningSystem, TestFunction
from mems_impact.errors import OrbitError
from mems_impact.orbits.newton import P
from mems_impact.orbits.shooting import ShootingEvaluation

MAX_EVENT_RATIO = 1e-6  # largest ratio of the value at a zero to the values at the step's ends


class FunctionCondition(DefiningSystem):
    """A function of the orbit, divided by the size of its first gradient.

    The function may have any unit, and its equation must have the accuracy of the others.
    """

    monitor: FunctionTest
    _size = 0.0

    def value(self, point: ShootingEvaluation) -> float:
        """Return the scaled value."""
        value = super().value(point)
        return value / self._size if self._size else value

    def gradient(self, point: ShootingEvaluation) -> Floats:
        """Return the derivatives by unknowns and parameters."""
        gradient = super().gradient(point)
        if not self._size:
            self._size = float(np.linalg.norm(gradient))
            if not 0.0 < self._size < np.inf:
                raise OrbitError(
                    f"{self.monitor.kind!r} does not depend on the orbit",
                    "give a function that varies along the branch",
                )
            gradient = gradient / self._size
        return gradient


@dataclass(frozen=True)
class FunctionTest(TestFunction):
    """A function that the user gives, zero at the points of interest, which `kind` names."""

    # ``function(equations, point)`` returns the value, NaN where it is undefined.
    function: Callable[[Any, Any], float]
    condition: ClassVar[type[DefiningSystem]] = FunctionCondition

    def value(self, equations: Any, point: Any, direction: Floats) -> float | None:
        """Return the value; None unless it is finite."""
        value = self.function(equations, point)
        return value if np.isfinite(value) else None


class FunctionZeros(Generic[P]):
    """Search for the zeros of functions along a branch."""

    def __init__(self, equations: Any, tests: Sequence[FunctionTest]) -> None:
        self.equations, self.tests = equations, tests
        self._last: tuple[P, list[float | None]] | None = None  # at the end of the last step

    def within(self, step: PredictorStep[P], length: float) -> list[tuple[float, FunctionTest, P]]:
        """Return the zeros in the first `length` of a step: position, test function and point.

        A jump through zero is no special point.
        """
        if not self.tests:
            return []
        start, end = step.at(0.0).point, step.at(length).point
        before = self._last[1] if self._last and self._last[0] is start else self._values(start)
        after = self._values(end)
        self._last = end, after
        found = []
        for test, first, last in zip(self.tests, before, after, strict=True):
            if first is None or last is None or (first < 0.0) == (last < 0.0):
                continue
            position = self._locate(test, step, length, max(abs(first), abs(last)))
            if position is not None:
                found.append((position, test, step.at(position).point))
        return found

    def _locate(
        self, test: FunctionTest, step: PredictorStep[P], length: float, size: float
    ) -> float | None:
        """Return the position of a zero; None at a jump, or at an end of the domain."""

        def value(point: P) -> float:
            found = test.value(self.equations, point, step.direction)
            if found is None:
                raise ValueError(test)
            return found

        try:
            position = step.zero(value, length)
            return (
                position if abs(value(step.at(position).point)) <= MAX_EVENT_RATIO * size else None
            )
        except ValueError:
            return None

    def _values(self, point: P) -> list[float | None]:
        return [test.value(self.equations, point, np.zeros(1)) for test in self.tests]
