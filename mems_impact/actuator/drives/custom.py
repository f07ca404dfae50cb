"""Waveforms defined by functions of the user."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import cache
from itertools import pairwise
from types import FunctionType
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from mems_impact.actuator.drives.base import Drive, Waveform
from mems_impact.actuator.parameter_base import Given, OptionalPositive, Positive, Unit
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.pickling import portable, same_function

WAVEFORM_KIND = "a plain Python function of t and q"
VALUES_FORM = "a table of finite numbers by name"
TIMES_KIND = "ascending times in (0, period]"
PROBE_COUNT = 24  # times at which rate and period are checked
WAVEFORM_RTOL = 1e-6  # of the largest value


def _function(value: Any) -> Any:
    value = getattr(value, "py_func", value)  # of a function that numba compiled
    if not isinstance(value, FunctionType):
        raise ValueError(WAVEFORM_KIND)
    return value


def _pairs(value: Any) -> tuple[tuple[str, float], ...]:
    try:
        pairs = tuple((name, float(number)) for name, number in dict(value).items())
    except (TypeError, ValueError):
        raise ValueError(VALUES_FORM) from None
    if not all(isinstance(name, str) and math.isfinite(number) for name, number in pairs):
        raise ValueError(VALUES_FORM)
    return pairs


def _times(value: Any) -> tuple[float, ...]:
    try:
        return tuple(float(time) for time in value)
    except (TypeError, ValueError):
        raise ValueError(TIMES_KIND) from None


Function = Annotated[Any, BeforeValidator(_function), Field(description=WAVEFORM_KIND)]


class Custom(Drive):
    """A voltage defined by your own functions.

    Parameters
    ----------
    function : callable
        ``function(t, q)`` returns the voltage. It is plain Python on floats that numba compiles:
        `math`, arithmetic, branches, and functions of the same kind. The square of the voltage must
        have the given period; at a switch, the function returns the value after the switch.
    period : float
        Forcing period [s], > 0.
    values : mapping of str to float, optional
        Parameters of the functions by name, which a sweep may vary: ``q[0]``, ``q[1]``, … in this
        order.
    switches : sequence of float, optional
        Times in (0, period], ascending, at which the voltage or its rate jumps. The functions must
        compare t (less its whole periods) with the very same numbers.
    fastest : float, optional
        Characteristic time of the voltage, `period` by default: no step of the integration is
        longer than 1/16 of it.
    time_unit, voltage_unit : float, optional
        Units of the functions; 1 by default.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown; if numba cannot compile the function, or
        the function raises; if the square of the voltage has another period.

    See Also
    --------
    Sampled, Drive

    Notes
    -----
    The period is checked at a few times, which finds common mistakes. A waveform whose period
    depends on its parameters requires a subclass of `Drive`.

    Examples
    --------
    >>> import math
    >>> import mems_impact as mi
    >>> def voltage(t, q):
    ...     return q[0] * math.cos(t) ** 3
    >>> drive = mi.Custom(function=voltage, period=math.pi, values={"top": 0.3})
    >>> drive.varied({"top": 0.2}).names
    ('top',)
    """

    function: Function
    period: Annotated[Positive, Unit("s")]
    values: Annotated[
        Given[tuple[tuple[str, float], ...]],
        BeforeValidator(_pairs),
        Field(description=VALUES_FORM),
    ] = ()
    switches: Annotated[
        Given[tuple[float, ...]], BeforeValidator(_times), Field(description=TIMES_KIND)
    ] = ()
    fastest: Annotated[OptionalPositive, Unit("s")] = None
    time_unit: Positive = 1.0
    voltage_unit: Positive = 1.0

    @model_validator(mode="after")
    def _check_functions(self) -> Self:
        times = (0.0, *self.switches, math.nextafter(self.period, math.inf))
        if not all(previous < time for previous, time in pairwise(times)):
            raise InvalidParameter("switches", self.switches, TIMES_KIND)
        problem = _compilation_problem(self.function)
        if problem:
            raise self._error(problem)
        self._check_values()
        return self

    def _check_values(self) -> None:
        borders = np.array([0.0, *self.switches, self.period])
        probes = (np.arange(PROBE_COUNT) + 0.5) / PROBE_COUNT * self.period
        distance = np.abs(probes[:, None] - borders).min(axis=1)
        h = 1e-5 * (self.fastest or self.period)
        probes = probes[distance > 2.0 * h]
        voltages, next_voltages = self._samples(probes), self._samples(probes + self.period)
        max_voltage = float(np.max(np.abs(voltages), initial=0.0))
        is_wrong = np.abs(next_voltages**2 - voltages**2) > WAVEFORM_RTOL * max_voltage**2
        if is_wrong.any():
            t = float(probes[np.argmax(is_wrong)])
            problem = (
                f"the square of the voltage at t = {t:.6g} differs from its value a period later"
            )
            raise InvalidParameter("period", self.period, "", problem=problem)

    def _samples(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        q: Any = self.parameters().tolist()  # NumPy would warn, Python raises
        try:
            values = np.array([float(self.voltage(t, q)) for t in times.tolist()])
        except Exception as error:
            raise self._error(f"raises {type(error).__name__}: {error}") from None
        if not np.isfinite(values).all():
            raise self._error(f"is not finite at t = {times[np.argmin(np.isfinite(values))]:.6g}")
        return values

    def _error(self, problem: str) -> InvalidParameter:
        return InvalidParameter("function", self.function.__name__, "", problem=problem)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Custom):
            return NotImplemented
        values, other_values = dict(self), dict(other)
        functions = values.pop("function"), other_values.pop("function")
        return values == other_values and same_function(*functions)

    def __hash__(self) -> int:
        return hash((self.period, self.values, self.switches))

    def __getstate__(self) -> dict[Any, Any]:
        """Return the pickled state, with functions that another process can load."""
        state = super().__getstate__()
        return {**state, "__dict__": portable(state["__dict__"])}

    @property
    def time_scale(self) -> float:
        """Characteristic time of the voltage."""
        return self.fastest or self.period

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the values."""
        return tuple(name for name, _ in self.values)

    def number(self, name: str) -> float:
        """Return the value with a name."""
        return dict(self.values)[name]

    def varied(self, values: Mapping[str, float], *, checked: bool = True) -> Self:
        """Return a copy with some values changed."""
        pairs = tuple({**dict(self.values), **values}.items())
        return self.replace(values=pairs) if checked else self.replace_unchecked(values=pairs)

    def parameters(self) -> NDArray[np.float64]:
        """Return the units of time and voltage, then the values."""
        values = [value for _, value in self.values]
        return np.array([self.time_unit, self.voltage_unit, *values], dtype=np.float64)

    def scaled(self, voltage: float, time: float) -> Self:
        """Return the same waveform in other units of voltage and time."""
        unit = self.time_unit * time
        period = self.period / time
        return self.replace(
            period=period,
            switches=[_first_from(s * self.time_unit, unit) for s in self.switches],
            fastest=None if self.fastest is None else self.fastest / time,
            time_unit=unit,
            voltage_unit=self.voltage_unit * voltage,
        )

    @property
    def voltage(self) -> Waveform:  # type: ignore[override]
        """The function, in its units."""
        return _in_units(self.function)


@cache
def _in_units(function: Waveform) -> Waveform:
    def voltage(t, q):  # type: ignore[no-untyped-def]
        return function(t * q[0], q[2:]) / q[1]

    return voltage


def _first_from(time: float, unit: float) -> float:
    """Return the smallest number whose product with `unit` is at least `time`."""
    result = time / unit
    while result * unit < time:
        result = math.nextafter(result, math.inf)
    while math.nextafter(result, 0.0) * unit >= time:
        result = math.nextafter(result, 0.0)
    return result


@cache
def _compilation_problem(function: Callable[..., Any]) -> str:
    """Return why numba cannot compile `function`, or None."""
    from numba import types

    from mems_impact.integrators.jit.closures import try_compile
    from mems_impact.integrators.jit.numba_support import jit_disabled

    if jit_disabled():
        return ""
    outcome = try_compile(function, (types.float64, types.Array(types.float64, 1, "C")))
    if outcome.problem:
        return f"numba cannot compile it ({outcome.problem})"
    if not isinstance(outcome.returned, types.Float | types.Integer):
        return f"must return a number on every path, not {outcome.returned}"
    return ""
