"""Exceptions, interruptions and warnings of the package.

Every exception keeps all its attributes when pickled, because studies report failures from other
processes. Every message is one line, because the command line prints it unchanged.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from os import PathLike, fspath
from typing import Any

from mems_impact._util.formatting import label, shown

__all__ = [
    "DiscontinuityWarning",
    "EngineFallbackWarning",
    "EngineUnavailable",
    "FileNotWritten",
    "FitWarning",
    "FunctionError",
    "FunctionsMissing",
    "Interrupted",
    "InvalidFile",
    "InvalidParameter",
    "LengthWarning",
    "MemsImpactError",
    "OrbitError",
    "Picklable",
    "PluginWarning",
    "RunError",
    "ScaleWarning",
    "StartWarning",
    "StiffnessWarning",
    "TransientWarning",
    "UnitsWarning",
    "ValidityWarning",
    "WorkersLost",
]

# --- The base of every exception.


class Picklable(BaseException):
    """An exception that is pickled with all its attributes."""

    def __reduce__(self) -> tuple[Any, ...]:
        # The inherited method calls the class with `args`, which fails for keyword-only arguments.
        return _restore, (type(self), self.args, self.__dict__)


class MemsImpactError(Picklable, Exception):
    """Base of the package's exceptions.

    See Also
    --------
    InvalidParameter, RunError, OrbitError, Interrupted

    Examples
    --------
    >>> import mems_impact as mi
    >>> try:
    ...     mi.load_actuator("zhao2004").replace(delta=2)
    ... except mi.MemsImpactError as error:
    ...     print(error)
    delta = 2: must be < 1, the gap d
    """


def _restore(
    kind: type[BaseException], args: tuple[Any, ...], attributes: dict[str, Any]
) -> BaseException:
    """Rebuild a pickled exception without calling its constructor."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(attributes)
    return error


# --- Bad input: a value, a file, a function.


class InvalidParameter(MemsImpactError, ValueError):
    """A parameter is missing or unknown, or its value is not allowed.

    Parameters
    ----------
    field : str
        Name of the parameter.
    value : object
        The given value; None if the parameter is missing.
    allowed : str
        Allowed values, worded to follow "must be": ``"between 0 and d = 1 (exclusive)"``.
    source : str or os.PathLike, optional
        The file that contains the value.
    problem : str, optional
        Message that replaces "must be `allowed`", for example for a missing or unknown parameter.

    Attributes
    ----------
    field, value, allowed, source, problem
        As given; `source` is a str or None.

    See Also
    --------
    MemsImpactError, InvalidFile

    Examples
    --------
    >>> import mems_impact as mi
    >>> try:
    ...     mi.load_actuator("zhao2004").replace(e=-1)
    ... except mi.InvalidParameter as error:
    ...     error.field, error.value
    ('e', -1)
    """

    def __init__(
        self,
        field: str,
        value: object,
        allowed: str,
        source: str | PathLike[str] | None = None,
        *,
        problem: str | None = None,
    ) -> None:
        self.field = field
        self.value = value
        self.allowed = allowed
        self.source = None if source is None else fspath(source)
        self.problem = problem
        subject = label(field)
        if value is not None or problem is None:
            subject += f" = {shown(value)}"
        message = f"{subject}: {problem or f'must be {allowed}'}"
        if self.source is not None:
            message += f" [in {label(self.source)}]"
        super().__init__(message)

    def renamed(self, field: str) -> InvalidParameter:
        """Return the same error for a parameter of another name."""
        error = InvalidParameter(field, self.value, self.allowed, self.source, problem=self.problem)
        for note in getattr(self, "__notes__", ()):
            error.add_note(note)
        return error

    def located(self, source: str | PathLike[str] = "", *, owner: str = "") -> InvalidParameter:
        """Return the same error for a parameter of `owner` and a value from the file `source`."""
        field = f"{owner}.{self.field}" if owner else self.field
        place = source or self.source
        return InvalidParameter(field, self.value, self.allowed, place, problem=self.problem)


