"""Fits of a system to measurements, by least squares with exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.warning_scopes import collected_warnings, warn
from mems_impact.analysis.run_derivatives import INITIAL
from mems_impact.errors import FitWarning, InvalidParameter, MemsImpactError
from mems_impact.integrators.options import Options
from mems_impact.studies.records import (
    DELAY,
    OFFSET,
    Comparison,
    Conditions,
    Measurement,
    Prediction,
    Record,
)
from mems_impact.systems.result import SummaryRepr
from mems_impact.systems.state import State, is_number, whole

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Fit", "fit"]

MISFIT = 3.0  # standard deviations of a normal variable that are as improbable as a misfit
LOOSE = 1.0  # a standard error above this part of the typical size leaves a value undetermined
NEGLIGIBLE = 1e-7  # relative singular value below which a combination is not identifiable
TELLING = 1e-3  # least component of a combination that is named
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

Verdict = Literal["good", "undetermined", "misfit", "unsettled", "not converged"]

REMEDIES: dict[Verdict, str] = {
    "undetermined": "add measurements that react to these parameters, or free fewer of them",
    "misfit": "check what was measured (per impact or per blow?) and its errors, free other "
    "parameters, widen their bounds or take several starts",
    "unsettled": "raise transient, or start runs near their motion by initial",
    "not converged": "start nearer to the solution, or free fewer parameters",
}
"""From the mildest verdict to the worst one."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fit(SummaryRepr):
    """A fitted system, with standard errors and diagnostics.

    Attributes
    ----------
    system : System or Actuator
        The first argument of the fit at the fitted values.
    parameters : DataFrame
        One row per free quantity: start, fitted value, standard error (infinite if the data do not
        depend on the quantity), 95 % interval, bounds, whether the data determine the quantity (to
        less than its size), whether it is at a bound.
    residuals : DataFrame
        One row per datum: record, quantity, t, measured, computed (nan for an unmatched event),
        difference, standard error, difference in standard errors.
    covariance : DataFrame
        By free quantity.
    noise : Series
        Standard errors estimated from the residuals, by quantity.
    singular_values : float array
        Singular values of the Jacobian of the weighted residuals with respect to the quantities in
        their typical sizes, largest first: the change of the data, in standard errors, along a
        combination of quantities.
    directions : DataFrame
        One row per singular value: the combination.
    chi_square : float
        Sum of squares of the differences in standard errors.
    degrees_of_freedom : int
    misfit : float
        The largest difference between computed and measured, in standard errors.
    verdict : {"good", "undetermined", "misfit", "unsettled", "not converged"}
        The worst of: "not converged"; "unsettled" if a statistic of a run is farther than a
        standard error from its limit (see `Settling`); "misfit" if `chi_square` is as improbable
        as three standard deviations; "undetermined" if the data do not determine a free quantity;
        "good" otherwise.
    note : str
        What the data miss, leave open or cannot separate, unmatched events, quantities at a bound.
    converged : bool
        Whether the search converged to a minimum, which need not fit the data.
    evaluations : int
        Number of evaluations of the residuals.
    starts : DataFrame
        One row per start: the values it led to, chi-square, whether it converged.

    See Also
    --------
    fit, Record, Target, plot_fit

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> pull_in = mi.Target(quantity="pull-in voltage", value=35)  # [V]
    >>> found = mi.fit(mita, [pull_in], free=["k"])
    >>> found.converged, found.misfit < 1e-6
    (True, True)
    """

    system: Any
    parameters: pd.DataFrame
    residuals: pd.DataFrame
    covariance: pd.DataFrame
    noise: pd.Series
    singular_values: Floats = field(repr=False)
    directions: pd.DataFrame
    chi_square: float
    degrees_of_freedom: int
    misfit: float
    verdict: Verdict
    note: str
    converged: bool
    evaluations: int
    starts: pd.DataFrame
    _problem: Problem = field(repr=False)
    _solution: Solution = field(repr=False)

    @property
    def values(self) -> dict[str, float]:
        """The fitted values by name."""
        return dict(zip(self.covariance.index, self.parameters["fitted"], strict=True))

    @property
    def units(self) -> dict[str, str]:
        """Units of the free quantities and of the recorded columns."""
        comparisons = self._problem.comparisons
        columns = {
            name: each.unit(name)
            for each in comparisons
            for name in ("t", *each.table["quantity"].unique())
        }
        return {**columns, **{each.label: each.unit for each in self._problem.unknowns}}

    @property
    def shared_parameters(self) -> dict[str, float]:
        """The fitted parameters of the system, without what belongs to records."""
        unknowns = zip(self._problem.unknowns, self.values.items(), strict=True)
        return dict(pair for each, pair in unknowns if each.owner < 0 and each.is_parameter)

    @property
    def correlations(self) -> pd.DataFrame:
        """Correlations of the estimates; nan where a standard error is infinite."""
        errors = np.sqrt(np.diag(self.covariance))
        with np.errstate(invalid="ignore"):
            return self.covariance / np.outer(errors, errors)

    def profile(self, name: str) -> pd.DataFrame:
        """Return the profile likelihood of a free quantity.

        The other quantities are fitted again at each value. The quantity lies in its 95 % interval
        where ``rise`` is below 3.84; unlike intervals by standard errors, this one need not be
        symmetric.

        Parameters
        ----------
        name : str

        Returns
        -------
        DataFrame
            The values of the quantity, the other ones, and ``rise`` of the sum of squares.
        """
        if name not in self.values:
            raise InvalidParameter("name", name, f"one of {', '.join(self.values)}")
        return self._problem.profile(self._solution, name)

    def summary(self) -> dict[str, Any]:
        """Return the verdict, and the fitted values with their standard errors."""
        rows = (
            self.parameters.iloc[:, 0],
            self.parameters["fitted"],
            self.parameters["standard error"],
        )
        return {
            "verdict": self.verdict,
            "note": self.note,
            "misfit": self.misfit,
            **{
                name: f"{value:.6g} ± {error:.2g}" for name, value, error in zip(*rows, strict=True)
            },
        }

    def __str__(self) -> str:
        form = {"index": False, "float_format": "{:.6g}".format}
        tables_ = f"{self.parameters.to_string(**form)}\n\n{self.residuals.to_string(**form)}"
        return f"{self.verdict}: {self.note}\n\n{tables_}"


