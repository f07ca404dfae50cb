"""What Ctrl-C raises: each kind of long work says how far it came, and holds what was done."""

from __future__ import annotations

from mems_impact.errors import Picklable

__all__ = [
    "ChartInterrupted",
    "Interrupted",
    "OptimizationInterrupted",
    "RunInterrupted",
    "StudyInterrupted",
    "SweepInterrupted",
]


class Interrupted(Picklable, KeyboardInterrupt):
    """Work was interrupted (Ctrl-C); what was done is kept.

    Attributes
    ----------
    after : str
        How far it had come, worded to follow "after".

    See Also
    --------
    RunInterrupted, StudyInterrupted, MemsImpactError

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     run = mi.simulate(actuator, drive, periods=300)
    ... except mi.Interrupted as stopped:
    ...     print(f"stopped after {stopped.after}")
    >>> issubclass(mi.Interrupted, KeyboardInterrupt)
    True
    """

    after: str


class RunInterrupted(Interrupted):
    """A run was interrupted (Ctrl-C); what was done is kept.

    Parameters
    ----------
    trajectory : object
        What was computed up to the interruption.
    periods : float
        Periods that were done.

    See Also
    --------
    Interrupted, simulate, RunError

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     trajectory = mi.simulate(actuator, drive, periods=300).trajectory
    ... except mi.RunInterrupted as stopped:
    ...     trajectory = stopped.trajectory
    >>> len(trajectory.events) > 0
    True
    """

    def __init__(self, trajectory: object, periods: float) -> None:
        self.trajectory = trajectory
        self.periods = periods
        self.after = f"{periods:g} periods"
        super().__init__(f"run interrupted after {self.after}; they are in .trajectory")


class SweepInterrupted(Interrupted):
    """A sweep was interrupted (Ctrl-C); what was done is kept.

    Parameters
    ----------
    table : object
        The table of the values that were done.
    done, total : int
        Number of values that were done, and of all.

    See Also
    --------
    Interrupted, sweep, StudyInterrupted

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     table = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=50, periods=5)
    ... except mi.SweepInterrupted as stopped:
    ...     table = stopped.table
    >>> len(table) > 0
    True
    """

    def __init__(self, table: object, done: int, total: int) -> None:
        self.table = table
        self.done = done
        self.total = total
        self.after = f"{done} of {total} values"
        super().__init__(f"sweep interrupted after {self.after}; they are in .table")


class StudyInterrupted(Interrupted):
    """A study was interrupted (Ctrl-C); what was done is kept.

    Parameters
    ----------
    table : object
        The table of the chunks that were done.
    done, total : int
        Number of points that were done, and of all.

    See Also
    --------
    Interrupted, operating_map, read_study

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     found = mi.operating_map(actuator, drive, x=("amplitude", [0.2]), y=("omega", [0.5]))
    ...     table = found.table
    ... except mi.StudyInterrupted as stopped:
    ...     table = stopped.table
    >>> len(table)
    1
    """

    def __init__(self, table: object, done: int, total: int) -> None:
        self.table = table
        self.done = done
        self.total = total
        self.after = f"{done} of {total} points"
        super().__init__(f"study interrupted after {self.after}; they are in .table")


class ChartInterrupted(Interrupted):
    """A chart was interrupted (Ctrl-C); what was done is kept.

    Parameters
    ----------
    chart : object
        The chart with the boundaries that were done, and what there is of the next one.
    done, total : int
        Number of boundaries that were done, and of all; the latter is 0 as long as the types of
        the range, and so their number, were not known.

    See Also
    --------
    Interrupted, operating_chart, Chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     chart = mi.operating_chart(actuator, drive, omega=(0.478, 0.495), crises=0)
    ... except mi.ChartInterrupted as stopped:
    ...     chart = stopped.chart
    >>> len(chart.table) > 0
    True
    """

    def __init__(self, chart: object, done: int, total: int) -> None:
        self.chart = chart
        self.done = done
        self.total = total
        self.after = f"{done} of {total or 'all'} boundaries"
        super().__init__(f"chart interrupted after {self.after}; they are in .chart")


class OptimizationInterrupted(Interrupted):
    """A search was interrupted (Ctrl-C); what was found is kept.

    Parameters
    ----------
    optimum : object
        The best point so far, and all before it.
    points : int
        Number of points that it took.

    See Also
    --------
    Interrupted, optimize, Optimum

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> try:
    ...     best = mi.optimize(orbit, maximize="mean speed", over={"amplitude": (0.23, 0.25)})
    ... except mi.OptimizationInterrupted as stopped:
    ...     best = stopped.optimum
    >>> best.quantity
    'mean speed'
    """

    def __init__(self, optimum: object, points: int) -> None:
        self.optimum = optimum
        self.points = points
        self.after = f"{points} points"
        super().__init__(f"search interrupted after {self.after}; they are in .optimum")
