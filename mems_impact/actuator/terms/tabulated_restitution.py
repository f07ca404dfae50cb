"""Measured restitution over impact speed."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Self

from pydantic import Field, model_validator

from mems_impact.actuator.parameter_base import Fraction, NonNegative, Unit
from mems_impact.actuator.plausible_ranges import SPEED
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution
from mems_impact.errors import InvalidParameter

TABLE = "a tuple of two numbers or more"


class TabulatedRestitution(Term):
    """Coefficient of restitution interpolated in a table over the impact speed, in place of `e`.

    Parameters
    ----------
    speeds : tuple of float
        Speeds of the block before the impact [m/s], >= 0, ascending; two or more.
    values : tuple of float
        The coefficient at each speed [-], 0 to 1.

    Raises
    ------
    InvalidParameter
        If a value is out of range, the speeds do not ascend, or the lengths differ.

    See Also
    --------
    PowerLawRestitution, CompliantStopper, Actuator

    Notes
    -----
    The interpolant is the monotone cubic of Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5
    (1984) 300; it is constant beyond the table, with a smooth transition.

    Examples
    --------
    >>> import mems_impact as mi
    >>> table = mi.TabulatedRestitution(speeds=(0.05, 0.2, 1.0), values=(0.85, 0.8, 0.6))
    >>> measured = mi.load_actuator("zhao2004").adding(table)
    """

    speeds: Annotated[
        tuple[NonNegative, ...], Field(min_length=2, description=TABLE), Unit("m/s", SPEED)
    ]
    values: Annotated[tuple[Fraction, ...], Field(min_length=2, description=TABLE)]

    replaced_rule = "restitution"

    @model_validator(mode="after")
    def _check_table(self) -> Self:
        if any(previous >= speed for previous, speed in pairwise(self.speeds)):
            raise InvalidParameter("speeds", self.speeds, "in ascending order, each once")
        if len(self.values) != len(self.speeds):
            raise InvalidParameter("values", self.values, f"{len(self.speeds)} numbers, as speeds")
        return self

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the restitution."""
        x, y = indices.p["speeds"], indices.p["values"]
        last = cls.lengths(shape)["speeds"] - 1

        def secant(i, p):  # type: ignore[no-untyped-def]
            return (p[y + i + 1] - p[y + i]) / (p[x + i + 1] - p[x + i])

        def slope(i, p):  # type: ignore[no-untyped-def]
            # The weighted harmonic mean of the secants; 0 at an extremum, and at the ends.
            if i == 0 or i == last:
                return 0.0
            left_secant, right_secant = secant(i - 1, p), secant(i, p)
            if left_secant * right_secant <= 0.0:
                return 0.0
            left_step, right_step = p[x + i] - p[x + i - 1], p[x + i + 1] - p[x + i]
            left_weight, right_weight = 2.0 * right_step + left_step, right_step + 2.0 * left_step
            return (left_weight + right_weight) / (
                left_weight / left_secant + right_weight / right_secant
            )

        def restitution(speed, p):  # type: ignore[no-untyped-def]
            if speed <= p[x]:
                return p[y]
            for i in range(last):
                if speed <= p[x + i + 1]:
                    h = p[x + i + 1] - p[x + i]
                    u = (speed - p[x + i]) / h
                    w = 1.0 - u
                    result = w * w * (1.0 + 2.0 * u) * p[y + i]
                    result += u * u * (1.0 + 2.0 * w) * p[y + i + 1]
                    return result + h * u * w * (w * slope(i, p) - u * slope(i + 1, p))
            return p[y + last]

        return TermContribution(restitution=restitution)
