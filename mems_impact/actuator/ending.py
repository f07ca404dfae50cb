"""An actuator whose run ends where a function of the user's falls through zero."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any, NoReturn, Self

import numpy as np

from mems_impact.actuator.drives import Drive
from mems_impact.actuator.ledger import NO_LEDGER
from mems_impact.actuator.parameters import PARAMETER_NAMES, PARAMETER_UNITS, Actuator
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis import given
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.columns import weight_of
from mems_impact.hybrid.portable import reference
from mems_impact.hybrid.problem import Numbers
from mems_impact.hybrid.record import ENDS
from mems_impact.hybrid.written import GENERATED, RATE_STEP, function, named
from mems_impact.units import Scales

__all__ = ["EndedSystem", "ended"]

Function = Callable[..., Any]


class EndedSystem(ActuatorSystem):
    """An actuator under a drive whose runs end where ``until(mode, t, y, p)`` falls through zero.

    The function is called in the units of the device, with the states and the eleven parameters by
    name. The place of the frame is counted from the start, so that a run may end there.
    """

    until: Function

    def _key(self) -> tuple[Any, ...]:
        return *super()._key(), self.until

    def _with(self, actuator: Actuator, drive: Drive, scales: Scales) -> Self:
        other = super()._with(actuator, drive, scales)
        other.until = self.until
        return other

    @property
    def unended(self) -> ActuatorSystem:
        """The actuator without what ends its runs."""
        return self._as(ActuatorSystem)

    @property
    def told_by_numbers(self) -> bool:
        """Never: a file cannot hold the function."""
        return False

    @property
    def functions(self) -> dict[str, str]:
        """Where the function is defined, and those of the drive that are not the package's own."""
        return {**super().functions, "until": reference(self.until)}

    def ending(self, until: Function) -> EndedSystem:
        """Return the actuator whose runs end by another function."""
        return ended(self, until)

    def with_energy(self) -> NoReturn:
        """Refuse: its studies run to no end of their own."""
        raise InvalidParameter("until", self.until, "", problem=NO_LEDGER)

    @property
    def automaton(self) -> Automaton:
        """The actuator's, with one guard more."""
        base, numbers = super().automaton, super().numbers()
        units = [float(self.out(name, 1.0)) for name in base.states]
        scales = self.scales
        kinds = (PARAMETER_UNITS.get(name) for name in PARAMETER_NAMES)
        sizes = [float(scales.out(1.0, unit)) if unit else 1.0 for unit in kinds]
        time, count = float(scales.out(1.0, "s")), len(numbers.parameters)
        step = RATE_STEP * (numbers.time_scale or numbers.period)
        return _ended(base, self.until, (*units, time, *sizes), count, step)

    @property
    def states(self) -> tuple[str, ...]:
        """Names of the components of the state."""
        return super().automaton.states

    def numbers(self, changes: Mapping[str, float] | None = None) -> Numbers:
        """Return the actuator's, with room for scratch behind them."""
        found = super().numbers(changes)
        scratch = np.zeros(2 * len(self.states))
        return found._replace(parameters=np.concatenate([found.parameters, scratch]))


def ended(system: ActuatorSystem, until: Function) -> EndedSystem:
    """Return the system whose runs end where `until` falls through zero.

    Raises
    ------
    InvalidParameter
        If it is no function of four arguments.
    """
    given.function("until", until, *given.ARGUMENTS)
    other = system._as(EndedSystem)
    other.until = until
    return other


@cache
def _ended(
    base: Automaton, until: Function, units: tuple[float, ...], count: int, step: float
) -> Automaton:
    """Return an automaton with one guard more, which ends the run.

    Parameters
    ----------
    base : Automaton
    until : callable
    units : tuple of float
        Of the states, of time and of the parameters, in those of the numerics.
    count : int
        Numbers of the system; twice as many as there are states stand behind them, as scratch.
    step : float
        Of the differences that give the rate.
    """
    n, m = len(base.states), len(base.guards)
    margin = _in_units_of_the_user(until, base.states, units)
    flow, margins, transition = base.flow, base.margins, base.transition

    def more_margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        margins(mode, t, y, p, g, r)
        slope, moved = p[count : count + n], p[count + n : count + 2 * n]
        flow(mode, t, y, p, slope)
        g[m] = margin(mode, t, y, p)
        r[m] = 0.0
        for point in range(1, 4):
            for sign in (-1.0, 1.0):
                for i in range(n):
                    moved[i] = y[i] + sign * point * step * slope[i]
                there = margin(mode, t + sign * point * step, moved, p)
                r[m] += sign * weight_of(point) * there / step

    def with_end(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        if code == m or code == 2 * m + 1:
            return ENDS
        # Codes of resting, and of a switch of the drive, stand behind one guard more, or two.
        own = code - 2 if code == 2 * m + 2 else (code - 1 if code > m else code)
        return transition(mode, own, t, y, p)

    last = max(guard.order or 0 for guard in base.guards)
    return replace(
        base,
        guards=(*base.guards, Guard("until", order=last + 1)),
        margins=more_margins,
        transition=with_end,
        cyclic=(),  # a run may end where the frame has come to a place
        bounds=True,
        recipe=(_ended, (base, until, units, count, step)),
    )


def _in_units_of_the_user(
    until: Function, states: tuple[str, ...], units: tuple[float, ...]
) -> Function:
    """Return `until` as a function of arrays of numbers as the numerics have them."""
    n = len(states)
    y = ", ".join(f"y[{i}] * {units[i]!r}" for i in range(n))
    p = ", ".join(f"p[{i}] * {unit!r}" for i, unit in enumerate(units[n + 1 :]))
    space: dict[str, Any] = {
        "__name__": __name__,
        "until": until,
        "State": named("State", states),
        "Parameters": named("Parameters", PARAMETER_NAMES),
    }
    line = f"return until(mode, t * {units[n]!r}, State({y}), Parameters({p}))"
    exec(compile(function("margin(mode, t, y, p)", [line]), GENERATED, "exec"), space)
    margin: Function = space["margin"]
    return margin
