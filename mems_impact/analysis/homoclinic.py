"""Homoclinic orbits at the ends of branches of limit cycles."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from mems_impact.analysis.equilibrium import Equilibrium
from mems_impact.continuation.homoclinic import cycles_beside, saddle_quantity
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result


@dataclass(frozen=True, kw_only=True, eq=False)
class HomoclinicEnd(Result):
    """The homoclinic orbit at the end of a branch of limit cycles, whose period diverges.

    Attributes
    ----------
    parameter : str
    value : float
        Value of the parameter at the homoclinic orbit, extrapolated from the last cycles.
    error : float
        Estimated error of the value.
    saddle : Equilibrium
        The saddle that the cycles approach, at the end of the branch.

    See Also
    --------
    Branch, continue_solution, Equilibrium

    Notes
    -----
    Kuznetsov, *Elements of Applied Bifurcation Theory*, 3rd edition (2004), chapter 6.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def flow(mode, t, y, p):  # Kuznetsov, example 6.1: homoclinic at a = 0
    ...     x, y = y.x, y.y
    ...     return -x + 2 * y + x**2, (2 - p.a) * x - y - 3 * x**2 + 1.5 * x * y
    >>> system = mi.System(states=("x", "y"), flow=flow, parameters={"a": 0.2})
    >>> cycle = mi.find_orbit(system, guess={"x": 0.7, "y": 0.1}, transient=100.0)
    >>> steps = mi.StepControl(max_step=0.2)
    >>> branch = mi.continue_solution(cycle, "a", stop=-0.2, steps=steps)
    >>> end = branch.homoclinic
    >>> abs(end.value) < 1e-6, round(end.saddle_quantity, 4), end.cycles
    (True, -2.0, 'one stable cycle')
    """

    parameter: str
    value: float
    error: float
    saddle: Equilibrium = field(repr=False)

    def __repr__(self) -> str:
        location, quantity = f"{self.parameter}={self.value:.9g}", f"{self.saddle_quantity:.6g}"
        return f"HomoclinicEnd({location}, {self.saddle}, saddle quantity {quantity})"

    @property
    def system(self) -> HybridSystem:
        """System of the saddle."""
        return self.saddle.system

    @property
    def saddle_quantity(self) -> float:
        """Sum of the real parts of the leading eigenvalues of the saddle, per unit of time."""
        return saddle_quantity(self.saddle.eigenvalues)

    @property
    def cycles(self) -> str:
        """The cycles nearby: a stable cycle, an unstable cycle, or infinitely many cycles.

        Empty if the saddle quantity is zero. Two homoclinic orbits at once, as in a symmetric
        system, may have further cycles.
        """
        return cycles_beside(self.saddle.eigenvalues)

    def summary(self) -> dict[str, Any]:
        """Return the value of the parameter, the saddle and the cycles that bifurcate."""
        return {
            self.system.units.label(self.parameter): self.value,
            "error": self.error,
            "saddle": repr(self.saddle.state),
            "saddle quantity": self.saddle_quantity,
            "cycles": self.cycles,
        }
