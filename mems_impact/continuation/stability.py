"""Changes of stability along a branch: eigenvalues or multipliers that cross the border.

Each eigenvalue at the start of a step is paired with its continuation at the end. The method is
independent of their number and size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eig
from scipy.optimize import brentq, linear_sum_assignment

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.continuation.arclength import (
    POSITION_TOLERANCE,
    SHORTER_STEP_REMEDY,
    PredictorStep,
    tangent,
)
from mems_impact.continuation.branch_points import BranchPoints
from mems_impact.continuation.test_functions import BRANCH_POINT, FOLD, UNEXPLAINED
from mems_impact.errors import OrbitError
from mems_impact.orbits.newton import P, Solvable
from mems_impact.orbits.periodic_schur import product_eigenvalues
from mems_impact.orbits.spectrum import EIGENVALUE_RTOL, MULTIPLIER_RTOL

# --- Crossings of the border of stability

MIN_CROSSING_SPACING = 1e-9  # distance, relative to the step, below which crossings count as one
TANGENCY_STEP_RATIO = 1e-2  # shortest part of a step that is searched for pairs of crossings
CURVATURE_SAFETY = 2.0  # safety factor of the curvature estimated by parabolas
BORDER_RTOL = 1e-6  # largest relative growth of a value on the border


@dataclass(frozen=True)
class Border:
    """A line in the complex plane beyond which eigenvalues are unstable."""

    # Of each of an array of values: negative within the border, positive beyond.
    growth: Callable[[Complexes], Floats]
    size: Callable[[Complexes], Floats]  # scale of the growth of each value
    distance: Callable[[Complexes, Complexes], Floats]  # between values, for their pairing
    center: float  # point of the border at which the equations are singular
    accuracy: float  # relative accuracy of the entries of a matrix
    # Largest distance of a value from `center` at a fold; farther away, the turn of the parameter
    # is rounding.
    fold_distance: float

    def spectrum(self, matrix: Floats) -> Spectrum:
        """Return the eigenvalues of a matrix, or of a product of matrices, with their growth."""
        if matrix.ndim == 3:
            if len(matrix) == 1:
                return self.spectrum(matrix[0])
            values, conditions = product_eigenvalues(matrix)
            return Spectrum(values, self.growth(values), self.accuracy * conditions)
        if not matrix.size:
            return Spectrum(np.zeros(0, complex), np.zeros(0), np.zeros(0))
        values, left, right = eig(matrix, left=True, right=True)
        # First-order sensitivity to relative errors of the entries, independent of units.
        sensitivity = np.einsum("ik,ij,jk->k", np.abs(left), np.abs(matrix), np.abs(right))
        alignment = np.abs(np.einsum("ik,ik->k", left.conj(), right))
        with np.errstate(divide="ignore", invalid="ignore"):
            uncertainty = (
                self.accuracy * sensitivity / alignment * self.size(values) / np.abs(values)
            )
        return Spectrum(values, self.growth(values), np.nan_to_num(uncertainty, nan=np.inf))

    def is_remote(self, spectrum: Spectrum) -> bool:
        """Return whether no value is near the center, as it is at a fold."""
        distances = self.distance(spectrum.values, np.array(self.center))
        return bool(np.all(distances > self.fold_distance))

    def crossings(self, before: Spectrum, after: Spectrum) -> list[tuple[int, int]]:
        """Return the values that cross the border, as indices before and after."""
        rows, columns = self.pairing(before, after)
        is_crossing = (before.growth[rows] < 0.0) != (after.growth[columns] < 0.0)
        is_certain = np.abs(before.growth[rows]) > before.uncertainty[rows]
        is_certain |= np.abs(after.growth[columns]) > after.uncertainty[columns]
        mask = is_crossing & is_certain
        return list(zip(rows[mask].tolist(), columns[mask].tolist(), strict=True))

    def pairing(
        self, before: Spectrum, after: Spectrum
    ) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the pairing of values, as indices before and after."""
        distances = self.distance(before.values[:, None], after.values)
        rows, columns = linear_sum_assignment(np.nan_to_num(distances))
        return rows, columns


@dataclass(frozen=True)
class Spectrum:
    """Eigenvalues or multipliers, with their growth, positive for unstable values; shapes (n,)."""

    values: Complexes
    growth: Floats
    uncertainty: Floats  # of the growth


