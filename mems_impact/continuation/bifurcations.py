"""Folds, branch points and changes of stability along a branch, of orbits or of equilibria."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Generic, NamedTuple

import numpy as np

from mems_impact.continuation.branching import BranchPoints
from mems_impact.continuation.corrector import Step, tangent
from mems_impact.continuation.ending import SHORTER
from mems_impact.continuation.monitors import BRANCH_POINT, FOLD, UNEXPLAINED
from mems_impact.continuation.stability import Border, Crossings, Spectrum, unexplained
from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.newton import P, Solvable

CROSSING = "crossing"  # of an eigenvalue that rotates, or of a multiplier -1
SHORT = 0.01  # part of the largest step, in which what is not found is told


class Bifurcation(NamedTuple, Generic[P]):
    """A point within a step.

    Attributes
    ----------
    place : float
    kind : str
        "fold", "branch point", "crossing" or "unexplained".
    point : Point or Balance
    value : complex
        The eigenvalue on the border of stability.
    """

    place: float
    kind: str
    point: P
    value: complex


class Bifurcations(Generic[P]):
    """The search for them along a branch.

    A change in the number of unstable eigenvalues is that of a pair or of a multiplier -1, or else
    there is a fold or a branch point; a step in which none is found is to be shortened, and in a
    short one it is "unexplained".

    Parameters
    ----------
    equations : Shooting or Balancing
        With one active parameter.
    border : Border
        Of stability.
    matrix : callable
        What has the eigenvalues, at a point.
    short : float
        Length below which a step is short.
    """

    def __init__(
        self,
        equations: Solvable[P],
        border: Border,
        matrix: Callable[[P], Floats],
        short: float,
    ) -> None:
        self.equations = equations
        self._border, self._matrix, self._short = border, matrix, short
        self._behind: tuple[float, Spectrum] | None = None
        self._last: tuple[Floats, Spectrum] | None = None  # where the last step begins
        self.branch_points = BranchPoints(equations)

    def within(
        self, step: Step[P], length: float, first: float, last: float
    ) -> list[Bifurcation[P]]:
        """Return all points in the first part of a step, in order.

        Parameters
        ----------
        step : Step
        length : float
        first, last : float
            `regularity` at both ends.

        Raises
        ------
        OrbitError
            If the step is too long to find them.
        """
        center, short = complex(self._border.center), length < self._short
        found = []
        if (first < 0.0) != (last < 0.0):
            try:
                place, point = self.branch_points.locate(step, length, first, last)
                found.append(Bifurcation(place, BRANCH_POINT, point, center))
            except OrbitError:
                if not short:
                    raise
        for place in self._turns(step, length):
            found.append(Bifurcation(place, FOLD, step.at(place).point, center))
        search = Crossings(
            self._border, lambda s: self._matrix(step.at(s).point), self._behind_of(step)
        )
        crossings = search.within(length)
        self._last = step.start, search.spectrum(0.0)
        for each in unexplained(crossings, [place for place, *_ in found]):
            if not short:
                raise OrbitError("stability changes at no point that is found", SHORTER)
            place = 0.5 * (each.begin + each.end)
            found.append(Bifurcation(place, UNEXPLAINED, step.at(place).point, each.value))
        found += [
            Bifurcation(each.begin, CROSSING, step.at(each.begin).point, each.value)
            for each in crossings
            if each.begin == each.end
        ]
        return sorted(found, key=lambda each: each.place)

    def _behind_of(self, step: Step[P]) -> tuple[float, Spectrum] | None:
        """Return how far back the last step began, and the spectrum there."""
        if self._last is not None and not np.array_equal(step.start, self._last[0]):
            start, spectrum = self._last
            self._behind = -float(np.linalg.norm(step.start - start)), spectrum
        return self._behind

    def _turns(self, step: Step[P], length: float) -> Iterator[float]:
        """Yield where the branch turns round, but for branch points."""

        def onward(point: P) -> float:
            return float(tangent(point, step.along)[-1])

        for begin, end in self.branch_points.between(step, length):
            first, last = (onward(step.at(s).point) < 0.0 for s in (begin, end))
            if first != last:
                try:
                    yield step.zero(onward, end, begin)
                except ValueError as error:
                    raise OrbitError("a fold could not be located", SHORTER) from error
