"""Components of a system, and components in contact.

The parts of a system are put together as source (`assembly`), of which the compiler sees plain
arithmetic. So a part answers with expressions. In all of them stand ``t``, the time; ``y[j]``,
component j of the state; ``p.name``, a parameter; and of the part itself its mode, a number, by the
name `CodeNames.mode`. Where `GuardSpec` says so, ``x`` holds what the flow makes in the current
mode: ``x[j]``, the derivative of component j; and of a contact `CodeNames.back`, `CodeNames.front`,
`CodeNames.needed` and `CodeNames.size`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mems_impact.errors import InvalidParameter
from mems_impact.systems.state import is_number

__all__ = [
    "ZERO_FORCE_RATIO",
    "CodeNames",
    "Constraint",
    "Contact",
    "ContactSides",
    "GuardSpec",
    "Part",
    "Quantity",
]

# --- What a part is: modes, guards, and what it adds to the flow, as lines of text.

Quantity = float | str | Callable[..., float]
"""A number, the name of a parameter, or a function."""

ANY = "-1"  # in place of a mode: the one that fits


@dataclass(frozen=True, kw_only=True)
class GuardSpec:
    """A guard of a part.

    Attributes
    ----------
    name : str
        What tables call the event.
    modes : tuple of int
        The part's own modes in which it watches.
    margin, rate : str
        Expressions; without a rate it is taken by differences. ``x`` is at hand.
    changes : mapping of int to str
        What the event makes of components of the state, from the old ones.
    leads : str
        The part's own mode after it, an expression; by default whichever fits the new state.
    rest : mapping of int to str or None
        Of an impact: `changes` where there is no rebound.
    rests : bool
        Whether the relative speed of a contact comes to zero in it.
    """

    name: str
    modes: tuple[int, ...]
    margin: str
    rate: str | None = None
    changes: Mapping[int, str] = field(default_factory=dict)
    leads: str = ANY
    rest: Mapping[int, str] | None = None
    rests: bool = False


@dataclass(frozen=True, kw_only=True)
class Constraint:
    """An equation that holds as long as a part is in a mode.

    Attributes
    ----------
    mode : int
        The part's own mode.
    value : str
        An expression that is zero where the equation holds.
    slopes : mapping of int to str
        Its derivatives by components of the state; others are zero.
    linear : bool
        Whether these are the same everywhere.
    """

    mode: int
    value: str
    slopes: Mapping[int, str]
    linear: bool = True


@dataclass(frozen=True)
class CodeNames:
    """How the text calls what a part speaks of.

    Attributes
    ----------
    part : Part
    place : int
        Which of the parts it is.
    states, parameters : tuple of str
    masses : mapping of str to Quantity
        By the velocity to which they belong.
    contact : int or None
        Which of the contacts it is.
    space : dict
        The functions that the text calls, by name.
    """

    part: Part
    place: int
    states: tuple[str, ...]
    parameters: tuple[str, ...]
    masses: Mapping[str, Quantity]
    contact: int | None
    space: dict[str, Any]

    @property
    def mode(self) -> str:
        """The part's own mode."""
        return f"m{self.place}"

    @property
    def last(self) -> str:
        """The part's own mode before an event."""
        return f"last{self.place}"

    @property
    def fired(self) -> str:
        """Whether the event is one of the part's own."""
        return f"fired == {self.place}"

    @property
    def upper(self) -> str:
        """The derivative of a surface's height along the flow above it."""
        return f"up{self.place}"

    @property
    def lower(self) -> str:
        """The derivative of a surface's height along the flow below it."""
        return f"down{self.place}"

    @property
    def back(self) -> str:
        """How far the force of a contact that holds is from the least that it bears."""
        return f"back{self.place}"

    @property
    def front(self) -> str:
        """How far the force of a contact that holds is from the largest that it bears."""
        return f"front{self.place}"

    @property
    def needed(self) -> str:
        """How much of the force of a stop that holds is needed beside what others bear."""
        return f"needed{self.place}"

    @property
    def size(self) -> str:
        """The forces on all bodies that hang together with a contact, without their signs."""
        return f"size{self.place}"

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
                known = ", ".join(self.parameters) or "of which there are none"
                allowed = f"a number, a function, or one of the parameters, {known}"
                raise InvalidParameter(self.label(field), quantity, allowed)
            return f"p.{quantity}"
        if not is_number(quantity):
            allowed = "a number, the name of a parameter, or a function"
            raise InvalidParameter(self.label(field), quantity, allowed)
        return repr(float(quantity))

    def call(self, function: Callable[..., Any], arguments: str) -> str:
        """Return the call of a function of the user as an expression."""
        known = (name for name, value in self.space.items() if value is function)
        name = next(known, f"given_{len(self.space)}")
        self.space[name] = function
        return f"{name}({arguments})"

    def mass(self, velocity: str) -> str:
        """Return the mass of a body as an expression; 1 where forces are per mass."""
        return self.value(f"mass of {velocity}", self.masses.get(velocity, 1.0))

    def label(self, field: str) -> str:
        """Return what errors call a field of the part."""
        return f"{field} of {self.part.name!r}"


