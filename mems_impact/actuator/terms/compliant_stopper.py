"""Stoppers of finite stiffness."""

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from mems_impact.actuator import equations as eq
from mems_impact.actuator.equations import V2, X2
from mems_impact.actuator.parameter_base import NonNegative, Number, Positive, Unit
from mems_impact.actuator.plausible_ranges import PER_SPEED, Range
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution


class CompliantStopper(Term):
    """Compliant stoppers in place of impacts, with contacts of finite duration and depth.

    Parameters
    ----------
    stiffness : float
        Force by depth [N/m] at the depth `depth`, > 0.
    exponent : float, optional
        Exponent of the force over the depth [-], >= 1: 1 for a beam, 1.5 for a sphere on a plane
        (Hertz); 1 by default.
    damping : float, optional
        Damping that determines the restitution [s/m], >= 0: e is 1 - damping v for a slow impact.
    depth : float, optional
        Depth at which `stiffness` is force by depth [m], > 0; irrelevant for the exponent 1. With
        the default 1, `stiffness` is the factor of depth^exponent.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    Adhesion, PowerLawRestitution, Actuator

    Notes
    -----
    Hunt and Crossley, "Coefficient of restitution interpreted as damping in vibroimpact", J. Appl.
    Mech. 42 (1975) 440: the force at the depth s is N = K s^n (1 + 3/2 a s'), where K is
    stiffness/depth^(n-1) and a the damping; never negative. Impacts are the starts of contacts. The
    device's `e` is not used. State ``contact_loss`` [J] accumulates the losses. A block at rest on
    a hard stopper makes the equations stiff, so the default method of runs is ``"auto"``.

    Examples
    --------
    >>> import mems_impact as mi
    >>> soft = mi.load_actuator("zhao2004").adding(mi.CompliantStopper(stiffness=1e4, damping=0.5))
    """

    stiffness: Annotated[Positive, Unit("N/m", Range(1e-2, 1e5, 1e11))]
    exponent: Annotated[Number, Field(ge=1)] = 1.0
    damping: Annotated[NonNegative, Unit("s/m", PER_SPEED)] = 0.0
    depth: Annotated[Positive, Unit("m", Range(1e-13, 1e-8, 1e-3))] = 1.0

    units = {"contact_loss": "J"}  # noqa: RUF012 - ClassVar above
    replaced_rule = "stopper"
    stiff = True

    @classmethod
    def states(cls, shape: Shape) -> tuple[str, ...]:
        """Return the name of the accumulated loss of contacts."""
        return ("contact_loss",)

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the force of a stopper."""
        stiffness, exponent = indices.p["stiffness"], indices.p["exponent"]
        damping, reference = indices.p["damping"], indices.p["depth"]

        def spring(depth, p):  # type: ignore[no-untyped-def]
            # An odd function, so that it is smooth if a trial step leaves the contact.
            if depth == 0.0:  # where the power has no derivative, its product with the depth has
                return depth * (p[stiffness] if p[exponent] == 1.0 else 0.0)
            depth_ratio = abs(depth) / p[reference]
            return p[stiffness] * depth * depth_ratio ** (p[exponent] - 1.0)

        def damping_factor(rate, p):  # type: ignore[no-untyped-def]
            # A stopper exerts no force on a block that leaves faster than it can follow.
            return max(1.0 + 1.5 * p[damping] * rate, 0.0)

        def stopper(depth, rate, p):  # type: ignore[no-untyped-def]
            return spring(depth, p) * damping_factor(rate, p)

        def energy(y, p):  # type: ignore[no-untyped-def]
            depth = max(abs(y[X2]) - p[eq.DELTA], 0.0)
            return spring(depth, p) * depth / (p[exponent] + 1.0)

        def dissipation(y, p):  # type: ignore[no-untyped-def]
            depth = max(abs(y[X2]) - p[eq.DELTA], 0.0)
            rate = math.copysign(y[V2], y[X2] * y[V2])
            return spring(depth, p) * (damping_factor(rate, p) - 1.0) * rate

        return TermContribution(
            stopper=stopper,
            rates=(dissipation,),
            sums=("contact_loss",),
            energy=energy,
            dissipation=dissipation,
        )
