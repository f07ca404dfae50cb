"""Dry friction, by the laws of Coulomb and Stribeck, on the ground, a belt or another body."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mems_impact._util.arrays import Floats
from mems_impact._util.warning_scopes import warn
from mems_impact.errors import ValidityWarning
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.components.base import (
    ZERO_FORCE_RATIO,
    CodeNames,
    Contact,
    ContactSides,
    GuardSpec,
    Limit,
    Quantity,
    sides,
)
from mems_impact.systems.observables import EventObserver

STUCK, FORWARD, BACKWARD = 0, 1, 2
NEGATIVE_RTOL = 1e-9  # of the largest value, above which a negative one is no rounding
NEAR_LIMIT = "1e-10"  # of the limit: a force this close to it holds


@dataclass(frozen=True)
class AtRest:
    """A coefficient of friction at zero speed."""

    mu: Callable[..., float]

    def __call__(self, p: Any) -> float:
        """Return the coefficient."""
        return self.mu(0.0, p)


@dataclass(frozen=True)
class Stribeck:
    """Stribeck's law: a coefficient of friction that decreases with the speed u.

    ``dynamic + (static - dynamic) exp(-u/speed) + viscous u``.

    Parameters
    ----------
    static, dynamic, speed, viscous : float or str
        Numbers, or names of parameters, >= 0; `speed` > 0; `viscous` is 0 by default.

    See Also
    --------
    Friction, StribeckFriction

    Examples
    --------
    >>> import mems_impact as mi
    >>> law = mi.Stribeck("mu_s", "mu_d", "v_s")
    >>> belt = mi.Friction("belt", "v", mu=law, surface="v_belt")
    """

    static: Quantity
    dynamic: Quantity
    speed: Quantity
    viscous: Quantity = 0.0

    def at(self, names: CodeNames, speed: str) -> str:
        """Return the coefficient at a relative speed, as an expression."""
        fields = ("static", "dynamic", "speed", "viscous")
        static, dynamic, unit, viscous = (names.value(name, getattr(self, name)) for name in fields)
        decay = f"math.exp(-({speed}) / {unit})"
        return f"{dynamic} + ({static} - {dynamic}) * {decay} + {viscous} * ({speed})"


@dataclass(frozen=True)
class Friction(Contact):
    """Dry friction on a body, with sticking.

    The friction force on a sliding body is mu times the normal force. When its relative speed
    reaches zero, the body sticks if the force that balances all other forces is within the static
    limit; otherwise the body slides in the direction of the load. A sticking body breaks away when
    the load reaches the limit.

    Parameters
    ----------
    name : str
    velocity : str
        The velocity of the body.
    mu : float, str, callable or Stribeck
        The coefficient of sliding friction, >= 0: a number, a parameter, or ``mu(speed, p)`` of
        the relative speed (>= 0), or a `Stribeck` law.
    normal : float, str or callable, optional
        The normal force, >= 0: a number, a parameter or ``normal(t, y, p)``. By default 1, so
        that `mu` is the force itself.
    static : float, str or callable, optional
        The coefficient of static friction: a number, a parameter or ``static(p)``, at least `mu`
        at zero speed, the default.
    sticks : bool, optional
        False for friction that vanishes with the speed, such as ``mu_d tanh(speed / width)``: the
        body creeps under any load. True by default.
    surface : float, str or callable, optional
        The speed of the other side: a number (0 by default), a parameter, ``surface(p)``, or
        another velocity of the system. If this velocity has a mass, the reaction acts on it.

    See Also
    --------
    Stribeck, Stopper, Part, System

    Notes
    -----
    Modes: stuck, forward, backward, which the flow reads as 0, 1 and -1. Events: ``NAME slip end``
    and ``NAME slips``.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def spring(mode, t, y, p):
    ...     return y.v, -y.x
    >>> block = mi.System(
    ...     states=("x", "v"), flow=spring, initial={"x": 1.0},
    ...     parts=[mi.Friction("ground", "v", mu=0.1)],
    ... )
    >>> mi.simulate(block, duration=50.0).final.mode
    'stuck'
    """

    velocity: str
    mu: Quantity | Stribeck = field(kw_only=True)
    normal: Quantity = field(default=1.0, kw_only=True)
    static: Quantity | None = field(default=None, kw_only=True)
    sticks: bool = field(default=True, kw_only=True)
    surface: Quantity = field(default=0.0, kw_only=True)

    modes: ClassVar[tuple[str, ...]] = ("stuck", "forward", "backward")
    signs: ClassVar[tuple[int, ...]] = (0, 1, -1)
    holding_modes: ClassVar[tuple[int, ...]] = (STUCK,)

    def sides(self, names: CodeNames) -> ContactSides:
        """Return the body and the surface on which it slides."""
        return sides(names, self.velocity, self.surface, "surface")

    def sliding(self, names: CodeNames, speed: str) -> str:
        """Return the magnitude of the force at a relative speed."""
        normal = names.value("normal", self.normal, "t, y, p")
        if isinstance(self.mu, Stribeck):
            return f"({self.mu.at(names, speed)}) * {normal}"
        return f"{names.value('mu', self.mu, f'{speed}, p')} * {normal}"

    def limit(self, names: CodeNames) -> str:
        """Return the static limit."""
        if self.static is None:
            return self.sliding(names, "0.0")
        normal = names.value("normal", self.normal, "t, y, p")
        return f"{names.value('static', self.static)} * {normal}"

    def forces(self, names: CodeNames) -> dict[int, str]:
        """Return the friction forces during sliding."""
        slip = self.sides(names).slip
        return {
            FORWARD: f"-({self.sliding(names, slip)})",
            BACKWARD: self.sliding(names, f"-{slip}"),
        }

    def force_limits(self, names: CodeNames) -> dict[int, tuple[str, str]]:
        """Return the static limit, for both directions."""
        return {STUCK: (names.limit, names.limit)}

    def variables(self, names: CodeNames) -> dict[str, str]:
        """Return the static limit."""
        return {names.limit: self.limit(names)}

    def motion_signs(self, names: CodeNames) -> Mapping[int, str]:
        """Return the sign of the relative speed."""
        return {FORWARD: "1", BACKWARD: "-1"}

    def rest_conditions(self, names: CodeNames) -> dict[int, str]:
        """Return whether the relative speed is zero."""
        near = self.sides(names).zero_slip
        return {STUCK: f"{near} or (jumped == 0 and {names.last} == {STUCK})"}

    def rounding(self, names: CodeNames) -> str:
        """Return the tolerance within which the holding force is at its limit."""
        return f"({NEAR_LIMIT} * {names.limit} + {ZERO_FORCE_RATIO} * {names.size})"

    def room(self, names: CodeNames) -> str:
        """Return the distance of the holding force from its limit."""
        return f"min({names.back}, {names.front})"

    def state_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions on the relative speed."""
        holding = names.rests(STUCK)
        # If no event has changed the state, it keeps its direction of sliding despite rounding.
        slides = f"{names.last} == {{}} if jumped == 0 else {self.sides(names).slip} {{}} 0.0"
        return [
            holding if self.sticks else "False",
            f"{holding} or ({slides.format(FORWARD, '>')})",
            f"{holding} or ({slides.format(BACKWARD, '<')})",
        ]

    def mode_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions of sticking, sliding forward and sliding backward."""
        sides, holding = self.sides(names), names.rests(STUCK)
        gain, rounding = sides.relative("x[{}]"), self.rounding(names)
        room = f"({NEAR_LIMIT} * {names.limit} * {sides.share} + {sides.drift})"
        # At its limit a contact stays only if others have taken over the load.
        threshold = f"({rounding} if {names.fired} and {names.last} == {STUCK} else -{rounding})"
        return [
            f"{self.room(names)} >= {threshold}",
            f"{gain} >= -{room} or not {holding}",
            f"{gain} <= {room} or not {holding}",
        ]

    def preferred_mode(self, names: CodeNames) -> str:
        """Return the mode before, or stuck if the body comes to rest."""
        rests = f"own < 0 and {names.rests(STUCK)}"
        return f"({STUCK} if {rests} else {names.last})" if self.sticks else names.last

    def limits(self) -> list[Limit]:
        """Return the limits of the quantities that do not depend on the state."""
        law, sliding, limits = self.mu, f"mu of {self.name!r}", []
        if isinstance(law, Stribeck):
            fields = {name: getattr(law, name) for name in ("static", "dynamic", "viscous")}
            limits += [Limit(f"{name} of {sliding}", value) for name, value in fields.items()]
            limits.append(Limit(f"speed of {sliding}", law.speed, exclusive=True))
            at_rest = law.static
        else:
            at_rest = AtRest(law) if callable(law) else law
            limits.append(Limit(sliding, at_rest))
        if not callable(self.normal):
            limits.append(Limit(f"normal of {self.name!r}", self.normal))
        if self.static is not None:
            limits.append(Limit(f"static of {self.name!r}", self.static, at_rest, of_low=sliding))
        return limits

    def along_motion(self, t: float, y: Any, p: Any) -> dict[str, float]:
        """Return the quantities that depend on the state, each of which must be >= 0."""
        values = {}
        if callable(self.normal):
            values["normal"] = float(self.normal(t, y, p))
        if callable(self.mu):
            surface = self.surface
            if isinstance(surface, str):
                surface = getattr(y if surface in y._fields else p, surface)
            surface = surface(p) if callable(surface) else surface
            values["mu"] = float(self.mu(abs(getattr(y, self.velocity) - surface), p))
        return values

    def guards(self, names: CodeNames) -> list[GuardSpec]:
        """Return the guards of the end of a slip and of break-away."""
        sides = self.sides(names)
        sign = f"(1.0 if {names.mode} == {FORWARD} else -1.0)"
        room = self.room(names)
        return [
            GuardSpec(
                name=f"{self.name} slip end",
                modes=(FORWARD, BACKWARD),
                margin=f"{sign} * {sides.slip}",
                rests=True,
            ),
            GuardSpec(
                name=f"{self.name} slips",
                modes=(STUCK,),
                # Clamped between two stops it bears any force.
                margin=f"{room} if {room} < math.inf else {names.limit}",
                # The load is at the limit to rounding: the body slips in the direction of the load.
                leads=f"{FORWARD} if {names.back} < {names.front} else {BACKWARD}",
            ),
        ]


class NegativeFriction(EventObserver):
    """A search of the events of a run for negative coefficients of friction and normal forces.

    ``values(time, y)`` returns the arguments ``t, y, p`` of the user's functions.
    """

    def __init__(
        self,
        parts: Sequence[Friction],
        problem: Problem,
        values: Callable[[float, Floats], tuple[float, Any, Any]],
        start: HybridState,
    ) -> None:
        self._parts, self._period, self._values = parts, problem.period, values
        self._lowest: dict[str, tuple[float, float]] = {}
        self._largest: dict[str, float] = {}
        self._take(start.cycle, start.time, start.y)

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""
        for i in range(len(events)):
            for y in (events.before[i], events.after[i]):
                self._take(int(events.cycle[i]), float(events.time[i]), y)

    def _take(self, cycle: int, time: float, y: Floats) -> None:
        arguments = self._values(time, y)
        for part in self._parts:
            for name, value in part.along_motion(*arguments).items():
                label = f"{name} of {part.name!r}"
                self._largest[label] = max(abs(value), self._largest.get(label, 0.0))
                if value < self._lowest.get(label, (0.0, 0.0))[0]:
                    self._lowest[label] = value, self._values(cycle * self._period + time, y)[0]

    def warn(self, trajectory: Trajectory) -> None:
        """Warn of each quantity that was negative beyond rounding."""
        final = trajectory.final
        self._take(final.cycle, final.time, final.y)
        for label, (value, t) in self._lowest.items():
            if value < -NEGATIVE_RTOL * self._largest[label]:
                problem = f"{label} is {value:.6g} at t = {t:.6g}, where friction adds energy"
                warn(f"{problem}; it must be >= 0 throughout the motion", ValidityWarning)
