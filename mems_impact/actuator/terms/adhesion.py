"""Adhesion of the block to stoppers."""

from __future__ import annotations

from typing import Annotated

from mems_impact.actuator import equations as eq
from mems_impact.actuator.equations import X2
from mems_impact.actuator.parameter_base import NonNegative, Unit
from mems_impact.actuator.plausible_ranges import FORCE
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution


class Adhesion(Term):
    """Adhesion between a stopper and the block at rest on it.

    Parameters
    ----------
    force : float
        Pull-off force [N], >= 0.

    Raises
    ------
    InvalidParameter
        If the value is out of range.

    See Also
    --------
    CompliantStopper, resting_voltage, Actuator

    Notes
    -----
    The pull-off force is independent of history (Maugis, "Contact, Adhesion and Rupture of Elastic
    Solids", 2000, Section 4). It has zero range, so that it does no work and does not change an
    impact. On a compliant stopper it acts at all depths. With force > k delta the spring alone
    cannot release a resting block.

    Examples
    --------
    >>> import mems_impact as mi
    >>> sticky = mi.load_actuator("zhao2004").adding(mi.Adhesion(force=0.1))
    """

    force: Annotated[NonNegative, Unit("N", FORCE)]

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the force."""
        force = indices.p["force"]

        def adhesion(p):  # type: ignore[no-untyped-def]
            return p[force]

        def energy(y, p):  # type: ignore[no-untyped-def]
            return -p[force] * max(abs(y[X2]) - p[eq.DELTA], 0.0)

        return TermContribution(adhesion=adhesion, energy=energy)
