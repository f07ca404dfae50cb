"""A stopper with restitution, on which a body can come to rest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from mems_impact.errors import InvalidParameter
from mems_impact.systems.components.base import (
    ZERO_FORCE_RATIO,
    CodeNames,
    Constraint,
    Contact,
    ContactSides,
    GuardSpec,
    Limit,
    Quantity,
    sides,
)

FREE, HELD = 0, 1
TOUCHES = "1e-14"  # of the positions: a smaller gap is closed


@dataclass(frozen=True)
class Stopper(Contact):
    """A stopper for a body, or between two bodies.

    An impact reverses the relative velocity, multiplied by the coefficient of restitution, and
    conserves the momentum of two bodies. A chatter sequence is completed and ends in sustained
    contact, until the contact force falls to zero.

    Parameters
    ----------
    name : str
    position, velocity : str
        Position and velocity of the body.
    upper, lower : float, str or callable
        Give exactly one of the two, the position of the stop: ``position <= upper``, or ``position
        >= lower``. A number, a parameter or a function of ``p``. Between two bodies, a bound of
        their distance.
    restitution : float, str or callable
        Coefficient of restitution: a number, a parameter or ``restitution(p)``, from 0 to 1. An
        `Impact` of your own may add energy.
    against : str or tuple of str, optional
        Position and velocity of the other body; its velocity alone if `position` is the distance of
        both bodies. A body without a mass moves as the flow prescribes, unaffected by impacts.

    See Also
    --------
    Impact, Friction, Part, System

    Notes
    -----
    Modes: free and held, which the flow reads as 0 and 1. Events: ``NAME``, an impact, and ``NAME
    lets go``.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def fall(mode, t, y, p):
    ...     return y.v, -p.g
    >>> ball = mi.System(
    ...     states=("x", "v"), flow=fall, parameters={"g": 9.81, "e": 0.5}, initial={"x": 1.0},
    ...     parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
    ... )
    >>> mi.simulate(ball, duration=2.0).final
    State(x=0.0, v=0.0, mode='held')
    """

    position: str
    velocity: str
    upper: Quantity | None = field(default=None, kw_only=True)
    lower: Quantity | None = field(default=None, kw_only=True)
    restitution: Quantity = field(kw_only=True)
    against: str | tuple[str, str] | None = field(default=None, kw_only=True)

    modes: ClassVar[tuple[str, ...]] = ("free", "held")
    signs: ClassVar[tuple[int, ...]] = (0, 1)
    holding_mode: ClassVar[int] = HELD

    def __post_init__(self) -> None:
        if (self.upper is None) == (self.lower is None):
            bounds = (self.upper, self.lower)
            raise InvalidParameter(
                f"upper, lower of {self.name!r}", bounds, "exactly one of the two"
            )

    def sides(self, names: CodeNames) -> ContactSides:
        """Return the body and the other body."""
        other = self.against if isinstance(self.against, str) else (self.against or (0.0, 0.0))[1]
        if isinstance(other, str):
            names.index("against", other)  # a velocity, not a parameter
        return sides(names, self.velocity, other, "against")

    def inwards(self, expression: str) -> str:
        """Return an expression along the position with its sign positive away from the stop."""
        return f"-{expression}" if self.upper is not None else expression

    def geometry(self, names: CodeNames) -> tuple[int, str, str]:
        """Return the number of the position, the position of the stop, and the terms of the gap."""
        position = names.index("position", self.position)
        level = self.upper if self.upper is not None else self.lower
        assert level is not None
        at = names.value("upper" if self.upper is not None else "lower", level)
        size = f"abs(y[{position}]) + abs({at})"
        if isinstance(self.against, tuple):
            other = names.index("against", self.against[0])
            at, size = f"({at} + y[{other}])", f"{size} + abs(y[{other}])"
        return position, at, size

    @property
    def force_sign(self) -> int:
        """The sign of its force on the body."""
        return -1 if self.upper is not None else 1

    @property
    def motion_signs(self) -> Mapping[int, int]:
        """The sign of the relative motion that opens the gap."""
        return {FREE: self.force_sign}

    def force_limits(self, names: CodeNames) -> tuple[str, str]:
        """Return the limits of the force: unbounded in its direction, else zero."""
        return ("math.inf", "") if self.upper is not None else ("", "math.inf")

    def holding_condition(self, names: CodeNames) -> str:
        """Return whether the gap is closed and the relative speed is zero."""
        sides = self.sides(names)
        position, at, size = self.geometry(names)
        gap = self.inwards(f"(y[{position}] - {at})")
        touches = f"{gap} <= {TOUCHES} * ({size})"
        closed = f"({names.fired} or {names.last} == {HELD} or {touches})"
        still = f"({sides.zero_slip} or (jumped == 0 and {names.last} == {HELD}))"
        return f"({still} and {closed})"

    def mode_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions of free and held."""
        sides, holding = self.sides(names), self.holding_condition(names)
        leaves = f"{self.inwards(sides.relative('x[{}]'))} >= -{sides.drift}"
        return [
            f"{leaves} or not {holding}",
            f"{holding} and {names.needed} >= -{ZERO_FORCE_RATIO} * {names.size}",
        ]

    def guards(self, names: CodeNames) -> list[GuardSpec]:
        """Return the guards of impact and release."""
        sides = self.sides(names)
        position, at, _ = self.geometry(names)
        return [
            GuardSpec(
                name=self.name,
                modes=(FREE,),
                margin=self.inwards(f"(y[{position}] - {at})"),
                rate=self.inwards(sides.slip),
                changes=self.after(names, names.value("restitution", self.restitution)),
                rest=self.after(names, "0.0"),
            ),
            GuardSpec(
                name=f"{self.name} lets go",
                modes=(HELD,),
                margin=names.needed,
                leads=str(FREE),
            ),
        ]

    def limits(self) -> list[Limit]:
        """Return the limits of the coefficient of restitution."""
        return [Limit(f"restitution of {self.name!r}", self.restitution, high=1.0)]

    def constraints(self, names: CodeNames) -> list[Constraint]:
        """Return the constraints in contact: a closed gap and zero relative speed."""
        position, at, _ = self.geometry(names)
        slopes = {position: "1.0"}
        if isinstance(self.against, tuple):
            slopes[names.index("against", self.against[0])] = "-1.0"
        closed = Constraint(mode=HELD, value=f"(y[{position}] - {at})", slopes=slopes)
        return [closed, *super().constraints(names)]

    def after(self, names: CodeNames, restitution: str) -> dict[int, str]:
        """Return positions and velocities after an impact."""
        sides = self.sides(names)
        position, at, _ = self.geometry(names)
        if sides.other_velocity is None:
            return {position: at, sides.velocity: f"-{restitution} * {sides.slip}"}
        speed = sides.speed
        if sides.other_mass is not None:
            # The other body's share of the impulse (1 + e) u/(1/m + 1/M).
            share = f"(1.0 / {sides.other_mass}) / {sides.share}"
            speed = f"({speed} + (1.0 + {restitution}) * {sides.slip} * {share})"
        changes = {
            sides.velocity: f"{speed} - {restitution} * {sides.slip}",
            sides.other_velocity: speed,
        }
        # Two positions are left unchanged, as either of them could be corrected.
        two_positions = isinstance(self.against, tuple) and sides.other_mass is not None
        return changes if two_positions else {position: at, **changes}
