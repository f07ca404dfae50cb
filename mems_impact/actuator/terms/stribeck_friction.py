"""Friction that decreases from its static to its dynamic value with the speed."""

from __future__ import annotations

import math
from typing import Annotated

from mems_impact.actuator import equations as eq
from mems_impact.actuator.parameter_base import NonNegative, Positive, Unit
from mems_impact.actuator.plausible_ranges import PER_SPEED, SPEED
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution


class StribeckFriction(Term):
    """Speed-dependent friction of the frame, with sticking as under Coulomb friction.

    Parameters
    ----------
    speed : float
        Speed over which friction falls from mu_s to mu_d [m/s], > 0.
    viscous : float, optional
        Viscous increase of the coefficient per speed [s/m], >= 0; 0 by default.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    See Also
    --------
    RegularizedFriction, Stribeck, Actuator

    Notes
    -----
    mu_d + (mu_s - mu_d) exp(-(v1/speed)^2) + viscous abs(v1), times the normal force
    (Armstrong-Helouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083, Eq. 5, with the
    exponent 2). The limit of zero `speed` is the paper's friction.

    Examples
    --------
    >>> import mems_impact as mi
    >>> smooth = mi.load_actuator("zhao2004").adding(mi.StribeckFriction(speed=0.05))
    """

    speed: Annotated[Positive, Unit("m/s", SPEED)]
    viscous: Annotated[NonNegative, Unit("s/m", PER_SPEED)] = 0.0

    replaced_rule = "friction"

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the coefficient."""
        scale, viscous = indices.p["speed"], indices.p["viscous"]

        def friction(speed, p):  # type: ignore[no-untyped-def]
            square = (speed / p[scale]) ** 2
            # Beyond rest the same to the fifth order, but not back at mu_d: else a step would pass
            # rest, and a rise of friction that is narrower than itself, without seeing it.
            decay = math.exp(-square) if speed > 0.0 else 1.0 - square / (1.0 + 0.5 * square)
            return p[eq.MU_D] + (p[eq.MU_S] - p[eq.MU_D]) * decay + p[viscous] * speed

        return TermContribution(friction=friction)
