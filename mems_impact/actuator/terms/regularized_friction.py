"""Friction without sticking, for comparison."""

from __future__ import annotations

import math

from mems_impact.actuator import equations as eq
from mems_impact.actuator.parameter_base import Positive
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution

__all__ = ["RegularizedFriction"]


class RegularizedFriction(Term):
    """Friction smoothed about rest: the frame never sticks, but creeps under any load.

    What others do who cannot switch between sticking and slipping; here to be compared with.

    Parameters
    ----------
    width : float
        Speed over which friction turns round [m/s], > 0.

    Raises
    ------
    InvalidParameter
        If the value is out of range.

    See Also
    --------
    StribeckFriction, Friction, Actuator

    Notes
    -----
    mu_d tanh(v1/width) times the normal force N; mu_s is not used. Under a constant load F the
    frame creeps at width artanh(F/(mu_d N)). All of its time it slips: ``share slipping`` is 1, and
    a step goes on until the next impact. Narrow widths make the equations stiff.

    Examples
    --------
    >>> import mems_impact as mi
    >>> creeping = mi.load_actuator("zhao2004").adding(mi.RegularizedFriction(width=1e-4))
    """

    width: Positive

    units = {"width": "m/s"}  # noqa: RUF012 - ClassVar above
    instead = "friction"
    stiff = True

    @classmethod
    def contribution(cls, at: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the coefficient."""
        width = at.p["width"]

        def friction(speed, p):  # type: ignore[no-untyped-def]
            return p[eq.MU_D] * math.tanh(speed / p[width])

        return TermContribution(friction=friction, sticks=False)
