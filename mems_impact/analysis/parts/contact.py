"""What parts between bodies share: a relative speed, a force, and a mode in which they hold."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from mems_impact.analysis.parts.part import Constraint, Part, Quantity, Words

__all__ = ["ROUNDING", "Contact", "Sides"]

NEAR = "1e-13"  # of the speeds: relative speeds below it are zero
ROUNDING = "1e-13"  # of forces and accelerations: what is so near to zero has no sign


@dataclass(frozen=True)
class Sides:
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
        return f"{ROUNDING} * ({' + '.join(sizes)})"

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
        return f"abs({self.slip}) <= {NEAR} * {size}"


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
    def sides(self, words: Words) -> Sides:
        """Return what it acts on, and against what."""

    def constraints(self, words: Words) -> list[Constraint]:
        """Return that there is no relative speed where it holds."""
        both = self.sides(words)
        slopes = (
            {both.on: "1.0"} if both.against is None else {both.on: "1.0", both.against: "-1.0"}
        )
        return [Constraint(mode=self.holds, value=both.slip, slopes=slopes)]

    @abstractmethod
    def bears(self, words: Words) -> tuple[str, str]:
        """Return how large the force on ``on`` may be, backward and forward; empty for zero."""

    def law(self, words: Words) -> dict[int, str]:
        """Return the forces on ``on`` in the other modes, where there are any."""
        return {}


def sides(words: Words, on: str, other: Quantity, field: str) -> Sides:
    """Return the sides of a contact on the velocity `on` against another one, or a speed."""
    index = words.index("velocity", on)
    mass = words.mass(on)
    if isinstance(other, str) and other in words.states:
        against = words.index(field, other)
        driven = words.mass(other) if other in words.masses else None
        return Sides(index, against, f"y[{against}]", mass, driven)
    return Sides(index, None, words.value(field, other), mass, None)
