"""Tolerance analysis: Monte Carlo statistics, Sobol indices, yield."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from mems_impact._util.arrays import Floats
from mems_impact.analysis.attractor import STUDY_OPTIONS, InitialCondition, RecurrenceOptions
from mems_impact.errors import InvalidParameter
from mems_impact.integrators.options import Options
from mems_impact.studies.attractor_study import (
    MOTION,
    AttractorEvaluator,
    IndependentAttractors,
    counted_motions,
)
from mems_impact.studies.engine.scheduler import completed_study, run_study
from mems_impact.studies.engine.study import OK, STATUS, Columns
from mems_impact.studies.sampling import (
    FIRST,
    LEVEL,
    SECOND,
    Making,
    ParameterSample,
    Rng,
    Sampling,
    check_sample,
    distributions,
    draw,
    matrices,
    wilson,
)
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.serialization.identity import identity_of_state
from mems_impact.systems.state import State, interval
from mems_impact.systems.statistics import UNSETTLED
from mems_impact.tables import merged_columns

# --- Sobol' indices

RESAMPLES = 999
MIN_SPREAD = 1e-9  # relative spread below which a quantity is constant


def indices_table(
    draws: ParameterSample, quantities: Sequence[str], values: Floats, seed: int
) -> pd.DataFrame:
    """Return first-order and total indices, each with an interval.

    The table is described in `mems_impact.tolerance_analysis`. The draws include the samples for
    indices; `values` has the shape (points, quantities), `seed` is that of the bootstrap.
    """
    missing = np.isnan(values).sum(axis=0)
    complete = missing == 0
    spread = np.ptp(values, axis=0)
    varies = complete & (spread > MIN_SPREAD * np.abs(values).max(axis=0))
    shape = (len(quantities), len(draws.names))
    indices = np.full((6, *shape), np.nan)  # first-order and total, each with interval bounds
    indices[:, complete] = 0.0
    if varies.any():
        indices[:, varies] = _estimated(matrices(draws, values[:, varies]), seed)
    columns = ("first", "first low", "first high", "total", "total low", "total high")
    return pd.DataFrame(
        {
            "quantity": np.repeat(np.array(quantities, dtype=object), shape[1]),
            "parameter": np.tile(np.array(draws.names, dtype=object), shape[0]),
            **{name: part.ravel() for name, part in zip(columns, indices, strict=True)},
            "missing": np.repeat(missing, shape[1]),
        }
    )


def _estimated(samples: tuple[Floats, Floats, Floats], seed: int) -> Floats:
    """Return indices and bounds of their intervals, by resampling rows."""
    n = samples[0].shape[1]
    rows = np.random.default_rng(seed).integers(n, size=(RESAMPLES, n))
    resampled = np.array([_indices([part[..., chosen] for part in samples]) for chosen in rows])
    outside = (1.0 - LEVEL) / 2.0
    low, high = np.quantile(resampled, [outside, 1.0 - outside], axis=0)
    first, total = _indices(samples)
    return np.stack([first, low[0], high[0], total, low[1], high[1]])


def _indices(samples: Sequence[Floats]) -> Floats:
    """Return first-order and total indices, shape (2, quantities, drawn)."""
    first, second, between = samples
    from scipy.stats import sobol_indices  # imported on first use, since it is slow

    indices = sobol_indices(func={"f_A": first, "f_B": second, "f_AB": between}, n=first.shape[1])
    shape = (len(first), len(between))
    return np.stack([indices.first_order.reshape(shape), indices.total_order.reshape(shape)])


# --- Spread of quantities, and yield


def settled_values(table: pd.DataFrame, columns: Any) -> Any:
    """Return columns of a table, NaN for motions whose limit is unknown."""
    return table[columns].where(table[MOTION] != UNSETTLED)


SAMPLE = "sample"  # column with the sample of a row, if indices are computed
ALL = "all"  # name of the last row of yields


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """Points with sampled parameters: those of a tolerance analysis, or the finished ones."""

    drawn: tuple[str, ...]  # names of the sampled quantities
    table: pd.DataFrame = field(repr=False)
    specification: dict[str, tuple[float, float]] = field(repr=False, default_factory=dict)
    indices: pd.DataFrame | None = field(repr=False, default=None)

    @property
    def points(self) -> pd.DataFrame:
        """The independent samples: all rows except the rows for indices only."""
        return self.table[self.table[SAMPLE].isin(["", FIRST, SECOND])]

    @property
    def quantities(self) -> list[str]:
        """The columns of measured quantities."""
        begin = list(self.table.columns).index(MOTION)
        numbers = self.table.iloc[:, begin:].select_dtypes("float").columns
        return [str(name) for name in numbers]

    @property
    def yields(self) -> pd.DataFrame:
        """Number of points within the specification.

        One row per quantity: ``from`` and ``to``, the number of ``points`` and their ``share`` with
        Wilson's interval (95 %), ``low`` and ``high``. The last row counts the points that meet all
        bounds. A point that failed, has not settled or has no value does not meet the
        specification.
        """
        points, rows = self.points, []
        good = (points[STATUS] == OK).to_numpy()
        for name, (low, high) in self.specification.items():
            fine = settled_values(points, name).between(low, high).to_numpy()
            good = good & fine
            rows.append((name, low, high, fine))
        rows.append((ALL, math.nan, math.nan, good))
        entries = []
        for name, low, high, fine in rows:
            count = int(fine.sum())
            entries.append((name, low, high, count, count / len(fine), *wilson(count, len(fine))))
        headings = ["quantity", "from", "to", "points", "share", "low", "high"]
        return pd.DataFrame(entries, columns=headings)

    def quantiles(self, q: Sequence[float] = (0.05, 0.5, 0.95)) -> pd.DataFrame:
        """Return quantiles of the measured quantities, over the settled points with a value.

        Parameters
        ----------
        q : sequence of float, optional
            Between 0 and 1.

        Returns
        -------
        DataFrame
            One row per quantity, one column per quantile, and the number of ``points``.
        """
        values = np.atleast_1d(np.asarray(q, dtype=float))
        if not ((values >= 0.0) & (values <= 1.0)).all():
            raise InvalidParameter("q", q, "between 0 and 1")
        points = settled_values(self.points, self.quantities)
        table = points.quantile(values.tolist()).T
        table["points"] = points.notna().sum()
        return table


# --- Tolerance analysis

Specification = Mapping[str, tuple[float | None, float | None]]


@dataclass(frozen=True, kw_only=True)
class ToleranceStudy(IndependentAttractors):
    """Motions of a system with sampled parameters."""

    draws: ParameterSample
    initial: State | None = None

    kind: ClassVar[str] = "tolerances"

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.draws.values)

    def identity(self) -> Mapping[str, Any]:
        """Return the inputs on which the results depend."""
        return {
            **self.measuring.identity(),
            **self.draws.identity,
            "initial": identity_of_state(self.initial),
        }

    @property
    def schema(self) -> Mapping[str, str]:
        """The columns of the table."""
        columns = dict.fromkeys((*self.draws.names, *self.draws.parameters), "float")
        return merged_columns(columns, {SAMPLE: "str"}, self.measuring.schema)

    @property
    def attrs(self) -> Mapping[str, Any]:
        """Units and captions of the table."""
        return {**super().attrs, "drawn": list(self.draws.names)}

    def _case(self, number: int) -> InitialCondition:
        row = self.draws.parameter_values[number].tolist()
        values = dict(zip(self.draws.parameters, row, strict=True))
        return InitialCondition(self.measuring.system.changed(**values), self.initial)

    def _identity_columns(self, first: int, last: int) -> Columns:
        draws, block = self.draws, self.points // len(self.draws.blocks)
        parameters = dict(zip(draws.parameters, draws.parameter_values[first:last].T, strict=True))
        quantities = dict(zip(draws.names, draws.values[first:last].T, strict=True))
        labels = [draws.blocks[number // block] for number in range(first, last)]
        return {**parameters, **quantities, SAMPLE: np.array(labels, dtype=object)}


@dataclass(frozen=True, kw_only=True, eq=False)
class ToleranceAnalysis(Spread, Result):
    """Propagation of tolerances to the attractors of a system.

    Attributes
    ----------
    system : System
        The system at its nominal parameters.
    drawn : tuple of str
        Names of the sampled quantities.
    specification : dict of str to (float, float)
        Bounds of the columns of a good device.
    table : DataFrame
        One row per point: the sampled quantities, the parameters computed from them, the number
        ``sample``; ``motion``, ``period`` and the measured quantities, as in `operating_map`; and
        ``status``.
    indices : DataFrame or None
        One row per quantity and sampled ``parameter``: the first-order index ``first`` (the share
        of the variance that vanishes if the parameter is known) and the ``total`` index (the share
        that remains if all others are known), each with the interval that contains 95 % of the
        bootstrap resamples. A quantity with ``missing`` values has no indices; a constant quantity
        has indices of zero.

    See Also
    --------
    tolerance_analysis, plot_tolerance_analysis

    Examples
    --------
    >>> from scipy import stats
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> found = mi.tolerance_analysis(
    ...     actuator, mi.Sine(amplitude=0.24, omega=0.5), over={"e": stats.norm(0.8, 0.02)},
    ...     specification={"displacement per period": (1e-4, None)}, samples=16,
    ...     initial=mi.kicked_state(actuator),
    ... )
    >>> found.drawn, len(found.points)
    (('e',), 16)
    """

    system: HybridSystem = field(repr=False)

    def __repr__(self) -> str:
        names, counted = ", ".join(self.drawn), counted_motions(self.points)
        text = f"ToleranceAnalysis({names}: {len(self.points)} points, {counted}"
        if self.specification:
            text += f", yield {self._yield()}"
        return text + ")"

    def summary(self) -> dict[str, Any]:
        """Return the sampled quantities, the kinds of motions and the yield."""
        rows = {"system": repr(self.system), "drawn": ", ".join(self.drawn)}
        rows |= {"points": str(len(self.points)), "motions": counted_motions(self.points)}
        if self.specification:
            rows["yield"] = self._yield()
        return rows

    def _yield(self) -> str:
        last = self.yields.iloc[-1]
        return f"{last['share']:.1%} ({last['low']:.1%} to {last['high']:.1%})"


@takes_system(start="initial")
def tolerance_analysis(
    system: HybridSystem,
    *,
    over: Mapping[str, Any],
    parameters: Making | None = None,
    samples: int = 256,
    sampling: Sampling = "sobol",
    rng: Rng = 0,
    specification: Specification | None = None,
    indices: bool = False,
    initial: State | Mapping[str, float] | None = None,
    recurrence: RecurrenceOptions = RecurrenceOptions(),  # noqa: B008 - immutable
    options: Options = STUDY_OPTIONS,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int | None = None,
    progress: bool | Callable[[float], None] = False,
) -> ToleranceAnalysis:
    """Propagate manufacturing tolerances; ``tolerance_analysis(actuator, drive, over=…)``.

    Every point is a system with parameters sampled from their distributions, and is simulated until
    its motion is periodic, as in `operating_map`.

    Parameters
    ----------
    system : System, or Actuator and Drive
    over : mapping of str to distribution
        Independent distributions of parameters. They are frozen distributions of ``scipy.stats``,
        in the units of the system: ``{"e": stats.norm(0.62, 0.02)}``. ``"5%"`` is the normal
        distribution about the system's own value with a standard deviation of 5 % of the value,
        ``"uniform: 5%"`` the uniform distribution within plus or minus 5 %. Both may have a unit in
        place of the per cent: ``"0.1 um"``.
    parameters : callable, optional
        Function that computes parameters by name from the sampled quantities by name, for
        correlated parameters. `over` may then have any names, such as a line width on which
        stiffness, masses and gap depend.
    samples : int, optional
        Number of points; a power of two suits Sobol's sequence, and is required for indices.
    sampling : {"sobol", "lhs", "random"}, optional
        Scrambled Sobol sequence, Latin hypercube, or independent points. Confidence intervals of
        shares are for independent points, and conservative for Sobol and Latin hypercube samples.
    rng : int, Generator, SeedSequence or None, optional
        Seed or generator of the sample, as for `numpy.random.default_rng`. The study keeps a seed.
    specification : mapping of str to (float, float), optional
        Bounds of columns of the table; one bound may be missing: ``{"displacement per period":
        (1e-5, None)}``.
    indices : bool, optional
        Whether to compute Sobol indices, which take d + 2 times as many points for d distributions.
    initial : State or mapping of str to float, optional
        Initial state of every motion; by default the initial state of the system. For an actuator,
        `kicked_state` finds the attractor with impacts.
    recurrence : RecurrenceOptions, optional
        Length of the transient, and criteria for a periodic motion.
    options : Options, optional
        Options of integration; method "auto" by default.
    store : str or os.PathLike, optional
        Directory in which finished chunks of points are stored; an interrupted or killed study
        resumes from it.
    executor : concurrent.futures.Executor or callable, optional
        Threads by default, or processes. A cluster's executor, or a function that creates one.
    workers : int, optional
        Number of threads or processes; by default the number of cores. Results do not depend on it.
    progress : bool or callable, optional

    Returns
    -------
    ToleranceAnalysis

    Raises
    ------
    InvalidParameter
        If an argument is out of range. Parameters that are not allowed, or a run that fails, are a
        row with its reason.
    Interrupted
        On Ctrl-C; ``partial`` is the table of the finished points.

    See Also
    --------
    ToleranceAnalysis, plot_tolerance_analysis, sensitivity

    Notes
    -----
    Indices are estimated after Saltelli et al. (*Computer Physics Communications* 181, 259, 2010),
    by ``scipy.stats.sobol_indices``; their intervals by 999 resamples of the rows, with `rng`.

    Examples
    --------
    >>> from scipy import stats
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> found = mi.tolerance_analysis(
    ...     actuator, mi.Sine(amplitude=0.24, omega=0.5),
    ...     over={"e": stats.norm(0.8, 0.02), "mu_d": stats.uniform(0.25, 0.04)},
    ...     specification={"displacement per period": (1e-4, None)}, samples=16,
    ...     initial=mi.kicked_state(actuator),
    ... )
    >>> steps = found.quantiles([0.1, 0.9]).loc["displacement per period"]
    >>> f"{steps[0.1]:.2e}", f"{steps[0.9]:.2e}"
    ('3.48e-04', '3.88e-04')
    >>> found.yields["share"].tolist()
    [1.0, 1.0]
    """
    sampled = distributions(over, system)
    count, seed = check_sample(samples, sampling, rng)
    if indices and count & (count - 1):
        nearest = 2 ** round(math.log2(count))
        raise InvalidParameter("samples", samples, f"a power of two for indices, such as {nearest}")
    measuring = AttractorEvaluator(system=system, recurrence=recurrence, options=options)
    start = measuring.start(initial)
    if parameters is not None and not callable(parameters):
        allowed = "a function of the sampled quantities by name that returns parameters by name"
        raise InvalidParameter("parameters", parameters, allowed)
    draws = draw(
        system,
        sampled,
        parameters,
        samples=count,
        sampling=sampling,
        seed=seed,
        indices=bool(indices),
    )
    study = ToleranceStudy(draws=draws, measuring=measuring, initial=start)
    bounds = _specification(specification or {}, study.schema, system)
    table = run_study(study, store=store, executor=executor, workers=workers, progress=progress)
    analysis = ToleranceAnalysis(
        system=system, drawn=draws.names, specification=bounds, table=table
    )
    if not indices:
        return analysis
    names = analysis.quantities
    with completed_study(study, table):
        effects = indices_table(draws, names, settled_values(table, names).to_numpy(), seed)
    effects.attrs = dict(table.attrs)
    return replace(analysis, indices=effects)


def _specification(
    specification: Specification, schema: Mapping[str, str], system: HybridSystem
) -> dict[str, tuple[float, float]]:
    """Return the specification without None; InvalidParameter unless it has columns and bounds."""
    names = [name for name, kind in schema.items() if kind in ("float", "int")]
    if not isinstance(specification, Mapping):
        raise InvalidParameter("specification", specification, "columns with their bounds")
    bounds = {}
    for name, ends in specification.items():
        if name not in names:
            raise InvalidParameter("specification", name, f"one of the columns {', '.join(names)}")
        label = f"specification.{name}"
        numbers = system.units.parse(name, ends, label)
        bounds[name] = interval(label, ends, numbers, bounded=False, point=True)
    return bounds
