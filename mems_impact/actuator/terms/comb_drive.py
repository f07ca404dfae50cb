"""Comb electrodes."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from mems_impact._util.limits import Bound
from mems_impact.actuator.parameter_base import Positive, Unit
from mems_impact.actuator.plausible_ranges import LENGTH, PERMITTIVITIES
from mems_impact.actuator.terms.base import (
    Device,
    Electrode,
    ParameterIndices,
    Shape,
    Term,
    reach_function,
)
from mems_impact.errors import InvalidParameter

PERMITTIVITY = 8.8541878188e-12  # of vacuum [F/m], CODATA 2022
MIN_OVERLAP_RATIO = 1e-6  # of the overlap at x2 = 0


class CombDrive(Term):
    """Comb electrodes, with a force independent of the position, in place of parallel plates.

    Parameters
    ----------
    fingers : float
        Number of fingers of the block at an electrode, each between two fixed fingers; > 0.
    gap : float
        Gap between neighbouring fingers [m], > 0.
    thickness : float
        Height of the fingers [m], > 0.
    overlap : float
        Length over which the fingers overlap at x2 = 0 [m], above delta; with
        compliant stoppers above half of d + delta.
    permittivity : float, optional
        Permittivity of the gap [F/m], > 0; the permittivity of vacuum by default. Required in a
        dimensionless device.
    sides : {"both", "right", "left"}, optional
        The electrodes that are combs; any other electrode remains a parallel plate.

    Raises
    ------
    InvalidParameter
        If a value is out of range, the fingers do not overlap over the whole travel, or the
        permittivity of a dimensionless device is missing.

    See Also
    --------
    TabulatedCapacitance, TiltedPlate, resting_voltage

    Notes
    -----
    The capacitance is C(x) = 2 fingers permittivity thickness (overlap + x)/gap, with x towards the
    electrode, so that the force is fingers permittivity thickness voltage^2/gap (W. C. Tang, T.-C.
    H. Nguyen, R. T. Howe, Sens. Actuators 20, 25 (1989)). Fields at the edges and the tips of the
    fingers, the levitation of the block over a ground plane, and lateral motion are neglected. A
    comb drive has no pull-in: the block reaches the stopper at `resting_voltage`.

    `alpha` and `d` do not enter the force. `alpha` determines the units of the scaled variables,
    and half the slope of C times d^2 is a good choice; `d` is the clearance of the tips.

    Examples
    --------
    >>> import mems_impact as mi
    >>> comb = mi.CombDrive(fingers=100, gap=2e-6, thickness=20e-6, overlap=30e-6)
    >>> device = mi.load_actuator("mita2003").adding(comb)
    >>> f"{mi.resting_voltage(device):.1f} V"
    '36.7 V'
    """

    fingers: Positive
    gap: Annotated[Positive, Unit("m", LENGTH)]
    thickness: Annotated[Positive, Unit("m", LENGTH)]
    overlap: Annotated[Positive, Unit("m", LENGTH)]
    permittivity: Annotated[Positive, Unit("F/m", PERMITTIVITIES)] = PERMITTIVITY
    sides: Literal["both", "right", "left"] = "both"

    replaced_rule = "electrode"
    plates = False

    @classmethod
    def bounds(cls, indices: ParameterIndices, shape: Shape, compliant: bool) -> tuple[Bound, ...]:
        """Return the bound of the overlap, which lasts over the whole travel."""
        meaning = "the largest deflection of the block"
        return (Bound(name="comb_drive.overlap", value=reach_function(compliant), meaning=meaning),)

    def check_on(self, actuator: Device) -> None:
        """Raise InvalidParameter if the comb does not fit, or is in other units."""
        super().check_on(actuator)
        check_permittivity(self, actuator)

    @classmethod
    def electrode(cls, indices: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return the electrode with the capacitance of the comb."""
        fingers, gap, thickness = indices.p["fingers"], indices.p["gap"], indices.p["thickness"]
        overlap, permittivity = indices.p["overlap"], indices.p["permittivity"]

        def slope(x, p):  # type: ignore[no-untyped-def]
            return 2.0 * p[fingers] * p[permittivity] * p[thickness] / p[gap]

        def capacitance(x, p):  # type: ignore[no-untyped-def]
            # A trial step may extend beyond the stopper, to where the fingers do not overlap.
            return slope(x, p) * max(p[overlap] + x, MIN_OVERLAP_RATIO * p[overlap])

        return electrode._replace(capacitance=capacitance, slope=slope)


def check_permittivity(term: Any, actuator: Device) -> None:
    """Raise InvalidParameter if a term of a dimensionless device has the default, in SI."""
    if actuator.units == "dimensionless" and term.permittivity == PERMITTIVITY:
        problem = "missing; the default is in SI, and the device is dimensionless"
        raise InvalidParameter(f"{term.name()}.permittivity", None, "", problem=problem)
