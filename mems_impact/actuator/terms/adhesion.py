"""Stoppers to which the block sticks."""

from __future__ import annotations

from mems_impact.actuator import equations as eq
from mems_impact.actuator.automaton import X2
from mems_impact.actuator.parameter_base import NonNegative
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution

__all__ = ["Adhesion"]


class Adhesion(Term):
    """A force that holds the block that rests on a stopper.

    Parameters
    ----------
    force : float
        What has to be overcome before the block lets go [N], >= 0.

    Raises
    ------
    InvalidParameter
        If the value is out of range.

    See Also
    --------
    CompliantStopper, resting_voltage, Actuator

    Notes
    -----
    Pull-off by a force that does not depend on the history (Maugis, "Contact, Adhesion and Rupture
    of Elastic Solids", 2000, Section 4); it has no range, so that it does no work, and does not
    change an impact. On a stopper that yields it acts at all depths. A block that rests comes off
    where force > k delta only if something else than the spring pulls it: without voltage never.

    Examples
    --------
    >>> import mems_impact as mi
    >>> sticky = mi.load_actuator("zhao2004").adding(mi.Adhesion(force=0.1))
    """

    force: NonNegative

    units = {"force": "N"}  # noqa: RUF012 - ClassVar above

    @classmethod
    def contribution(cls, at: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the force."""
        force = at.p["force"]

        def adhesion(p):  # type: ignore[no-untyped-def]
            return p[force]

        def energy(y, p):  # type: ignore[no-untyped-def]
            return -p[force] * max(abs(y[X2]) - p[eq.DELTA], 0.0)

        return TermContribution(adhesion=adhesion, energy=energy)