@dataclass(frozen=True)
class Crossing:
    """Crossing of an eigenvalue with its conjugate, or of several at one position, in a step.

    The bracket from `begin` to `end` is a point if the crossing is located. A crossing at
    `Border.center`, where the equations may be singular, is only bracketed.
    """

    begin: float
    end: float
    value: complex  # one of the eigenvalues


def _chord(values: Complexes, others: Complexes) -> Floats:
    """Return the chordal distance on the Riemann sphere, which is finite at infinity."""
    return np.asarray(
        np.abs(values - others) / np.hypot(1.0, np.abs(values)) / np.hypot(1.0, np.abs(others))
    )


def _log_size(values: Complexes) -> Floats:
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.abs(values)))


IMAGINARY_AXIS = Border(
    growth=lambda values: np.asarray(values.real),
    size=lambda values: np.asarray(np.abs(values)),
    distance=lambda one, other: np.asarray(np.abs(one - other)),
    center=0.0,
    accuracy=EIGENVALUE_RTOL,
    fold_distance=np.inf,
)
"""The imaginary axis, for the eigenvalues of equilibria."""

CIRCLE = Border(
    growth=_log_size,
    size=lambda values: np.ones(values.shape),
    distance=_chord,
    center=1.0,
    accuracy=MULTIPLIER_RTOL,
    fold_distance=0.1,
)
"""The unit circle, for the multipliers of orbits."""


class Crossings:
    """Search for crossings in a step.

    `matrix` returns the matrix of the eigenvalues at a position in the step, or its factors, and
    may raise OrbitError. `previous` is a (negative) position before the step, with the spectrum
    there; `start` is the spectrum at the start, if it is known.
    """

    def __init__(
        self,
        border: Border,
        matrix: Callable[[float], Floats],
        previous: tuple[float, Spectrum] | None = None,
        start: Spectrum | None = None,
    ) -> None:
        self._border, self._matrix, self._previous = border, matrix, previous
        self._spectra: dict[float, Spectrum] = {} if start is None else {0.0: start}

    def spectrum(self, s: float) -> Spectrum:
        """Return the spectrum at a position in the step."""
        if s not in self._spectra:
            self._spectra[s] = self._border.spectrum(self._matrix(s))
        return self._spectra[s]

    def within(self, length: float) -> list[Crossing]:
        """Return all crossings in the first `length` of a step, in order."""
        if length == 0.0:  # a loss at the start of the step
            return []
        if self._previous is None:
            half = 0.5 * length
            first, last = (0.0, self.spectrum(0.0)), (length, self.spectrum(length))
            return self._between(0.0, half, length, last) + self._between(
                half, length, length, first
            )
        return self._between(0.0, length, length, self._previous)

    def _between(
        self, begin: float, end: float, length: float, third: tuple[float, Spectrum]
    ) -> list[Crossing]:
        """Return the crossings between two positions, given the spectrum at a third one."""
        before, after = self.spectrum(begin), self.spectrum(end)
        pairs = self._border.crossings(before, after)
        paths = [(complex(before.values[i]), complex(after.values[j])) for i, j in pairs]
        crossing = self._single_crossing(begin, end, paths)
        if crossing is not None:
            return [crossing]
        relative_length = (end - begin) / length
        if (
            relative_length > MIN_CROSSING_SPACING
            if pairs
            else relative_length > TANGENCY_STEP_RATIO
            and self._may_cross_twice((begin, end), third)
        ):
            middle = 0.5 * (begin + end)
            crossings = self._between(begin, middle, length, (end, after))
            crossings += self._between(middle, end, length, (begin, before))
            if crossings:
                return crossings
        # Several at one position, as in a system of equal parts, unless the pairing is wrong.
        if sum(np.sign(after.growth[j]) for _, j in pairs) == 0:
            return []
        middle, center = 0.5 * (begin + end), self._border.center
        # Without damping, real values meet at the border and continue along it as a pair.
        values = (first if first.imag == 0.0 else last for first, last in paths)
        kinds = {(value.imag == 0.0, value.real >= center): value for value in values}
        return [
            Crossing(begin, end, complex(center))
            if is_real and (is_beyond or center == 0.0)
            else Crossing(middle, middle, value)
            for (is_real, is_beyond), value in kinds.items()
        ]

    def _may_cross_twice(self, ends: tuple[float, float], third: tuple[float, Spectrum]) -> bool:
        """Estimate by parabolas whether a value may cross the border twice."""
        (a, b), (c, other) = ends, third
        first, last = self.spectrum(a), self.spectrum(b)
        rows, columns = self._border.pairing(first, last)
        g_a, g_b = first.growth[rows], last.growth[columns]
        pairing = dict(
            zip(*(each.tolist() for each in self._border.pairing(first, other)), strict=True)
        )
        g_c = np.array(
            [other.growth[pairing[i]] if i in pairing else np.nan for i in rows.tolist()]
        )
        with np.errstate(invalid="ignore"):
            curvature = ((g_c - g_a) / (c - a) - (g_b - g_a) / (b - a)) / (c - b)
            deviation = 0.25 * np.abs(curvature) * (b - a) ** 2  # largest deviation from the chord
            is_near = np.minimum(np.abs(g_a), np.abs(g_b)) < CURVATURE_SAFETY * deviation
        return bool(np.any(is_near & np.isfinite(deviation)))

    def _single_crossing(
        self, begin: float, end: float, paths: Sequence[tuple[complex, ...]]
    ) -> Crossing | None:
        """Return the only crossing, of one value with its conjugate; None if there are others."""
        if len(paths) == 2 and all(v.conjugate() == w for v, w in zip(*paths, strict=True)):
            paths = [tuple(complex(v.real, abs(v.imag)) for v in paths[0])]
        if len(paths) != 1:
            return None
        ((first, last),) = paths
        if (first.imag == 0.0) != (last.imag == 0.0):
            return None
        center = self._border.center
        if first.imag == 0.0 and (first.real < center) != (last.real < center):
            return Crossing(begin, end, complex(center))

        def value(s: float) -> complex:
            prediction = first + (s - begin) / (end - begin) * (last - first)
            values = self.spectrum(s).values
            return complex(values[np.argmin(np.abs(values - prediction))])

        def growth(s: float) -> float:
            return float(self._border.growth(np.array(value(s))))

        position = float(brentq(growth, begin, end, xtol=POSITION_TOLERANCE))
        border_value = value(position)
        if abs(growth(position)) > BORDER_RTOL * float(self._border.size(np.array(border_value))):
            return None  # the value was confused with another one
        return Crossing(position, position, border_value)


