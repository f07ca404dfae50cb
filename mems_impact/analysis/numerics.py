"""From the functions and numbers of a user to those of the numerics, and back."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mems_impact.analysis import given
from mems_impact.analysis.observable import Observable
from mems_impact.analysis.shown import Shown
from mems_impact.errors import FunctionError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.blaming import line_of
from mems_impact.hybrid.observed import Observed, observed
from mems_impact.hybrid.problem import Numbers, Problem, Section
from mems_impact.hybrid.scaling import Typical, scaled
from mems_impact.hybrid.trajectory import Events, Floats
from mems_impact.hybrid.written import (
    RATE_STEP,
    Definition,
    hidden_parameters,
    named,
    writes_into_arrays,
    written,
)
from mems_impact.tables.common import name_of

__all__ = ["Number", "Numerics"]

Number = float | Callable[..., float]


class Numerics(Shown):
    """A system whose user has written functions: they, and what the event loop gets of them.

    Where typical sizes are given, the numerics count in them; the functions never know.
    """

    _definition: Definition
    _parameters: dict[str, float]
    _period: Number | None
    _switches: Sequence[float] | Callable[..., Sequence[float]]
    _time_scale: Number | None
    _section: Section | None
    _typical: Typical | None = None
    _begin: Callable[..., int] | None = None

    @property
    def automaton(self) -> Automaton:
        """Modes, flow, guards and transitions, as the event loop takes them."""
        if self._typical is None:
            return written(self._definition)
        return written(scaled(self._definition, self._typical))

    @property
    def is_scaled(self) -> bool:
        """Whether the numerics count in typical sizes."""
        return self._typical is not None

    def factor(self, heading: str) -> float:
        """Return the unit of the numerics for what stands under a heading."""
        if self._typical is None:
            return super().factor(heading)
        sizes = self._typical
        found = dict(zip(self.states, sizes.states, strict=True), time=sizes.time)
        found |= zip(self._parameters, sizes.parameters, strict=True)
        return found.get(name_of(heading, found), 1.0)

    def margin_factor(self, guard: str) -> float:
        """Return the unit of the numerics for the margin of a guard."""
        sizes = dict(self._typical.margins) if self._typical else {}
        return sizes.get(guard, 1.0)

    @property
    def section(self) -> Section | None:
        """The Poincaré section: component, level, direction; in the units of the numerics."""
        if self._section is None:
            return None
        state, level, direction = self._section
        return state, self.into(self.states[state], level), direction

    def numbers(self, changes: Mapping[str, float] | None = None) -> Numbers:
        """Return what of the problem depends on the parameters, in the units of the numerics.

        Parameters
        ----------
        changes : mapping of str to float, optional
            Other values of some parameters, in the system's units, allowed or not: differences by
            a parameter at the end of its range look beyond it, as do trial steps.
        """
        p = self._named({**self._parameters, **(changes or {})}.values())
        time = self.factor("time")
        period = _in_units(given.number("period", self._period, p), time)
        scale = _in_units(given.number("time_scale", self._time_scale, p), time)
        tail = np.zeros(hidden_parameters(self._definition))
        unit = scale if scale is not None else period if period is not None else 1.0
        tail[0] = RATE_STEP * unit
        switches = given.times("switches", self._switches, p)
        return Numbers(
            parameters=np.concatenate([self._inner(p), tail]),
            period=period if period is not None else unit,
            switches=tuple(switch / time for switch in switches),
            time_scale=scale,
        )

    @property
    def forcing_period(self) -> float | None:
        """The forcing period; None for a system without forcing."""
        return given.number("period", self._period, self._named(self._parameters.values()))

    def mode_of(self, y: Floats, time: float, problem: Problem, mode: int = 0) -> int:
        """Return the mode of a state whose mode is not given; `y` may be put right.

        Where several fit, as within the hysteresis of a relay, it is `mode` if that is one of them.
        """
        if self._begin is None:
            return mode
        when, state = self.out("time", time), self._state(y)
        try:
            return int(self._begin(mode, when, state, self._outer(problem)))
        except ArithmeticError as error:
            raised, remedy = f"raises {type(error).__name__}: {error}", "give masses above 0"
            place = line_of(error.__traceback__, self._begin)
            if place[0]:  # in a function of the user's
                remedy = "let it have a value wherever a run starts"
            raise FunctionError("the flow with its parts", raised, remedy, *place) from error

    def fits(self, mode: int, y: Floats, problem: Problem) -> bool:
        """Return whether a state may be in a mode, as far as parts say: on its surface, at rest."""
        automaton = problem.automaton
        if mode in automaton.constrained:  # of a state that is there already
            p = np.asarray(problem.parameters, dtype=float)
            return automaton.transition(mode, automaton.switch_code, 0.0, y.copy(), p) == mode
        return self.mode_of(y, 0.0, problem, mode) == mode

    def measure(self, observable: Observable, y: Floats, problem: Problem) -> float:
        """Return an observable, which has a unit of its own, of a state of the numerics."""
        return float(observable.function(self._state(y), self._outer(problem)))

    def measure_event(
        self, observable: Observable, events: Events, i: int, problem: Problem
    ) -> float:
        """Return an observable, which has a unit of its own, at an event of the numerics."""
        p = self._outer(problem)
        before, after = self._state(events.before[i]), self._state(events.after[i])
        mode, time = int(events.mode_before[i]), float(self.out("time", events.time[i]))
        return float(observable.function(mode, time, before, after, p))

    @property
    def observed(self) -> Observed:
        """The observables that studies gather, as one function of the numerics."""
        guards = [guard.name for guard in self.automaton.guards]
        return observed(
            tuple(
                (each.name, each.function, tuple(guards.index(name) for name in each.at))
                for each in self.studied
            ),
            self.states,
            tuple(self._parameters),
            writes_into_arrays(self._definition.flow),
            self._typical,
        )

    def _named(self, values: Iterable[float]) -> Any:
        return named("Parameters", tuple(self._parameters))(*values)

    def _state(self, y: Floats) -> Any:
        """Return a state by name, as functions read it; as a list where they take an array."""
        values = (y if self._typical is None else y * np.array(self._typical.states)).tolist()
        if writes_into_arrays(self._definition.flow):
            return values
        return named("State", self.states)(*values)

    def _inner(self, p: Any) -> Floats:
        """Return parameters in the units of the numerics."""
        values = np.array(p, dtype=float)
        return values if self._typical is None else values / np.array(self._typical.parameters)

    def _outer(self, problem: Problem) -> Any:
        """Return the parameters of a problem by name, as functions read them."""
        values = problem.parameters[: len(self._parameters)]
        if self._typical is not None:
            values = values * np.array(self._typical.parameters)
        return self._named(values.tolist())

    def _own_time(self) -> float:
        """Return a time within which something happens, as far as it is known."""
        p = self._named(self._parameters.values())
        scale = given.number("time_scale", self._time_scale, p)
        period = given.number("period", self._period, p)
        return scale or (period or 2.0 * math.pi) / (2.0 * math.pi)


def _in_units(value: float | None, unit: float) -> float | None:
    return None if value is None else value / unit
