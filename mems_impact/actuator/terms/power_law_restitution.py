"""Restitution that decreases with the impact speed by a power law."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator import equations as eq
from mems_impact.actuator.parameter_base import NonNegative, Positive, Unit
from mems_impact.actuator.plausible_ranges import SPEED
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution


class PowerLawRestitution(Term):
    """Coefficient of restitution that decreases with the impact speed, by plastic deformation.

    Parameters
    ----------
    speed : float
        Speed at which plastic deformation sets in [m/s], > 0: slower impacts have the device's `e`.
    exponent : float, optional
        Exponent of the decrease [-], >= 0; 1/4 by default, as for a fully plastic contact.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    TabulatedRestitution, CompliantStopper, Actuator

    Notes
    -----
    e (1 + (v/speed)^2)^(-exponent/2) at the speed v of the block: e below `speed`, e
    (v/speed)^-exponent above (Johnson, Contact Mechanics, 1985, Section 11.5; Goldsmith, Impact,
    1960), and smooth between, at most a factor 2^(-exponent/2) below the corner.

    Examples
    --------
    >>> import mems_impact as mi
    >>> yielding = mi.load_actuator("zhao2004").adding(mi.PowerLawRestitution(speed=0.1))
    """

    speed: Annotated[Positive, Unit("m/s", SPEED)]
    exponent: NonNegative = 0.25

    replaced_rule = "restitution"

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the restitution."""
        scale, exponent = indices.p["speed"], indices.p["exponent"]

        def restitution(speed, p):  # type: ignore[no-untyped-def]
            speed_ratio = speed / p[scale]
            return p[eq.E] * (1.0 + speed_ratio * speed_ratio) ** (-0.5 * p[exponent])

        return TermContribution(restitution=restitution)
