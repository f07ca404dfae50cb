"""Basins of attraction: attractors reached from many states, and their shares."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mems_impact.analysis.attractor import (
    STUDY_OPTIONS,
    Attractor,
    InitialCondition,
    RecurrenceOptions,
)
from mems_impact.analysis.equilibrium import checked_box
from mems_impact.errors import InvalidParameter
from mems_impact.integrators.options import Options
from mems_impact.studies import attractor_matching
from mems_impact.studies.attractor_matching import AttractorMatcher
from mems_impact.studies.attractor_study import AttractorEvaluator, IndependentAttractors
from mems_impact.studies.basin_entropy import (
    BasinEntropy,
    UncertaintyExponent,
    basin_entropy,
    uncertainty_exponent,
)
from mems_impact.studies.engine.scheduler import completed_study, run_study
from mems_impact.studies.engine.study import STATUS, Columns
from mems_impact.studies.sampling import (
    Grid,
    InitialConditions,
    Rng,
    Sample,
    Sampling,
    axis,
    check_sample,
)
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.serialization.identity import identity_of_state
from mems_impact.systems.state import State, is_number
from mems_impact.systems.statistics import FAILED
from mems_impact.tables import merged_columns

if TYPE_CHECKING:
    import pandas as pd

ATTRACTOR = attractor_matching.ATTRACTOR


@dataclass(frozen=True, kw_only=True)
class BasinsStudy(IndependentAttractors):
    """Motions of one system from many states."""

    starts: InitialConditions
    recognition: AttractorMatcher
    initial: State

    kind: ClassVar[str] = "basins"

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.starts.points)

    def identity(self) -> Mapping[str, Any]:
        """Return the inputs on which the results depend."""
        return {
            **self.measuring.identity(),
            **self.starts.identity(),
            "initial": identity_of_state(self.initial),
        }

    @property
    def schema(self) -> Mapping[str, str]:
        """The columns of the table."""
        schema = self.measuring.schema
        status = {STATUS: schema.pop(STATUS)}
        starts = dict.fromkeys(self.starts.names, "float")
        return merged_columns(starts, schema, self.recognition.schema, status)

    @property
    def attrs(self) -> Mapping[str, Any]:
        """Units and captions of the table."""
        return {**super().attrs, "starts": list(self.starts.names)}

    def _case(self, number: int) -> InitialCondition:
        values = self.starts.points[number].tolist()
        start = self.initial.replace(**dict(zip(self.starts.names, values, strict=True)))
        return InitialCondition(self.measuring.system, start)

    def _attractor_columns(self, attractors: Sequence[Attractor]) -> Columns:
        columns = super()._attractor_columns(attractors)
        return {**columns, **self.recognition.columns(attractors)}

    def _identity_columns(self, first: int, last: int) -> Columns:
        return dict(zip(self.starts.names, self.starts.points[first:last].T, strict=True))


@dataclass(frozen=True, kw_only=True, eq=False)
class Basins(Result):
    """Attractors reached from many initial states of one system.

    Attributes
    ----------
    system : System
    starts : Grid or Sample
        The initial states.
    initial : State
        All other components of the initial states.
    table : DataFrame
        One row per point: the varied components of the initial state; ``attractor``, its name;
        ``motion``, ``period`` and the measured quantities, as in `operating_map`; the mean,
        smallest and largest value of each component at the returns (``"v2 mean"``, …), by which
        attractors are recognized; the final state (``"v2 final"``); and ``status``.
    attractors : DataFrame
        One row per attractor, the largest share first: its name, ``motion``, ``period``,
        ``points``, ``share`` of all points with the bounds ``low`` and ``high``; the largest
        Lyapunov exponent if `RecurrenceOptions` asks for exponents, computed once per attractor;
        then the columns of the table for its first point.
    returns : DataFrame
        The states at the returns of each attractor, over one period or the whole simulation.

    See Also
    --------
    basins, continue_attractors, plot_basins

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.2, omega=0.5)
    >>> v2 = np.linspace(-1.2, 1.2, 9)
    >>> found = mi.basins(actuator, drive, x=("x2", [0.0]), y=("v2", v2))
    >>> found.grid().shape, len(found.table)
    ((9, 1), 9)
    >>> found.attractors["share"].sum().item()
    1.0
    """

    system: HybridSystem = field(repr=False)
    starts: Grid | Sample = field(repr=False)
    initial: State = field(repr=False)
    table: pd.DataFrame = field(repr=False)
    attractors: pd.DataFrame = field(repr=False)
    returns: pd.DataFrame = field(repr=False)

    def __repr__(self) -> str:
        names = ", ".join(self.starts.names)
        return f"Basins({names}: {len(self.table)} points, {self._attractor_summary()})"

    def summary(self) -> dict[str, Any]:
        """Return the initial states and the attractors."""
        points = self.starts.points
        ends = zip(self.starts.names, points.min(axis=0), points.max(axis=0), strict=True)
        return {
            "system": repr(self.system),
            **{self.system.units.label(name): f"{low:g} to {high:g}" for name, low, high in ends},
            "points": len(self.table),
            "attractors": self._attractor_summary(),
        }

    def state(self, name: str) -> State:
        """Return a state of an attractor, as initial state for `simulate` and `find_orbit`.

        Parameters
        ----------
        name : str
            Name of the attractor.

        Raises
        ------
        InvalidParameter
            If there is no such attractor.
        """
        names = self.attractors[ATTRACTOR]
        if name not in set(names):
            raise InvalidParameter("name", name, f"one of {', '.join(names)}")
        return attractor_matching.state_of(self.system, self.attractors[names == name].iloc[0])

    def grid(self, column: str = ATTRACTOR) -> NDArray[Any]:
        """Return a column of the table as an array.

        Parameters
        ----------
        column : str, optional

        Returns
        -------
        array, shape (values of y, values of x)
            Without y, the number of values of x.

        Raises
        ------
        InvalidParameter
            If the table has no such column, or the initial states are a sample.
        """
        if not isinstance(self.starts, Grid):
            problem = "the starts are a sample, not a grid: see table"
            raise InvalidParameter("column", column, "", problem=problem)
        if column not in self.table:
            raise InvalidParameter("column", column, f"one of {', '.join(self.table.columns)}")
        return np.asarray(self.table[column].to_numpy()).reshape(self.starts.shape)

    def entropy(self, box: int = 5) -> BasinEntropy:
        """Compute basin entropy and boundary basin entropy of a grid.

        The grid is divided into boxes; incomplete boxes at its upper ends are omitted. The entropy
        of a box is the entropy of the shares of the attractors among its points, without failed
        points.

        Parameters
        ----------
        box : int, optional
            Points along a side of a box, >= 2.

        Returns
        -------
        BasinEntropy
            ``basin`` (Sb) is the mean over all boxes, ``boundary`` (Sbb) the mean over the boxes
            with at least two attractors: above log 2 the boundary is fractal.

        Raises
        ------
        InvalidParameter
            If `box` is out of range, or the initial states are a sample.

        Notes
        -----
        Daza et al., *Scientific Reports* 6, 31416 (2016). Compare entropies at one size of boxes.

        Examples
        --------
        >>> import numpy as np
        >>> import mems_impact as mi
        >>> def double_well(mode, t, y, p):
        ...     return y.v, y.x - y.x**3 - 0.5 * y.v
        >>> system = mi.System(states=("x", "v"), flow=double_well)
        >>> points = np.linspace(-2.05, 2.0, 10)
        >>> entropy = mi.basins(system, x=("x", points), y=("v", points)).entropy()
        >>> entropy.boxes, bool(0.0 < entropy.basin < np.log(2.0))
        (4, True)
        """
        return basin_entropy(self.grid(), box)

    def uncertainty_exponent(self, largest: int | None = None) -> UncertaintyExponent:
        """Estimate the uncertainty exponent of a grid.

        A point is uncertain at a distance if a point within this distance along the axes reaches
        another attractor. The fraction of uncertain points, as long as it is far below 1, grows as
        the distance to the power of the exponent.

        Parameters
        ----------
        largest : int, optional
            Largest distance in grid steps; a tenth of the shortest axis by default.

        Returns
        -------
        UncertaintyExponent
            ``exponent`` is 1 for a smooth boundary and smaller for a fractal boundary, whose
            dimension is the dimension of the grid minus the exponent; ``error`` is the variation of
            the exponent between halves of the range of distances.

        Raises
        ------
        InvalidParameter
            If the grid has fewer than 10 points along an axis, `largest` is out of range, or the
            initial states are a sample.

        Notes
        -----
        Grebogi, McDonald, Ott and Yorke, *Physics Letters A* 99, 415 (1983).

        Examples
        --------
        >>> import numpy as np
        >>> import mems_impact as mi
        >>> def double_well(mode, t, y, p):
        ...     return y.v, y.x - y.x**3 - 0.5 * y.v
        >>> system = mi.System(states=("x", "v"), flow=double_well)
        >>> points = np.linspace(-0.45, 0.5, 40)
        >>> found = mi.basins(system, x=("x", points), y=("v", points)).uncertainty_exponent()
        >>> abs(found.exponent - 1.0) < 0.05
        True
        """
        return uncertainty_exponent(self.grid(), largest)

    def _attractor_summary(self) -> str:
        attractors = self.attractors
        shares = [
            f"{name} {share:.1%}"
            for name, share in zip(attractors[ATTRACTOR], attractors["share"], strict=True)
        ]
        failed = int((self.table[ATTRACTOR] == FAILED).sum())
        return ", ".join([*shares, *([f"{failed} failed"] if failed else [])])


@takes_system(start="initial")
def basins(
    system: HybridSystem,
    *,
    x: tuple[str, ArrayLike] | None = None,
    y: tuple[str, ArrayLike] | None = None,
    box: Mapping[str, tuple[float, float]] | None = None,
    samples: int = 1000,
    sampling: Sampling = "random",
    rng: Rng = 0,
    initial: State | Mapping[str, float] | None = None,
    recurrence: RecurrenceOptions = RecurrenceOptions(),  # noqa: B008 - immutable
    distance: float = 1e-3,
    options: Options = STUDY_OPTIONS,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int | None = None,
    progress: bool | Callable[[float], None] = False,
) -> Basins:
    """Compute basins of attraction; ``basins(actuator, drive, …)``.

    The initial states are a grid over one or two components, or a sample of a box in any number of
    components. Motions with the same attractor agree in kind and period and return to the same
    states. Two aperiodic motions cannot be identified with certainty; they count as one attractor
    if the boxes around their returns intersect.

    Parameters
    ----------
    system : System, or Actuator and Drive
    x, y : tuple of str and array_like
        Component of the state and its values, in the units of the system: ``("v2", values)``; x or
        y alone is enough.
    box : mapping of str to (float, float), optional
        Instead of x and y, bounds of components of the state, between which states are sampled.
    samples : int, optional
        Number of states sampled from the box.
    sampling : {"random", "sobol", "lhs"}, optional
        Independent states, a Sobol sequence, or a Latin hypercube. The last two fill the box more
        evenly, so that the bounds of shares are conservative.
    rng : int, Generator, SeedSequence or None, optional
        Seed or generator of the sample, as for `numpy.random.default_rng`. The study keeps a seed.
    initial : State or mapping of str to float, optional
        All other components; by default the initial state of the system.
    recurrence : RecurrenceOptions, optional
        Length of the transient, and criteria for a periodic motion.
    distance : float, optional
        Distance within which two motions share an attractor, relative to the size of each
        component: far above the tolerance to which motions settle, far below the distances between
        attractors.
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
    Basins

    Raises
    ------
    InvalidParameter
        If an argument is out of range. A run that fails is a row with its reason.
    Interrupted
        On Ctrl-C; ``partial`` is the table of the finished points.

    See Also
    --------
    Basins, continue_attractors, plot_basins, operating_map

    Notes
    -----
    A periodic motion that at most 1 % of the points reach counts as an attractor only if motions
    from perturbed states return to it, since a point may lie on the stable manifold of a saddle.

    Shares are of all points, failed points included. The bounds of a sample are the interval of
    Wilson (*J. American Statistical Association* 22, 209, 1927), in which the share of the box lies
    with a probability of 95 %. The bounds of a grid are the share of the points whose neighbours
    all reach the same attractor, and the share of these points and their neighbours. The share of
    the basin lies between these bounds as far as the grid resolves the basin; at fractal boundaries
    the bounds are far apart.

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.2, omega=0.5)
    >>> v2 = np.linspace(-1.2, 1.2, 9)
    >>> found = mi.basins(actuator, drive, x=("x2", [0.0]), y=("v2", v2))
    >>> sorted(found.attractors["attractor"])
    ['off', 'period 1']
    >>> mi.find_orbit(found.system, guess=found.state("period 1")).stable
    True
    """
    starts = _starts(system, x, y, box, (samples, sampling, rng))
    measuring = AttractorEvaluator(system=system, recurrence=recurrence, options=options)
    if not (is_number(distance) and 0.0 < distance < 1.0):
        raise InvalidParameter("distance", distance, "a number above 0 and below 1")
    start = measuring.start(initial) or system.initial
    study = BasinsStudy(
        starts=starts,
        measuring=measuring.without_exponents,
        recognition=AttractorMatcher(system=system, options=options, distance=distance),
        initial=start,
    )
    table = run_study(study, store=store, executor=executor, workers=workers, progress=progress)
    with completed_study(study, table):
        labels = attractor_matching.match_attractors(
            table, starts.names, study.recognition, study.measuring
        )
        motions = attractor_matching.continued_motions(
            attractor_matching.representatives(table, labels), measuring
        )
        table, attractors = attractor_matching.label_points(
            table, labels, motions, starts, recurrence.longest
        )
        return Basins(
            system=system,
            starts=starts,
            initial=start,
            table=table,
            attractors=attractors,
            returns=attractor_matching.returns(attractors, motions, system),
        )


def _starts(system: HybridSystem, x: Any, y: Any, box: Any, sample: tuple[Any, Any, Any]) -> Any:
    """Return the initial states from the arguments."""
    if box is not None:
        if x is not None or y is not None:
            problem = "give a grid (x, y) or a box to sample, not both"
            raise InvalidParameter("box", None, "", problem=problem)
        count, seed = check_sample(*sample)
        bounds = checked_box(system, box)
        if not bounds:
            raise InvalidParameter("box", box, f"given for some of {', '.join(system.states)}")
        return Sample(tuple((n, *ends) for n, ends in bounds.items()), count, sample[1], seed)
    if x is None and y is None:
        problem = "give a grid (x, y), or a box to sample"
        raise InvalidParameter("x", None, "", problem=problem)
    first = axis("x" if x is not None else "y", x if x is not None else y, system.states, system)
    if x is None or y is None:
        return Grid(first)
    second = axis("y", y, system.states, system)
    if second.name == first.name:
        raise InvalidParameter("y", second.name, "another component than x")
    return Grid(first, second)
