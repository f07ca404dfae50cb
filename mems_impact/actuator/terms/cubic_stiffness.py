"""A suspension with cubic stiffness."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator.equations import X2
from mems_impact.actuator.parameter_base import Number, Unit
from mems_impact.actuator.plausible_ranges import Range
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution


class CubicStiffness(Term):
    """A spring between block and frame with the force -k x2 - k3 x2^3.

    Parameters
    ----------
    k3 : float
        Cubic stiffness [N/m^3]; positive for a clamped beam, which stretches as it bends.

    Raises
    ------
    InvalidParameter
        If the value is not a number.

    See Also
    --------
    Fringing, CompliantStopper, Actuator

    Notes
    -----
    The relative increase of the frequency of free oscillation at amplitude A is 3 k3 A^2/(8 k), to
    first order (A. H. Nayfeh, D. T. Mook, *Nonlinear Oscillations*, 1979, Section 2.1).

    Examples
    --------
    >>> import mems_impact as mi
    >>> stiffer = mi.load_actuator("zhao2004").adding(mi.CubicStiffness(k3=0.5))
    """

    k3: Annotated[Number, Unit("N/m^3", Range(1e2, 1e11, 1e20))]

    replaced_rule = "spring"

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the force."""
        k3 = indices.p["k3"]

        def force(y, p):  # type: ignore[no-untyped-def]
            return -p[k3] * y[X2] * y[X2] * y[X2]

        def energy(y, p):  # type: ignore[no-untyped-def]
            return 0.25 * p[k3] * y[X2] ** 4

        return TermContribution(force=force, energy=energy)
