"""Where the motions of a study start: a grid over components of the state, or a sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from mems_impact.analysis.state import is_number
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.trajectory import Floats
from mems_impact.studies.axes import Axis, identity_of_axis
from mems_impact.studies.sampling import digest_of, unit_sample

__all__ = ["Grid", "Sample", "Starts", "box_of"]


class Starts(Protocol):
    """Values of some components of the state, numbered from 0."""

    @property
    def names(self) -> tuple[str, ...]:
        """The components."""

    @property
    def points(self) -> Floats:
        """Their values, a row a point."""

    def identity(self) -> dict[str, Any]:
        """Return what tells them from others."""


@dataclass(frozen=True)
class Grid:
    """All pairs of the values of x and y, those of x first; or the values of x."""

    x: Axis
    y: Axis | None = None

    @property
    def axes(self) -> tuple[Axis, ...]:
        """X, and y if there is one."""
        return (self.x,) if self.y is None else (self.x, self.y)

    @property
    def names(self) -> tuple[str, ...]:
        """The components."""
        return tuple(axis.name for axis in self.axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Values of y, values of x."""
        return tuple(len(axis.values) for axis in reversed(self.axes))

    @cached_property
    def points(self) -> Floats:
        """Their values, a row a point."""
        grids = np.meshgrid(*(np.array(axis.values) for axis in self.axes))
        return np.stack([grid.ravel() for grid in grids], axis=1)

    def identity(self) -> dict[str, Any]:
        """Return what tells them from others."""
        names = ("x", "y")[: len(self.axes)]
        return {name: identity_of_axis(axis) for name, axis in zip(names, self.axes, strict=True)}


@dataclass(frozen=True)
class Sample:
    """A sample of a box, uniform in it.

    Attributes
    ----------
    box : tuple of (str, float, float)
        Components of the state, each with its ends.
    n : int
    sampling : {"random", "sobol", "lhs"}
    seed : int
    """

    box: tuple[tuple[str, float, float], ...]
    n: int
    sampling: str
    seed: int

    @property
    def names(self) -> tuple[str, ...]:
        """The components."""
        return tuple(name for name, _, _ in self.box)

    @cached_property
    def points(self) -> Floats:
        """Their values, a row a point."""
        low, high = np.array([ends for _, *ends in self.box]).T
        return low + (high - low) * unit_sample(self.n, len(self.box), self.sampling, self.seed)

    def identity(self) -> dict[str, Any]:
        """Return what tells them from others."""
        return {
            "box": {name: [low, high] for name, low, high in self.box},
            "samples": self.n,
            "sampling": self.sampling,
            "seed": self.seed,
            "points": digest_of(self.points),
        }


def box_of(
    given: Mapping[str, tuple[float, float]], names: tuple[str, ...]
) -> tuple[tuple[str, float, float], ...]:
    """Return a box as it was given; InvalidParameter unless it has ends for some of `names`."""
    allowed = f'ends of some components, {{"{names[0]}": (low, high)}}'
    if not isinstance(given, Mapping) or not given:
        raise InvalidParameter("box", given, allowed)
    box = []
    for name, ends in given.items():
        if name not in names:
            raise InvalidParameter("box", name, f"of components among {', '.join(names)}")
        try:
            low, high = ends
        except (TypeError, ValueError):
            raise InvalidParameter(f"box.{name}", ends, "two numbers, low and high") from None
        if not (is_number(low) and is_number(high) and low < high):
            raise InvalidParameter(f"box.{name}", ends, "two finite numbers, the lower one first")
        box.append((name, float(low), float(high)))
    return tuple(box)
