"""A problem: automaton, parameters and period."""

from __future__ import annotations

import itertools
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.availability import available_options
from mems_impact.integrators.options import Options

Section = tuple[int, float, int]  # component, level, direction of the crossing (0: both)


class ProblemParameters(NamedTuple):
    """The part of a problem that depends on the values of its parameters."""

    parameters: Any
    period: float
    switches: tuple[float, ...]
    time_scale: float | None


@dataclass(frozen=True, kw_only=True)
class Problem:
    """An automaton with everything that is constant along a run.

    A run works in any units. Orbits need time and states of order one, which the differences of
    `mems_impact.hybrid.variational.derivatives` assume.
    """

    automaton: Automaton
    parameters: Any  # ``p`` of the automaton's functions
    # Unit of run lengths: the period of the drive, or any time for an autonomous system.
    period: float
    # Times in (0, period] at which flow or margins jump; without forcing, any times above 0.
    switches: tuple[float, ...] = ()
    # Component, level and direction: record crossings of ``y[component] = level``; direction 0 for
    # both.
    section: Section | None = None
    # By default a method that suits the automaton; another method or engine replaces one that this
    # machine lacks.
    options: Options = field(default_factory=Options)
    # Time that resolves the forcing and the vector field; the period by default.
    time_scale: float | None = None
    # Why the problem cannot be run: the functions of its automaton are missing.
    unavailable_reason: str = ""
    # ``discontinuity_check(at, length)`` is called if a step of a run collapses without an event
    # nearby, with the state at its start; it warns if the flow is discontinuous there, and returns
    # whether it is.
    discontinuity_check: Callable[[HybridState, float], bool] | None = field(
        default=None, compare=False, repr=False
    )

    # ``mode_failure(code, at)`` returns why no mode fits a state, by the code that the transition
    # returned, and the remedy.
    mode_failure: Callable[[int, HybridState], tuple[str, str]] | None = field(
        default=None, compare=False, repr=False
    )

    def __post_init__(self) -> None:
        if not isinstance(self.options, Options):
            raise InvalidParameter("options", self.options, "Options(…)")
        options = self.options.suited(self.automaton.stiff)
        if not self.unavailable_reason:
            options = available_options(options)
        object.__setattr__(self, "options", options)
        check_times(self.numbers, forced=self.automaton.forced)

    def with_time_unit(self, period: float) -> Problem:
        """Return the same problem with another unit of run lengths.

        For autonomous systems only. The original unit still bounds the steps.
        """
        return replace(self, period=period, time_scale=self.time_scale or self.period)

    def parameters_at(self, cycle: int) -> Floats:
        """Return the parameters with the time base at the start of a period."""
        p = np.array(self.parameters, dtype=float)
        if self.automaton.clock is not None:
            p[self.automaton.clock] = cycle * self.period
        return p

    @property
    def numbers(self) -> ProblemParameters:
        """The values of the parameters, and the times that depend on the parameters."""
        return ProblemParameters(self.parameters, self.period, self.switches, self.time_scale)


def check_times(
    numbers: ProblemParameters, size: float = 1.0, unit: str = "", *, forced: bool
) -> None:
    """Raise InvalidParameter if times are invalid; the message has them in a unit of `size`."""
    # The time scale first, which is the period of a system without one.
    for name, time in (("time_scale", numbers.time_scale), ("period", numbers.period)):
        if time is not None and not (math.isfinite(time) and time > 0.0):
            raise InvalidParameter(field=name, value=time * size, allowed="finite and above 0")
    switches, last = numbers.switches, numbers.period if forced else sys.float_info.max
    if not all(
        a < b for a, b in itertools.pairwise((0.0, *switches, math.nextafter(last, math.inf)))
    ):
        allowed = "ascending times above 0"
        if forced:
            allowed += f" and up to the period, {numbers.period * size:.6g} {unit}".rstrip()
        times = tuple(time * size for time in switches)
        raise InvalidParameter(field="switches", value=times, allowed=allowed)
