"""A definition in other units: what the numerics integrate where a system is far from order one.

The numerics count every state, parameter and margin, and the time, in units of their own, all
powers of two. So a user's function is called with numbers that differ from those of the numerics by
exact factors: nothing is rounded on the way there or back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.written import (
    GENERATED,
    Definition,
    function,
    indented,
    named,
    writes_into_arrays,
)

__all__ = ["Typical", "power_of_two", "scaled"]


@dataclass(frozen=True, kw_only=True)
class Typical:
    """The units of the numerics, in those of the user.

    Attributes
    ----------
    states, parameters : tuple of float
    time : float
    margins : tuple of (str, float)
        By the names of guards; 1 for those that are not there.
    """

    states: tuple[float, ...]
    parameters: tuple[float, ...]
    time: float
    margins: tuple[tuple[str, float], ...] = ()


def power_of_two(value: float) -> float:
    """Return the power of two that is nearest to a size; 1 where there is none."""
    size = abs(value)
    return 2.0 ** round(math.log2(size)) if 0.0 < size < math.inf else 1.0


@cache
def scaled(definition: Definition, typical: Typical) -> Definition:
    """Return a definition whose functions count in other units; the same one for the same two."""
    return _Text(definition, typical).scaled()


class _Text:
    """The source of functions around those of the user."""

    def __init__(self, definition: Definition, typical: Typical) -> None:
        self.definition, self.typical = definition, typical
        self.n = len(definition.states)
        self.by_array = writes_into_arrays(definition.flow)
        self.space: dict[str, Any] = {
            "__name__": __name__,
            "SIZE": typical.states,
            "Parameters": named("Parameters", definition.parameters),
        }
        if not self.by_array:
            self.space["State"] = named("State", definition.states)

    def scaled(self) -> Definition:
        """Return the definition of the functions."""
        definition, margins = self.definition, dict(self.typical.margins)
        guards = []
        for i, guard in enumerate(definition.guards):
            size = margins.get(guard.name, 1.0)
            new: dict[str, Any] = {
                "margin": self.number(f"margin_{i}", guard.margin, 1.0 / size),
                "rate": self.number(f"rate_{i}", guard.rate, self.typical.time / size),
                "transition": self.change(f"transition_{i}", guard.transition),
                "rest": self.change(f"rest_{i}", guard.rest),
            }
            made: Guard = replace(guard, **new)
            guards.append(made)
        return replace(
            definition,
            guards=tuple(guards),
            flow=self.flow(),
            settle=self.change("settle", definition.settle),
            projection=self.change("projection", definition.projection),
            jacobian=self.jacobian(),
            sizes=(*self.typical.states, self.typical.time),
            constraints=tuple(
                (mode, self.value(f"constraint_{i}", each, 1.0))
                for i, (mode, each) in enumerate(definition.constraints)
            ),
        )

    def make(self, name: str, arguments: str, lines: Sequence[str]) -> Callable[..., Any]:
        """Return a function of these lines."""
        exec(compile(function(f"{name}({arguments})", lines), GENERATED, "exec"), self.space)
        made: Callable[..., Any] = self.space[name]
        return made

    def call(self, name: str, given: Callable[..., Any], rest: str = "") -> str:
        """Return the call of a user's function, in the units of the user."""
        self.space[f"{name}_of"] = given
        time = f"t * {self.typical.time!r}"
        p = ", ".join(f"p[{i}] * {size!r}" for i, size in enumerate(self.typical.parameters))
        y = ", ".join(f"y[{i}] * {size!r}" for i, size in enumerate(self.typical.states))
        state = "y" if self.by_array else f"State({y})"
        return f"{name}_of(mode, {time}, {state}, Parameters({p}){rest})"

    def around(self, lines: Sequence[str], *arrays: str) -> list[str]:
        """Return lines for which arrays are in the units of the user, and then as they were."""
        if not self.by_array:
            return list(lines)
        there = [f"    {array}[k] *= SIZE[k]" for array in arrays]
        back = [f"    {array}[k] /= SIZE[k]" for array in arrays]
        loop = f"for k in range({self.n}):"
        return [loop, *there, *lines, loop, *back]

    def flow(self) -> Callable[..., Any]:
        """Return the flow: derivatives by the time of the numerics."""
        time = self.typical.time
        if self.by_array:
            call = self.call("flow", self.definition.flow, ", dy")
            slopes = [f"for k in range({self.n}):", f"    dy[k] *= {time!r} / SIZE[k]"]
            return self.make("flow", "mode, t, y, p, dy", [*self.around([call], "y"), *slopes])
        rates = ", ".join(f"d[{i}] * {time / size!r}" for i, size in enumerate(self.typical.states))
        lines = [f"d = {self.call('flow', self.definition.flow)}", f"return ({rates},)"]
        return self.make("flow", "mode, t, y, p", lines)

    def number(
        self, name: str, given: Callable[..., Any] | None, unit: float
    ) -> Callable[..., Any] | None:
        """Return a margin or a rate."""
        return None if given is None else self.value(name, given, unit)

    def value(self, name: str, given: Callable[..., Any], unit: float) -> Callable[..., Any]:
        """Return what gives one number."""
        lines = self.around([f"value = {self.call(name, given)}"], "y")
        return self.make(name, "mode, t, y, p", [*lines, f"return value * {unit!r}"])

    def change(self, name: str, given: Callable[..., Any] | None) -> Callable[..., Any] | None:
        """Return a transition."""
        if given is None:
            return None
        if self.by_array:
            lines = self.around([f"after = {self.call(name, given, ', new')}"], "y", "new")
            return self.make(name, "mode, t, y, p, new", [*lines, "return after"])
        new = ", ".join(f"new[{i}] * {1.0 / size!r}" for i, size in enumerate(self.typical.states))
        lines = [f"after, new = {self.call(name, given)}", f"return after, ({new},)"]
        return self.make(name, "mode, t, y, p", lines)

    def jacobian(self) -> Callable[..., Any] | None:
        """Return the derivatives of the flow by the states."""
        given = self.definition.jacobian
        if given is None:
            return None
        units = [
            f"for i in range({self.n}):",
            *indented([f"for j in range({self.n}):"]),
            f"        entries[i, j] *= {self.typical.time!r} * SIZE[j] / SIZE[i]",
        ]
        lines = [*self.around([self.call("jacobian", given, ", entries")], "y"), *units]
        return self.make("jacobian", "mode, t, y, p, entries", lines)
