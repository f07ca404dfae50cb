"""A drive that sets the charge of each electrode."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator.parameter_base import NonNegative, Unit
from mems_impact.actuator.plausible_ranges import CAPACITANCE
from mems_impact.actuator.terms.base import (
    Device,
    Electrode,
    Function,
    ParameterIndices,
    Shape,
    Term,
    field_energy,
)
from mems_impact.errors import InvalidParameter


class ChargeDrive(Term):
    """A source that sets the charge of each electrode instead of its voltage.

    The values of the drive, such as its amplitude, are charges [C].

    Parameters
    ----------
    parasitic_capacitance : float, optional
        Parasitic capacitance to ground, parallel to the electrode [F], >= 0, which takes a part of
        the charge.

    Raises
    ------
    InvalidParameter
        If a value is out of range, or the actuator has a `SeriesResistance` or `SlewRate`, which
        limit a voltage.

    See Also
    --------
    pull_in_charge, SeriesResistance, Actuator

    Notes
    -----
    The charge determines the voltage at the electrode,

        charge = C(x) (node - offset) + Cp node,

    with the capacitance C(x) of the electrode and terms in its gap, and the parasitic capacitance
    Cp. Without Cp, the force charge^2/(4 alpha) of parallel plates does not depend on the gap, so
    that there is no pull-in. With Cp, the block is stable up to (d/3) (1 + 2 alpha/(d Cp)), which
    is beyond the gap if Cp is below half of the capacitance of the electrodes (J. I. Seeger, B. E.
    Boser, J. Microelectromech. Syst. 12, 656 (2003)).

    Examples
    --------
    >>> import mems_impact as mi
    >>> charged = mi.load_actuator("zhao2004").adding(mi.ChargeDrive(parasitic_capacitance=0.5))
    >>> drive = mi.Sine(amplitude=0.6, omega=0.5)
    >>> run = mi.simulate(charged, drive, periods=20)
    >>> "node voltage" in run.samples()
    True
    """

    parasitic_capacitance: Annotated[NonNegative, Unit("F", CAPACITANCE)] = 0.0

    replaced_rule = "source"
    layer = 1
    in_series = True
    drive_unit = "C"

    def check_on(self, actuator: Device) -> None:
        """Raise InvalidParameter if another term limits the voltage of the source."""
        for term in actuator.terms:
            if term.name() == "slew_rate":
                problem = "slew_rate limits a voltage, and charge_drive sets none; give one of them"
                raise InvalidParameter("terms", None, "", problem=problem)

    @classmethod
    def electrode(cls, indices: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return the electrode with the voltage determined by the charge of the drive."""
        capacitance, offset = electrode.capacitance, electrode.offset
        parasitic = indices.p["parasitic_capacitance"]

        def node(v, x, y, p):  # type: ignore[no-untyped-def]
            gap_capacitance = capacitance(x, p)
            return (v + gap_capacitance * offset(y, p)) / (gap_capacitance + p[parasitic])

        return electrode._replace(node=node)

    @classmethod
    def electrode_energy(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> Function:
        """Return the energy of the fields, in the gap and in the parasitic capacitance."""
        return field_energy(electrode, indices.p["parasitic_capacitance"])
