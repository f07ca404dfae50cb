"""Measured waveforms."""

from __future__ import annotations

import math
from functools import partial
from itertools import pairwise
from os import PathLike
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from mems_impact._util.files import file_path
from mems_impact._util.formatting import shown
from mems_impact._util.text_tables import even_times
from mems_impact._util.warning_scopes import warn
from mems_impact.actuator.drives.piecewise import Piece, PiecewiseDrive
from mems_impact.actuator.parameter_base import Given, Number, Positive, Unit, finite_numbers
from mems_impact.actuator.toml_files import read_columns
from mems_impact.errors import InvalidParameter, ValidityWarning

LONGEST_STEP = 1.0 / 16.0  # of a period: that of the integration
MIN_SAMPLE_SPACING = 1e-9  # of the record: closer samples coincide
BEND_RATIO = 0.25  # of the range of the voltage
ALTERNATING = 0.02  # of the range of the voltage
LIST = "a list of 3 or more finite numbers"


Numbers = Annotated[
    Given[tuple[float, ...]],
    BeforeValidator(partial(finite_numbers, least=3)),
    Field(description=LIST),
]


class Sampled(PiecewiseDrive):
    """A measured voltage, repeated with its period and interpolated between its samples.

    Parameters
    ----------
    times : sequence of float
        Times of the samples [s], ascending; the first is t = 0 of the waveform.
    voltages : sequence of float
        Voltages [V] at these times.
    period : float, optional
        Forcing period [s]. By default the record is one period: up to its last sample if the first
        and the last voltage are equal, else, if the samples are equally spaced, one spacing
        further.
    phase : float, optional
        Phase of the waveform [rad]; 2 pi is a period.

    Raises
    ------
    InvalidParameter
        If a parameter is out of range, missing or unknown.

    See Also
    --------
    Custom, load

    Notes
    -----
    The interpolant is the monotone cubic of Fritsch and Butland (SciPy's "pchip"), closed over the
    period. It has a continuous rate, so that the integration need not stop at every sample, and no
    overshoot: it never leaves the range between two neighbouring samples. Where the record bends so
    sharply that a step of the integration might pass over the bend, there is a switch: after every
    stretch over which the slope changes, in sum, by a quarter of the range in 1/16 of a period. A
    smooth record has a few switches, a noisy record a switch at every sample: smooth a noisy record
    first.

    If the square of the voltage has half the period of the voltage, give half the record, unless
    the actuator has a term that depends on the sign.

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> times = np.linspace(0.0, 10.0, 41)
    >>> record = mi.Sampled(times=times, voltages=0.3 * np.cos(2 * np.pi * times / 10.0))
    >>> record.period
    10.0
    """

    times: Annotated[Numbers, Unit("s")]
    voltages: Annotated[Numbers, Unit("V")]
    period: Annotated[Positive, Unit("s")] = math.nan  # by default that of the record
    phase: Number = 0.0

    @classmethod
    def from_csv(
        cls,
        path: str | PathLike[str],
        *,
        channel: int | str | None = None,
        period: float | None = None,
        phase: float = 0.0,
    ) -> Self:
        """Read a record from a file with columns of time and voltage.

        Parameters
        ----------
        path : str or os.PathLike
            Columns separated by comma, semicolon, tab or blanks; beside the others, commas may be
            decimal commas. Headings, settings written by an oscilloscope, and lines that begin with
            # are skipped, apart from units such as ``time [ms], voltage [mV]``; without units,
            numbers are in SI.
        channel : int or str, optional
            Which column is the voltage, in a file with several: its heading, or its number from 1.
        period, phase : float, optional
            As for the class.

        Raises
        ------
        InvalidFile
            If the file cannot be read or is not such a table.
        InvalidParameter
            If its numbers are not allowed.

        Warns
        -----
        ValidityWarning
            If the times are rounded, so that equally spaced times take their place; or if the
            record is a whole cycle of a voltage whose second half is the negative of the first: the
            cycle is then the forcing period, twice the period of the force.
        """
        times, voltages = read_columns(path, 2, [("s",), ("V", "C")], channel)
        even = even_times(times)
        if even is not None:
            warn(
                f"{file_path(path, '')}: the times are rounded; they are taken as equally spaced, "
                f"{even.spacing:.6g} s apart, up to {even.deviation:.2g} s from those of the file",
                ValidityWarning,
            )
            times = even.times.tolist()
        values: dict[str, Any] = {"times": times, "voltages": voltages, "period": period}
        try:
            record = cls(**values, phase=phase)
        except InvalidParameter as error:
            raise error.located(path) from None
        if record.alternates:
            warn(
                f"{file_path(path, '')}: the second half of the record is the negative of the "
                "first, with the same force: the forcing period is the whole record, which counts "
                "two periods of the force as one",
                ValidityWarning,
            )
        return record

    @property
    def alternates(self) -> bool:
        """Whether the second half of the record is the negative of the first, to a few percent."""
        t, v = np.array(self.times) - self.times[0], np.array(self.voltages)
        half = np.interp((t + 0.5 * self.period) % self.period, [*t, self.period], [*v, v[0]])
        return bool(np.abs(half + v).max() < ALTERNATING * np.ptp(v) > 0.0)

    @model_validator(mode="before")
    @classmethod
    def _close(cls, values: dict[str, Any]) -> dict[str, Any]:
        """Determine the period of the record and drop a last sample that repeats the first."""
        try:
            times, voltages = (
                finite_numbers(values["times"], least=3),
                finite_numbers(values["voltages"], least=3),
            )
        except (KeyError, ValueError):
            return values  # validation of the fields reports it
        if len(times) != len(voltages):
            allowed = f"as many as times, {len(times)}"
            raise InvalidParameter("number of voltages", len(voltages), allowed)
        min_spacing = MIN_SAMPLE_SPACING * (max(times) - min(times))
        for previous, time in pairwise(times):
            if not time - previous > min_spacing:
                allowed = f"ascending, above the time before, {shown(previous)}"
                raise InvalidParameter("times", time, allowed)
        period, length = values.get("period"), times[-1] - times[0]
        voltage_range = max(voltages) - min(voltages)
        is_closed = abs(voltages[-1] - voltages[0]) <= 1e-9 * voltage_range
        if period is None:
            gaps = np.diff(times)
            if is_closed:
                period = length
            elif np.ptp(gaps) <= 1e-6 * gaps.max():
                period = length * len(times) / (len(times) - 1)
            else:
                problem = (
                    "give it: the last voltage does not repeat the first, and the times are not "
                    "equally spaced"
                )
                raise InvalidParameter("period", None, "", problem=problem)
        elif isinstance(period, int | float) and math.isfinite(period):
            if period < length * (1.0 - 1e-12):
                allowed = f"no shorter than the record, {shown(length)}"
                raise InvalidParameter("period", period, allowed)
            covers_period = period <= length * (1.0 + 1e-12)
            if covers_period and not is_closed:
                allowed = f"the first, {shown(voltages[0])}, at the end of the period"
                raise InvalidParameter("last voltage", voltages[-1], allowed)
            is_closed = covers_period
        else:
            return values
        if is_closed:
            times, voltages = times[:-1], voltages[:-1]
        return {**values, "times": times, "voltages": voltages, "period": period}

    @property
    def lead(self) -> float:
        """Phase of the waveform, as a time."""
        return self.phase / (2.0 * math.pi) * self.period

    def pieces(self) -> list[Piece]:
        """Return one cubic per sample."""
        from scipy.interpolate import PchipInterpolator  # imported on use: a run need not wait

        times, voltages = np.array(self.times) - self.times[0], np.array(self.voltages)
        # Beyond the record by neighbours: the slopes at its ends depend on them.
        beyond = np.concatenate([times[-1:] - self.period, times, self.period + times[:2]])
        repeated = np.concatenate([voltages[-1:], voltages, voltages[:2]])
        cubics = PchipInterpolator(beyond, repeated).c[::-1, 1:-1]
        secants = np.diff(repeated[1:-1]) / np.diff(beyond[1:-1])
        columns = (times, *cubics, self._sharp_turns(secants))
        return [Piece(*row) for row in zip(*(c.tolist() for c in columns), strict=True)]

    def _sharp_turns(self, secants: NDArray[np.float64]) -> NDArray[np.bool_]:
        voltage_range = max(self.voltages) - min(self.voltages)
        if voltage_range == 0.0:
            return np.zeros(secants.size, dtype=bool)
        slope_changes = np.abs(secants - np.roll(secants, 1)) * LONGEST_STEP * self.period
        counts = np.floor(np.cumsum(slope_changes) / (BEND_RATIO * voltage_range))
        result: NDArray[np.bool_] = np.diff(counts, prepend=0.0) > 0.0
        return result
