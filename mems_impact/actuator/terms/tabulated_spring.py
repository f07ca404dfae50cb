"""A suspension with a measured or computed force."""

from __future__ import annotations

from typing import Annotated

from mems_impact._util.limits import Bound
from mems_impact.actuator import equations as eq
from mems_impact.actuator.equations import X2
from mems_impact.actuator.parameter_base import Unit
from mems_impact.actuator.plausible_ranges import FORCE
from mems_impact.actuator.terms.base import ParameterIndices, Shape, TermContribution
from mems_impact.actuator.terms.table import TableNumbers, TableTerm

STIFFNESS_RTOL = 0.01  # difference of k from the stiffness of the table at x2 = 0


class TabulatedSpring(TableTerm):
    """A spring between block and frame with a force from a table, in place of k x2.

    Parameters
    ----------
    positions : tuple of float
        Positions x2 of the block [m], ascending, four or more; they cover the travel from -delta to
        delta; with compliant stoppers up to halfway between stopper and electrode.
    forces : tuple of float
        The restoring force at each position [N], with the sign of k x2: positive at positive
        positions for a spring that pulls the block back.

    Raises
    ------
    InvalidParameter
        If a value is out of range, the positions do not ascend, or the lengths differ; if the table
        does not cover the travel of the block, or its stiffness at x2 = 0 is positive and differs
        from `k` by more than 1 %.

    See Also
    --------
    CubicStiffness, TabulatedCapacitance, Actuator

    Notes
    -----
    The interpolant, as of `TabulatedCapacitance`, is monotone wherever three successive intervals
    of the table are monotone. The energy of the spring is its integral; in the table of `energy`
    the account "spring" is k x2^2/2, and "tabulated_spring" the rest.

    `k` does not enter the force: it is the stiffness of small oscillations, ``slope(0.0)`` of the
    table, from which `Actuator.from_design` takes `k`. ``TabulatedSpring.from_csv(path,
    column_units=("um", "uN"))`` reads a file of two columns; in a device file, these are the
    entries ``file`` and ``column_units``.

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> x = np.linspace(-0.5, 0.5, 21)
    >>> spring = mi.TabulatedSpring(positions=x, forces=x + 0.5 * x**3)
    >>> tabulated = mi.load_actuator("zhao2004").adding(spring)
    >>> cubic = mi.load_actuator("zhao2004").adding(mi.CubicStiffness(k3=0.5))
    >>> f"{mi.pull_in_voltage(tabulated):.9f}, {mi.pull_in_voltage(cubic):.9f}"
    '0.396247024, 0.396247024'
    """

    forces: Annotated[TableNumbers, Unit("N", FORCE)]

    column = "forces"
    replaced_rule = "spring"

    def energy(self, position: float) -> float:
        """Return the energy of the spring at a position, 0 at x2 = 0, in the units of the table."""
        spline, p = self.own_spline()
        return float(spline.integral(position, p) - spline.integral(0.0, p))

    @classmethod
    def bounds(cls, indices: ParameterIndices, shape: Shape, compliant: bool) -> tuple[Bound, ...]:
        """Return the bounds of the travel and of the stiffness, which the table determines."""
        slope = cls.spline(indices, shape).slope

        def stiffness(p):  # type: ignore[no-untyped-def]
            table_slope = slope(0.0, p)
            return table_slope if table_slope > 0.0 else p[eq.K]

        def min_stiffness(p):  # type: ignore[no-untyped-def]
            return (1.0 - STIFFNESS_RTOL) * stiffness(p)

        def max_stiffness(p):  # type: ignore[no-untyped-def]
            return (1.0 + STIFFNESS_RTOL) * stiffness(p)

        meaning = "within 1 % of the stiffness of the table at x2 = 0"
        return (
            *super().bounds(indices, shape, compliant),
            Bound(name="k", value=min_stiffness, excluded=False, meaning=meaning),
            Bound(name="k", value=max_stiffness, upper=True, excluded=False, meaning=meaning),
        )

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return force and energy beyond the linear spring."""
        spline_force, _, integral = cls.spline(indices, shape)

        def force(y, p):  # type: ignore[no-untyped-def]
            return p[eq.K] * y[X2] - spline_force(y[X2], p)

        def energy(y, p):  # type: ignore[no-untyped-def]
            spline_energy = integral(y[X2], p) - integral(0.0, p)
            return spline_energy - 0.5 * p[eq.K] * y[X2] * y[X2]

        return TermContribution(force=force, energy=energy)
