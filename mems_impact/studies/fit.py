"""Fits of a system to measurements, by least squares with exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.warning_scopes import collected_warnings, warn
from mems_impact.errors import FitWarning, InvalidParameter
from mems_impact.integrators.options import Options
from mems_impact.studies.least_squares import (
    INTERVAL,
    MISFIT,
    NEGLIGIBLE,
    SMALL,
    STEP,
    LeastSquares,
    Minimum,
)
from mems_impact.studies.records import Comparison, Conditions, Measurement, Record
from mems_impact.studies.sampling import Rng, seed_of
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, whole

if TYPE_CHECKING:
    import pandas as pd

LOOSE = 1.0  # a standard error above this part of the typical size leaves a value undetermined
TELLING = 1e-3  # least component of a combination that is named

MOST_ROWS = 20  # of residuals in print

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
class Fit(Result):
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
    units : dict of str to str
        Units of the free quantities and of the recorded columns.
    shared_parameters : dict of str to float
        The fitted parameters of the system, without what belongs to records.

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
    units: dict[str, str] = field(repr=False)
    shared_parameters: dict[str, float] = field(repr=False)
    _problem: LeastSquares | None = field(default=None, compare=False)
    _solution: Minimum | None = field(default=None, compare=False)

    @property
    def values(self) -> dict[str, float]:
        """The fitted values by name."""
        return dict(zip(self.covariance.index, self.parameters["fitted"], strict=True))

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

        Raises
        ------
        InvalidParameter
            If there is no such quantity, or the fit is from a file, which does not hold its runs.
        """
        if self._problem is None or self._solution is None:
            problem = "from a file, which does not hold the runs for a profile: fit again"
            raise InvalidParameter("fit", None, "", problem=problem)
        if name not in self.values:
            raise InvalidParameter("name", name, f"one of {', '.join(self.values)}")
        return self._problem.profile(self._solution, name)

    def summary(self) -> dict[str, Any]:
        """Return the verdict, and the fitted values with their standard errors."""
        shown = self.parameters[["parameter", "fitted", "standard error"]].to_numpy().tolist()
        values = {name: f"{value:.6g} ± {error:.2g}" for name, value, error in shown}
        return {"verdict": self.verdict, "note": self.note, "misfit": self.misfit, **values}

    def __str__(self) -> str:
        form = {"index": False, "float_format": "{:.6g}".format}
        parts = [f"{self.verdict}: {self.note}", self.parameters.to_string(**form)]
        if len(self.residuals) <= MOST_ROWS:
            parts.append(self.residuals.to_string(**form))
        return "\n\n".join(parts)


def fit(
    system: Any,
    data: Any,
    free: Sequence[str],
    *,
    drive: Any = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, tuple[float | str, float | str]] | None = None,
    starts: int = 1,
    rng: Rng = 0,
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
    rng : int, Generator, SeedSequence or None, optional
        Seed or generator of these, as for `numpy.random.default_rng`.
    transient : int, optional
        Forcing periods before the measurement; by default none before a record, and before a
        `Target` as many as its statistic takes to settle.
    periods : int, optional
        Forcing periods in which a `Target` is measured.
    initial : State or mapping of str to float, optional
        Initial state of the runs.
    options : Options, optional
        Options of the integration; method "adams" by default, and "auto" with a stiff term.

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
    The search begins with the first part of the records, which is doubled, so that a
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
    problem = LeastSquares(
        comparisons,
        [symbol(name, "free") for name in names],
        {symbol(name): bound for name, bound in (bounds or {}).items()},
        {symbol(name): prior for name, prior in (priors or {}).items()},
    )
    whole("starts", starts, 1)
    with collected_warnings():
        solutions = problem.solutions(starts, np.random.default_rng(seed_of(rng)))
    found = _result(problem, system, solutions)
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


