"""Least squares of comparisons with data, by exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.warning_scopes import collected_warnings
from mems_impact.analysis.run_derivatives import INITIAL
from mems_impact.errors import InvalidParameter, MemsImpactError
from mems_impact.studies.records import DELAY, OFFSET, Comparison, Prediction
from mems_impact.studies.sequence_border import nearest_within
from mems_impact.systems.state import is_number

if TYPE_CHECKING:
    import pandas as pd

MISFIT = 3.0  # standard deviations of a normal variable that are as improbable as a misfit
SMALL, LARGE = 0.1, 0.5  # of residuals, by the spread of the data
ALIKE = 4.0  # standard deviations of the number of neighbouring residuals of one sign
NEGLIGIBLE = 1e-7  # relative singular value below which a combination is not identifiable
INTERVAL = 0.95  # probability of intervals
LEAST_NOISE = 1e-12  # estimated standard error relative to the spread of the data
SAME_NOISE = 1e-2  # relative change of estimated standard errors that ends their iteration
NOISE_ROUNDS = 10
GROWTH = 2.0  # of the part of a record from one fit to the next
LEAST_ROWS = 2  # in the first part
WIDE, NARROW = 3.0, 0.3  # distances that leave an event unmatched, far from and near the minimum
REST_WEIGHT = 1e-2  # of the distance from the start, in typical sizes, while parts grow
EVALUATIONS = 200  # of the residuals, at most
TOLERANCE = 1e-10  # relative, of least squares
AT_BOUND = 1e-6  # distance from a bound, in typical sizes, that counts as zero
STEP = 1e-4  # of differences where derivatives do not exist, in typical sizes
START_SCATTER = 0.5  # of further starts without bounds, in typical sizes
PROFILE_POINTS = 12  # on each side of the estimate
PROFILE_STEP = 0.5  # standard errors
DESCENT = 1e-2  # of chi-square, expected beyond the end of a search that has stopped at a border
BORDER_ROUNDS = 12  # of steps along a border
BEYOND = 3e-2  # standard errors beyond a border


class Unknown(NamedTuple):
    """A free quantity."""

    label: str  # its name, with the record that it belongs to
    name: str
    owner: int  # number of its comparison; -1 for all
    start: float  # first value
    scale: float  # typical size
    low: float
    high: float
    prior: tuple[float, float]  # mean and standard error, which is infinite without a prior
    unit: str

    @property
    def heading(self) -> str:
        """The label with the unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def is_parameter(self) -> bool:
        """Whether it is a parameter of a system."""
        return self.name != DELAY and not self.name.startswith((INITIAL, OFFSET))


class Minimum(NamedTuple):
    """A minimum in s unknowns, for m data."""

    values: Floats  # shape (s,)
    errors: Floats  # standard errors of the data, shape (m,)
    prediction: Prediction
    parts: list[Prediction]  # the same by comparison
    cost: float  # sum of squares, of data and priors
    converged: bool
    evaluations: int
    gap: float  # distance that left an event unmatched, in spacings
    # The data beyond a border of the sequence of events at which the search ended, shape (m,); nan
    # for none.
    beyond: Floats | float = math.nan


