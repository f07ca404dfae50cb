"""PlateCode electrodes that are not parallel."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from mems_impact._util.limits import Bound
from mems_impact.actuator import equations as eq
from mems_impact.actuator.parameter_base import Number, Positive, Unit
from mems_impact.actuator.plausible_ranges import ELECTRODE_LENGTH, Range
from mems_impact.actuator.terms.base import (
    Electrode,
    ParameterIndices,
    Shape,
    Term,
)

FREE_SHARE = 0.25  # of the room between stopper and contact of an edge, where the force is frozen
YIELDING_SHARE = 1.0 / 3.0  # largest wedge with compliant stoppers, of the gap at the stopper
SERIES_RATIO = 1e-4  # of wedge and gap, below which the series of the capacitance is exact


class TiltedPlate(Term):
    """PlateCode electrodes at an angle, with a wedge-shaped gap, in place of parallel plates.

    Parameters
    ----------
    angle : float
        Angle between the plates [rad]; the sign does not matter.
    length : float
        Length of the plates along the slope [m], > 0.
    sides : {"both", "right", "left"}, optional
        The electrodes that are tilted; any other electrode remains parallel.

    Raises
    ------
    InvalidParameter
        If a value is out of range, or an edge of the plate reaches the electrode before the block
        reaches the stopper.

    See Also
    --------
    Fringing, TabulatedCapacitance, CombDrive

    Notes
    -----
    With the gap d - x in the middle and the wedge w = length abs(angle)/2, half the difference of
    the gaps at both ends, the capacitance is (alpha/w) ln((d - x + w)/(d - x - w)), as of two
    plates in planes that intersect at this angle, without fringing fields; the force is alpha
    voltage^2/((d - x)^2 - w^2). The angle is constant: electrostatic torque does not turn the
    block.

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> tilted = actuator.adding(mi.TiltedPlate(angle=0.05, length=10.0))
    >>> f"{mi.pull_in_voltage(actuator):.4f}, {mi.pull_in_voltage(tilted):.4f}"
    '0.3849, 0.3581'
    """

    angle: Annotated[Number, Unit("", Range(0.0, 0.01, 0.8))]
    length: Annotated[Positive, Unit("m", ELECTRODE_LENGTH)]
    sides: Literal["both", "right", "left"] = "both"

    replaced_rule = "electrode"

    @classmethod
    def bounds(cls, indices: ParameterIndices, shape: Shape, compliant: bool) -> tuple[Bound, ...]:
        """Return the bounds of the angle, at which an edge reaches the electrode."""
        length, share = indices.p["length"], YIELDING_SHARE if compliant else 1.0

        def max_angle(p):  # type: ignore[no-untyped-def]
            return 2.0 * share * (p[eq.D] - p[eq.DELTA]) / p[length]

        def min_angle(p):  # type: ignore[no-untyped-def]
            return -max_angle(p)

        location = "in a contact with the compliant stopper" if compliant else "before the stopper"
        meaning = f"where an edge reaches the electrode {location}"
        return (
            Bound(name="tilted_plate.angle", value=max_angle, upper=True, meaning=meaning),
            Bound(name="tilted_plate.angle", value=min_angle, meaning=meaning),
        )

    @classmethod
    def electrode(cls, indices: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return the electrode with the capacitance of the wedge."""
        angle, length = indices.p["angle"], indices.p["length"]

        def wedge(p):  # type: ignore[no-untyped-def]
            return 0.5 * p[length] * abs(p[angle])

        def gap_at(x, w, p):  # type: ignore[no-untyped-def]
            # A trial step may extend beyond the stopper. The force is frozen before an edge touches
            # the electrode; with compliant stoppers that is beyond halfway to the electrode.
            return max(p[eq.D] - x, w + FREE_SHARE * (p[eq.D] - p[eq.DELTA] - w))

        def capacitance(x, p):  # type: ignore[no-untyped-def]
            w = wedge(p)
            gap = gap_at(x, w, p)
            ratio = w / gap
            factor = 1.0 + ratio * ratio / 3.0
            if ratio > SERIES_RATIO:
                factor = math.atanh(ratio) / ratio
            return 2.0 * p[eq.ALPHA] * factor / gap

        def slope(x, p):  # type: ignore[no-untyped-def]
            w = wedge(p)
            gap = gap_at(x, w, p)
            return 2.0 * p[eq.ALPHA] / ((gap - w) * (gap + w))

        return electrode._replace(capacitance=capacitance, slope=slope)