def _result(problem: LeastSquares, system: Any, solutions: Sequence[Minimum]) -> Fit:
    """Return the result of the best minimum."""
    import pandas as pd
    from scipy.stats import norm, t

    best = solutions[0]
    prediction, errors, values = best.prediction, best.errors, best.values
    (singular, directions), covariance = problem.inverse(best)
    spread = np.sqrt(np.diag(covariance))
    known = int(np.isfinite(prediction.values).sum())
    spare = known - len(problem.unknowns)
    quantile = norm.ppf(0.5 + 0.5 * INTERVAL)
    if problem.groups:
        quantile = t.ppf(0.5 + 0.5 * INTERVAL, max(1, spare))
    labels = [each.label for each in problem.unknowns]
    at_bound = problem.at_bounds(values) != 0
    determined = spread <= LOOSE * np.maximum(np.abs(values), problem.scales)
    parameters = pd.DataFrame(
        {
            "parameter": [each.heading for each in problem.unknowns],
            "start": problem.first,
            "fitted": values,
            "standard error": spread,
            "95 % low": values - quantile * spread,
            "95 % high": values + quantile * spread,
            "low": problem.low,
            "high": problem.high,
            "determined": determined,
            "at bound": at_bound,
        }
    )
    table = pd.concat([each.table for each in problem.comparisons], ignore_index=True)
    difference = prediction.values - problem.measured
    table["computed"], table["difference"] = prediction.values, difference
    table["standard error"], table["in standard errors"] = errors, difference / errors
    off = np.abs(difference / errors)
    misfit = float(np.nanmax(off, initial=0.0))
    remarks = [
        remark
        for i, (each, part) in enumerate(zip(problem.comparisons, best.parts, strict=True))
        for remark in each.remarks(problem.mine(i, values), part)
    ]
    is_misfit = problem.is_misfit(best)
    sentences = [
        *(text for _, text in remarks),
        *(_missed(table, problem.missed_part(best)[0]) if is_misfit else ()),
        *_undetermined(labels, singular, directions, spread, values, problem.scales),
        *(
            f"{each.label} is at its {'lower' if side < 0 else 'upper'} bound"
            for each, side in zip(problem.unknowns, problem.at_bounds(values), strict=True)
            if side
        ),
        *_at_border(table, best.beyond),
        *_at_limits(problem, values),
        *_indifferent(table, prediction.jacobian),
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
        for each, value in zip(problem.unknowns, values, strict=True)
        if each.owner < 0 and each.is_parameter
    }
    units = {
        name: each.unit(name)
        for each in problem.comparisons
        for name in ("t", *each.table["quantity"].unique())
    }
    return Fit(
        system=system.changed(**shared) if shared else system,
        parameters=parameters,
        residuals=table,
        covariance=pd.DataFrame(covariance, index=labels, columns=labels),
        noise=pd.Series(
            {n: (errors * problem.weights)[rows[0]] for n, rows in problem.groups.items()},
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
        units=units | {each.label: each.unit for each in problem.unknowns},
        shared_parameters=shared,
        _problem=problem,
        _solution=best,
    )


def _missed(table: pd.DataFrame, part: float) -> Iterator[str]:
    """Yield a sentence about missed data; `part` of their spread is missed on average."""
    off = table["in standard errors"].abs()
    missed = int((off > MISFIT).sum())
    if part > SMALL:
        yield (
            f"the fit misses the data by {part:.0%} of their spread; a record of a steady state "
            "needs transient, or free initial states"
        )
        return
    if not missed:
        yield f"the fit misses the data by {math.sqrt(off.pow(2).mean()):.3g} standard errors each"
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


def _at_border(table: pd.DataFrame, beyond: Floats | float) -> Iterator[str]:
    """Yield a sentence about the sequence of events, if it changes next to the fitted values."""
    if np.isnan(beyond).all():
        return
    table = table.assign(beyond=beyond)
    jump = (table["beyond"] - table["computed"]).abs() > table["standard error"]
    jumps = " and ".join(
        f"{row['quantity']} jumps from {row['computed']:.4g} to {row['beyond']:.4g}"
        for _, row in table[jump & table["t"].isna()].iterrows()
    )
    yield (
        f"the sequence of events changes next to the fitted values{jumps and f', where {jumps}'}; "
        "standard errors neglect it"
    )


def _at_limits(problem: LeastSquares, values: Floats) -> Iterator[str]:
    """Yield a sentence about each quantity next to whose value there is no system."""
    for j, each in enumerate(problem.unknowns):
        for sign in (1.0, -1.0):
            moved = values.copy()
            moved[j] += sign * STEP * problem.scales[j]
            if not each.low <= moved[j] <= each.high:
                continue
            try:
                for i, comparison in enumerate(problem.comparisons):
                    comparison.check(problem.mine(i, moved))
            except InvalidParameter as error:
                yield f"{each.label} is at a limit of the system: {error}"


def _indifferent(table: pd.DataFrame, jacobian: Floats) -> Iterator[str]:
    """Yield a sentence about each quantity on which no free one acts."""
    keys = list(zip(table["record"], table["quantity"], strict=True))
    for key in dict.fromkeys(keys):
        rows = [each == key for each in keys]
        if not np.any(jacobian[rows]):
            yield f"{key[1]} depends on none of the free parameters"


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
        sizes_of_parts = np.round(np.abs(parts) / np.abs(parts).max(), 6)
        order = np.argsort(-sizes_of_parts, kind="stable")
        components = [(float(parts[j]), names[j]) for j in order]
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
