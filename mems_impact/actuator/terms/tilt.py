"""A device on an inclined ground."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from mems_impact.actuator import equations as eq
from mems_impact.actuator.equations import X1, X2
from mems_impact.actuator.parameter_base import Number, Unit
from mems_impact.actuator.plausible_ranges import Range
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution

MAX_ANGLE = 0.5 * math.pi


class Tilt(Term):
    """Inclined ground: gravity pulls frame and block to the left, and the normal force is smaller.

    Parameters
    ----------
    angle : float
        Inclination [rad], between -pi/2 and pi/2; for positive angles the right is uphill.

    Raises
    ------
    InvalidParameter
        If the value is out of range.

    See Also
    --------
    FrameForce, FrameSpring, Actuator

    Notes
    -----
    Forces -m1 g sin(angle) on the frame and -m2 g sin(angle) on the block; normal force
    (m1 + m2) g cos(angle). Static friction holds a device at rest up to the angle atan(mu_s).

    Examples
    --------
    >>> import mems_impact as mi
    >>> uphill = mi.load_actuator("zhao2004").adding(mi.Tilt(angle=0.05))
    """

    angle: Annotated[Number, Field(gt=-MAX_ANGLE, lt=MAX_ANGLE), Unit("", Range(0.0, 0.05, 0.8))]

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the forces and the factor of the normal force."""
        angle = indices.p["angle"]

        def on_frame(y, p):  # type: ignore[no-untyped-def]
            return -p[eq.M1] * p[eq.G] * math.sin(p[angle])

        def on_block(y, p):  # type: ignore[no-untyped-def]
            return -p[eq.M2] * p[eq.G] * math.sin(p[angle])

        def normal(p):  # type: ignore[no-untyped-def]
            return math.cos(p[angle])

        def energy(y, p):  # type: ignore[no-untyped-def]
            weight = p[eq.G] * math.sin(p[angle])
            return weight * ((p[eq.M1] + p[eq.M2]) * y[X1] + p[eq.M2] * y[X2])

        return TermContribution(
            on_frame=on_frame, on_block=on_block, weight_factor=normal, energy=energy
        )