def fit(
    system: Any,
    data: Any,
    free: Sequence[str],
    *,
    drive: Any = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, tuple[float | str, float | str]] | None = None,
    starts: int = 1,
    seed: int = 0,
    transient: int | None = None,
    periods: int = 2,
    initial: State | Mapping[str, float] | None = None,
    options: Options = Options(),  # noqa: B008 - immutable
) -> Fit:
    """Fit parameters of a system to measurements.

    The fit minimizes the residuals, divided by their standard errors, by bounded least squares
    (`scipy.optimize.least_squares`, trust region reflective) with the derivatives of the runs.

    Parameters
    ----------
    system : System or Actuator
        Start of the search; parameters that are not free keep their values.
    data : DataFrame, path of a CSV file, Record or Target, or a sequence of these
        A table of samples, or of events if it has a column ``event``. Tables of one motion belong
        in one `Record`; different tables are different motions.
    free : sequence of str
        Quantities to fit: parameters (of an actuator k, or as in a data sheet, stiffness), initial
        states (``"x0.x"``), the ``"delay"`` of the clock of the record (its time less the time of
        the motion), and the ``"offset.x"`` of a recorded column.
    drive : Drive, optional
        Of records of an actuator.
    bounds : mapping of str to tuple of float, optional
        Bounds of a free quantity, which may have units; by default the range of the parameter.
    priors : mapping of str to tuple of float, optional
        Mean and standard error of a free quantity from other sources.
    starts : int, optional
        Number of starts of the search; further ones are drawn within the bounds.
    seed : int, optional
        Of these.
    transient : int, optional
        Forcing periods before the measurement; by default none before a record, and before a
        `Target` as many as its statistic takes to settle.
    periods : int, optional
        Forcing periods in which a `Target` is measured.
    initial : State or mapping of str to float, optional
        Initial state of the runs.
    options : Options, optional

    Returns
    -------
    Fit

    Raises
    ------
    InvalidParameter
        If an argument or a record is wrong.
    RunError
        If a run fails at the start of the search.

    Warns
    -----
    FitWarning
        If the verdict is not "good".

    See Also
    --------
    Fit, Record, Target, plot_fit, value_and_jacobian, FitWarning

    Notes
    -----
    The search begins with the first part of the records, which grows threefold, so that a
    frequency that is a little wrong does not lead to another minimum. Standard errors that are not
    given are estimated from the residuals by quantity, and those of the estimates follow from
    them; given ones are taken as they are.

    Examples
    --------
    >>> import pandas as pd
    >>> import mems_impact as mi
    >>> ball = mi.System(
    ...     states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g),
    ...     parameters={"g": 9.8, "e": 0.7}, initial={"x": 1.0},
    ...     parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
    ... )
    >>> heard = pd.DataFrame({"t": [0.452, 1.174, 1.753, 2.215]})  # [s]
    >>> found = mi.fit(ball, mi.Record(events=heard, errors={"t": 0.001}), free=["e", "x0.x"])
    >>> found.verdict, round(found.values["e"], 2)
    ('good', 0.8)
    """
    names = [free] if isinstance(free, str) else list(free)
    symbol = getattr(system, "_symbol", lambda name, field="": name)
    conditions = Conditions(system, drive, initial, transient, periods, options)
    comparisons = _comparisons(data, conditions)
    problem = Problem(
        comparisons,
        [symbol(name, "free") for name in names],
        {symbol(name): bound for name, bound in (bounds or {}).items()},
        {symbol(name): prior for name, prior in (priors or {}).items()},
    )
    whole("starts", starts, 1)
    with collected_warnings():
        solutions = problem.solutions(starts, np.random.default_rng(seed))
    found = problem.result(system, solutions)
    if found.verdict != "good":
        warn(f"{found.verdict}: {found.note}; {REMEDIES[found.verdict]}", FitWarning)
    return found


