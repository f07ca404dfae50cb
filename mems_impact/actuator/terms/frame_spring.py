"""A spring between frame and ground."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator.equations import X1
from mems_impact.actuator.parameter_base import NonNegative, Unit
from mems_impact.actuator.plausible_ranges import STIFFNESS
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution


class FrameSpring(Term):
    """A spring between frame and ground, without force at x1 = 0.

    The frame walks until an impact makes it slip under a spring force above dynamic friction. If
    mu_s is above mu_d the frame then slides back, and walks again.

    Parameters
    ----------
    k1 : float
        Stiffness [N/m], >= 0.

    Raises
    ------
    InvalidParameter
        If the value is out of range.

    See Also
    --------
    FrameForce, Tilt, Actuator

    Notes
    -----
    Static friction holds a frame without voltage up to abs(x1) = mu_s (m1 + m2) g/k1. The position
    x1 is then not cyclic: an orbit must close in x1 too.

    Examples
    --------
    >>> import mems_impact as mi
    >>> held = mi.load_actuator("zhao2004").adding(mi.FrameSpring(k1=0.1))
    """

    k1: Annotated[NonNegative, Unit("N/m", STIFFNESS)]

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the force."""
        k1 = indices.p["k1"]

        def on_frame(y, p):  # type: ignore[no-untyped-def]
            return -p[k1] * y[X1]

        def energy(y, p):  # type: ignore[no-untyped-def]
            return 0.5 * p[k1] * y[X1] * y[X1]

        return TermContribution(on_frame=on_frame, energy=energy, depends_on_x1=True)