def unexplained(crossings: list[Crossing], positions: list[float]) -> list[Crossing]:
    """Return the bracketed crossings without a fold or branch point, at `positions`, inside."""
    return [
        each
        for each in crossings
        if each.begin < each.end and not any(each.begin <= s <= each.end for s in positions)
    ]


# --- Folds, branch points and changes of stability

CROSSING = "crossing"  # of a complex pair, or of a multiplier -1
# Part of the largest step below which an unlocated change of stability is reported.
UNEXPLAINED_STEP_RATIO = 0.01
CONTINUUM_SLOPE = 1e-8  # parameter in a unit tangent that counts as zero


class LocatedPoint(Protocol):
    """A special point with a kind."""

    @property
    def kind(self) -> str:
        """Kind of the special point."""


X = TypeVar("X", bound=LocatedPoint)


class Bifurcation(NamedTuple, Generic[P]):
    """A bifurcation within a step."""

    position: float
    kind: str  # "fold", "branch point", "crossing" or "unexplained"
    point: P
    value: complex  # the eigenvalue on the border of stability


class Bifurcations(Generic[P]):
    """Search for bifurcations along a branch, of equations with one active parameter.

    A change in the number of unstable eigenvalues is the crossing of a pair or of a multiplier -1,
    or occurs at a fold or a branch point. A step with an unlocated change is repeated with a
    shorter length; in a step below `short_length` the change is "unexplained". `matrix` returns the
    matrix of the eigenvalues at a point, or its factors.
    """

    def __init__(
        self,
        equations: Solvable[P],
        border: Border,
        matrix: Callable[[P], Floats],
        short_length: float,
    ) -> None:
        self.equations = equations
        self._border, self._matrix, self._short_length = border, matrix, short_length
        self._previous: tuple[float, Spectrum] | None = None
        self._last: tuple[Floats, Spectrum] | None = None  # start of the last step
        self._end: tuple[P, Spectrum] | None = None  # its end
        self.branch_points = BranchPoints(equations)

    def within(
        self, step: PredictorStep[P], length: float, first: float, last: float
    ) -> list[Bifurcation[P]]:
        """Return all bifurcations in the first `length` of a step, in order.

        `first` and `last` are the `regularity` at both ends. Raises OrbitError if a bifurcation
        cannot be located in this step.
        """
        center, is_short = complex(self._border.center), length < self._short_length
        bifurcations = []
        if (first < 0.0) != (last < 0.0):
            # Without a branch point there, the end of the step lies on another branch.
            position, point = self.branch_points.locate(step, length, first, last)
            bifurcations.append(Bifurcation(position, BRANCH_POINT, point, center))
        continuum = self._is_continuum(step, length)
        for position in () if continuum else self._folds(step, length):
            bifurcations.append(Bifurcation(position, FOLD, step.at(position).point, center))
        first_point, last_point = step.at(0.0).point, step.at(length).point
        start_spectrum = self._end[1] if self._end and self._end[0] is first_point else None
        search = Crossings(
            self._border,
            lambda s: self._matrix(step.at(s).point),
            self._previous_start(step),
            start_spectrum,
        )
        crossings = search.within(length)
        self._last = step.start, search.spectrum(0.0)
        self._end = last_point, search.spectrum(length)
        # A real eigenvalue that passes the border at a fold, and beyond the border elsewhere in the
        # step, has no crossing between the ends.
        hidden_folds = [
            each
            for each in bifurcations
            if each.kind == FOLD and not any(c.begin <= each.position <= c.end for c in crossings)
        ]
        rounding_folds = [
            f for f in hidden_folds if self._border.is_remote(search.spectrum(f.position))
        ]
        bifurcations = [each for each in bifurcations if each not in rounding_folds]
        missing_crossings = (
            [] if continuum else unexplained(crossings, [position for position, *_ in bifurcations])
        )
        if (len(hidden_folds) > len(rounding_folds) or missing_crossings) and not is_short:
            raise OrbitError("a change of stability was not located", SHORTER_STEP_REMEDY)
        for each in missing_crossings:
            position = 0.5 * (each.begin + each.end)
            bifurcations.append(
                Bifurcation(position, UNEXPLAINED, step.at(position).point, each.value)
            )
        bifurcations += [
            Bifurcation(each.begin, CROSSING, step.at(each.begin).point, each.value)
            for each in crossings
            if each.begin == each.end
        ]
        return sorted(bifurcations, key=lambda each: each.position)

    def without_spurious_folds(self, events: Sequence[X], point_of: Callable[[X], P]) -> list[X]:
        """Return special points of the branch without folds that are branch points.

        An error of the equations separates crossing branches, with a spurious fold that an earlier
        step may have located.
        """
        is_known = self.branch_points.is_known
        return [each for each in events if each.kind != FOLD or not is_known(point_of(each))]

    def _previous_start(self, step: PredictorStep[P]) -> tuple[float, Spectrum] | None:
        """Return the (negative) position of the start of the last step, and its spectrum."""
        if self._last is not None and not np.array_equal(step.start, self._last[0]):
            start, spectrum = self._last
            self._previous = -float(np.linalg.norm(step.start - start)), spectrum
        return self._previous

    def _is_continuum(self, step: PredictorStep[P], length: float) -> bool:
        """Return whether the parameter stays constant, as along the orbits of a linear center.

        The sign of its change, and that of the distance of an eigenvalue from the border, is
        rounding there.
        """
        tangents = (tangent(step.at(s).point, step.direction) for s in (0.0, length))
        return all(abs(each[-1]) < CONTINUUM_SLOPE for each in tangents)

    def _folds(self, step: PredictorStep[P], length: float) -> Iterator[float]:
        """Yield the positions of folds outside branch points."""

        def parameter_rate(point: P) -> float:
            return float(tangent(point, step.direction)[-1])

        for begin, end in self.branch_points.intervals(step, length):
            first, last = (parameter_rate(step.at(s).point) < 0.0 for s in (begin, end))
            if first != last:
                try:
                    yield step.zero(parameter_rate, end, begin)
                except ValueError as error:
                    raise OrbitError("a fold could not be located", SHORTER_STEP_REMEDY) from error