def _comparisons(data: Any, conditions: Conditions) -> list[Comparison]:
    """Return the data of each measurement beside their computation."""
    several = isinstance(data, Sequence) and not isinstance(data, str)
    measurements = [
        each if isinstance(each, Measurement) else Record.of(each)
        for each in (data if several else [data])
    ]
    if not measurements:
        raise InvalidParameter("data", data, "one or more DataFrames, Record(…) or Target(…)")
    by_kind = sorted(measurements, key=lambda each: type(each).__name__)
    groups = [list(group) for _, group in groupby(by_kind, key=type)]
    return [each for group in groups for each in group[0].comparisons(group, conditions)]


# --- The least-squares problem


class Unknown(NamedTuple):
    """A free quantity.

    Attributes
    ----------
    label : str
        Its name, with the record that it belongs to.
    name : str
    owner : int
        Number of its comparison; -1 for all.
    start, scale : float
        First value, and typical size.
    low, high : float
    prior : tuple of float
        Mean and standard error; the error is infinite without a prior.
    unit : str
    """

    label: str
    name: str
    owner: int
    start: float
    scale: float
    low: float
    high: float
    prior: tuple[float, float]
    unit: str

    @property
    def heading(self) -> str:
        """The label with the unit."""
        return f"{self.label} [{self.unit}]" if self.unit else self.label

    @property
    def is_parameter(self) -> bool:
        """Whether it is a parameter of a system."""
        return self.name != DELAY and not self.name.startswith((INITIAL, OFFSET))


class Solution(NamedTuple):
    """A minimum.

    Attributes
    ----------
    values : float array, shape (s,)
    errors : float array, shape (m,)
        Standard errors of the data.
    prediction : Prediction
    cost : float
        Sum of squares, of data and priors.
    converged : bool
    evaluations : int
    gap : float
        Distance that left an event unmatched, in spacings.
    """

    values: Floats
    errors: Floats
    prediction: Prediction
    cost: float
    converged: bool
    evaluations: int
    gap: float