class LeastSquares:
    """Comparisons and free quantities as a problem of least squares."""

    def __init__(
        self,
        comparisons: Sequence[Comparison],
        names: Sequence[str],
        bounds: Mapping[str, Any],
        priors: Mapping[str, Any],
    ) -> None:
        self.comparisons = comparisons
        self.measured = np.concatenate([each.table["measured"] for each in comparisons])
        self.given = np.concatenate([each.errors for each in comparisons])
        self.weights = np.concatenate([each.weights for each in comparisons])
        self.spreads = np.concatenate([each.spreads for each in comparisons])
        quantities = np.concatenate([each.table["quantity"] for each in comparisons])
        unknown = np.isnan(self.given)
        self.groups = {
            name: np.flatnonzero(unknown & (quantities == name))
            for name in dict.fromkeys(quantities[unknown].tolist())
        }
        ends = np.cumsum([0, *(len(each.table) for each in comparisons)])
        self._rows = [slice(a, b) for a, b in pairwise(ends.tolist())]
        self.unknowns: list[Unknown] = []
        for owner, chosen in [(-1, names), *((i, each.own) for i, each in enumerate(comparisons))]:
            for name in chosen:
                self.unknowns.append(self._unknown(name, owner, bounds, priors))
        labels = [each.label for each in self.unknowns]
        if not labels or len(set(labels)) != len(labels):
            raise InvalidParameter("free", names, "one or more different names")
        for field_, table in (("bounds", bounds), ("priors", priors)):
            for name in table:
                if name not in [each.name for each in self.unknowns]:
                    allowed = f"for one of {', '.join(labels)}"
                    raise InvalidParameter(f"{field_} of {name}", table[name], allowed)
        self._scale()
        self.low, self.high, self.scales, self.first = (
            np.array([getattr(each, name) for each in self.unknowns])
            for name in ("low", "high", "scale", "start")
        )

    def _unknown(
        self, name: str, owner: int, bounds: Mapping[str, Any], priors: Mapping[str, Any]
    ) -> Unknown:
        shared = owner < 0
        candidates = self.comparisons if shared else [self.comparisons[owner]]
        known = [each for each in candidates if each.start(name) is not None]
        if not known:
            known_names = ", ".join(dict.fromkeys(n for each in candidates for n in each.names))
            raise InvalidParameter("free", name, f"one of {known_names}")
        first = known[0]
        value = float(first.start(name))  # type: ignore[arg-type]
        limits = first.limits(name)
        low, high = limits.low, limits.high
        if name in bounds:
            low, high = _pair(first, name, bounds[name], "bounds")
            if not low <= value <= high or not low < high:
                allowed = f"(low, high) with low <= {value:g} <= high, where the search begins"
                raise InvalidParameter(f"bounds of {name}", (low, high), allowed)
        prior = 0.0, math.inf
        if name in priors:
            prior = _pair(first, name, priors[name], "prior")
            if not prior[1] > 0.0:
                raise InvalidParameter(f"prior of {name}", prior, "(mean, standard error > 0)")
        scale = abs(value) or (prior[1] if prior[1] < math.inf else 0.0)
        label = name if shared else f"{name} {self.comparisons[owner].name}".rstrip()
        return Unknown(label, name, owner, value, scale, low, high, prior, first.unit(name))

    def _scale(self) -> None:
        """Find the typical sizes of quantities that begin at zero: they move the data so much."""
        if all(each.scale > 0.0 for each in self.unknowns):
            return
        first = np.array([each.start for each in self.unknowns])
        jacobian = self.predict(first)[0].jacobian / self.spreads[:, None]
        sizes = np.sqrt(np.nanmean(jacobian**2, axis=0))
        self.unknowns = [
            each if each.scale > 0.0 else each._replace(scale=1.0 / size if size > 0.0 else 1.0)
            for each, size in zip(self.unknowns, sizes.tolist(), strict=True)
        ]

    def mine(self, i: int, values: Floats) -> dict[str, float]:
        """Return the values of the quantities of a comparison."""
        return {self.unknowns[j].name: float(values[j]) for j in self._places[i]}

    @cached_property
    def _places(self) -> list[list[int]]:
        """The numbers of the quantities of each comparison."""
        return [
            [
                j
                for j, unknown in enumerate(self.unknowns)
                if unknown.owner in (-1, i) and comparison.start(unknown.name) is not None
            ]
            for i, comparison in enumerate(self.comparisons)
        ]

    def predict(
        self, values: Floats, part: float = 1.0, gap: float = NARROW
    ) -> tuple[Prediction, list[Prediction]]:
        """Return the computed data and their derivatives, together and by comparison."""
        computed = np.full(self.measured.size, math.nan)
        jacobian = np.zeros((self.measured.size, len(self.unknowns)))
        found = []
        for i, (comparison, rows) in enumerate(zip(self.comparisons, self._rows, strict=True)):
            found.append(comparison.predict(self.mine(i, values), part, gap))
            computed[rows] = found[i].values
            jacobian[rows, self._places[i]] = found[i].jacobian
        return Prediction(computed, jacobian), found

    def until(self, part: float) -> NDArray[np.bool_]:
        """Return which data belong to a part of the records."""
        return np.concatenate([each.until(part) for each in self.comparisons])

    # --- Minima

    def solutions(self, starts: int, generator: np.random.Generator) -> list[Minimum]:
        """Return the minima found from several starts, the best one first."""
        self.predict(self.first)  # raises what is wrong at the start
        found = [self._beside(self._search(self.first))]
        if self.is_misfit(found[0]):
            found += self._tried(self.first, grows=False)
        for _ in range(starts - 1):
            found += self._tried(self._drawn(generator))
        return sorted(found, key=self._criterion)

    def _tried(self, first: Floats, grows: bool = True) -> list[Minimum]:
        try:
            return [self._beside(self._search(first, grows))]
        except MemsImpactError:  # no system, or no run, at such a start
            return []

    def _beside(self, found: Minimum) -> Minimum:
        """Return the minimum beside a border at which a search has stopped.

        Beyond it the system has another sequence of events, so that residuals are not smooth, and
        steps of least squares that do not lie along it become ever shorter.
        """
        sequence, beyond = self._sequence(found.values), None
        for _ in range(BORDER_ROUNDS):
            by_error, wanted = self._descent(found)
            if not wanted @ wanted > DESCENT:
                break

            def at(z: Floats, found: Minimum = found, by_error: Floats = by_error) -> Floats:
                return np.clip(found.values + by_error @ z, self.low, self.high)

            def inside(z: Floats, at: Callable[[Floats], Floats] = at) -> bool:
                return self._sequence(at(z)) == sequence

            place = nearest_within(inside, wanted)
            if place is None:
                break
            nearest, outer = place
            beyond = at(nearest + BEYOND * outer)
            better = self._at(at(nearest), found)
            if not self._criterion(better) < self._criterion(found) - DESCENT:
                break
            found = better
        if beyond is not None:
            with suppress(MemsImpactError):
                there = self._at(beyond, found).prediction.values
                other = self._settled(beyond, found.errors, found.gap)
                sides = (found, there), (other, found.prediction.values)
                found, there = min(sides, key=lambda side: self._improbability(side[0]))
                found = found._replace(beyond=there)
        return found

    def _improbability(self, solution: Minimum) -> float:
        """Return minus twice the logarithm of the probability of all values about a minimum."""
        singular = self.inverse(solution)[0][0]
        least = NEGLIGIBLE * max(singular[0], 1e-300)
        return self._criterion(solution) + 2.0 * float(np.log(np.maximum(singular, least)).sum())

    def _sequence(self, values: Floats) -> Any:
        """Return what changes discretely with the values; None without a run."""
        try:
            return [c.sequence(self.mine(i, values)) for i, c in enumerate(self.comparisons)]
        except MemsImpactError:
            return None

    def _descent(self, found: Minimum) -> tuple[Floats, Floats]:
        """Return combinations of quantities with unit error, and the step of Gauss and Newton."""
        known = np.isfinite(found.prediction.values)
        free = np.flatnonzero(self.at_bounds(found.values) == 0)
        means, sizes = np.array([each.prior for each in self.unknowns])[free].T
        errors, scales = found.errors[known], self.scales[free]
        rows = found.prediction.jacobian[known][:, free] / errors[:, None] * scales
        rows = np.concatenate([rows, np.diag(scales / sizes)])
        residuals = (found.prediction.values - self.measured)[known] / errors
        residuals = np.append(residuals, (found.values[free] - means) / sizes)
        left, singular, directions = np.linalg.svd(rows, full_matrices=False)
        kept = singular > NEGLIGIBLE * singular.max(initial=0.0)
        combinations = np.zeros((found.values.size, int(kept.sum())))
        combinations[free] = scales[:, None] * (directions[kept] / singular[kept, None]).T
        return combinations, -left[:, kept].T @ residuals

    def _at(self, values: Floats, near: Minimum) -> Minimum:
        """Return the place with some values, as a minimum."""
        prediction, parts = self.predict(values, gap=near.gap)
        found = near._replace(values=values, prediction=prediction, parts=parts)
        return self._weighted(found, self._estimated(found))

    def _drawn(self, generator: np.random.Generator) -> Floats:
        """Return another start, within the bounds."""
        size = START_SCATTER * self.scales
        low = np.where(np.isfinite(self.low), self.low, self.first - 2.0 * size)
        high = np.where(np.isfinite(self.high), self.high, self.first + 2.0 * size)
        finite = np.isfinite(self.low) & np.isfinite(self.high)
        near = np.clip(self.first + size * generator.standard_normal(size.size), low, high)
        return np.where(finite, generator.uniform(low, high), near)

    def _criterion(self, solution: Minimum) -> float:
        """Return what is least at the best minimum: minus twice the logarithm of the likelihood."""
        penalty = np.isnan(solution.prediction.values).sum() * MISFIT**2
        return float(solution.cost + 2.0 * np.log(solution.errors).sum() + penalty)

    def _search(self, first: Floats, grows: bool = True) -> Minimum:
        """Return the minimum from a start, by parts of the records that grow."""
        values, evaluations = first, 0
        errors = np.where(np.isnan(self.given), self.spreads / self.weights, self.given)
        for part in self._parts() if grows else []:
            found = self._minimum(values, errors, part, tolerance=1e-3, rest=values, gap=WIDE)
            values, evaluations = found.values, evaluations + found.evaluations
        found = self._settled(values, errors, WIDE)
        near = self._settled(found.values, found.errors, NARROW)
        best = min((near, found), key=self._criterion)
        return best._replace(evaluations=evaluations + near.evaluations + found.evaluations)

    def _settled(self, values: Floats, errors: Floats, gap: float) -> Minimum:
        """Return the minimum with standard errors estimated from its own residuals."""
        evaluations = 0
        for _ in range(NOISE_ROUNDS):
            found = self._minimum(values, errors, gap=gap)
            values, evaluations = found.values, evaluations + found.evaluations
            estimated = self._estimated(found)
            same = (np.abs(estimated - errors) <= SAME_NOISE * errors).all()
            errors = estimated
            if same or (len(self.groups) == 1 and np.isnan(self.given).all() and not self._known):
                break
        return self._weighted(found._replace(evaluations=evaluations), errors)

    @property
    def _known(self) -> bool:
        """Whether there are priors."""
        return any(each.prior[1] < math.inf for each in self.unknowns)

    def _weighted(self, solution: Minimum, errors: Floats) -> Minimum:
        residuals = (solution.prediction.values - self.measured) / errors
        priors = [
            (v - u.prior[0]) / u.prior[1]
            for v, u in zip(solution.values, self.unknowns, strict=True)
        ]
        cost = float(np.nansum(residuals**2) + np.sum(np.square(priors)))
        return solution._replace(errors=errors, cost=cost)

    def _estimated(self, solution: Minimum) -> Floats:
        """Return the standard errors of the data, those not given from the residuals."""
        errors = solution.errors.copy()
        residuals = solution.prediction.values - self.measured
        known = int(np.isfinite(residuals).sum())
        free = max(1, known - len(self.unknowns)) / max(1, known)
        for rows in self.groups.values():
            scaled = residuals[rows] * self.weights[rows]
            square = float(np.nanmean(scaled**2)) / free if np.isfinite(scaled).any() else 1.0
            least = LEAST_NOISE * self.spreads[rows] * self.weights[rows]
            errors[rows] = np.maximum(math.sqrt(square), least) / self.weights[rows]
        return errors

    def _parts(self) -> Iterator[float]:
        """Yield growing parts of the records."""
        part = 1.0 / GROWTH
        parts = []
        while int(self.until(part).sum()) >= LEAST_ROWS:
            if all(each.until(part).any() for each in self.comparisons):
                parts.append(part)
            if bool(self.until(part).all()) or part < 1e-6:
                return
            part /= GROWTH
        yield from reversed(parts)

    def _minimum(
        self,
        first: Floats,
        errors: Floats,
        part: float = 1.0,
        *,
        tolerance: float = TOLERANCE,
        gap: float = NARROW,
        rest: Floats | None = None,
        fixed: tuple[int, float] | None = None,
    ) -> Minimum:
        """Return the minimum near some values, by part of the records, or with one value fixed."""
        from scipy.optimize import least_squares

        within = self.until(part)
        moving = np.array([j for j in range(len(first)) if fixed is None or j != fixed[0]])
        low, high, scales = self.low[moving], self.high[moving], self.scales[moving]
        means, sizes = np.array([each.prior for each in self.unknowns])[moving].T
        last: dict[bytes, tuple[Floats, Floats, Prediction, list[Prediction]]] = {}

        def full(x: Floats) -> Floats:
            values = first.copy()
            values[moving] = np.clip(x * scales, low, high)  # rounding must not cross a bound
            if fixed is not None:
                values[fixed[0]] = fixed[1]
            return values

        def at(x: Floats) -> tuple[Floats, Floats, Prediction, list[Prediction]]:
            key = x.tobytes()
            if key not in last:
                values = full(x)
                try:
                    prediction, found = self.predict(values, part, gap)
                except MemsImpactError:  # without a run there is no fit
                    if not last:
                        raise
                    nothing = np.full(self.measured.size, math.nan)
                    prediction = Prediction(nothing, np.zeros((nothing.size, len(first))))
                    found = []
                    residuals = np.full(int(within.sum()), math.inf)
                else:
                    residuals = ((prediction.values - self.measured) / errors)[within]
                    unmatched = np.isnan(residuals)
                    residuals[unmatched] = gap * (self.spreads / errors)[within][unmatched]
                parts = [residuals, (values[moving] - means) / sizes]
                jacobian = prediction.jacobian[within][:, moving] / errors[within, None]
                rows = [jacobian * scales, np.diag(scales / sizes)]
                if rest is not None:
                    parts.append(REST_WEIGHT * (values - rest)[moving] / scales)
                    rows.append(REST_WEIGHT * np.eye(len(moving)))
                last.clear()
                last[key] = np.concatenate(parts), np.concatenate(rows), prediction, found
            return last[key]

        def jacobian(x: Floats) -> Floats:
            residuals, rows, *_ = at(x)
            rows = rows.copy()
            for j in np.flatnonzero(~np.isfinite(rows).all(axis=0)).tolist():
                rows[:, j] = difference(x, residuals, j)
            return rows

        def difference(x: Floats, residuals: Floats, j: int) -> Floats:
            """Return a column by differences, where no derivative exists."""
            for sign in (1.0, -1.0):
                moved = x.copy()
                moved[j] += sign * STEP
                if low[j] <= moved[j] * scales[j] <= high[j]:
                    aside = at(moved)[0]
                    if np.isfinite(aside).all():
                        return (aside - residuals) / (moved[j] - x[j])
            return np.zeros_like(residuals)

        start = first[moving] / scales
        if not moving.size:
            residuals, _, prediction, found = at(start)
            cost = float(residuals @ residuals)
            return Minimum(full(start), errors, prediction, found, cost, True, 1, gap)
        solved = least_squares(
            lambda x: at(x)[0],
            np.clip(start, low / scales, high / scales),
            jac=jacobian,
            bounds=(low / scales, high / scales),
            method="trf",
            x_scale=1.0,
            ftol=tolerance,
            xtol=tolerance,
            gtol=tolerance,
            max_nfev=EVALUATIONS,
        )
        residuals, _, prediction, found = at(solved.x)
        jac = np.zeros_like(prediction.jacobian)
        jac[:, moving] = prediction.jacobian[:, moving]
        for j in np.flatnonzero(~np.isfinite(prediction.jacobian[:, moving]).all(axis=0)).tolist():
            column = difference(solved.x, residuals, j)[: int(within.sum())]
            jac[within, moving[j]] = column * errors[within] / scales[j]
        return Minimum(
            full(solved.x), errors, prediction._replace(jacobian=jac), found,
            2.0 * float(solved.cost), bool(solved.success), int(solved.nfev), gap,
        )  # fmt: skip

    def is_misfit(self, solution: Minimum) -> bool:
        """Return whether the residuals are as improbable as `MISFIT` standard deviations.

        Those without given errors are a misfit if they are as large as the data vary, or smaller
        ones whose sign changes rarely from a datum to the next, unlike that of noise.
        """
        from scipy.stats import chi2, norm

        known = np.isfinite(solution.prediction.values)
        data = known & np.isfinite(self.given)
        residuals = ((solution.prediction.values - self.measured) / solution.errors)[data]
        spare = max(1, data.sum() - round(len(self.unknowns) * data.sum() / max(1, known.sum())))
        improbable = chi2.sf(float(residuals @ residuals), spare) < 2.0 * norm.sf(MISFIT)
        part, alike = self.missed_part(solution)
        return bool(improbable) or part > LARGE or (part > SMALL and alike > ALIKE)

    def missed_part(self, solution: Minimum) -> tuple[float, float]:
        """Return the size of residuals by that of the data, and how alike in sign neighbours are.

        The latter in standard deviations of a random order. Of data without given errors; (0, 0)
        without such data.
        """
        rows = np.concatenate([*self.groups.values(), np.zeros(0, dtype=int)])
        far = (solution.prediction.values - self.measured)[rows] / self.spreads[rows]
        far = far[np.isfinite(far)]
        square = float(far @ far)
        if not square > 0.0:
            return (math.inf if rows.size > far.size else 0.0), 0.0
        alike = float(np.sign(far[1:] * far[:-1]).sum()) / math.sqrt(far.size)
        return math.sqrt(square / far.size), alike

    def profile(self, solution: Minimum, name: str) -> pd.DataFrame:
        """Return the profile likelihood of a free quantity."""
        import pandas as pd
        from scipy.stats import chi2

        labels = [each.label for each in self.unknowns]
        j = labels.index(name)
        size = float(np.sqrt(self.inverse(solution)[1][j, j]))
        if not math.isfinite(size):
            size = float(self.scales[j])
        limit = 1.5 * float(chi2.ppf(INTERVAL, 1))
        rows = [(*solution.values.tolist(), 0.0)]
        for sign in (-1.0, 1.0):
            values = solution.values
            for count in range(1, PROFILE_POINTS + 1):
                value = solution.values[j] + sign * count * PROFILE_STEP * size
                if not self.low[j] <= value <= self.high[j]:
                    break
                try:
                    with collected_warnings():
                        found = self._minimum(
                            values, solution.errors, fixed=(j, value), gap=solution.gap
                        )
                except MemsImpactError:
                    break
                values = found.values
                prior = self.unknowns[j].prior
                own = ((value - prior[0]) / prior[1]) ** 2
                rows.append((*values.tolist(), found.cost + own - solution.cost))
                if rows[-1][-1] > limit:
                    break
        table = pd.DataFrame(rows, columns=[*labels, "rise"])
        return table.sort_values(name, ignore_index=True)

    # --- Results

    def inverse(self, solution: Minimum) -> tuple[tuple[Floats, Floats], Floats]:
        """Return singular values and directions of the weighted Jacobian, and the covariance."""
        known = np.isfinite(solution.prediction.values)
        rows = solution.prediction.jacobian[known] / solution.errors[known, None] * self.scales
        sizes = np.array([each.prior[1] for each in self.unknowns])
        rows = np.concatenate([rows, np.diag(self.scales / sizes)])
        _, singular, directions = np.linalg.svd(rows, full_matrices=False)
        with np.errstate(divide="ignore", invalid="ignore"):
            lost = ~(singular > NEGLIGIBLE * max(singular[0], 1e-300))
            inverse = np.where(lost, np.inf, 1.0 / singular)
            components = np.where(np.abs(directions) > 1e-6, directions, 0.0)
            parts = np.where(components != 0.0, inverse[:, None] * components, 0.0)
            covariance = np.einsum("ki,kj->ij", parts, parts)
        return (singular, directions), covariance * np.outer(self.scales, self.scales)

    def at_bounds(self, values: Floats) -> NDArray[np.int64]:
        """Return for each quantity -1 at its lower bound, 1 at its upper one, otherwise 0."""
        near = AT_BOUND * self.scales
        return (values >= self.high - near).astype(int) - (values <= self.low + near)


def _pair(comparison: Comparison, name: str, given: Any, field_: str) -> tuple[float, float]:
    """Return two numbers about a free quantity."""
    field_ = f"{field_} of {name}"
    try:
        first, second = (comparison.parse(name, each, field_) for each in given)
    except (TypeError, ValueError) as error:
        if isinstance(error, InvalidParameter):
            raise
        raise InvalidParameter(field_, given, "two numbers") from None
    if not all(is_number(each) or each in (-math.inf, math.inf) for each in (first, second)):
        raise InvalidParameter(field_, given, "two numbers")
    return float(first), float(second)
