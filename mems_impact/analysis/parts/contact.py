"""What parts between bodies share: a relative speed, a force, and a mode in which they hold."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from mems_impact.analysis.parts.part import Part, Quantity, Words

__all__ = ["Contact", "Sides"]

NEAR = "1e-13"  # of the speeds: relative speeds below it are zero


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
    yielding, resisting : str or None
        The acceleration that a unit of force makes on either side; None where it makes none.
    """

    on: int
    against: int | None
    speed: str
    yielding: str
    resisting: str | None

    @property
    def slip(self) -> str:
        """The relative speed."""
        return f"y[{self.on}]" if self.speed == "0.0" else f"(y[{self.on}] - {self.speed})"

    def relative(self, slope: str) -> str:
        """Return the relative acceleration, of slopes ``slope[j]``."""
        if self.against is None:
            return slope.format(self.on)
        return f"({slope.format(self.on)} - {slope.format(self.against)})"

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
    """The mode in which the relative speed stays zero, whatever force that takes."""

    @abstractmethod
    def sides(self, words: Words) -> Sides:
        """Return what it acts on, and against what."""

    def law(self, words: Words) -> dict[int, str]:
        """Return the forces on ``on`` in the other modes, where there are any."""
        return {}


def sides(words: Words, on: str, other: Quantity, field: str) -> Sides:
    """Return the sides of a contact on the velocity `on` against another one, or a speed."""
    index = words.index("velocity", on)
    yielding = f"1.0 / {words.mass(on)}"
    if isinstance(other, str) and other in words.states:
        against = words.index(field, other)
        resisting = f"1.0 / {words.mass(other)}" if other in words.masses else None
        return Sides(index, against, f"y[{against}]", yielding, resisting)
    return Sides(index, None, words.value(field, other), yielding, None)