class Problem:
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

    def solutions(self, starts: int, generator: np.random.Generator) -> list[Solution]:
        """Return the minima found from several starts, the best one first."""
        self.predict(self.first)  # raises what is wrong at the start
        found = [self._search(self.first)]
        if self._is_misfit(found[0]):
            found += self._tried(self.first, grows=False)
        for _ in range(starts - 1):
            found += self._tried(self._drawn(generator))
        return sorted(found, key=lambda each: self._criterion(each))

    def _tried(self, first: Floats, grows: bool = True) -> list[Solution]:
        try:
            return [self._search(first, grows)]
        except MemsImpactError:  # no system, or no run, at such a start
            return []

    def _drawn(self, generator: np.random.Generator) -> Floats:
        """Return another start, within the bounds."""
        size = START_SCATTER * self.scales
        low = np.where(np.isfinite(self.low), self.low, self.first - 2.0 * size)
        high = np.where(np.isfinite(self.high), self.high, self.first + 2.0 * size)
        finite = np.isfinite(self.low) & np.isfinite(self.high)
        near = np.clip(self.first + size * generator.standard_normal(size.size), low, high)
        return np.where(finite, generator.uniform(low, high), near)

    def _criterion(self, solution: Solution) -> float:
        """Return what is least at the best minimum: minus twice the logarithm of the likelihood."""
        penalty = np.isnan(solution.prediction.values).sum() * MISFIT**2
        return float(solution.cost + 2.0 * np.log(solution.errors).sum() + penalty)

    def _search(self, first: Floats, grows: bool = True) -> Solution:
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

    def _settled(self, values: Floats, errors: Floats, gap: float) -> Solution:
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

    def _weighted(self, solution: Solution, errors: Floats) -> Solution:
        residuals = (solution.prediction.values - self.measured) / errors
        priors = [
            (v - u.prior[0]) / u.prior[1]
            for v, u in zip(solution.values, self.unknowns, strict=True)
        ]
        cost = float(np.nansum(residuals**2) + np.sum(np.square(priors)))
        return solution._replace(errors=errors, cost=cost)

    def _estimated(self, solution: Solution) -> Floats:
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
    ) -> Solution:
        """Return the minimum near some values, by part of the records, or with one value fixed."""
        from scipy.optimize import least_squares

        within = self.until(part)
        moving = np.array([j for j in range(len(first)) if fixed is None or j != fixed[0]])
        low, high, scales = self.low[moving], self.high[moving], self.scales[moving]
        means, sizes = np.array([each.prior for each in self.unknowns])[moving].T
        last: dict[bytes, tuple[Floats, Floats, Prediction]] = {}

        def full(x: Floats) -> Floats:
            values = first.copy()
            values[moving] = np.clip(x * scales, low, high)  # rounding must not cross a bound
            if fixed is not None:
                values[fixed[0]] = fixed[1]
            return values

        def at(x: Floats) -> tuple[Floats, Floats, Prediction]:
            key = x.tobytes()
            if key not in last:
                values = full(x)
                try:
                    prediction, _ = self.predict(values, part, gap)
                except MemsImpactError:  # without a run there is no fit
                    if not last:
                        raise
                    nothing = np.full(self.measured.size, math.nan)
                    prediction = Prediction(nothing, np.zeros((nothing.size, len(first))))
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
                last[key] = np.concatenate(parts), np.concatenate(rows), prediction
            return last[key]

        def jacobian(x: Floats) -> Floats:
            residuals, rows, _ = at(x)
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
            found = at(start)
            return Solution(full(start), errors, found[2], float(found[0] @ found[0]), True, 1, gap)
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
        residuals, _, prediction = at(solved.x)
        jac = np.zeros_like(prediction.jacobian)
        jac[:, moving] = prediction.jacobian[:, moving]
        for j in np.flatnonzero(~np.isfinite(prediction.jacobian[:, moving]).all(axis=0)).tolist():
            column = difference(solved.x, residuals, j)[: int(within.sum())]
            jac[within, moving[j]] = column * errors[within] / scales[j]
        return Solution(
            full(solved.x), errors, prediction._replace(jacobian=jac), 2.0 * float(solved.cost),
            bool(solved.success), int(solved.nfev), gap,
        )  # fmt: skip

    def _is_misfit(self, solution: Solution) -> bool:
        """Return whether the residuals are as improbable as `MISFIT` standard deviations."""
        from scipy.stats import chi2, norm

        known = np.isfinite(solution.prediction.values)
        data = known & np.isfinite(self.given)
        residuals = ((solution.prediction.values - self.measured) / solution.errors)[data]
        spare = max(1, data.sum() - round(len(self.unknowns) * data.sum() / max(1, known.sum())))
        improbable = chi2.sf(float(residuals @ residuals), spare) < 2.0 * norm.sf(MISFIT)
        far = np.zeros(0)
        if self.groups:  # without given errors, data that are missed by their own spread
            rows = np.concatenate([*self.groups.values()])
            far = (solution.prediction.values - self.measured)[rows] / self.spreads[rows]
        lost = bool(far.size) and not float(np.sqrt(np.nanmean(far**2))) < 0.5
        return bool(improbable) or lost

    def profile(self, solution: Solution, name: str) -> pd.DataFrame:
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

    def inverse(self, solution: Solution) -> tuple[tuple[Floats, Floats], Floats]:
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

    def result(self, system: Any, solutions: Sequence[Solution]) -> Fit:
        """Return the result of the best minimum."""
        import pandas as pd
        from scipy.stats import norm, t

        best = solutions[0]
        prediction, errors, values = best.prediction, best.errors, best.values
        (singular, directions), covariance = self.inverse(best)
        spread = np.sqrt(np.diag(covariance))
        known = int(np.isfinite(prediction.values).sum())
        spare = known - len(self.unknowns)
        quantile = norm.ppf(0.5 + 0.5 * INTERVAL)
        if self.groups:
            quantile = t.ppf(0.5 + 0.5 * INTERVAL, max(1, spare))
        labels = [each.label for each in self.unknowns]
        at_bound = self._at_bounds(values) != 0
        determined = spread <= LOOSE * np.maximum(np.abs(values), self.scales)
        parameters = pd.DataFrame(
            {
                "parameter": [
                    f"{u.label} [{u.unit}]" if u.unit else u.label for u in self.unknowns
                ],
                "start": self.first,
                "fitted": values,
                "standard error": spread,
                "95 % low": values - quantile * spread,
                "95 % high": values + quantile * spread,
                "low": self.low,
                "high": self.high,
                "determined": determined,
                "at bound": at_bound,
            }
        )
        table = pd.concat([each.table for each in self.comparisons], ignore_index=True)
        difference = prediction.values - self.measured
        table["computed"], table["difference"] = prediction.values, difference
        table["standard error"], table["in standard errors"] = errors, difference / errors
        off = np.abs(difference / errors)
        misfit = float(np.nanmax(off, initial=0.0))
        parts = self.predict(values, gap=best.gap)[1]
        remarks = [
            remark
            for i, (each, part) in enumerate(zip(self.comparisons, parts, strict=True))
            for remark in each.remarks(self.mine(i, values), part)
        ]
        is_misfit = self._is_misfit(best)
        sentences = [
            *(text for _, text in remarks),
            *(self._missed(table, is_misfit)),
            *_undetermined(labels, singular, directions, spread, values, self.scales),
            *(
                f"{each.label} is at its {'lower' if side < 0 else 'upper'} bound"
                for each, side in zip(self.unknowns, self._at_bounds(values), strict=True)
                if side
            ),
            *self._at_limits(values),
            *self._indifferent(table, prediction.jacobian),
        ]
        verdicts = {verdict for verdict, _ in remarks if verdict}
        verdicts |= {"misfit"} if is_misfit else set()
        verdicts |= set() if determined.all() else {"undetermined"}
        verdicts |= set() if best.converged else {"not converged"}
        verdict: Verdict = next((v for v in reversed(REMEDIES) if v in verdicts), "good")
        runs = pd.DataFrame([each.values for each in solutions], columns=labels)
        runs["chi-square"] = [each.cost for each in solutions]
        runs["converged"] = [each.converged for each in solutions]
        shared = {
            each.name: float(value)
            for each, value in zip(self.unknowns, values, strict=True)
            if each.owner < 0 and each.is_parameter
        }
        return Fit(
            system=system.changed(**shared) if shared else system,
            parameters=parameters,
            residuals=table,
            covariance=pd.DataFrame(covariance, index=labels, columns=labels),
            noise=pd.Series(
                {n: (errors * self.weights)[rows[0]] for n, rows in self.groups.items()},
                dtype=float,
            ),
            singular_values=singular,
            directions=pd.DataFrame(directions, columns=labels),
            chi_square=best.cost,
            degrees_of_freedom=spare,
            misfit=misfit,
            verdict=verdict,
            note="; ".join(sentences) or "the data determine all free parameters",
            converged=best.converged,
            evaluations=sum(each.evaluations for each in solutions),
            starts=runs,
            _problem=self,
            _solution=best,
        )

    def _missed(self, table: pd.DataFrame, is_misfit: bool) -> Iterator[str]:
        """Yield a sentence about missed data."""
        off = table["in standard errors"].abs()
        missed = int((off > MISFIT).sum())
        if not is_misfit:
            return
        if not missed:
            yield "the fit misses the data by as much as they vary"
            return
        row = table.loc[off.idxmax()]
        under, record = "", row["record"]
        if math.isfinite(row["t"]):
            under = f"{f' of record {record}' if record else ''} at t = {row['t']:.6g}"
        elif record:
            under = f" under {record}"
        number = f"{missed} of {len(table)} data" if len(table) > 1 else "the datum"
        yield (
            f"the fit misses {number} by more than {MISFIT:g} standard errors, {row['quantity']}"
            f"{under} by {off.max():.4g}"
        )

    def _at_bounds(self, values: Floats) -> NDArray[np.int64]:
        """Return for each quantity -1 at its lower bound, 1 at its upper one, otherwise 0."""
        near = AT_BOUND * self.scales
        return (values >= self.high - near).astype(int) - (values <= self.low + near)

    def _at_limits(self, values: Floats) -> Iterator[str]:
        """Yield a sentence about each quantity next to whose value there is no system."""
        for j, each in enumerate(self.unknowns):
            for sign in (1.0, -1.0):
                moved = values.copy()
                moved[j] += sign * STEP * self.scales[j]
                if not each.low <= moved[j] <= each.high:
                    continue
                try:
                    for i, comparison in enumerate(self.comparisons):
                        comparison.check(self.mine(i, moved))
                except InvalidParameter as error:
                    yield f"{each.label} is at a limit of the system: {error}"

    def _indifferent(self, table: pd.DataFrame, jacobian: Floats) -> Iterator[str]:
        """Yield a sentence about each quantity on which no free one acts."""
        keys = list(zip(table["record"], table["quantity"], strict=True))
        for key in dict.fromkeys(keys):
            rows = [each == key for each in keys]
            if not np.any(jacobian[rows]):
                yield f"{key[1]} depends on none of the free parameters"


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


def _undetermined(
    names: Sequence[str],
    sizes: Floats,
    directions: Floats,
    errors: Floats,
    values: Floats,
    scales: Floats,
) -> Iterator[str]:
    """Yield a sentence about each combination and quantity that the data do not determine."""
    relative = errors / np.maximum(np.abs(values), scales)
    for size, direction in zip(sizes, directions, strict=True):
        if size > NEGLIGIBLE * sizes[0]:
            continue
        # Of relative changes, which are those of products of powers.
        parts = direction * scales / np.where(values != 0.0, values, scales)
        components = sorted(zip(parts.tolist(), names, strict=True), key=lambda each: -abs(each[0]))
        largest = components[0][0]
        telling = [(w / largest, name) for w, name in components if abs(w / largest) > TELLING]
        if len(telling) == 1:
            yield f"the data do not determine {telling[0][1]}"
        else:
            product = " ".join(f"{name}^{power:.3g}" for power, name in telling)
            joined = ", ".join(name for _, name in telling)
            yield f"the data cannot separate {joined}: they do not change along {product}"
    for name, error in zip(names, relative.tolist(), strict=True):
        if LOOSE < error < math.inf:
            yield (
                f"the data do not determine {name}: its standard error is {error:.3g} times its "
                "value"
            )