class InvalidFile(MemsImpactError, ValueError):
    """A file cannot be read or written, or its content is invalid.

    Parameters
    ----------
    path : str or os.PathLike
        The file, as the user named it.
    reason : str
        The problem.
    remedy : str
        How to solve it.

    Attributes
    ----------
    path, reason, remedy : str
        As given.

    See Also
    --------
    InvalidParameter, load_actuator, load

    Examples
    --------
    >>> from pathlib import Path
    >>> import mems_impact as mi
    >>> _ = Path("mine.toml").write_text("m1 = ")
    >>> try:
    ...     mi.load_actuator("mine.toml")
    ... except mi.InvalidFile as error:
    ...     str(error)[:25]
    'mine.toml: not valid TOML'
    """

    def __init__(self, path: str | PathLike[str], reason: str, remedy: str) -> None:
        self.path = fspath(path)
        self.reason = reason
        self.remedy = remedy
        super().__init__(f"{label(self.path)}: {reason}; {remedy}")


class FunctionError(MemsImpactError, TypeError):
    """A function of a system violates its contract.

    Parameters
    ----------
    role : str
        Role of the function in the system, and its name: ``"flow 'fall'"``.
    problem : str
        The violation, worded to follow `role`.
    remedy : str
        How to solve it.
    file : str, optional
        File of the function or of the line that fails.
    line : int, optional
        Line of the function, or the line that fails.

    Attributes
    ----------
    partial : object
        The run in which the problem was detected, or None.

    See Also
    --------
    System, MemsImpactError

    Examples
    --------
    >>> import mems_impact as mi
    >>> def flow(mode, t, y, p):
    ...     return (y.v,)
    >>> try:
    ...     mi.System(states=("x", "v"), flow=flow)
    ... except mi.FunctionError as error:
    ...     error.role, error.problem
    ("flow 'flow'", 'returns 1 numbers for 2 states in mode free')
    """

    def __init__(self, role: str, problem: str, remedy: str, file: str = "", line: int = 0) -> None:
        self.role, self.problem, self.remedy = role, problem, remedy
        self.file, self.line = file, line
        self.partial: Any = None
        super().__init__(f"{self.reason}; {remedy}")

    @property
    def reason(self) -> str:
        """The message without its remedy."""
        name = self.file.replace("\\", "/").rpartition("/")[2]
        place = f" ({label(name)}, line {self.line})" if name else ""
        return " ".join(f"{self.role}{place} {self.problem}".split())


class FunctionsMissing(MemsImpactError, RuntimeError):
    """An operation needs the functions of a system, but the result was loaded without them.

    Parameters
    ----------
    reason : str
        The file and the functions that it lacks.

    Attributes
    ----------
    reason : str
        As given.

    See Also
    --------
    load, System

    Examples
    --------
    >>> import mems_impact as mi
    >>> error = mi.FunctionsMissing("ball.zip holds no functions")
    >>> str(error).partition("; ")[2]
    'give the system: mems_impact.load(path, system=…)'
    """

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"{reason}; give the system: mems_impact.load(path, system=…)")


class FileNotWritten(MemsImpactError):
    """A file could not be written, for example because the disk is full.

    Parameters
    ----------
    path : str or os.PathLike
        The file. An earlier version of the file is unchanged.
    reason : str
        The problem.
    remedy : str
        How to solve it.

    See Also
    --------
    Run, load

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, 10)
    >>> try:
    ...     run.save("run.zip")
    ... except mi.FileNotWritten as error:
    ...     print(error.remedy)
    """

    def __init__(self, path: str | PathLike[str], reason: str, remedy: str) -> None:
        self.path = fspath(path)
        self.reason = reason
        self.remedy = remedy
        super().__init__(f"{label(self.path)}: cannot be written ({reason}); {remedy}")


# --- Failures of a computation: a run, an engine, workers, an orbit.

_MOST_STATES = 8


