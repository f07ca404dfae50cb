"""What a part is: modes, guards, and what it adds to the flow, as lines of text.

The parts of a system are put together as source (`text`), of which the compiler sees plain
arithmetic. So a part answers with expressions. In all of them stand ``t``, the time; ``y[j]``,
component j of the state; ``p.name``, a parameter; and of the part itself its mode, a number, by the
name `Words.mode`. Where `Watch` says so, ``x`` holds what the flow makes in the current mode:
``x[j]``, the derivative of component j; and of a contact `Words.back`, `Words.front`,
`Words.needed` and `Words.size`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from mems_impact.analysis.state import is_number
from mems_impact.errors import InvalidParameter

__all__ = ["Constraint", "Part", "Quantity", "Watch", "Words"]

Quantity = float | str | Callable[..., float]
"""A number, the name of a parameter, or a function."""

ANY = "-1"  # in place of a mode: the one that fits


@dataclass(frozen=True, kw_only=True)
class Watch:
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
class Words:
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
    parameters of the system, which `Words` turns into expressions and checks.

    Parameters
    ----------
    name : str
        What tables call it; the flow finds its mode as ``mode.name``.

    See Also
    --------
    Friction, Stopper, Relay, Surface, System

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
    def fits(self, words: Words) -> list[str]:
        """Return the conditions under which each of its modes fits the state, in order.

        At hand are ``x``, `Words.last`, `Words.fired` and ``jumped``, 1 where the state may have
        been moved by the event of another part, or a run begins.
        """

    def stays(self, words: Words) -> str:
        """Return the mode in which it is left where several fit: by default the one before."""
        return words.last

    @abstractmethod
    def watches(self, words: Words) -> list[Watch]:
        """Return its guards."""

    def constraints(self, words: Words) -> list[Constraint]:
        """Return the equations that hold for good while it is in a mode."""
        return []
