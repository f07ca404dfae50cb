"""Fringing fields of the electrodes."""

from __future__ import annotations

import math
from typing import Annotated

from mems_impact._util.limits import Bound
from mems_impact.actuator import equations as eq
from mems_impact.actuator.parameter_base import OptionalPositive, Positive, Unit
from mems_impact.actuator.plausible_ranges import ELECTRODE_LENGTH
from mems_impact.actuator.terms.base import Electrode, ParameterIndices, Shape, Term


class Fringing(Term):
    """Electrodes with fringing fields at their edges.

    Parameters
    ----------
    width : float
        Width of the electrodes [m], at least twice the widest gap, d + delta.
    length : float, optional
        Length of the electrodes [m], with the same minimum; without a length only two edges count.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    SeriesResistance, CubicStiffness, Actuator

    Notes
    -----
    The capacitance of two equal thin plates is 2 alpha/gap times

        1 + gap/(pi width) (1 + ln(2 pi width/gap))

    and times the same of the length (H. B. Palmer, Electr. Eng. 56, 363 (1937)); the force is
    exactly half its derivative, times the square of the voltage. With the width alone the force is
    the paper's times 1 + gap/(pi width). For long plates, against a solution of the integral
    equation of their charges, the force is too large by 0.3 % at a gap of a tenth of the width, by
    1.4 % at a quarter and by 4.0 % at half, the end of the range.

    Examples
    --------
    >>> import mems_impact as mi
    >>> wider = mi.load_actuator("zhao2004").adding(mi.Fringing(width=5.0))
    """

    width: Annotated[Positive, Unit("m", ELECTRODE_LENGTH)]
    length: Annotated[OptionalPositive, Unit("m", ELECTRODE_LENGTH)] = None

    replaced_rule = "electrode"

    @classmethod
    def bounds(cls, indices: ParameterIndices, shape: Shape, compliant: bool) -> tuple[Bound, ...]:
        """Return the bounds of the sizes."""

        def min_size(p):  # type: ignore[no-untyped-def]
            return 2.0 * (p[eq.D] + p[eq.DELTA])

        meaning = "twice the widest gap d + delta"
        return tuple(
            Bound(name=f"{cls.name()}.{size}", value=min_size, excluded=False, meaning=meaning)
            for size in indices.p
        )

    @classmethod
    def electrode(cls, indices: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return the electrode with the capacitance of its edges."""
        width, length = indices.p["width"], indices.p.get("length", -1)

        def capacitance(x, p):  # type: ignore[no-untyped-def]
            gap = eq.electrode_gap(x, p)
            factor = fringe(gap, p[width])
            if length >= 0:
                factor *= fringe(gap, p[length])
            return 2.0 * p[eq.ALPHA] * factor / gap

        def slope(x, p):  # type: ignore[no-untyped-def]
            gap = eq.electrode_gap(x, p)
            factor, factor_slope = fringe(gap, p[width]), fringe_slope(gap, p[width])
            if length >= 0:
                length_factor = fringe(gap, p[length])
                factor_slope = factor_slope * length_factor + factor * fringe_slope(gap, p[length])
                factor *= length_factor
            return 2.0 * p[eq.ALPHA] * (factor / gap - factor_slope) / gap

        return electrode._replace(capacitance=capacitance, slope=slope)


def fringe(gap: float, size: float) -> float:
    """Return Palmer's factor of the capacitance for one pair of edges."""
    return 1.0 + gap / (math.pi * size) * (1.0 + math.log(2.0 * math.pi * size / gap))


def fringe_slope(gap: float, size: float) -> float:
    """Return its derivative with respect to the gap."""
    return math.log(2.0 * math.pi * size / gap) / (math.pi * size)
