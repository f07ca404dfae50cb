"""Scatter: what tolerances of parameters make of the motions of a system."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from mems_impact.analysis.attractor import STUDY_OPTIONS, Case, Settling
from mems_impact.analysis.state import State, is_number, state_from
from mems_impact.analysis.storing.identity import identity_of_state
from mems_impact.analysis.system import System
from mems_impact.analysis.values import Value
from mems_impact.analysis.verbs import takes_system
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.studies.draws import Draws, Making, distributions, draw
from mems_impact.studies.measuring import Measuring, MotionStudy
from mems_impact.studies.running import run_study
from mems_impact.studies.sampling import Sampling, check_sample
from mems_impact.studies.spread import SAMPLE, Spread
from mems_impact.studies.study import Columns

__all__ = ["Scatter", "ScatterStudy", "scatter"]

Specification = Mapping[str, tuple[float | None, float | None]]


@dataclass(frozen=True, kw_only=True)
class ScatterStudy(MotionStudy):
    """Motions of a system with parameters that are drawn."""

    draws: Draws
    initial: State | None = None

    kind: ClassVar[str] = "scatter"

    @property
    def points(self) -> int:
        """How many points there are."""
        return len(self.draws.values)

    def identity(self) -> Mapping[str, Any]:
        """Return what the numbers depend on."""
        return {
            **self.measuring.identity(),
            **self.draws.identity,
            "initial": identity_of_state(self.initial),
        }

    @property
    def schema(self) -> Mapping[str, str]:
        """The columns of the table."""
        drawn = dict.fromkeys((*self.draws.names, *self.draws.parameters), "float")
        return {**drawn, SAMPLE: "str", **self.measuring.schema}

    @property
    def attrs(self) -> Mapping[str, Any]:
        """Units and captions of the table."""
        told = self.measuring.attrs(tuple(self.schema))
        return {**told, "drawn": list(self.draws.names)}

    def _case(self, number: int) -> Case:
        row = self.draws.settings[number].tolist()
        values = dict(zip(self.draws.parameters, row, strict=True))
        return Case(self.measuring.system.changed(**values), self.initial)

    def _places(self, first: int, last: int) -> Columns:
        draws, block = self.draws, self.points // len(self.draws.blocks)
        made = dict(zip(draws.parameters, draws.settings[first:last].T, strict=True))
        drawn = dict(zip(draws.names, draws.values[first:last].T, strict=True))
        which = [draws.blocks[number // block] for number in range(first, last)]
        return {**made, **drawn, SAMPLE: np.array(which, dtype=object)}


@dataclass(frozen=True, kw_only=True, eq=False)
class Scatter(Spread, Value):
    """What tolerances make of the motions of a system.

    Attributes
    ----------
    system : System
        At its nominal parameters.
    drawn : tuple of str
        What was drawn.
    specification : dict of str to (float, float)
        What a good device does.
    table : DataFrame
        One row a point: what was drawn, the parameters made of it, to which ``sample`` it belongs;
        ``motion``, ``period`` and what is measured, as `operating_map` tells it; and ``status``.
    indices : DataFrame or None
        One row a quantity and a ``parameter`` that was drawn: its index of first order, ``first``
        (the share of the variance that would be gone if it were known), and ``total`` (the share
        that would be left if all others were known), each with the ends of an interval in which
        95 % of resamples lie. They need numbers: of a quantity for which some are ``missing``
        nothing is told. One that does not vary has indices of zero.

    See Also
    --------
    scatter, plot_scatter

    Examples
    --------
    >>> from scipy import stats
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> found = mi.scatter(
    ...     actuator, mi.Sine(amplitude=0.24, omega=0.5), over={"e": stats.norm(0.8, 0.02)},
    ...     specification={"displacement per period": (1e-4, None)}, samples=16,
    ...     initial=mi.kicked(actuator),
    ... )
    >>> found.drawn, len(found.points)
    (('e',), 16)
    """

    system: System = field(repr=False)

    def __repr__(self) -> str:
        told = f"Scatter({', '.join(self.drawn)}: {len(self.points)} points, {self._counted()}"
        if self.specification:
            told += f", yield {self.yields['share'].iloc[-1]:.1%}"
        return told + ")"

    def summary(self) -> dict[str, Any]:
        """Return what was drawn, what motions there are, and the yield."""
        rows = {"system": repr(self.system), "drawn": ", ".join(self.drawn)}
        rows |= {"points": str(len(self.points)), "motions": self._counted()}
        if self.specification:
            last = self.yields.iloc[-1]
            rows["yield"] = f"{last['share']:.1%} ({last['low']:.1%} to {last['high']:.1%})"
        return rows


@takes_system(start="initial")
def scatter(
    system: System,
    *,
    over: Mapping[str, Any],
    parameters: Making | None = None,
    samples: int = 256,
    sampling: Sampling = "sobol",
    seed: int = 0,
    specification: Specification | None = None,
    indices: bool = False,
    initial: State | Mapping[str, float] | None = None,
    settle: Settling = Settling(),  # noqa: B008 - immutable
    options: Options = STUDY_OPTIONS,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int | None = None,
    progress: bool | Callable[[float], None] = False,
) -> Scatter:
    """Tell what tolerances make of a system; ``scatter(actuator, drive, over=…)``.

    Every point is a system with parameters of its own, drawn from their distributions, and is
    followed until it repeats itself, as in `operating_map`.

    Parameters
    ----------
    system : System, or Actuator and Drive
    over : mapping of str to distribution
        Frozen distributions of ``scipy.stats`` by the names of parameters, in the units of the
        system: ``{"e": stats.norm(0.62, 0.02)}``. They are independent of each other. ``"5%"`` is
        the normal distribution about the system's own value with 5 % of it as standard deviation,
        ``"uniform: 5%"`` the uniform one of as much to either side.
    parameters : callable, optional
        What depends on one thing together is made of it here: a function that takes what is drawn
        by name and returns parameters by name. `over` may then have any names, such as that of a
        line width, which stiffness, masses and gap depend on.
    samples : int, optional
        Number of points; a power of two suits Sobol's sequence, and indices need one.
    sampling : {"sobol", "lhs", "random"}, optional
        Sobol's sequence, scrambled; a Latin hypercube; or independent points. Intervals of shares
        are those of independent points: the others, which are spread more evenly, do better.
    seed : int, optional
    specification : mapping of str to (float, float), optional
        Between what a column of the table shall lie: ``{"displacement per period": (1e-5, 2e-5)}``;
        None for no bound.
    indices : bool, optional
        Whether Sobol's indices are told. They take d + 2 times as many points, of d
        distributions.
    initial : State or mapping of str to float, optional
        Where every motion starts; the system's own start by default. Of an actuator, `kicked` shows
        where it walks once it has begun to.
    settle : Settling, optional
        How long motions are given, and when they count as periodic.
    options : Options, optional
        How they are integrated; method "auto" by default.
    store : str or os.PathLike, optional
        A directory in which chunks of points are kept as they are done: a study that is
        interrupted or killed goes on from there.
    executor : concurrent.futures.Executor or callable, optional
        What computes: threads by default; processes, a cluster's, or a function that makes one.
    workers : int, optional
        How many threads. No number depends on it.
    progress : bool or callable, optional

    Returns
    -------
    Scatter

    Raises
    ------
    InvalidParameter
        If an argument is out of range. Parameters that are not allowed, or a run that fails, are a
        row with its reason.
    StudyInterrupted
        On Ctrl-C; its ``table`` holds the points done.

    See Also
    --------
    Scatter, plot_scatter, sensitivity

    Notes
    -----
    Indices are estimated after Saltelli et al. (*Computer Physics Communications* 181, 259, 2010),
    by ``scipy.stats.sobol_indices``; their intervals by 999 resamples of the rows, with `seed`.

    Examples
    --------
    >>> from scipy import stats
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> found = mi.scatter(
    ...     actuator, mi.Sine(amplitude=0.24, omega=0.5),
    ...     over={"e": stats.norm(0.8, 0.02), "mu_d": stats.uniform(0.25, 0.04)},
    ...     specification={"displacement per period": (1e-4, None)}, samples=16,
    ...     initial=mi.kicked(actuator),
    ... )
    >>> steps = found.quantiles([0.1, 0.9]).loc["displacement per period"]
    >>> f"{steps[0.1]:.2e}", f"{steps[0.9]:.2e}"
    ('3.48e-04', '3.88e-04')
    >>> found.yields["share"].tolist()
    [1.0, 1.0]
    """
    given = distributions(over, system)
    count = check_sample(samples, sampling, seed)
    if indices and count & (count - 1):
        nearest = 2 ** round(math.log2(count))
        raise InvalidParameter("samples", samples, f"a power of two for indices, such as {nearest}")
    start = initial
    if start is not None and not isinstance(start, State):
        start = state_from(start)
    if not isinstance(settle, Settling):
        raise InvalidParameter("settle", settle, "a Settling(…)")
    system.instant(start, system.problem(options))
    if parameters is not None and not callable(parameters):
        allowed = "a function that takes what is drawn by name and returns parameters by name"
        raise InvalidParameter("parameters", parameters, allowed)
    draws = draw(
        system,
        given,
        parameters,
        samples=count,
        sampling=sampling,
        seed=int(seed),
        indices=bool(indices),
    )
    study = ScatterStudy(
        draws=draws,
        measuring=Measuring(system=system, settle=settle, options=options),
        initial=start,
    )
    wanted = _specification(specification or {}, study.schema)
    table = run_study(study, store=store, executor=executor, workers=workers, progress=progress)
    found = Scatter(system=system, drawn=draws.names, specification=wanted, table=table)
    if not indices:
        return found
    from mems_impact.studies.indices import indices_table

    names = found.quantities
    told = indices_table(draws, names, table[names].to_numpy(), int(seed))
    told.attrs = dict(table.attrs)
    return Scatter(
        system=system, drawn=draws.names, specification=wanted, table=table, indices=told
    )


def _specification(
    given: Specification, schema: Mapping[str, str]
) -> dict[str, tuple[float, float]]:
    """Return what is specified, without None; InvalidParameter unless it is columns and ends."""
    known = [name for name, kind in schema.items() if kind in ("float", "int")]
    if not isinstance(given, Mapping):
        raise InvalidParameter("specification", given, "columns and what they shall lie between")
    found = {}
    for name, ends in given.items():
        if name not in known:
            raise InvalidParameter("specification", name, f"of columns among {', '.join(known)}")
        field, allowed = f"specification.{name}", "two numbers, low and high, or None for either"
        try:
            low, high = ends
        except (TypeError, ValueError):
            raise InvalidParameter(field, ends, allowed) from None
        low, high = -math.inf if low is None else low, math.inf if high is None else high
        if not all(is_number(end) or abs(end) == math.inf for end in (low, high)) or low > high:
            raise InvalidParameter(field, ends, allowed)
        found[name] = (float(low), float(high))
    return found
