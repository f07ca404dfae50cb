"""Operating maps: attractors on a grid of two parameters."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mems_impact.analysis.attractor import STUDY_OPTIONS, InitialCondition, RecurrenceOptions
from mems_impact.errors import FunctionError, InvalidParameter
from mems_impact.integrators.options import Options
from mems_impact.studies.attractor_study import (
    AttractorEvaluator,
    IndependentAttractors,
    counted_motions,
    map_summary,
)
from mems_impact.studies.engine.scheduler import run_study
from mems_impact.studies.engine.study import Columns
from mems_impact.studies.sampling import Axis, axis, check_different, identity_of_axis
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.serialization.identity import identity_of_state
from mems_impact.systems.state import State
from mems_impact.tables import merged_columns

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True)
class MapStudy(IndependentAttractors):
    """The points of an operating map; x varies fastest."""

    x: Axis
    y: Axis
    initial: State | None = None

    kind: ClassVar[str] = "operating_map"

    @property
    def points(self) -> int:
        """Number of points."""
        return len(self.x.values) * len(self.y.values)

    def identity(self) -> Mapping[str, Any]:
        """Return the inputs on which the results depend."""
        # The system's own values of the two parameters have no effect.
        try:
            system = self._system(0)
        except (InvalidParameter, FunctionError):
            system = self.measuring.system
        return {
            **replace(self.measuring, system=system).identity(),
            "x": identity_of_axis(self.x),
            "y": identity_of_axis(self.y),
            "initial": identity_of_state(self.initial),
        }

    @property
    def schema(self) -> Mapping[str, str]:
        """The columns of the table."""
        return merged_columns({self.x.name: "float", self.y.name: "float"}, self.measuring.schema)

    @property
    def attrs(self) -> Mapping[str, Any]:
        """Units and captions of the table."""
        return {**super().attrs, "x": self.x.name, "y": self.y.name}

    def _case(self, number: int) -> InitialCondition:
        return InitialCondition(self._system(number), self.initial)

    def _identity_columns(self, first: int, last: int) -> Columns:
        numbers = np.arange(first, last)
        count = len(self.x.values)
        return {
            self.x.name: np.array(self.x.values)[numbers % count],
            self.y.name: np.array(self.y.values)[numbers // count],
        }

    def _system(self, number: int) -> HybridSystem:
        row, column = divmod(number, len(self.x.values))
        values = {self.x.name: self.x.values[column], self.y.name: self.y.values[row]}
        return self.measuring.system.changed(**values)


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingMap(Result):
    """Attractors on a grid of two parameters.

    Attributes
    ----------
    system : System
        At its own values of both parameters.
    x, y : Axis
        Name and values of each parameter.
    table : DataFrame
        One row per point, the values of x first: the two parameters; ``motion`` ("periodic", "off",
        "resting", "chaotic", "quasi-periodic", "unsettled", "failed"), ``period`` (in forcing
        periods, 0 if aperiodic), the measured quantities, ``returns`` (number of simulated
        returns), and ``status``.

    See Also
    --------
    operating_map, plot_map

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> found = mi.operating_map(
    ...     actuator, mi.Sine(amplitude=0.24, omega=0.5),
    ...     x=("amplitude", [0.2, 0.24]), y=("omega", [0.49, 0.5]),
    ...     initial=mi.kicked_state(actuator),
    ... )
    >>> found.table["motion"].tolist()
    ['periodic', 'periodic', 'off', 'periodic']
    >>> found.motions[["motion", "points"]].values.tolist()
    [['off', 1], ['period 1', 3]]
    >>> found.grid("impacts per period").round(6).tolist()
    [[1.0, 1.0], [0.0, 1.0]]
    """

    system: HybridSystem = field(repr=False)
    x: Axis = field(repr=False)
    y: Axis = field(repr=False)
    table: pd.DataFrame = field(repr=False)

    def __repr__(self) -> str:
        size = f"{len(self.x.values)} x {len(self.y.values)}"
        counted = counted_motions(self.table)
        return f"OperatingMap({self.x.name}, {self.y.name}: {size} points, {counted})"

    def summary(self) -> dict[str, Any]:
        """Return the varied parameters and the kinds of motions."""
        rows = {"system": repr(self.system)}
        for each in (self.x, self.y):
            low, high = min(each.values), max(each.values)
            rows[self.system.units.label(each.name)] = (
                f"{low:g} to {high:g}, {len(each.values)} values"
            )
        return {**rows, "motions": counted_motions(self.table)}

    @property
    def motions(self) -> pd.DataFrame:
        """One row for each kind of motion: number and range of its points.

        Motion ("off", "period 1", "chaotic", …), the number of points, their share, and the
        smallest and largest value of each parameter among them. Points of several kinds may lie
        between these values.
        """
        return map_summary(self.table)

    def grid(self, column: str) -> NDArray[Any]:
        """Return a column of the table as an array.

        Parameters
        ----------
        column : str

        Returns
        -------
        array, shape (values of y, values of x)

        Raises
        ------
        InvalidParameter
            If the table has no such column.
        """
        if column not in self.table:
            raise InvalidParameter("column", column, f"one of {', '.join(self.table.columns)}")
        values = self.table[column].to_numpy()
        return np.asarray(values).reshape(len(self.y.values), len(self.x.values))


@takes_system(start="initial")
def operating_map(
    system: HybridSystem,
    *,
    x: tuple[str, ArrayLike],
    y: tuple[str, ArrayLike],
    initial: State | Mapping[str, float] | None = None,
    recurrence: RecurrenceOptions = RecurrenceOptions(),  # noqa: B008 - immutable
    options: Options = STUDY_OPTIONS,
    store: str | os.PathLike[str] | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    workers: int | None = None,
    progress: bool | Callable[[float], None] = False,
) -> OperatingMap:
    """Compute the attractor at each point of a grid; ``operating_map(actuator, drive, …)``.

    The grid is over two parameters. Every point starts from the initial state and is simulated
    until the motion is periodic, so that a periodic motion takes few periods. Points of one
    automaton run together in compiled code.

    Parameters
    ----------
    system : System, or Actuator and Drive
    x, y : tuple of str and array_like
        Parameter and its values, in the units of the system: ``("amplitude", values)``.
    initial : State or mapping of str to float, optional
        Initial state of every point; by default the initial state of the system. The initial state
        decides between several attractors: for an actuator, `kicked_state` finds the attractor
        with impacts.
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
    OperatingMap

    Raises
    ------
    InvalidParameter
        If an argument is out of range. A value that is not allowed, or a run that fails, is a row
        with its reason.
    Interrupted
        On Ctrl-C; ``partial`` is the table of the finished points.

    See Also
    --------
    OperatingMap, plot_map, basins

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> found = mi.operating_map(
    ...     actuator, drive,
    ...     x=("amplitude", np.linspace(0.2, 0.26, 4)), y=("omega", [0.49, 0.5]),
    ...     initial=mi.kicked_state(actuator),
    ... )
    >>> found.grid("displacement per period").shape
    (2, 4)
    """
    names = tuple(system.parameters)
    across, up = axis("x", x, names, system), axis("y", y, names, system)
    check_different(across, up, system)
    measuring = AttractorEvaluator(system=system, recurrence=recurrence, options=options)
    study = MapStudy(x=across, y=up, measuring=measuring, initial=measuring.start(initial))
    table = run_study(study, store=store, executor=executor, workers=workers, progress=progress)
    return OperatingMap(system=system, x=across, y=up, table=table)