class RunError(MemsImpactError, RuntimeError):
    """A run failed before its end.

    Parameters
    ----------
    reason : str
        The problem.
    remedy : str
        How to solve it.
    cycle : int
        Number of completed forcing periods.
    phase_time : float
        Time since the beginning of the current forcing period, in the unit of the run.
    mode : str
        Mode of the automaton.
    state : mapping of str to float
        The state, by name.
    partial : object, optional
        The run up to the failure.
    period : float, optional
        The forcing period; of an autonomous system the time that `cycle` counts.

    Attributes
    ----------
    reason, remedy, cycle, phase_time, mode, state, partial, period
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
    ...     error.cycle, len(error.partial.events), error.remedy
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
        partial: object = None,
        period: float = 1.0,
    ) -> None:
        self.reason = reason
        self.remedy = remedy
        self.cycle = cycle
        self.period = period
        self._forced = True
        self.phase_time = phase_time
        self.mode = mode
        self.state = dict(state)
        self.partial: Any = partial
        self._units: Mapping[str, str] | None = None
        super().__init__(self._message())

    def convert(self, units: Any, *, forced: bool) -> None:
        """Convert time and state to the units of the user; later calls have no effect.

        `units` are those of the system; the message counts periods if it is `forced`.
        """
        if self._units is None:
            self._forced = forced
            self.period = float(units.out("time", self.period))
            self.phase_time = float(units.out("time", self.phase_time))
            self.state = {name: float(units.out(name, value)) for name, value in self.state.items()}
            self._units = units
            self.args = (self._message(),)

    def _message(self) -> str:
        def amount(name: str, value: float) -> str:
            return f"{value:.9g} {(self._units or {}).get(name, '')}".rstrip()

        if self._forced:
            where = [f"cycle {self.cycle}", f"phase time {amount('time', self.phase_time)}"]
        else:
            where = [f"time {amount('time', self.cycle * self.period + self.phase_time)}"]
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
        The missing or incompatible component.
    remedy : str
        How to solve it.

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
    """The workers of a study died and cannot be replaced; the exception holds the partial result.

    Parameters
    ----------
    reason : str
        The problem.
    remedy : str
        What the user can do.
    after : str
        The progress made, worded to follow "after".
    partial : object
        The table of the finished chunks.

    See Also
    --------
    Interrupted, operating_map

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     table = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=200).table
    ... except mi.WorkersLost as error:
    ...     table = error.partial  # of the finished chunks
    >>> len(table) > 0
    True
    """

    def __init__(self, reason: str, remedy: str, after: str, partial: object) -> None:
        self.reason, self.remedy = " ".join(reason.split()).rstrip("."), remedy
        self.after = after
        self.partial: Any = partial
        super().__init__(f"the workers died after {after} ({self.reason}); {remedy}")


class OrbitError(MemsImpactError, RuntimeError):
    """A periodic orbit could not be found or continued.

    Parameters
    ----------
    reason : str
        The problem.
    remedy : str
        How to solve it.
    partial : object, optional
        The partial result.

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
    'raise transient'
    """

    def __init__(self, reason: str, remedy: str, partial: object = None) -> None:
        self.reason = reason
        self.remedy = remedy
        self.partial: Any = partial
        super().__init__(f"{reason}; {remedy}")


# --- Interruptions by Ctrl-C.


class Interrupted(Picklable, KeyboardInterrupt):
    """Ctrl-C interrupted a computation; the exception holds the partial result.

    Parameters
    ----------
    work : str
        The computation.
    after : str
        The progress made, worded to follow "after".
    partial : object
        The partial result: the run, the table of the finished points, the chart, diagram or report
        of the finished parts, the best point so far.

    Attributes
    ----------
    work, after, partial
        As given.

    See Also
    --------
    simulate, operating_map, optimize, MemsImpactError

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> try:
    ...     run = mi.simulate(actuator, drive, periods=300)
    ... except mi.Interrupted as stop:
    ...     run = stop.partial
    >>> len(run.events) > 0
    True
    """

    def __init__(self, work: str, after: str, partial: object) -> None:
        self.work, self.after = work, after
        self.partial: Any = partial
        super().__init__(f"{work} interrupted after {after}; .partial is the result so far")


# --- Warnings.


class DiscontinuityWarning(UserWarning):
    """The flow of a system has an undeclared jump, across which no step is accurate.

    See Also
    --------
    System, Guard, Friction, Relay, SwitchingSurface

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> def flow(mode, t, y, p):
    ...     return y.v, -y.x + (1.0 if t % 3.0 < 1.0 else -1.0)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     system = mi.System(states=("x", "v"), flow=flow, period=3.0)
    >>> "at t = 1, where no step is accurate" in str(caught[0].message)
    True
    """


class EngineFallbackWarning(UserWarning):
    """The requested engine is unavailable; a slower one replaces it.

    See Also
    --------
    EngineUnavailable, Options

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", mi.EngineFallbackWarning)  # rather fail than be slow
    ...     run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), 10)
    """


class FitWarning(UserWarning):
    """A fit misses its targets, or the data do not determine the fitted parameters.

    See Also
    --------
    fit, Fit

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> pull_in = mi.Target(quantity="pull-in voltage", value=35)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     found = mi.fit(mita, [pull_in], free=["k", "alpha"])  # one number, two parameters
    >>> found.verdict, [warning.category.__name__ for warning in caught]
    ('undetermined', ['FitWarning'])
    """


class LengthWarning(UserWarning):
    """A run ends at its default length, since its `until` function has not fallen through zero.

    See Also
    --------
    simulate, Run

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> clock = mi.System(states=("q",), flow=lambda mode, t, y, p: (1.0,), period=1.0)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     run = mi.simulate(clock, until=lambda mode, t, y, p: 1.0 + y.q)
    >>> [warning.category.__name__ for warning in caught], run.ended
    (['LengthWarning'], 'time')
    """


class PluginWarning(UserWarning):
    """An extension from another package fails to load and is omitted.

    See Also
    --------
    load

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("error", mi.PluginWarning)  # rather fail than go without it
    ...     actuator = mi.load_actuator("zhao2004")
    """


class UnitsWarning(UserWarning):
    """Numbers of a device, a drive or a target look like numbers in other units.

    Either a device file without ``units`` looks like SI, or a number of a device in SI, of a term,
    a drive or a target is far outside the usual range. For a frequency below a 300th of the
    resonance, the warning suggests kilohertz, unless the voltage pulls the block in.

    See Also
    --------
    load_actuator, Actuator

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> from pathlib import Path
    >>> mita = mi.load_actuator("mita2003")
    >>> names = ("m1", "m2", "k", "c", "d", "delta", "e", "mu_s", "mu_d", "alpha", "g")
    >>> values = {name: getattr(mita, name) for name in names}
    >>> lines = ["[parameters]", *(f"{name} = {value}" for name, value in values.items())]
    >>> _ = Path("mine.toml").write_text(chr(10).join(lines))
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     device = mi.load_actuator("mine.toml")
    >>> [warning.category.__name__ for warning in caught]
    ['UnitsWarning']
    """


class ScaleWarning(UserWarning):
    """Numbers are far from order one, and the system declares no typical values.

    See Also
    --------
    System

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> def spring(mode, t, y, p):
    ...     return y.v, -1e12 * y.x
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     small = mi.System(states=("x", "v"), flow=spring, initial={"x": 1e-6})
    ...     run = mi.simulate(small, duration=1e-5)
    >>> [warning.category.__name__ for warning in caught]
    ['ScaleWarning']
    """


class StartWarning(UserWarning):
    """A motion starts where a guard that moves the state has a negative margin, or may part.

    The motion may part on a switching surface from which the flow leads away to both sides, and on
    an intersection of three switching surfaces around which motions may expand.

    See Also
    --------
    Guard, Impact, simulate

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> def fall(mode, t, y, p):
    ...     return y.v, -1.0
    >>> def below(mode, t, y, p):  # of a ball above the floor this is negative
    ...     return -y.x
    >>> def rebound(mode, t, y, p):
    ...     return mode, (0.0, -0.5 * y.v)
    >>> floor = mi.Guard("floor", below, rebound)
    >>> ball = mi.System(states=("x", "v"), flow=fall, initial={"x": 1.0}, guards=[floor])
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     run = mi.simulate(ball, duration=0.5)
    >>> [warning.category.__name__ for warning in caught]
    ['StartWarning']
    """


class TransientWarning(UserWarning):
    """The statistics of a run still change: they belong to a transient.

    See Also
    --------
    Settling, simulate

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), 10)
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     statistics = run.statistics
    >>> [each.category.__name__ for each in caught]
    ['TransientWarning']
    """


class ValidityWarning(UserWarning):
    """A run left the range of validity of a term of the model, or a device or drive leaves it.

    The beams of a `Geometry` may deflect too far, and a drive may exceed the breakdown voltage of
    the gap, or a voltage at which fingers bend or snap to a side.

    See Also
    --------
    Term, SqueezeFilm, Geometry, Run

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> film = mi.SqueezeFilm(length=1, width=0.5, pressure=2, viscosity=1, free_path_pressure=0.1)
    >>> actuator = mi.load_actuator("zhao2004").adding(film)
    >>> drive = mi.Sine(amplitude=0.6, omega=0.5)
    >>> options = mi.Options(engine="interpreted")  # nothing to compile for so short a run
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always")
    ...     run = mi.simulate(actuator, drive, 0.2, initial=mi.State(v2=1.0), options=options)
    >>> [warning.category.__name__ for warning in caught]
    ['ValidityWarning']
    """


class StiffnessWarning(UserWarning):
    """Stability limits the steps of an explicit method; an implicit method may be faster.

    See Also
    --------
    Options, EngineFallbackWarning

    Examples
    --------
    >>> import warnings
    >>> import mems_impact as mi
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", mi.StiffnessWarning)
    ...     run = mi.simulate(mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), 10)
    """
