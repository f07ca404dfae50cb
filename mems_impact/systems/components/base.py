"""Components of a system, and components in contact.

`assembly` combines the parts of a system as source code, which the compiler sees as plain
arithmetic. The methods of a part therefore return expressions. All expressions can use ``t``, the
time; ``y[j]``, component j of the state; ``p.name``, a parameter; and `CodeNames.mode`, the mode of
the part. Where `GuardSpec` allows it, ``x[j]`` is the derivative of component j in the current
mode, and `CodeNames.back`, `CodeNames.front`, `CodeNames.needed` and `CodeNames.size` describe a
contact.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mems_impact.errors import InvalidParameter
from mems_impact.systems.state import is_number

# --- Parts

Quantity = float | str | Callable[..., float]
"""A number, the name of a parameter, or a function."""

ANY = "-1"  # in place of a mode: whichever fits


@dataclass(frozen=True, kw_only=True)
class GuardSpec:
    """A guard of a part."""

    name: str  # of the event in tables
    modes: tuple[int, ...]  # the modes of the part in which it is active
    margin: str  # an expression, which can use ``x``
    # New values of components of the state after the event, as expressions of the old values.
    changes: Mapping[int, str] = field(default_factory=dict)
    # The mode of the part after the event, an expression; by default whichever fits the new state.
    leads: str = ANY
    rest: Mapping[int, str] | None = None  # for an impact: `changes` without rebound
    rests: bool = False  # whether the relative speed of a contact is zero at the event


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """A constraint that holds in a mode of a part."""

    mode: int  # of the part
    value: str  # an expression that is zero where the constraint holds
    # Its derivatives with respect to components of the state, expressions; others are zero.
    slopes: Mapping[int, str]
    linear: bool = True  # whether the slopes are constant


@dataclass(frozen=True)
class Limit:
    """A limit of a quantity of a part, beyond which it adds energy or has no mode that fits."""

    field: str  # name of the quantity in errors
    quantity: Quantity  # a function takes ``p``
    low: Quantity = 0.0  # the lower bound
    high: Quantity = math.inf  # the upper bound
    of_low: str = ""  # name of the lower bound, if it is a quantity of the part
    exclusive: bool = False  # whether the lower bound itself is excluded

    def check(self, p: Any) -> None:
        """Raise InvalidParameter, with the name of the parameter, if a value is beyond."""
        value, low, high = (_at(each, p) for each in (self.quantity, self.low, self.high))
        if not (value < low or value > high or (self.exclusive and value == low)):
            return
        bound = f"{'>' if self.exclusive else '>='} {low:g}"
        if high < math.inf:
            bound = f"between {low:g} and {high:g}"
        if self.of_low:
            name = f"{self.low}, " if isinstance(self.low, str) else ""
            bound += f" ({name}{self.of_low})"
        if isinstance(self.quantity, str):
            raise InvalidParameter(self.quantity, value, f"{bound}; it is {self.field}")
        if callable(self.quantity):
            values = ", ".join(f"{name} = {each:g}" for name, each in p._asdict().items())
            bound += f"; it is a function of {values}" if values else ""
        raise InvalidParameter(self.field, value, bound)


def _at(quantity: Quantity, p: Any) -> float:
    """Return a quantity at given parameters; a function that fails there has no limits."""
    if isinstance(quantity, str):
        return float(getattr(p, quantity))
    if not callable(quantity):
        return float(quantity)
    try:
        return float(quantity(p))
    except Exception:  # the checks of user functions report it
        return math.nan


class Numbered:
    """An expression of the generated source that ends with the number of a part."""

    def __init__(self, start: str) -> None:
        self.start = start

    def __get__(self, names: CodeNames, _owner: type) -> str:
        return f"{self.start}{names.number}"


@dataclass(frozen=True)
class CodeNames:
    """Names in the generated source of the quantities of a part."""

    part: Part
    number: int  # index of the part
    states: tuple[str, ...]
    parameters: tuple[str, ...]
    masses: Mapping[str, Quantity]  # by velocity
    contact: int | None  # index among the contacts
    space: dict[str, Any]  # the functions that the source calls, by name
    # The velocities to which a velocity is relative: their sum is the velocity of the body.
    bases: Mapping[int, tuple[int, ...]]
    time_scale: str = "1.0"  # an expression

    mode = Numbered("m")  # the mode of the part
    last = Numbered("last")  # the mode of the part before an event
    fired = Numbered("fired == ")  # whether the event belongs to the part
    on = Numbered("on")  # whether the state lies on a surface
    # The least distance of a motion from leaving the surfaces on which the state slides.
    room: ClassVar[str] = "room"
    unlimited = Numbered("unlimited")  # the derivatives of the state in mode 0 of the part
    # Distances of the force of a holding contact from its lower and upper limits.
    back, front = Numbered("back"), Numbered("front")
    needed = Numbered("needed")  # part of the force of a holding stop that others cannot bear
    limit = Numbered("limit")  # the static limit of a friction contact
    # Sum of the magnitudes of the forces on all bodies connected with a contact.
    size = Numbered("size")

    def rests(self, mode: int) -> str:
        """Return the variable of whether a contact could hold in a mode."""
        return f"rests{self.number}_{mode}"

    def index(self, field: str, state: str) -> int:
        """Return the number of a state."""
        if state not in self.states:
            allowed = f"one of {', '.join(self.states)}"
            raise InvalidParameter(self.label(field), state, allowed)
        return self.states.index(state)

    def value(self, field: str, quantity: Quantity, arguments: str = "p") -> str:
        """Return a number, a parameter or the call of a function as an expression."""
        if callable(quantity):
            return self.call(quantity, arguments)
        if isinstance(quantity, str):
            if quantity not in self.parameters:
                parameters = ", ".join(self.parameters) or "but the system has none"
                allowed = f"a number, a function, or one of the parameters, {parameters}"
                raise InvalidParameter(self.label(field), quantity, allowed)
            return f"p.{quantity}"
        if not is_number(quantity):
            allowed = "a number, the name of a parameter, or a function"
            raise InvalidParameter(self.label(field), quantity, allowed)
        return repr(float(quantity))

    def call(self, function: Callable[..., Any], arguments: str) -> str:
        """Return the call of a function as an expression."""
        return f"{self.name_of(function)}({arguments})"

    def name_of(self, function: Callable[..., Any]) -> str:
        """Return the name of a function in the generated source."""
        existing = (name for name, value in self.space.items() if value is function)
        name = next(existing, f"given_{len(self.space)}")
        self.space[name] = function
        return name

    def mass(self, velocity: str) -> str:
        """Return the mass of a body as an expression; 1 if forces are per mass."""
        return self.value(f"mass of {velocity}", self.masses.get(velocity, 1.0))

    def coordinates(self, velocities: Mapping[int, str]) -> dict[int, str]:
        """Return new values of the states from new velocities of bodies, as expressions."""
        values = {j: new for j, new in velocities.items() if j not in self.bases}
        for own, bases in sorted(self.bases.items(), key=lambda each: len(each[1])):
            if own in velocities:
                given = (values.get(j, f"y[{j}]") for j in bases)
                values[own] = f"{velocities[own]} - ({' + '.join(given)})"
            elif any(j in values for j in bases):
                moved = (f" - ({values[j]} - y[{j}])" for j in bases if j in values)
                values[own] = f"y[{own}]{''.join(moved)}"
        return values

    def label(self, field: str) -> str:
        """Return the name of a field of the part in errors."""
        return f"{field} of {self.part.name!r}"


@dataclass(frozen=True)
class Part:
    """A component of a system: ``System(parts=[...])``.

    A subclass is a frozen dataclass of the arguments of the user. Strings name states or parameters
    of the system, which `CodeNames` checks and converts to expressions.

    Parameters
    ----------
    name : str
        Name in tables; the flow reads the mode of the part as ``mode.name``.

    See Also
    --------
    Friction, Stopper, Relay, SwitchingSurface, System

    Examples
    --------
    >>> import mems_impact as mi
    >>> wall = mi.Stopper("wall", "x", "v", upper=1.0, restitution=0.8)
    >>> parts = [mi.Friction("ground", "v", mu=0.1), wall]
    >>> [part.name for part in parts]
    ['ground', 'wall']
    >>> all(isinstance(part, mi.Part) for part in parts)
    True
    """

    name: str

    @property
    @abstractmethod
    def modes(self) -> tuple[str, ...]:
        """Names of its modes."""

    @property
    @abstractmethod
    def signs(self) -> tuple[int, ...]:
        """Value of ``mode.name`` in each of them."""

    def state_conditions(self, names: CodeNames) -> list[str]:
        """Return the conditions of each of its modes that do not use ``x``, tested first."""
        return ["True"] * len(self.modes)

    @abstractmethod
    def mode_conditions(self, names: CodeNames) -> list[str]:
        """Return the further conditions under which each of its modes fits the state, in order.

        Conditions can use ``x``, `CodeNames.last`, `CodeNames.fired` and ``jumped``, which is 1 if
        an event of another part may have changed the state, or at the start of a run.
        """

    def preferred_mode(self, names: CodeNames) -> str:
        """Return the preferred mode if several fit: by default the mode before."""
        return names.last

    @abstractmethod
    def guards(self, names: CodeNames) -> list[GuardSpec]:
        """Return the guards of the part."""

    def constraints(self, names: CodeNames) -> list[Constraint]:
        """Return the constraints that hold in its modes."""
        return []

    def rates(self, names: CodeNames) -> dict[int, dict[int, str]]:
        """Return derivatives in place of those of the flow, by mode and component."""
        return {}

    def limits(self) -> list[Limit]:
        """Return the limits of its quantities."""
        return []


# --- Contacts between bodies

ZERO_SPEED_RATIO = "1e-13"  # of the speeds: smaller relative speeds are zero
ZERO_FORCE_RATIO = "1e-13"  # of forces and accelerations: smaller ones have no sign


@dataclass(frozen=True)
class ContactSides:
    """The two sides of a contact, in names of the generated source."""

    velocity: int  # on which the force of the contact acts
    # On which the reaction acts, or a prescribed velocity; None for `speed`.
    other_velocity: int | None
    speed: str  # of the other side, an expression
    mass: str
    other_mass: str | None  # None if no force acts on the other side
    # The relative velocity is the sum of the velocities in `plus` less the sum of those in `minus`,
    # without a prescribed speed.
    plus: tuple[int, ...]
    minus: tuple[int, ...]

    @property
    def is_coordinate(self) -> bool:
        """Whether the velocity is relative to the other side."""
        return self.other_velocity is not None and self.plus == (self.velocity,) and not self.minus

    @property
    def slip(self) -> str:
        """The relative speed."""
        prescribed = self.other_velocity is None and self.speed != "0.0"
        slip = self.relative("y[{}]")
        return f"({slip} - {self.speed})" if prescribed else slip

    @property
    def drift(self) -> str:
        """Rounding error of the relative acceleration."""
        sizes = [
            f"abs(x[{body}])" for body in (self.velocity, self.other_velocity) if body is not None
        ]
        return f"{ZERO_FORCE_RATIO} * ({' + '.join(sizes)})"

    def relative(self, slope: str) -> str:
        """Return the relative acceleration for derivatives ``slope[j]``."""
        total = " + ".join(map(slope.format, self.plus))
        total += "".join(f" - {slope.format(j)}" for j in self.minus)
        return total if len(self.plus + self.minus) == 1 else f"({total})"

    @property
    def share(self) -> str:
        """The relative acceleration per unit of force, as an expression."""
        return f"(1.0 / {self.mass}{f' + 1.0 / {self.other_mass}' if self.other_mass else ''})"

    @property
    def zero_slip(self) -> str:
        """Whether the relative speed is zero to rounding."""
        if self.slip == f"y[{self.velocity}]":
            return f"{self.slip} == 0.0"
        size = f"(abs(y[{self.velocity}]) + abs({self.speed}))"
        return f"abs({self.slip}) <= {ZERO_SPEED_RATIO} * {size}"


@dataclass(frozen=True)
class Contact(Part):
    """A part that acts on a velocity and holds it in one of its modes."""

    @property
    @abstractmethod
    def holding_modes(self) -> tuple[int, ...]:
        """The modes in which its force keeps the relative speed at zero."""

    @property
    def force_signs(self) -> Mapping[int, int]:
        """The sign of its force on its velocity by holding mode; empty for either sign."""
        return {}

    def holds(self, mode: str) -> str:
        """Return whether it holds in a mode, as an expression."""
        return " or ".join(f"{mode} == {each}" for each in self.holding_modes)

    @abstractmethod
    def sides(self, names: CodeNames) -> ContactSides:
        """Return its two sides."""

    @abstractmethod
    def rest_conditions(self, names: CodeNames) -> dict[int, str]:
        """Return whether it could hold, by mode: it is closed and the relative speed is zero."""

    def could_hold(self, names: CodeNames) -> str:
        """Return whether it could hold in some mode, of the variables `CodeNames.rests`."""
        return f"({' or '.join(map(names.rests, self.holding_modes))})"

    @abstractmethod
    def motion_signs(self, names: CodeNames) -> Mapping[int, str]:
        """Return the sign of the relative motion that starts from rest, by other mode."""

    def constraints(self, names: CodeNames) -> list[Constraint]:
        """Return the constraint of zero relative speed where it holds."""
        sides = self.sides(names)
        slopes = {**dict.fromkeys(sides.plus, "1.0"), **dict.fromkeys(sides.minus, "-1.0")}
        return [
            Constraint(mode=mode, value=sides.slip, slopes=slopes) for mode in self.holding_modes
        ]

    def variables(self, names: CodeNames) -> dict[str, str]:
        """Return expressions of the variables in its `force_limits` and conditions."""
        return {}

    @abstractmethod
    def force_limits(self, names: CodeNames) -> dict[int, tuple[str, str]]:
        """Return the limits of the force backward and forward, by holding mode."""

    def forces(self, names: CodeNames) -> dict[int, str]:
        """Return the forces on its velocity in the other modes, if any."""
        return {}


def sides(names: CodeNames, velocity: str, other: Quantity, field: str) -> ContactSides:
    """Return the sides of a contact between a velocity and another velocity or a speed."""
    index = names.index("velocity", velocity)
    mass, plus = names.mass(velocity), (index, *names.bases.get(index, ()))
    if isinstance(other, str) and other in names.states:
        number = names.index(field, other)
        driven = names.mass(other) if other in names.masses else None
        minus = (number, *names.bases.get(number, ()))
        speed = " + ".join(f"y[{j}]" for j in minus)
        return ContactSides(
            index,
            number,
            speed if len(minus) == 1 else f"({speed})",
            mass,
            driven,
            tuple(j for j in plus if j not in minus),
            tuple(j for j in minus if j not in plus),
        )
    return ContactSides(index, None, names.value(field, other), mass, None, plus, ())
