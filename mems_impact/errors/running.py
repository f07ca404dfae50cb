"""What goes wrong on the way: a run, an engine, workers, an orbit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import islice

from mems_impact.errors.base import MemsImpactError

__all__ = ["EngineUnavailable", "OrbitError", "RunError", "WorkersLost"]

_MOST_STATES = 8


class RunError(MemsImpactError, RuntimeError):
    """A run cannot go on.

    Parameters
    ----------
    reason : str
        What happened.
    remedy : str
        What to do about it.
    cycle : int
        Number of forcing periods completed before this one.
    phase_time : float
        Time since the beginning of the current forcing period, in the unit of the run.
    mode : str
        Mode of the automaton.
    state : mapping of str to float
        The state, by name.
    trajectory : object, optional
        What was computed up to here.

    Attributes
    ----------
    reason, remedy, cycle, phase_time, mode, state, trajectory
        As given; `state` is a dict.

    See Also
    --------
    simulate, Options, MemsImpactError

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     mi.simulate(actuator, drive, options=mi.Options(max_steps=10))
    ... except mi.RunError as error:
    ...     error.cycle, len(error.trajectory.events), error.remedy
    (0, 0, "raise max_steps, loosen rtol, or use method 'auto' if the system is stiff")
    """

    def __init__(
        self,
        *,
        reason: str,
        remedy: str,
        cycle: int,
        phase_time: float,
        mode: str,
        state: Mapping[str, float],
        trajectory: object = None,
    ) -> None:
        self.reason = reason
        self.remedy = remedy
        self.cycle = cycle
        self.phase_time = phase_time
        self.mode = mode
        self.state = dict(state)
        self.trajectory = trajectory
        self._units: Mapping[str, str] | None = None
        super().__init__(self._message())

    def convert(self, out: Callable[[str, float], float], units: Mapping[str, str]) -> None:
        """Tell all in the units of the user; once, whoever asks again.

        `out` converts what stands under a heading, `units` has its unit.
        """
        if self._units is None:
            self.phase_time = float(out("time", self.phase_time))
            self.state = {name: float(out(name, value)) for name, value in self.state.items()}
            self._units = units
            self.args = (self._message(),)

    def _message(self) -> str:
        def amount(name: str, value: float) -> str:
            return f"{value:.9g} {(self._units or {}).get(name, '')}".rstrip()

        where = [f"cycle {self.cycle}", f"phase time {amount('time', self.phase_time)}"]
        where += [f"mode {self.mode}"]
        first = islice(self.state.items(), _MOST_STATES)
        where += [f"{name} = {amount(name, number)}" for name, number in first]
        where += ["…"] if len(self.state) > _MOST_STATES else []
        return f"{self.reason} ({', '.join(where)}); {self.remedy}"


class EngineUnavailable(MemsImpactError, ImportError):
    """An engine cannot be used on this machine.

    Parameters
    ----------
    reason : str
        What is missing or does not fit.
    remedy : str
        What to do about it.

    See Also
    --------
    Options, EngineFallbackWarning

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     run = mi.simulate(actuator, drive, 10, options=mi.Options(engine="compiled"))
    ... except mi.EngineUnavailable as error:
    ...     print(error.remedy)
    """

    def __init__(self, reason: str, remedy: str) -> None:
        self.reason = reason
        self.remedy = remedy
        super().__init__(f"{reason}; {remedy}")


class WorkersLost(MemsImpactError, RuntimeError):
    """The workers of a study died, and no others can be had; what was done is kept.

    Parameters
    ----------
    reason : str
        What happened.
    table : object
        The table of the chunks that were done.
    done, total : int
        Number of points that were done, and of all.

    See Also
    --------
    StudyInterrupted, operating_map

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     table = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=50, periods=5)
    ... except mi.WorkersLost as error:
    ...     table = error.table  # the chunks that were done
    >>> len(table) > 0
    True
    """

    def __init__(self, reason: str, table: object, done: int, total: int) -> None:
        self.reason = " ".join(reason.split()).rstrip(".")
        self.table = table
        self.done = done
        self.total = total
        super().__init__(
            f"the workers are lost after {done} of {total} points, which are in .table "
            f"({self.reason}); give as executor a function that makes one, and can make it anew"
        )


class OrbitError(MemsImpactError, RuntimeError):
    """No periodic orbit could be found or followed.

    Parameters
    ----------
    reason : str
        What went wrong.
    remedy : str
        What to do about it.
    partial : object, optional
        What had been computed.

    See Also
    --------
    find_orbit, Orbit, MemsImpactError

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> try:
    ...     mi.find_orbit(actuator, mi.Sine(amplitude=0.2357, omega=0.45))
    ... except mi.OrbitError as error:
    ...     error.remedy.partition(", ")[0]
    'let transients die out (transient=300)'
    """

    def __init__(self, reason: str, remedy: str, partial: object = None) -> None:
        self.reason = reason
        self.remedy = remedy
        self.partial = partial
        super().__init__(f"{reason}; {remedy}")
