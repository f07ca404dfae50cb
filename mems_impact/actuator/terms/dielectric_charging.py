"""Charging of the insulation of each electrode."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from mems_impact.actuator.parameter_base import Number, Positive, Unit
from mems_impact.actuator.plausible_ranges import Range
from mems_impact.actuator.terms.base import Electrode, Function, ParameterIndices, Shape, Term


class DielectricCharging(Term):
    """Dielectric charging, which shifts the effective voltage of the electrodes.

    Parameters
    ----------
    share : float
        Fraction of a constant voltage that trapped charge compensates in the end [-], between -1
        and 1; positive values screen the voltage, negative values add to the voltage.
    time : float
        Time constant of the charging [s], > 0.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    SeriesResistance, Fringing, Actuator

    Notes
    -----
    The trapped charge acts as a voltage in series with the electrode, ``offset`` (and
    ``left_offset``), a state that is 0 initially; the force is proportional to (node - offset)^2,
    so that the curve of force over voltage is shifted (J. Wibbeler, G. Pfeifer, M. Hietschold,
    Sens. Actuators A 71, 74 (1998)). The offset follows the voltage at the electrode,

        d offset/dt = (share node - offset)/time

    with one time constant of the several by which X. Yuan et al. (IEEE MTT-S Int. Microw. Symp.
    2005, 753) fit such charging. Measured currents follow the power law of Curie and von Schweidler
    over decades of time: one constant is valid for about one decade around it.

    The trapped charge has no energy of its own in this model.

    Examples
    --------
    >>> import mems_impact as mi
    >>> ageing = mi.load_actuator("mita2003").adding(mi.DielectricCharging(share=0.1, time=60.0))
    """

    share: Annotated[Number, Field(ge=-1, le=1)]
    time: Annotated[Positive, Unit("s", Range(1e-8, 1.0, 1e9))]

    units = {"offset": "V"}  # noqa: RUF012 - ClassVar above
    signed = True

    @classmethod
    def electrode_states(cls, shape: Shape) -> tuple[str, ...]:
        """Return the offset."""
        return ("offset",)

    @classmethod
    def electrode(cls, indices: ParameterIndices, shape: Shape, electrode: Electrode) -> Electrode:
        """Return the electrode with the offset."""
        other_offset, index = electrode.offset, indices.y["offset"]

        def offset(y, p):  # type: ignore[no-untyped-def]
            return other_offset(y, p) + y[index]

        return electrode._replace(offset=offset)

    @classmethod
    def electrode_rates(
        cls, indices: ParameterIndices, shape: Shape, electrode: Electrode
    ) -> tuple[Function, ...]:
        """Return the rate of charging."""
        node = electrode.node
        offset, share, time = indices.y["offset"], indices.p["share"], indices.p["time"]

        def charging(v, x, speed, y, p):  # type: ignore[no-untyped-def]
            return (p[share] * node(v, x, y, p) - y[offset]) / p[time]

        return (charging,)
