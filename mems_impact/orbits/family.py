"""Families of problems: problems as functions of named parameters."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.differences import sixth_order_difference
from mems_impact.hybrid.problem import Problem, ProblemParameters

RELATIVE_STEP = 3e-3  # difference step of the derivatives by a value, relative to it


@dataclass(frozen=True)
class Family(ABC):
    """A problem for every set of values of its named parameters.

    The parameter array, the period and the switching times must be smooth in the values.
    """

    values: Mapping[str, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def __reduce__(self) -> Any:
        """Pickle the values as a dict: a mapping proxy cannot be."""
        rest = (getattr(self, each.name) for each in fields(self)[1:])
        return type(self), (dict(self.values), *rest)

    @property
    @abstractmethod
    def automaton(self) -> Automaton:
        """The automaton, which does not depend on the values."""

    @abstractmethod
    def problem(self) -> Problem:
        """Return the problem at the present values."""

    @abstractmethod
    def with_method(self, method: str) -> Self:
        """Return the family integrated by another method."""

    def numbers(self, /, **changes: float) -> ProblemParameters:
        """Return the part of the problem that depends on the values, at some other values.

        Corrections and finite differences call it thousands of times, so a subclass should avoid
        building a problem.
        """
        return self.at(**changes).problem().numbers

    def at(self, /, **changes: float) -> Self:
        """Return the family at other values; raise InvalidParameter for an unknown name."""
        differs = [self.value(name) != value for name, value in changes.items()]
        return replace(self, values={**self.values, **changes}) if any(differs) else self

    def suited(self, stiff: bool) -> Self:
        """Return the family with a fixed method in place of ``"auto"``.

        An orbit uses one method, so that steps of Newton's method do not change it.
        """
        if self.problem().options.method != "auto":
            return self
        return self.with_method("bdf" if stiff else "dop853")

    def value(self, name: str) -> float:
        """Return the present value of a parameter; raise InvalidParameter for an unknown name."""
        if name not in self.values:
            names = ", ".join(self.values)
            raise InvalidParameter(field="parameter", value=name, allowed=f"one of {names}")
        return self.values[name]

    def amount(self, heading: str, value: float) -> str:
        """Return a number in the system's units, as text."""
        return f"{value:.9g}"

    def convert(self, error: RunError) -> None:  # noqa: B027 - there may be no other units
        """Convert the numbers in an error of a run to the system's units."""

    @cached_property
    def _sizes(self) -> tuple[int, int]:
        numbers = self.numbers()
        return len(numbers.switches), len(numbers.parameters)

    def check_switches(self, numbers: ProblemParameters) -> None:
        """Raise OrbitError unless the forcing has as many pieces as at the present values."""
        (count, size), (own_count, own_size) = (
            (len(numbers.switches), len(numbers.parameters)), self._sizes,
        )  # fmt: skip
        if count != own_count:
            reason = f"the forcing has {count} switching times there instead of {own_count}"
            raise OrbitError(reason, "find an orbit beyond, and continue it")
        if size != own_size:
            reason = "the forcing has another number of pieces there"
            raise OrbitError(reason, "choose a value at which neighbours have as many")

    def derivative(self, name: str) -> tuple[Floats, float, Floats]:
        """Return the derivatives of parameter array, period and switching times by a value.

        Central differences of sixth order, whose error is below 1e-13 for a period that is the
        inverse of a frequency.
        """
        value = self.value(name)
        h = RELATIVE_STEP * (abs(value) if value != 0.0 else 1.0)

        count = 0  # of the parameter array

        def numbers(step: float) -> Floats:
            nonlocal count
            shifted = self.numbers(**{name: value + step})
            self.check_switches(shifted)
            count = len(shifted.parameters)
            return np.concatenate([shifted.parameters, shifted.switches, [shifted.period]])

        rates = sixth_order_difference(numbers, h)
        return rates[:count], float(rates[-1]), rates[count:-1]


# --- Numbers of a problem at values of the active parameters

MAX_PERIOD_RATIO = (
    4.0 / 3.0
)  # largest ratio of continuous periods: a sine without bias has half the period
PERIOD_BISECTIONS = 40  # of the interval between two values, to distinguish a jump of the period


@dataclass(frozen=True, eq=False)
class ParameterPoint:
    """A problem's numbers at some values of k parameters, with derivatives (rates) by these."""

    values: Floats  # shape (k,)
    parameters: Floats  # shape (count,)
    # Derivatives of the parameter array, shape (max(1, k), count), each divided by its scale, for
    # differences along unit directions.
    directions: Floats
    scales: Floats  # shape (k,)
    period: float
    period_rates: Floats  # shape (k,)
    switches: Floats  # shape (s,)
    switch_rates: Floats  # shape (k, s)
    time_scale: float  # characteristic time of the forcing

    @classmethod
    def of(cls, family: Family, active: tuple[str, ...], values: Floats) -> ParameterPoint:
        """Return the numbers at `values` of the parameters `active`."""
        shifted = family.at(**dict(zip(active, values.tolist(), strict=True)))
        numbers = shifted.numbers()
        family.check_switches(numbers)
        p, switches = np.asarray(numbers.parameters, dtype=float), np.array(numbers.switches)
        k = len(active)
        directions = np.zeros((max(1, k), p.size))
        scales, period_rates, switch_rates = np.ones(k), np.zeros(k), np.zeros((k, switches.size))
        for j, name in enumerate(active):
            p_rate, period_rates[j], rates = shifted.derivative(name)
            switch_rates[j] = rates[: switches.size]
            scales[j] = float(np.abs(p_rate).max()) or 1.0
            directions[j] = p_rate / scales[j]
        scale = numbers.time_scale or numbers.period
        return cls(
            values, p, directions, scales, numbers.period, period_rates, switches, switch_rates,
            scale,
        )  # fmt: skip

    def check_period(self, family: Family, active: tuple[str, ...], near: ParameterPoint) -> None:
        """Raise OrbitError if the forcing period jumps between `near` and here."""
        if _similar(near.period, self.period):
            return
        (begin, first), (end, last) = (near.values, near.period), (self.values, self.period)
        for _ in range(PERIOD_BISECTIONS):
            middle = 0.5 * (begin + end)
            between = dict(zip(active, middle.tolist(), strict=True))
            period = family.numbers(**between).period
            if not _similar(first, period):
                end, last = middle, period
            elif not _similar(period, last):
                begin, first = middle, period
            else:
                return
        raise OrbitError(
            reason=f"the period jumps from {family.amount('period', first)} to "
            f"{family.amount('period', last)} here",
            remedy="stay on this side (a sine without bias has half the period)",
        )

    def with_period(self, period: float) -> ParameterPoint:
        """Return the numbers for a limit cycle with a given period."""
        return replace(self, period=period, period_rates=np.zeros_like(self.period_rates))


def _similar(one: float, other: float) -> bool:
    return 1.0 / MAX_PERIOD_RATIO < other / one < MAX_PERIOD_RATIO
