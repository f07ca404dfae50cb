"""Friction without sticking, for comparison."""

from __future__ import annotations

import math
from typing import Annotated

from mems_impact._util.formatting import shown
from mems_impact._util.units import Scales
from mems_impact.actuator import equations as eq
from mems_impact.actuator.parameter_base import Positive, Unit
from mems_impact.actuator.plausible_ranges import SPEED
from mems_impact.actuator.terms.base import ParameterIndices, Shape, Term, TermContribution
from mems_impact.errors import InvalidParameter
from mems_impact.integrators.options import Options

WIDTH_TOLERANCES = (
    1e3  # absolute tolerances in a width: loads of a thousandth of friction still have a sign
)


class RegularizedFriction(Term):
    """Friction regularized near zero speed: the frame never sticks, but creeps under any load.

    A common substitute for switching between sticking and slipping, for comparison.

    Parameters
    ----------
    width : float
        Width of the transition between the signs of friction, as a speed [m/s], > 0.

    Raises
    ------
    InvalidParameter
        If the value is out of range; at a run, if the tolerances do not resolve the width.

    See Also
    --------
    StribeckFriction, Friction, Actuator

    Notes
    -----
    mu_d tanh(v1/width) times the normal force N; mu_s is not used. Under a constant load F the
    frame creeps at width artanh(F/(mu_d N)). The frame always slips: ``share slipping`` is 1, and a
    step lasts until the next impact. Narrow widths make the equations stiff. Integration errors
    would reverse a frame that creeps more slowly than the absolute tolerance, so the width must be
    at least 1000 times `Options.atol`, in scaled units.

    Examples
    --------
    >>> import mems_impact as mi
    >>> creeping = mi.load_actuator("zhao2004").adding(mi.RegularizedFriction(width=1e-4))
    """

    width: Annotated[Positive, Unit("m/s", SPEED)]

    replaced_rule = "friction"
    stiff = True

    def check_resolved(self, options: Options, scales: Scales, capacitance: float) -> None:
        """Raise InvalidParameter if the frame would creep at less than the absolute tolerance."""
        scaled_width = scales.into(self.width, "m/s")
        if scaled_width < WIDTH_TOLERANCES * options.atol:
            min_width = float(scales.out(WIDTH_TOLERANCES * options.atol, "m/s"))
            quantity = f"{min_width:.3g}{' m/s' * scales.named}"
            atol = 10.0 ** math.floor(math.log10(scaled_width / WIDTH_TOLERANCES))
            allowed = (
                f">= {quantity} at atol = {shown(options.atol)}, at which slower creep cannot be "
                f"distinguished from rest; take atol = {atol:.0e} for this width"
            )
            raise InvalidParameter(f"{self.name()}.width", self.width, allowed)

    @classmethod
    def contribution(cls, indices: ParameterIndices, shape: Shape) -> TermContribution:
        """Return the coefficient."""
        width = indices.p["width"]

        def friction(speed, p):  # type: ignore[no-untyped-def]
            return p[eq.MU_D] * math.tanh(speed / p[width])

        return TermContribution(friction=friction, sticks=False)
