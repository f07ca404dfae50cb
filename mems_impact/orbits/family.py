"""Problems that depend on named parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from mems_impact.errors import InvalidParameter, RunError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.columns import weight_of
from mems_impact.hybrid.problem import Numbers, Problem
from mems_impact.hybrid.trajectory import Floats

RELATIVE_STEP = 3e-3  # of the differences that give dp/dvalue and dperiod/dvalue


@dataclass(frozen=True)
class Family:
    """A problem for every set of values of its named parameters.

    Parameters
    ----------
    build : callable
        ``build(values)`` returns the `Problem` for a mapping from names to values. The parameter
        array, the period and the switching times must be smooth in the values.
    values : mapping of str to float
        Names and present values.

    Notes
    -----
    Where `build` has an attribute ``automaton``, this is the automaton of all its problems. Where
    it has a method ``numbers(values)``, this returns the `Numbers` of a problem without making one:
    corrections and differences by a parameter ask for them by thousands. Where it has a method
    ``by(method)``, this returns what builds the same problems for another method of integration;
    ``amount(heading, value)`` and ``convert(error)`` tell numbers in the units of the user.
    """

    build: Callable[[Mapping[str, float]], Problem]
    values: Mapping[str, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", MappingProxyType(dict(self.values)))

    def __reduce__(self) -> Any:
        """Pickle the values as a dict: a mapping proxy cannot be."""
        return Family, (self.build, dict(self.values))

    def at(self, /, **changes: float) -> Family:
        """Return the family at other values.

        Raises
        ------
        InvalidParameter
            If a name is not one of the family's.
        """
        for name in changes:
            self.value(name)
        return Family(self.build, {**self.values, **changes})

    def by(self, method: str) -> Family:
        """Return the family integrated by another method."""
        known: Callable[[str], Callable[[Mapping[str, float]], Problem]] | None
        known = getattr(self.build, "by", None)
        build = _By(self.build, method) if known is None else known(method)
        return Family(build, self.values)

    def suited(self, stiff: bool) -> Family:
        """Return the family, integrated by one method where that was left open (``"auto"``).

        An orbit keeps to one method, lest a step of Newton's method change it.
        """
        if self.problem().options.method != "auto":
            return self
        return self.by("bdf" if stiff else "dop853")

    def value(self, name: str) -> float:
        """Return the present value of a parameter.

        Raises
        ------
        InvalidParameter
            If the name is not one of the family's.
        """
        if name not in self.values:
            known = ", ".join(self.values)
            raise InvalidParameter(field="parameter", value=name, allowed=f"one of {known}")
        return self.values[name]

    def amount(self, heading: str, value: float) -> str:
        """Return a number in the units of the user, to be printed."""
        known: Callable[[str, float], str] | None = getattr(self.build, "amount", None)
        return f"{value:.9g}" if known is None else known(heading, value)

    def convert(self, error: RunError) -> None:
        """Let an error of a run tell all in the units of the user."""
        known: Callable[[RunError], None] | None = getattr(self.build, "convert", None)
        if known is not None:
            known(error)

    @property
    def automaton(self) -> Automaton:
        """The automaton, which does not depend on the values."""
        known: Automaton | None = getattr(self.build, "automaton", None)
        return self.problem().automaton if known is None else known

    def problem(self) -> Problem:
        """Return the problem at the present values."""
        return self.build(self.values)

    def numbers(self, /, **changes: float) -> Numbers:
        """Return what of the problem depends on the values, at some other ones."""
        values = {**self.values, **changes}
        return _numbers_of(self.build, values)

    def derivative(self, name: str) -> tuple[Floats, float, Floats]:
        """Return the derivatives of parameter array, period and switching times by a value.

        Central differences of sixth order, whose error is below 1e-13 for a period that goes with
        the inverse of a frequency.
        """
        value = self.value(name)
        h = RELATIVE_STEP * (abs(value) if value != 0.0 else 1.0)
        p: Floats | float = 0.0
        period = 0.0
        switches: Floats | float = 0.0
        for s in (1, 2, 3):
            up = self.numbers(**{name: value + s * h})
            down = self.numbers(**{name: value - s * h})
            w = weight_of(s) / h
            p = p + w * (np.asarray(up.parameters) - np.asarray(down.parameters))
            period += w * (up.period - down.period)
            switches = switches + w * (np.array(up.switches) - np.array(down.switches))
        return np.asarray(p, dtype=float), period, np.atleast_1d(np.asarray(switches, dtype=float))


def _numbers_of(
    build: Callable[[Mapping[str, float]], Problem], values: Mapping[str, float]
) -> Numbers:
    known: Callable[[Mapping[str, float]], Numbers] | None = getattr(build, "numbers", None)
    return build(values).numbers if known is None else known(values)


@dataclass(frozen=True)
class _By:
    """What builds the same problems, to be integrated by another method."""

    build: Callable[[Mapping[str, float]], Problem]
    method: str

    def __call__(self, values: Mapping[str, float]) -> Problem:
        problem = self.build(values)
        return replace(problem, options=replace(problem.options, method=self.method))

    def numbers(self, values: Mapping[str, float]) -> Numbers:
        return _numbers_of(self.build, values)
