"""A force that presses the frame on the ground."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator.parameter_base import NonNegative, Unit
from mems_impact.actuator.plausible_ranges import CLAMP
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution


class Clamp(Term):
    """A constant force that presses the frame on the ground, such as that of a spring or a magnet.

    Parameters
    ----------
    force : float
        Clamping force [N], >= 0, in addition to the weight.

    Raises
    ------
    InvalidParameter
        If the value is out of range.

    See Also
    --------
    ClampElectrode, Tilt, Actuator

    Notes
    -----
    The normal force is the weight plus the clamping force: ``(m1 + m2) g cos(angle) + force``. The
    clamp exerts no force along the ground.

    Examples
    --------
    >>> import mems_impact as mi
    >>> clamped = mi.load_actuator("mita2003").adding(mi.Clamp(force="2 mN"))
    >>> round(clamped.datasheet["normal_force"], 6)
    0.002123
    """

    force: Annotated[NonNegative, Unit("N", CLAMP)]

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the clamping force."""
        force = indices.p["force"]

        def clamp(p):  # type: ignore[no-untyped-def]
            return p[force]

        return TermContribution(clamp=clamp)
