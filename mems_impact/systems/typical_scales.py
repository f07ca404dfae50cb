"""Typical scales of states, and warnings about poor ones."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.quantities import base_powers, factors
from mems_impact._util.warning_scopes import warn
from mems_impact.errors import InvalidParameter, ScaleWarning
from mems_impact.hybrid.definition import (
    Definition,
    Typical,
    named_tuple,
    power_of_two,
    writes_into_arrays,
)
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.tangents import STEP
from mems_impact.integrators.options import Options
from mems_impact.systems.observables import EventObserver

# --- Warnings about poor scaling

MIN_STATE_TOLERANCES = 1e3  # smallest magnitude of a well-scaled state, in absolute tolerances
MIN_STEP_RATIO = 1e-4  # smallest mean step, relative to the assumed time scale
SAMPLES_BETWEEN_EVENTS = 64  # between events
SHORTEST_RUN = 1e-6  # periods; a shorter run has states at one instant
ORDER_ONE = (1e-5, 1e5)  # periods that suit the tolerances of event times
STATE_ROUNDING = 1e-12  # smaller states are errors of Newton's method


class SizeMonitor(EventObserver):
    """The sizes of states and steps of a run without typical magnitudes.

    The system defines a period or a time scale if `timed`.
    """

    def __init__(self, options: Options, start: HybridState, *, timed: bool) -> None:
        self.options, self.timed, self.sizes = options, timed, np.abs(start.y)

    def __call__(self, events: Events) -> None:
        """Process a chunk of events."""
        for y in (events.before, events.after):
            if len(y):
                np.maximum(self.sizes, np.abs(y).max(axis=0), out=self.sizes)

    def warn(self, trajectory: Trajectory) -> None:
        """Warn if a state stays below the resolution of `atol`, or if steps are tiny."""
        limit = MIN_STATE_TOLERANCES * self.options.atol
        sizes = np.maximum(self.sizes, np.abs(trajectory.final.y))
        if ((sizes > 0.0) & (sizes < limit)).any():
            # A speed may be zero at all events, if they are turning points.
            sizes = np.maximum(sizes, between(trajectory))
        small = {
            name: decade(float(size))
            for name, size in zip(trajectory.automaton.states, sizes, strict=True)
            if 0.0 < size < limit
        }
        start, final, period = trajectory.start, trajectory.final, trajectory.period
        length = (final.cycle - start.cycle) * period + final.time - start.time
        step = length / trajectory.steps if trajectory.steps else 1.0
        if small:
            stay = " and ".join(f"{name} stays below {size:.0e}" for name, size in small.items())
            problem = f"{stay}, poorly resolved by atol = {self.options.atol:g}"
            _warn(problem, small)
        elif not self.timed and 0.0 < step < MIN_STEP_RATIO:
            step = decade(step)
            problem = f"steps are below {step:.0e}, although the time scale is assumed to be 1"
            _warn(problem, {"time": 10.0 * step})


def warn_if_badly_scaled_orbit(period: float) -> None:
    """Warn if the period is too large or small for the absolute tolerances of event times."""
    low, high = ORDER_ONE
    if not low < period < high:
        problem = f"the period = {period:.1e}: far from order one, which tolerances of times assume"
        _warn(problem, {"time": period})


def warn_if_below_differences(
    states: tuple[str, ...], sizes: Floats, trajectory: Callable[[], Trajectory]
) -> None:
    """Warn if a state is smaller than the step of the differences for multipliers and exponents.

    `sizes`, shape (n,), are magnitudes of the states at some instants of a motion. `trajectory`
    returns a run along the motion, whose sizes are included if some are small.
    """

    def small() -> NDArray[np.bool_]:
        return (sizes > STATE_ROUNDING) & (sizes < STEP)

    if small().any():  # a speed may be zero at these instants
        sizes = np.maximum(sizes, between(trajectory()))
    far = {states[i]: decade(float(sizes[i])) for i in np.flatnonzero(small())}
    if far:
        stay = " and ".join(f"{name} stays below {size:.0e}" for name, size in far.items())
        _warn(f"{stay}, but finite differences take steps of {STEP:.0e}", far)


def between(trajectory: Trajectory) -> Floats:
    """Return the largest magnitudes of the states in the first two periods, between events too."""
    start, final, period = trajectory.start, trajectory.final, trajectory.period
    first, last = (each.cycle + each.time / period for each in (start, final))
    length = min(2.0, last - first)
    if length <= SHORTEST_RUN:
        return np.maximum(np.abs(start.y), np.abs(final.y))
    samples = trajectory.samples(math.ceil(SAMPLES_BETWEEN_EVENTS / length), last=first + length).y
    return np.abs(samples).max(axis=0, initial=0.0)


def decade(size: float) -> float:
    """Return the power of ten above a magnitude, so that a sweep repeats no warning."""
    return float(10.0 ** math.ceil(math.log10(size)))


def _warn(problem: str, sizes: Mapping[str, float]) -> None:
    pairs = ", ".join(f"{name!r}: {size:.0e}" for name, size in sizes.items())
    message = f"{problem}; give typical magnitudes, for example System(typical={{{pairs}}})"
    warn(message, ScaleWarning, problem)


# --- Scales of variables from typical magnitudes by name or unit

# Derived SI units as powers of base units, without angles.
DERIVED: dict[str, dict[str, int]] = {
    unit: {base: power for base, power in base_powers(unit).items() if base != "rad"}
    for unit in ("rad", "Hz", "N", "Pa", "J", "W", "C", "V", "ohm", "F", "H", "T", "Wb")
}


def of_units(unit: str, sizes: Mapping[str, float]) -> float | None:
    """Return the typical magnitude of a unit such as "m/s^2", from the magnitudes of other units.

    All units after a slash divide. None unless each unit in it has a magnitude.
    """
    if unit in sizes:
        return sizes[unit]
    size, determined = 1.0, False
    try:
        for name, power in factors(unit):
            base = {name: 1} if name in sizes else DERIVED.get(name, {name: 1})
            for each, times in base.items():
                size, determined = size * sizes[each] ** (power * times), True
    except KeyError:
        return None
    return size if determined else None


def typical_of(
    typical: Mapping[str, float],
    *,
    definition: Definition,
    values: Mapping[str, float],
    initial: Mapping[str, float],
    units: Mapping[str, str],
    time: float,
) -> Typical:
    """Return the scales of all variables.

    `typical` is by the names of states and parameters, "time", or units. By default typical are the
    `values` of the parameters, the `initial` states, where runs start, and `time`. Raises
    InvalidParameter if a name or unit is unknown.
    """
    names = {*definition.states, *definition.parameters, "time"}
    symbols = {part for unit in units.values() for part in re.findall(r"[A-Za-z]+", unit)}
    base = {name for part in symbols for name in (part, *DERIVED.get(part, ()))}
    for name in typical:
        if name not in names | base | set(units.values()):
            allowed = f"typical magnitudes of {', '.join(sorted(names))}, or of units"
            raise InvalidParameter("typical", name, allowed)

    sizes = {name: size for name, size in typical.items() if name not in names}

    def size_of(name: str, otherwise: float) -> float:
        size = typical.get(name)
        if size is None and sizes and name in units:
            size = of_units(units[name], sizes)
        return power_of_two(otherwise if size is None else size)

    time = size_of("time", time)
    if sizes:
        sizes.setdefault(units.get("time", "s"), time)
    result = Typical(
        states=tuple(size_of(name, initial.get(name, 1.0)) for name in definition.states),
        # Parameters vary in continuation: by default their own magnitude is typical.
        parameters=tuple(size_of(name, value) for name, value in values.items()),
        time=time,
    )
    start = [initial.get(name, 0.0) for name in definition.states]
    margins = {
        guard.name: _size_of_margin(definition, guard, result.states, start, values)
        for guard in definition.guards
    }
    return replace(result, margins=tuple(margins.items()))


def _size_of_margin(
    definition: Definition,
    guard: Any,
    sizes: tuple[float, ...],
    start: list[float],
    values: Mapping[str, float],
) -> float:
    """Return the change of a margin if each state changes by its typical magnitude.

    The margin is evaluated near the initial state; 1 if the margin fails there.
    """
    p = named_tuple("Parameters", tuple(values))(*values.values())
    mode = int(guard.modes[0]) if guard.modes else 0
    total = 0.0
    for j, size in enumerate(sizes):
        ends = []
        for sign in (-0.5, 0.5):
            y: Any = [value + sign * size * (i == j) for i, value in enumerate(start)]
            if not writes_into_arrays(definition.flow):
                y = named_tuple("State", definition.states)(*y)
            try:
                ends.append(guard.margin(mode, 0.0, y, p))
            except (ArithmeticError, ValueError):
                return 1.0
        total += abs(ends[1] - ends[0])
    return power_of_two(total) if math.isfinite(total) else 1.0