@dataclass(frozen=True)
class Part:
    """Something that a system is put together from: ``System(parts=[...])``.

    A subclass is a frozen dataclass of what its user gives. Strings in it name states or
    parameters of the system, which `CodeNames` turns into expressions and checks.

    Parameters
    ----------
    name : str
        What tables call it; the flow finds its mode as ``mode.name``.

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

    modes: ClassVar[tuple[str, ...]] = ()
    """What its modes are called."""
    signs: ClassVar[tuple[int, ...]] = ()
    """What the flow finds as ``mode.name`` in each of them."""

    @abstractmethod
    def fits(self, words: CodeNames) -> list[str]:
        """Return the conditions under which each of its modes fits the state, in order.

        At hand are ``x``, `CodeNames.last`, `CodeNames.fired` and ``jumped``, 1 where the state may
        have been moved by the event of another part, or a run begins.
        """

    def stays(self, words: CodeNames) -> str:
        """Return the mode in which it is left where several fit: by default the one before."""
        return words.last

    @abstractmethod
    def watches(self, words: CodeNames) -> list[GuardSpec]:
        """Return its guards."""

    def constraints(self, words: CodeNames) -> list[Constraint]:
        """Return the equations that hold for good while it is in a mode."""
        return []


# --- What parts between bodies share: a relative speed, a force, and a mode in which they hold.

ZERO_SPEED_RATIO = "1e-13"  # of the speeds: relative speeds below it are zero
ZERO_FORCE_RATIO = "1e-13"  # of forces and accelerations: what is so near to zero has no sign


@dataclass(frozen=True)
class ContactSides:
    """The two sides of a contact, in words of the text.

    Attributes
    ----------
    on : int
        The velocity that its force drives.
    against : int or None
        The velocity that it drives back, or that is prescribed; None for `speed`.
    speed : str
        That of the other side, as an expression.
    mass, other : str or None
        Their masses; None where nothing drives the other side.
    """

    on: int
    against: int | None
    speed: str
    mass: str
    other: str | None

    @property
    def slip(self) -> str:
        """The relative speed."""
        return f"y[{self.on}]" if self.speed == "0.0" else f"(y[{self.on}] - {self.speed})"

    @property
    def drift(self) -> str:
        """The roundings of the relative acceleration."""
        sizes = [f"abs(x[{body}])" for body in (self.on, self.against) if body is not None]
        return f"{ZERO_FORCE_RATIO} * ({' + '.join(sizes)})"

    def relative(self, slope: str) -> str:
        """Return the relative acceleration, of slopes ``slope[j]``."""
        if self.against is None:
            return slope.format(self.on)
        return f"({slope.format(self.on)} - {slope.format(self.against)})"

    @property
    def share(self) -> str:
        """The relative acceleration that a unit of force makes, as an expression."""
        return f"(1.0 / {self.mass}{f' + 1.0 / {self.other}' if self.other else ''})"

    @property
    def near(self) -> str:
        """Whether there is no relative speed but for rounding."""
        if self.speed == "0.0":
            return f"y[{self.on}] == 0.0"
        size = f"(abs(y[{self.on}]) + abs({self.speed}))"
        return f"abs({self.slip}) <= {ZERO_SPEED_RATIO} * {size}"


@dataclass(frozen=True)
class Contact(Part):
    """A part that acts on a velocity, and in one of its modes holds it."""

    holds: ClassVar[int]
    """The mode in which the relative speed stays zero, by the force that this takes."""

    @property
    def pushes(self) -> int:
        """The sign of its force on ``on`` where it holds; 0 where it has either."""
        return 0

    @abstractmethod
    def sides(self, words: CodeNames) -> ContactSides:
        """Return what it acts on, and against what."""

    @abstractmethod
    def rests(self, words: CodeNames) -> str:
        """Return whether it could hold: it is closed, and there is no relative speed."""

    @property
    @abstractmethod
    def moves(self) -> Mapping[int, int]:
        """The sign of the relative motion of ``on`` that begins at rest, by the other modes."""

    def constraints(self, words: CodeNames) -> list[Constraint]:
        """Return that there is no relative speed where it holds."""
        both = self.sides(words)
        slopes = (
            {both.on: "1.0"} if both.against is None else {both.on: "1.0", both.against: "-1.0"}
        )
        return [Constraint(mode=self.holds, value=both.slip, slopes=slopes)]

    @abstractmethod
    def bears(self, words: CodeNames) -> tuple[str, str]:
        """Return how large the force on ``on`` may be, backward and forward; empty for zero."""

    def law(self, words: CodeNames) -> dict[int, str]:
        """Return the forces on ``on`` in the other modes, where there are any."""
        return {}


def sides(words: CodeNames, on: str, other: Quantity, field: str) -> ContactSides:
    """Return the sides of a contact on the velocity `on` against another one, or a speed."""
    index = words.index("velocity", on)
    mass = words.mass(on)
    if isinstance(other, str) and other in words.states:
        against = words.index(field, other)
        driven = words.mass(other) if other in words.masses else None
        return ContactSides(index, against, f"y[{against}]", mass, driven)
    return ContactSides(index, None, words.value(field, other), mass, None)
