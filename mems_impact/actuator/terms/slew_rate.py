"""A limited rate of the voltage of the source."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.drives.slewed import SlewedDrive
from mems_impact.actuator.parameter_base import Positive, Unit
from mems_impact.actuator.plausible_ranges import Range
from mems_impact.actuator.terms.base import Term
from mems_impact.errors import InvalidParameter


class SlewRate(Term):
    """A limit of the rate at which the voltage of the source changes.

    Parameters
    ----------
    rate : float
        Largest absolute rate of the voltage [V/s], > 0.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    SeriesResistance, ChargeDrive, Actuator

    Notes
    -----
    The output of the source equals the voltage of the drive while this voltage changes at less than
    the rate. Otherwise the output changes at the rate until it equals the drive again. The ends of
    these ramps, computed before a run, are switching times. The output belongs to a source in its
    periodic regime, from the start of a run on.

    Examples
    --------
    >>> import mems_impact as mi
    >>> slow = mi.load_actuator("mita2003").adding(mi.SlewRate(rate="0.1 V/us"))
    >>> slow.terms[0].rate
    100000.0
    """

    rate: Annotated[Positive, Unit("V/s", Range(1e-6, 1e5, 1e12))]

    in_series = True

    def check_under(self, drive: Drive) -> None:
        """Raise InvalidParameter if the drive has a clamp, which the rate does not limit."""
        if drive.clamp_voltage is not None:
            problem = "the rate of a clamp is not limited; omit this term, or give ramps as a drive"
            raise InvalidParameter("slew_rate", None, "", problem=problem)

    def source(self, drive: Drive) -> Drive:
        """Return the output of the source for the voltage of a drive."""
        return SlewedDrive(wave=drive, rate=self.rate)
