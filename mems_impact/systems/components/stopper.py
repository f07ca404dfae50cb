"""Stops for a body, rigid with restitution or compliant, on which the body can come to rest."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from mems_impact.errors import InvalidParameter
from mems_impact.systems.components.base import (
    ANY,
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

FREE = 0
TOUCHES = "1e-14"  # of the positions: a smaller gap is closed


class Stop(NamedTuple):
    """A stop on one side."""

    number: int  # of the mode of the contact
    mode: str  # the same by name
    field: str  # "upper" or "lower"
    at: Quantity  # its position
    sign: int  # of its force on the body

    def inwards(self, expression: str) -> str:
        """Return an expression along the position with its sign positive away from the stop."""
        return f"-{expression}" if self.sign < 0 else expression

    def outwards(self, expression: str) -> str:
        """Return an expression along the position with its sign positive towards the stop."""
        return expression if self.sign < 0 else f"-{expression}"


@dataclass(frozen=True)
class Stopper(Contact):
    """A stopper for a body, or between two bodies, on one side or on both.

    An impact reverses the relative velocity, multiplied by the coefficient of restitution, and
    conserves the momentum of two bodies. A chatter sequence is completed and ends in sustained
    contact, until the contact force falls to zero. A compliant stopper exerts a force that depends
    on depth and rate in place of impacts.

    Parameters
    ----------
    name : str
    position, velocity : str
        Position and velocity of the body.
    upper, lower : float, str or callable, optional
        The position of the stop: ``position <= upper``, or ``position >= lower``; of two stops,
        such as those of a backlash, both. A number, a parameter or a function of ``p``. Between two
        bodies, a bound of their distance.
    restitution : float, str or callable, optional
        Coefficient of restitution, from 0 to 1: a number, a parameter, ``restitution(p)``, or
        ``restitution(speed, p)`` of the impact speed. An `Impact` of your own may add energy.
    law : callable, optional
        ``law(depth, rate, p)``, the force of a compliant stopper at a depth >= 0, in place of
        `restitution`. The contact lasts while the depth is positive. The stopper does not pull:
        where the law is negative, the force is zero.
    adhesion : float, str or callable, optional
        Pull-off force of a body in contact, >= 0: a number (0 by default), a parameter or a
        function of ``p``. It does no work: its range is zero. On a compliant stopper it acts at all
        depths.
    against : str or tuple of str, optional
        Position and velocity of the other body; its velocity alone if `position` is the distance of
        both bodies. A body without a mass moves as the flow prescribes, unaffected by impacts.

    Raises
    ------
    InvalidParameter
        If neither or both of `restitution` and `law` are given, or no stop.

    See Also
    --------
    Impact, Friction, Part, System

    Notes
    -----
    Modes: free and held, which the flow reads as 0 and 1; contact in place of held if the stopper
    is compliant. Events: ``NAME``, an impact or the start of a contact, and ``NAME lets go``. With
    two stops the modes are free, upper and lower, which the flow reads as 0, 1 and -1, and the
    impacts are ``NAME upper`` and ``NAME lower``.

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
    restitution: Quantity | None = field(default=None, kw_only=True)
    law: Callable[..., float] | None = field(default=None, kw_only=True)
    adhesion: Quantity = field(default=0.0, kw_only=True)
    against: str | tuple[str, str] | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        if not self.stops:
            label = f"upper, lower of {self.name!r}"
            raise InvalidParameter(label, (None, None), "one of the two, or both")
        if (self.restitution is None) == (self.law is None):
            label, given = f"restitution, law of {self.name!r}", (self.restitution, self.law)
            raise InvalidParameter(label, given, "exactly one of the two")

    @property
    def stops(self) -> tuple[Stop, ...]:
        """The stops, on one side or on both."""
        given = [("upper", self.upper, -1), ("lower", self.lower, 1)]
        ends = [(name, at, sign) for name, at, sign in given if at is not None]
        alone = "held" if self.law is None else "contact"
        return tuple(
            Stop(number, name if len(ends) > 1 else alone, name, at, sign)
            for number, (name, at, sign) in enumerate(ends, 1)
        )

    @property
    def modes(self) -> tuple[str, ...]:
        """Names of its modes."""
        return ("free", *(stop.mode for stop in self.stops))

    @property
    def signs(self) -> tuple[int, ...]:
        """Value of ``mode.name`` in each of them."""
        return (0, 1, -1)[: len(self.modes)]

    @property
    def holding_modes(self) -> tuple[int, ...]:
        """The modes in which the body rests on a rigid stop."""
        return tuple(stop.number for stop in self.stops if self.law is None)

    @property
    def force_signs(self) -> Mapping[int, int]:
        """The sign of the force on the body, by mode."""
        return {stop.number: stop.sign for stop in self.stops}

    def sides(self, names: CodeNames) -> ContactSides:
        """Return the body and the other body."""
        other = self.against if isinstance(self.against, str) else (self.against or (0.0, 0.0))[1]
        if isinstance(other, str):
            names.index("against", other)  # a velocity, not a parameter
        return sides(names, self.velocity, other, "against")

    def geometry(self, names: CodeNames, stop: Stop) -> tuple[int, str, str]:
        """Return the number of the position, the position of a stop, and the terms of the gap."""
        position = names.index("position", self.position)
        at = names.value(stop.field, stop.at)
        size = f"abs(y[{position}]) + abs({at})"
        if isinstance(self.against, tuple):
            other = names.index("against", self.against[0])
            at, size = f"({at} + y[{other}])", f"{size} + abs(y[{other}])"
        return position, at, size

    def gap(self, names: CodeNames, stop: Stop) -> str:
        """Return the distance from a stop."""
        position, at, _ = self.geometry(names, stop)
        return stop.inwards(f"(y[{position}] - {at})")

    def by_mode(self, names: CodeNames, expressions: list[str]) -> str:
        """Return the expression of the stop in contact."""
        first, *others = expressions
        return f"({first} if {names.mode} == 1 else {others[0]})" if others else first

    def nearest(self, names: CodeNames, stop: Stop) -> str:
        """Return whether a stop is the nearest."""
        others = [each for each in self.stops if each.number != stop.number]
        nearer = (f"{self.gap(names, stop)} < {self.gap(names, other)}" for other in others)
        return next(nearer, "True")

    def motion_signs(self, names: CodeNames) -> Mapping[int, str]:
        """Return the sign of the relative motion that opens the gap of the nearest stop."""
        first, *others = self.stops
        near = f" if {self.nearest(names, first)} else {others[0].sign}" if others else ""
        return {FREE: f"{first.sign}{near}"}

    def force_limits(self, names: CodeNames) -> dict[int, tuple[str, str]]:
        """Return the limits of the force: unbounded away from a stop, adhesion towards it."""
        adhesion = names.value("adhesion", self.adhesion)
        return {
            stop.number: ("math.inf", adhesion) if stop.sign < 0 else (adhesion, "math.inf")
            for stop in self.stops
        }

    def forces(self, names: CodeNames) -> dict[int, str]:
        """Return the forces of a compliant stopper on the body."""
        if self.law is None:
            return {}
        slip, adhesion = self.sides(names).slip, names.value("adhesion", self.adhesion)
        found = {}
        for stop in self.stops:
            # Trial steps beyond the end of a contact have no power of a negative depth.
            depth = f"max(-{self.gap(names, stop)}, 0.0)".replace("--", "")
            law = names.call(self.law, f"{depth}, {stop.outwards(slip)}, p")
            found[stop.number] = f"{stop.sign}.0 * (max({law}, 0.0) - {adhesion})"
        return found

    def rest_conditions(self, names: CodeNames) -> dict[int, str]:
        """Return whether the gap of each stop is closed and the relative speed is zero."""
        found = {}
        for stop in self.stops:
            fired, held = names.fired, f"{names.last} == {stop.number}"
            if len(self.stops) > 1:
                fired = f"({fired} and {self.nearest(names, stop)})"
            touches = f"{self.gap(names, stop)} <= {TOUCHES} * ({self.geometry(names, stop)[2]})"
            rests = f"{self.sides(names).zero_slip} or (jumped == 0 and {held})"
            found[stop.number] = f"({rests}) and ({fired} or {held} or {touches})"
        return found

    def touching(self, names: CodeNames, stop: Stop) -> str:
        """Return whether the body is in contact with a compliant stop."""
        sides, gap = self.sides(names), self.gap(names, stop)
        rate, gain = stop.outwards(sides.slip), stop.outwards(sides.relative("x[{}]"))
        enters = f"({rate} > 0.0 or ({rate} == 0.0 and {gain} > 0.0))"
        inside = f"{gap} < 0.0 or ({gap} == 0.0 and {enters})"
        return f"({names.last} == {stop.number} if jumped == 0 else ({inside}))"

    def state_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions of rest on each rigid stop."""
        if self.law is not None:
            return super().state_conditions(names)
        return ["True", *(names.rests(stop.number) for stop in self.stops)]

    def mode_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions of free, and of contact with each stop."""
        if self.law is not None:
            contacts = [self.touching(names, stop) for stop in self.stops]
            free = f"{names.fired} or not ({' or '.join(contacts)})"
            return [free, *(f"{names.fired} or {each}" for each in contacts)]
        sides = self.sides(names)
        leaves, held = [], []
        for stop in self.stops:
            away = f"{stop.inwards(sides.relative('x[{}]'))} >= -{sides.drift}"
            leaves.append(f"({away} or not {names.rests(stop.number)})")
            held.append(f"{self.reserve(names)} >= -{ZERO_FORCE_RATIO} * {names.size}")
        return [" and ".join(leaves), *held]

    def preferred_mode(self, names: CodeNames) -> str:
        """Return the mode before; with adhesion, rest in contact."""
        preferred = names.last
        if self.law is None and self.adhesion != 0.0:
            for stop in self.stops:
                rests = f"own < 0 and {names.rests(stop.number)}"
                preferred = f"({stop.number} if {rests} else {preferred})"
        return preferred

    def reserve(self, names: CodeNames) -> str:
        """Return the distance of the contact force from the end of the contact."""
        if self.adhesion == 0.0:
            return names.needed
        return f"({names.needed} + {names.value('adhesion', self.adhesion)})"

    def guards(self, names: CodeNames) -> list[GuardSpec]:
        """Return the guards of impact, or of the start of a contact, and of release."""
        starts = []
        for stop in self.stops:
            position, at, _ = self.geometry(names, stop)
            rigid = self.restitution is not None
            starts.append(
                GuardSpec(
                    name=f"{self.name} {stop.mode}" if len(self.stops) > 1 else self.name,
                    modes=(FREE,),
                    margin=self.gap(names, stop),
                    changes=self.after(names, stop, self.coefficient(names))
                    if rigid
                    else {position: at},
                    rest=self.after(names, stop, "0.0") if rigid else None,
                    leads=ANY if rigid else str(stop.number),
                )
            )
        margin, changes = self.reserve(names), dict[int, str]()
        if self.law is not None:
            margin = self.by_mode(names, [f"-{self.gap(names, stop)}" for stop in self.stops])
            ends = [self.geometry(names, stop)[1] for stop in self.stops]
            changes = {position: self.by_mode(names, ends)}
        release = GuardSpec(
            name=f"{self.name} lets go",
            modes=tuple(stop.number for stop in self.stops),
            margin=margin,
            changes=changes,
            leads=str(FREE),
        )
        return [*starts, release]

    def coefficient(self, names: CodeNames) -> str:
        """Return the coefficient of restitution of an impact."""
        restitution = self.restitution
        assert restitution is not None
        if not takes_speed(restitution):
            return names.value("restitution", restitution)
        return names.call(restitution, f"abs({self.sides(names).slip}), p")  # type: ignore[arg-type]

    def limits(self) -> list[Limit]:
        """Return the limits of the quantities that do not depend on the state."""
        limits = [Limit(f"adhesion of {self.name!r}", self.adhesion)]
        if self.restitution is not None and not takes_speed(self.restitution):
            limits.append(Limit(f"restitution of {self.name!r}", self.restitution, high=1.0))
        return limits

    def constraints(self, names: CodeNames) -> list[Constraint]:
        """Return the constraints in contact: a closed gap and zero relative speed."""
        closed = []
        for stop in self.stops if self.law is None else ():
            position, at, _ = self.geometry(names, stop)
            slopes = {position: "1.0"}
            if isinstance(self.against, tuple):
                slopes[names.index("against", self.against[0])] = "-1.0"
            value = f"(y[{position}] - {at})"
            closed.append(Constraint(mode=stop.number, value=value, slopes=slopes))
        return [*closed, *super().constraints(names)]

    def after(self, names: CodeNames, stop: Stop, restitution: str) -> dict[int, str]:
        """Return positions and velocities after an impact."""
        sides = self.sides(names)
        position, at, _ = self.geometry(names, stop)
        rebound, speed = f"-{restitution} * {sides.slip}", sides.speed
        if sides.other_velocity is None:
            return {position: at, **names.coordinates({sides.velocity: rebound})}
        if sides.other_mass is not None:
            # The other body's share of the impulse (1 + e) u/(1/m + 1/M).
            share = f"(1.0 / {sides.other_mass}) / {sides.share}"
            speed = f"({speed} + (1.0 + {restitution}) * {sides.slip} * {share})"
        changes = names.coordinates(
            {sides.velocity: f"{speed} - {restitution} * {sides.slip}", sides.other_velocity: speed}
        )
        if sides.is_coordinate:
            changes[sides.velocity] = rebound
        # Two positions are left unchanged, as either of them could be corrected.
        two_positions = isinstance(self.against, tuple) and sides.other_mass is not None
        return changes if two_positions else {position: at, **changes}


def takes_speed(restitution: Quantity) -> bool:
    """Return whether a coefficient of restitution is a function of speed and parameters."""
    return callable(restitution) and len(inspect.signature(restitution).parameters) > 1
