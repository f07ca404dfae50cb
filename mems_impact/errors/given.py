"""What is wrong with what was given: a value, a file, a function."""

from __future__ import annotations

from os import PathLike, fspath

from mems_impact.errors.base import MemsImpactError
from mems_impact.wording import label, shown

__all__ = ["FileNotWritten", "FunctionError", "FunctionsMissing", "InvalidFile", "InvalidParameter"]


class InvalidParameter(MemsImpactError, ValueError):
    """A parameter has a value that the model does not allow, is missing, or is unknown.

    Parameters
    ----------
    field : str
        Name of the parameter.
    value : object
        The value that was given; None if the parameter is missing.
    allowed : str
        What is allowed, worded to follow "must be": ``"between 0 and d = 1 (exclusive)"``.
    source : str or os.PathLike, optional
        The file that the value came from.
    problem : str, optional
        What is wrong, where "must be `allowed`" does not say it (a missing or unknown parameter).
        `allowed` is then not shown.

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

    def located(self, source: str | PathLike[str] = "", *, owner: str = "") -> InvalidParameter:
        """Return the same error, of a parameter of `owner`, of a value from the file `source`."""
        field = f"{owner}.{self.field}" if owner else self.field
        place = source or self.source
        return InvalidParameter(field, self.value, self.allowed, place, problem=self.problem)


class InvalidFile(MemsImpactError, ValueError):
    """A file cannot be read, is not what it should be, or cannot stand where it is wanted.

    Parameters
    ----------
    path : str or os.PathLike
        The file, as the user named it.
    reason : str
        What is wrong with it.
    remedy : str
        What to do about it.

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
    """A function of a system does not do what the package asks of it.

    Parameters
    ----------
    role : str
        What the function is of the system, and its name: ``"flow 'fall'"``.
    problem : str
        What it does, worded to follow `role`.
    remedy : str
        What to do about it.
    file : str, optional
        Where the function, or the line that fails, stands.
    line : int, optional

    Attributes
    ----------
    trajectory : object
        The run after which it was found out, None where there was none.

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
        self.trajectory: object = None
        super().__init__(f"{self.reason}; {remedy}")

    @property
    def reason(self) -> str:
        """The sentence without its remedy."""
        name = self.file.replace("\\", "/").rpartition("/")[2]
        place = f" ({label(name)}, line {self.line})" if name else ""
        return " ".join(f"{self.role}{place} {self.problem}".split())


class FunctionsMissing(MemsImpactError, RuntimeError):
    """What is asked for needs the functions of a system, and a result was loaded without them.

    Parameters
    ----------
    reason : str
        Which file does not hold which functions.

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
    """A file could not be written, though its place is a good one: the disk is full, for example.

    Parameters
    ----------
    path : str or os.PathLike
        The file. What stood there before stands there still.
    reason : str
        What happened.
    remedy : str
        What to do about it.

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
