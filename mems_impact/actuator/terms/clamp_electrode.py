"""An electrode that presses the frame on the ground."""

from __future__ import annotations

from typing import Annotated, Literal

from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameter_base import Number, Positive, Unit
from mems_impact.actuator.plausible_ranges import LENGTH, PERMITTIVITIES, Range
from mems_impact.actuator.terms.base import (
    Device,
    ParameterIndices,
    Shape,
    Term,
    TermContribution,
    drive_unit,
)
from mems_impact.actuator.terms.comb_drive import PERMITTIVITY, check_permittivity
from mems_impact.errors import InvalidParameter


class ClampElectrode(Term):
    """An electrode below the frame, which its voltage presses on the ground.

    Parameters
    ----------
    area : float
        Area of the electrode [m^2], > 0.
    gap : float
        Distance between electrode and frame [m], > 0: for an insulated electrode, the thickness of
        the insulation over its relative permittivity.
    voltage : float, optional
        Constant voltage [V], 0 by default.
    follows : {"nothing", "right", "left", "clamp"}, optional
        The voltage of the drive that acts on the electrode in place of a constant one: that of the
        right or the left electrode of the block, or the drive's own for the clamp (see `Voltages`).
    permittivity : float, optional
        Permittivity of the gap [F/m], > 0; the permittivity of vacuum by default. Required in a
        dimensionless device.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    Clamp, Voltages, Actuator

    Notes
    -----
    The clamping force is ``permittivity area V^2/(2 gap^2)``, as of parallel plates. The frame does
    not move towards the ground.

    Examples
    --------
    A clamp at a constant voltage, as a data sheet tells it:

    >>> import mems_impact as mi
    >>> plate = mi.ClampElectrode(area="0.04 mm^2", gap="0.5 um", voltage="20 V")
    >>> clamped = mi.load_actuator("mita2003").adding(plate)
    >>> round(clamped.datasheet["clamp_force"], 9)
    0.000283334
    """

    area: Annotated[Positive, Unit("m^2", Range(1e-14, 1e-8, 1e-3))]
    gap: Annotated[Positive, Unit("m", LENGTH)]
    voltage: Annotated[Number, Unit("V", Range(0.0, 30.0, 1e4))] = 0.0
    follows: Literal["nothing", "right", "left", "clamp"] = "nothing"
    permittivity: Annotated[Positive, Unit("F/m", PERMITTIVITIES)] = PERMITTIVITY

    def check_on(self, actuator: Device) -> None:
        """Raise InvalidParameter if a number is in other units, or the voltage is not used."""
        check_permittivity(self, actuator)
        if self.follows != "nothing" and drive_unit(actuator.terms) != "V":
            problem = "the drive sets a charge, no voltage; give the clamp a constant voltage"
            raise InvalidParameter("clamp_electrode.follows", self.follows, "", problem=problem)
        if self.follows != "nothing" and self.voltage != 0.0:
            problem = f"the drive sets the voltage, since the clamp follows {self.follows!r}"
            raise InvalidParameter("clamp_electrode.voltage", self.voltage, "", problem=problem)

    def check_under(self, drive: Drive) -> None:
        """Raise InvalidParameter if the drive lacks the voltage that the clamp follows."""
        waveforms = {"left": drive.left_voltage, "clamp": drive.clamp_voltage}
        if waveforms.get(self.follows, drive.voltage) is None:
            problem = f"the drive has no such voltage; give Voltages({self.follows}=…)"
            raise InvalidParameter("clamp_electrode.follows", self.follows, "", problem=problem)

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the clamping force."""
        area, gap, bias, permittivity = (
            indices.p[name] for name in ("area", "gap", "voltage", "permittivity")
        )

        def force(voltage, p):  # type: ignore[no-untyped-def]
            return 0.5 * p[permittivity] * p[area] * voltage * voltage / (p[gap] * p[gap])

        def constant(p):  # type: ignore[no-untyped-def]
            return force(p[bias], p)

        def by_right(v, w, u, p):  # type: ignore[no-untyped-def]
            return force(v, p)

        def by_left(v, w, u, p):  # type: ignore[no-untyped-def]
            return force(w, p)

        def by_own(v, w, u, p):  # type: ignore[no-untyped-def]
            return force(u, p)

        driven = {"right": by_right, "left": by_left, "clamp": by_own}
        follows = str(dict(zip(cls.model_fields, shape, strict=True))["follows"])
        if follows in driven:
            return TermContribution(driven_clamp=driven[follows])
        return TermContribution(clamp=constant)
