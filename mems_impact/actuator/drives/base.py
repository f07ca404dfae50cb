"""The interface of waveforms."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from enum import Enum
from functools import lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import model_validator

from mems_impact._util.quantities import quantity
from mems_impact._util.units import DIMENSIONLESS, Scales
from mems_impact.actuator.parameter_base import TEXTS, Varied
from mems_impact.actuator.units import DeviceScales, scaled_fields
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.problem import ProblemParameters
from mems_impact.systems.state import is_number

GOLDEN_PHASE = 0.5 * (5.0**0.5 - 1.0)  # where no waveform of a few pieces is zero
MIN_CHECKS, MAX_CHECKS = 16, 10_000  # of the sign of a voltage, between two switches

Channel = Literal["right", "left", "clamp"]
CHANNELS: tuple[Channel, ...] = ("right", "left", "clamp")
Waveform = Callable[[float, NDArray[np.float64]], float]


class Drive(Varied, ABC):
    """Base of voltage waveforms v(t).

    A new waveform is a subclass that declares its parameters as pydantic fields (with the number
    types of `mems_impact.actuator.parameter_base`) and defines the attributes and methods below.
    `mems_impact.actuator.drives` lists its kind for files and the command line.

    The waveform itself is a module-level function of plain Python that the equations call,
    interpreted or compiled by numba unchanged. The function takes a float and one float64 array,
    uses `math` alone, carries no decorator, and becomes part of the class by `staticmethod`::

        def _ramp_voltage(t, q):
            return q[0] * t

        class Ramp(Drive):
            voltage = staticmethod(_ramp_voltage)

    Attributes
    ----------
    period : float
        The forcing period, > 0: the period of v(t)^2, to which the electrostatic force is
        proportional, and which may be shorter than the period of v(t).
    switches : tuple of float
        The times in (0, period], ascending, at which v or its rate is discontinuous; empty if v is
        smooth. Integration stops and restarts there.
    time_scale : float
        Characteristic time of the voltage, `period` by default: no step of the integration is
        longer than 1/16 of it. A waveform with short features that are not bounded by switches
        needs a shorter time.
    left_voltage : callable or None
        Like `voltage`, for the electrode on the left; None by default.
    clamp_voltage : callable or None
        Like `voltage`, for the electrode of a clamp (see `ClampElectrode`); None by default.
    units : mapping of str to str
        The SI unit of every field that is not dimensionless: "V" (a charge in C if the actuator has
        a `ChargeDrive`), "s", "rad/s" or "Hz" (see `mems_impact.actuator.units.KNOWN_UNITS`). The
        unit determines `scaled`, and the heading of the field in tables of a device in SI. It may
        be a `Unit` in the annotation of the field, which may hold a tuple (of tuples) of numbers.

    Methods
    -------
    parameters()
        The array q, shape (n,), float64, that `voltage` reads.
    voltage(t, q)
        v at time t. For every t, v(t + period)^2 = v(t)^2 must hold, since a long run uses only
        times within the current forcing period (or two, see `changes_sign`). At a switching time,
        the value after it.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.

    See Also
    --------
    load, plot_drive, Sine, Custom

    Examples
    --------
    >>> import mems_impact as mi
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> isinstance(drive, mi.Drive), drive.names
    (True, ('amplitude', 'omega', 'bias', 'phase'))
    >>> f"{drive.value(0.0):.2f}"
    '0.24'
    """

    units: ClassVar[Mapping[str, str]] = {}
    inputs: ClassVar[Any] = {}  # of an exported model (see `imported`)

    if TYPE_CHECKING:
        # Not at run time: a property of this name would hide fields.
        @property
        def period(self) -> float:
            """Forcing period, in the unit of time of the actuator."""

        @property
        def switches(self) -> tuple[float, ...]:
            """Times in (0, period] at which the voltage or its rate jumps."""

        @property
        def left_voltage(self) -> Waveform | None:
            """The voltage at the left electrode, if there is one."""

        @property
        def clamp_voltage(self) -> Waveform | None:
            """The voltage of a clamp, if the drive has one."""
    else:
        left_voltage: ClassVar = None
        clamp_voltage: ClassVar = None

    @classmethod
    def _magnitude(cls, name: str, value: Any) -> float:
        try:
            return super()._magnitude(name, value)
        except InvalidParameter:
            if cls.unit_of(name) != "V":
                raise
            try:
                return quantity(name, value, "C")  # the drive may set a charge
            except InvalidParameter:
                pass
            raise

    def check_texts(self, unit: str) -> None:
        """Raise InvalidParameter if a text is a charge under a voltage drive, or a voltage."""
        for name, value in vars(self).get(TEXTS, {}).items():
            if self.unit_of(name) == "V":
                quantity(name, value, unit)
        for nested in self._nested:
            nested.check_texts(unit)

    @model_validator(mode="before")
    @classmethod
    def _convert_frequency(cls, values: Any) -> Any:
        """Compute omega from a frequency."""
        if "omega" not in cls.model_fields or not isinstance(values, Mapping):
            return values
        frequency = values.get("frequency")
        if frequency is None:
            return values
        frequency = quantity("frequency", frequency, "Hz")
        if not is_number(frequency) or frequency <= 0.0:
            raise InvalidParameter("frequency", frequency, "a finite number > 0")
        omega = 2.0 * math.pi * frequency
        if values.get("omega", omega) != omega:
            raise InvalidParameter("frequency", frequency, "omitted if omega is given")
        other_values = {name: value for name, value in values.items() if name != "frequency"}
        frequency_field = {"frequency": frequency} if "frequency" in cls.model_fields else {}
        return {**other_values, **frequency_field, "omega": omega}

    @model_validator(mode="after")
    def _check_omega(self) -> Self:
        if math.isnan(getattr(self, "omega", 0.0)):
            problem = "missing, must be a finite number > 0"
            raise InvalidParameter("omega", None, "", problem=problem)
        if not math.isfinite(2.0 * math.pi / getattr(self, "omega", 1.0)):
            raise InvalidParameter("omega", self.omega, "large enough for a finite period")  # type: ignore[attr-defined]
        return self

    def _replaced(self, changes: Mapping[str, Any]) -> dict[str, Any]:
        """Return all fields after changes; of omega and frequency, only the changed one."""
        values = {**dict(self), **changes}
        if changes.get("frequency", values.get("frequency")) is not None:
            del values[
                "frequency" if "omega" in changes and "frequency" not in changes else "omega"
            ]
        return values

    def replace(self, /, **changes: Any) -> Self:
        """Return a copy with some parameters changed, checked like a new one.

        Parameters
        ----------
        **changes : object
            New values, by parameter name. Either of ``omega`` and ``frequency`` replaces both.

        Raises
        ------
        InvalidParameter
            If the changed set is not allowed, or a name is unknown.
        """
        alternatives = {"omega", "frequency"}  # one quantity
        names = {*changes, *(alternatives if alternatives & changes.keys() else ())}
        return self._with_texts(type(self)(**self._replaced(changes)), names)

    __replace__ = replace

    def replace_unchecked(self, /, **changes: Any) -> Self:
        """Return a copy with some parameters changed, without validation."""
        values = self._replaced(changes)
        if "omega" in dict(self) and "omega" not in values:
            values["omega"] = 2.0 * math.pi * values["frequency"]
        return type(self).model_construct(**values)

    def __repr_args__(self) -> Any:
        alternative = "omega" if getattr(self, "frequency", None) is not None else "frequency"
        return [(name, value) for name, value in dict(self).items() if name != alternative]

    @property
    def sides(self) -> tuple[Channel, ...]:
        """The electrodes of the block that have a voltage: right, or right and left."""
        return ("right",) if self.left_voltage is None else ("right", "left")

    @property
    def time_scale(self) -> float:
        """Characteristic time of the voltage."""
        return self.period

    @property
    def changes_sign(self) -> bool:
        """Whether v changes its sign from each forcing period to the next.

        For a model that depends on the sign of v, two forcing periods are then combined into one:
        `voltage` must have the right sign in both, and the switches of the second are exactly
        ``period + time``.

        Notes
        -----
        Samples decide for a waveform without switches; a subclass may override the attribute.
        """
        return not self.switches and _signs(self) is Signs.ALTERNATE

    def check_signed(self) -> None:
        """Raise InvalidParameter if the sign of the voltage does not repeat after two periods."""
        for drive in self._nested:
            drive.check_signed()
        if not self._nested and _signs(self) is not Signs.STAY and not self.changes_sign:
            problem = (
                "the voltage changes its sign from one forcing period to the next, which matters "
                "to a term of the actuator; give the period of the voltage itself, with all its "
                "switches"
            )
            raise InvalidParameter("period", self.period, "", problem=problem)

    def check_period(self) -> None:
        """Raise InvalidParameter if the drive has no forcing period."""

    def check(self) -> None:
        """Raise InvalidParameter if floating-point numbers cannot represent the waveform.

        Each parameter is validated when the drive is made; this checks quantities derived from
        them: times so close that they coincide, and overflow.
        """
        try:
            with np.errstate(all="ignore"):
                period, times = self.period, (0.0, *self.switches)
                numbers = (period, *self.value((0.0, 0.3 * period)), *self.parameters())
            is_ascending = all(a < b for a, b in pairwise(times)) and times[-1] <= period
            is_valid = is_ascending and period > 0.0 and bool(np.isfinite(numbers).all())
        except (ArithmeticError, ValueError):
            is_valid = False
        if not is_valid:
            problem = "its times are too close or its numbers too large for floating point"
            raise InvalidParameter(type(self).__name__, None, "", problem=problem)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers that can be varied; in a nested drive as ``wave.omega``."""
        names = super().names
        if getattr(self, "frequency", None) is None:
            return names
        return tuple("frequency" if n == "omega" else n for n in names if n != "frequency")

    @abstractmethod
    def parameters(self) -> NDArray[np.float64]:
        """Return the array q that `voltage` reads."""

    @staticmethod
    @abstractmethod
    def voltage(t: float, q: NDArray[np.float64]) -> float:
        """Return v(t)."""

    def scaled(self, voltage: float, time: float) -> Self:
        """Return the same waveform in other units of voltage and time.

        Parameters
        ----------
        voltage, time : float
            The new units in the old units, > 0: voltages are divided by `voltage` and times by
            `time`, so that v_new(t) = v(time t) / voltage.

        Notes
        -----
        The method uses `units`. Override it only if a field is not simply a voltage, a time, a
        frequency or a dimensionless number.
        """
        return self.replace(**scaled_fields(self, self.units, DeviceScales.of_drive(voltage, time)))

    def numbers(self, changes: Mapping[str, float], scales: Scales) -> ProblemParameters:
        """Return q, period, switches and time scale in `scales`, at other values of some `names`.

        The values are in the drive's own units and need not be allowed.

        Notes
        -----
        The method makes a drive with these values. Override it, with the same arithmetic, if the
        results are simple functions of a few numbers: continuation calls it thousands of times.
        """
        drive = self.varied(changes, checked=False) if changes else self
        if scales is not DIMENSIONLESS:
            drive = drive.scaled(scales.unit("V"), scales.unit("s"))
        return ProblemParameters(drive.parameters(), drive.period, drive.switches, drive.time_scale)

    def value(self, t: ArrayLike, *, channel: Channel = "right") -> NDArray[np.float64]:
        """Return the voltage at many times, for plots.

        Parameters
        ----------
        t : array_like
            Times.
        channel : {"right", "left", "clamp"}, optional
            The electrode, by default the right one; the voltage is 0 where there is none.

        Returns
        -------
        ndarray
            Voltages, in the shape of `t`.
        """
        q = self.parameters()
        times = np.asarray(t, dtype=np.float64)
        waveforms = {"right": self.voltage, "left": self.left_voltage, "clamp": self.clamp_voltage}
        waveform = waveforms[channel]
        if waveform is None:
            return np.zeros_like(times)
        voltages = [waveform(time, q) for time in times.ravel().tolist()]
        return np.array(voltages, dtype=np.float64).reshape(times.shape)


class Signs(Enum):
    """Behaviour of the sign of a voltage from one forcing period to the next."""

    STAY = 0
    ALTERNATE = 1
    OTHER = 2


@lru_cache(maxsize=16)
def _signs(drive: Drive) -> Signs:
    """Return the behaviour of the sign of a drive's voltages, from samples at many times."""
    q, period = drive.parameters(), drive.period
    times: list[float] = []
    for begin, end in pairwise((0.0, *drive.switches, period)):
        count = max(MIN_CHECKS, round(MIN_CHECKS * (end - begin) / drive.time_scale))
        count = min(count, MAX_CHECKS)
        times += [begin + (end - begin) * (i + GOLDEN_PHASE) / count for i in range(count)]
    channels = (drive.voltage, drive.left_voltage, drive.clamp_voltage)
    waveforms = [each for each in channels if each is not None]
    rows = [[each(t + k * period, q) for k in range(3)] for each in waveforms for t in times]
    first, second, third = np.array(rows).T
    # One voltage equals the other, or its negative, to rounding.
    if not (np.abs(second - first) > np.abs(first)).any():
        return Signs.STAY
    return Signs.OTHER if (np.abs(third - first) > np.abs(first)).any() else Signs.ALTERNATE
