"""A resistance between the drive and each electrode."""

from __future__ import annotations

import math
from typing import Annotated

from mems_impact._util.formatting import shown
from mems_impact._util.units import Scales
from mems_impact.actuator.parameter_base import NonNegative, OptionalPositive, Positive, Unit
from mems_impact.actuator.plausible_ranges import CAPACITANCE, Range
from mems_impact.actuator.terms.base import (
    Electrode,
    Function,
    ParameterIndices,
    RateBound,
    Shape,
    Term,
    field_energy,
)
from mems_impact.errors import InvalidParameter
from mems_impact.integrators.options import Options

# With a current limit, a time constant of 2 sqrt(rtol) of the motion gives the accuracy of rtol.
RESOLVED_TIME = 5.0
RESOLVED_CHARGE = 10.0  # charge of a current limit in a time constant, in absolute tolerances


class SeriesResistance(Term):
    """A resistance of source or leads, through which each electrode is charged.

    Parameters
    ----------
    resistance : float
        Between drive and electrode [ohm], > 0.
    parasitic_capacitance : float, optional
        Parasitic capacitance to ground, parallel to the electrode [F], >= 0.
    current_limit : float, optional
        Largest current of the source to each electrode, in either direction [A]; unlimited by
        default.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    SlewRate, ChargeDrive, DielectricCharging, Actuator

    Notes
    -----
    The charge behind the resistance is a state, ``charge`` (and ``left_charge``), 0 by default:

        charge = C(x) (node - offset) + Cp node,    d charge/dt = (v - node)/resistance

    with the capacitance C(x) = 2 alpha/(d - x) of the electrode and terms in its gap, the parasitic
    capacitance Cp, and the voltage ``node`` at the electrode, which determines the force (S. D.
    Senturia, *Microsystem Design*, 2001, Chapter 6). Slow charging prevents pull-in: at constant
    charge, without parasitic capacitance, the attraction does not grow as the gap closes (J. I.
    Seeger, B. E. Boser, J. Microelectromech. Syst. 12, 656 (2003)). The charge has the sign of the
    voltage: if the sign alternates, the forcing period is the period of the voltage, not of its
    square.

    A current (v - node)/resistance above the limit is replaced by the limit. The modes of the
    motion then have the suffix "source", for a current to the electrode, or "sink", and tables of
    events list each crossing as "current limit".

    A time constant far below the forcing period makes the equations stiff, so the default method of
    runs is ``"auto"``.

    Examples
    --------
    >>> import mems_impact as mi
    >>> slower = mi.load_actuator("mita2003").adding(mi.SeriesResistance(resistance=1e9))
    """

    resistance: Annotated[Positive, Unit("ohm", Range(1e-3, 1e6, 1e16))]
    parasitic_capacitance: Annotated[NonNegative, Unit("F", CAPACITANCE)] = 0.0
    current_limit: Annotated[OptionalPositive, Unit("A", Range(1e-15, 1e-6, 10.0))] = None

    units = {"charge": "C"}  # noqa: RUF012 - ClassVar above
    replaced_rule = "source"
    layer = 1
    signed = True
    stiff = True
    in_series = True

    def check_resolved(self, options: Options, scales: Scales, capacitance: float) -> None:
        """Raise InvalidParameter if errors of the charge hide when the current is limited."""
        if self.current_limit is None:
            return
        scaled_term = self.scaled(scales)
        capacitance += scaled_term.parasitic_capacitance
        assert scaled_term.current_limit is not None
        min_resistance = max(
            RESOLVED_TIME * math.sqrt(options.rtol) / capacitance,
            RESOLVED_CHARGE * options.atol / (capacitance * scaled_term.current_limit),
        )
        if scaled_term.resistance < min_resistance:
            quantity = f"{float(scales.out(min_resistance, 'ohm')):.3g}{' ohm' * scales.named}"
            allowed = (
                f">= {quantity} at rtol = {shown(options.rtol)}, atol = {shown(options.atol)}: the "
                "charge settles so fast that its errors hide when the current is limited"
            )
            raise InvalidParameter(f"{self.name()}.resistance", self.resistance, allowed)

    @classmethod
    def electrode_states(cls, shape: Shape) -> tuple[str, ...]:
        """Return the charge."""
        return ("charge",)

    @classmethod
    def electrode(cls, indices: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return the electrode with the voltage determined by its charge."""
        capacitance, offset = electrode.capacitance, electrode.offset
        charge, parasitic = indices.y["charge"], indices.p["parasitic_capacitance"]

        def node(v, x, y, p):  # type: ignore[no-untyped-def]
            gap_capacitance = capacitance(x, p)
            return (y[charge] + gap_capacitance * offset(y, p)) / (gap_capacitance + p[parasitic])

        return electrode._replace(node=node)

    @classmethod
    def electrode_rates(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> tuple[Function, ...]:
        """Return the current."""
        ohmic_current, limit = current_of(indices, electrode), indices.p.get("current_limit", -1)
        if limit < 0:
            return (ohmic_current,)

        def current(v, x, speed, y, p):  # type: ignore[no-untyped-def]
            return min(max(ohmic_current(v, x, speed, y, p), -p[limit]), p[limit])

        return (current,)

    @classmethod
    def rate_limit(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> RateBound | None:
        """Return the limit of the current."""
        limit = indices.p.get("current_limit", -1)
        if limit < 0:
            return None

        def max_current(p):  # type: ignore[no-untyped-def]
            return p[limit]

        current = current_of(indices, electrode)
        return RateBound("current limit", "charge", ("source", "sink"), current, max_current)

    @classmethod
    def electrode_energy(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> Function:
        """Return the energy of the fields, in the gap and in the parasitic capacitance."""
        return field_energy(electrode, indices.p["parasitic_capacitance"])

    @classmethod
    def electrode_dissipation(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> Function:
        """Return the power dissipated in the source and its resistance."""
        node, (current,) = electrode.node, cls.electrode_rates(indices, shape, electrode)

        def dissipation(v, x, y, p):  # type: ignore[no-untyped-def]
            return (v - node(v, x, y, p)) * current(v, x, 0.0, y, p)

        return dissipation


def current_of(indices: ParameterIndices, electrode: Electrode) -> Function:
    """Return the current without a limit."""
    node, resistance = electrode.node, indices.p["resistance"]

    def current(v, x, speed, y, p):  # type: ignore[no-untyped-def]
        return (v - node(v, x, y, p)) / p[resistance]

    return current
