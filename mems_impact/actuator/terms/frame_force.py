"""A constant load on the frame."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator.equations import X1
from mems_impact.actuator.parameter_base import Number, Unit
from mems_impact.actuator.plausible_ranges import FORCE
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution


class FrameForce(Term):
    """A constant force on the frame, against motion to the right.

    Parameters
    ----------
    force : float
        Force [N], positive to the left: walking to the right is work against the force.

    Raises
    ------
    InvalidParameter
        If the value is not a number.

    See Also
    --------
    FrameSpring, Tilt, force_curve, Actuator

    Notes
    -----
    Static friction holds a device without voltage up to mu_s (m1 + m2) g.

    Examples
    --------
    >>> import mems_impact as mi
    >>> loaded = mi.load_actuator("zhao2004").adding(mi.FrameForce(force=0.2))
    """

    force: Annotated[Number, Unit("N", FORCE)]

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the force."""
        load = indices.p["force"]

        def on_frame(y, p):  # type: ignore[no-untyped-def]
            return -p[load]

        def energy(y, p):  # type: ignore[no-untyped-def]
            return p[load] * y[X1]

        return TermContribution(on_frame=on_frame, energy=energy)
