"""Options that commands share: drives, ranges, studies.

They are collected in click's context, so that a command need not name each of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Literal

import click
from click.shell_completion import CompletionItem

from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.cli.runtime import quiet
from mems_impact.integrators.options import ENGINES, METHODS, Options

if TYPE_CHECKING:
    from mems_impact.actuator.drives.base import Drive
    from mems_impact.actuator.parameters import Actuator
    from mems_impact.systems.state import State

# --- The options that commands share, and what is made of them.

Decorator = Callable[[Any], Any]

# Of modules that are slow to import: `mems_impact.studies.engine.config`,
# `mems_impact.analysis.attractor`.
EXECUTORS = ("threads", "processes")
SAMPLING_NAMES = ("sobol", "lhs", "random")
EXPONENTS = ("unsettled", "all", "none")


def apply_decorators(*decorators: Decorator) -> Decorator:
    """Return one decorator that applies `decorators`, the first outermost."""

    def decorate(function: Any) -> Any:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return decorate


def assignment(text: str) -> tuple[str, float]:
    """Return name and number of a text such as e=0.7."""
    name, _, number = (part.strip() for part in text.partition("="))
    try:
        value = float(number)
    except ValueError:
        name = ""
    if not name:
        raise click.BadParameter(f"{text!r} must be NAME=NUMBER, such as e=0.7")
    return name, value


def _assignments(
    _ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> dict[str, float]:
    return dict(map(assignment, texts))


def _tolerances(
    _ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> dict[str, float | str]:
    """Return tolerances by name; those in per cent as they stand."""
    found: dict[str, float | str] = {}
    for text in texts:
        name, _, given = (part.strip() for part in text.partition("="))
        found |= {name: given} if name and given.endswith("%") else dict([assignment(text)])
    return found


def _devices(_ctx: click.Context, _parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Return what a shell offers for DEVICE: the presets, and files."""
    from mems_impact.actuator.parameters import preset_names

    names = [CompletionItem(name) for name in preset_names() if name.startswith(begun)]
    return [*names, CompletionItem(begun, type="file")]


def device_argument(**settings: Any) -> Decorator:
    """Return the argument of what a command is about."""
    return click.argument("device", shell_complete=_devices, **settings)


changes_option = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="NAME=NUMBER",
    callback=_assignments,
    help="Change a parameter of the device, such as e=0.7, or of a term, such as "
    "tilt.angle=0.1, which is added if need be. May be repeated.",
)

device_options = apply_decorators(device_argument(), changes_option)

Initial = dict[str, float] | Literal["kicked"]
KICKED: Literal["kicked"] = "kicked"


def _initial(ctx: click.Context, parameter: click.Parameter, texts: tuple[str, ...]) -> Initial:
    return KICKED if texts == (KICKED,) else _assignments(ctx, parameter, texts)


initial_option = click.option(
    "--initial",
    multiple=True,
    metavar="NAME=NUMBER",
    callback=_initial,
    help="A component of the initial state, such as x2=0.1: x1, x2 [m], v1, v2 [m/s], or time [s] "
    "since the forcing period began. May be repeated. Or kicked: the block passes the middle fast "
    "enough to strike a stopper.",
    show_default="0 each",
)

parameter_option = click.option(
    "--parameter",
    required=True,
    metavar="NAME",
    help="What to vary: a parameter of drive or device, or of a term, such as tilt.angle.",
)


tolerance_option = click.option(
    "--tolerance",
    "tolerances",
    multiple=True,
    metavar="NAME=NUMBER[%]",
    callback=_tolerances,
    help="Standard deviation of a parameter, such as delta=0.005, or delta=2% of its value. May be "
    "repeated.",
)


def range_options(start: str, stop: str, defaults: tuple[str, str] | None = None) -> Decorator:
    """Return the options of where a varied parameter starts and stops.

    Parameters
    ----------
    start, stop : str
        Their help texts.
    defaults : tuple of str, optional
        What the command takes for each that is not given, in words; without, both are required.
    """
    words = defaults or (None, None)
    return apply_decorators(
        *(
            click.option(
                option, type=float, required=defaults is None, show_default=default, help=text
            )
            for option, text, default in zip(
                ("--start", "--stop"), (start, stop), words, strict=True
            )
        )
    )


def periods_option(text: str, default: float, kind: type = int) -> Decorator:
    """Return the option of how many forcing periods a command's work takes."""
    return click.option("--periods", type=kind, default=default, show_default=True, help=text)


def transient_option(text: str, default: float, kind: type = int) -> Decorator:
    """Return the option of how many forcing periods pass before a command looks."""
    return click.option("--transient", type=kind, default=default, show_default=True, help=text)


def workers_option(text: str, **settings: Any) -> Decorator:
    """Return the option of how much is done at once."""
    settings = {"show_default": True, **settings}
    return click.option("--workers", type=click.IntRange(1, 64), help=text, **settings)


SUITED = "adams; auto with a term that may be stiff"


def _integrator(method: str | None, rtol: float, atol: float) -> Decorator:
    return apply_decorators(
        click.option(
            "--method",
            type=click.Choice(METHODS),
            default=method,
            show_default=method or SUITED,
            help="CVODE's Adams or BDF formulas, or a one-step method of order 8; auto: that one, "
            "and BDF wherever the system is stiff.",
        ),
        click.option(
            "--rtol", type=float, default=rtol, show_default=True, help="Relative tolerance."
        ),
        click.option(
            "--atol",
            type=float,
            default=atol,
            show_default=True,
            help="Absolute tolerance, of the dimensionless state.",
        ),
        click.option(
            "--engine",
            type=click.Choice(ENGINES),
            default=Options.engine,
            show_default=True,
            help="Compiled, or interpreted (slower); auto: compiled where it is available.",
        ),
    )


AXIS_TYPE = click.Tuple([str, float, float, click.IntRange(1, 1_000_000)])


def axis_options(first: str, second: str) -> Decorator:
    """Return the options of what a study is over, with these help texts."""
    return apply_decorators(
        *(
            click.option(option, type=AXIS_TYPE, metavar="NAME START STOP POINTS", help=text)
            for option, text in (("--x", first), ("--y", second))
        )
    )


def sample_options(samples: int, sampling: str) -> Decorator:
    """Return the options of how a study draws its points, with these defaults."""
    return apply_decorators(
        click.option(
            "--samples", type=int, default=samples, show_default=True, help="How many are drawn."
        ),
        click.option(
            "--sampling",
            type=click.Choice(SAMPLING_NAMES),
            default=sampling,
            show_default=True,
            help="How: Sobol's sequence, a Latin hypercube, or independent of each other.",
        ),
        click.option("--seed", type=int, default=0, show_default=True, help="Of what is drawn."),
    )


recurrence_options = apply_decorators(
    transient_option("Forcing periods in which a motion may become periodic.", 300),
    periods_option("Forcing periods over which it is measured then, if it has not.", 100),
    click.option(
        "--longest",
        type=int,
        default=16,
        show_default=True,
        help="Forcing periods after which a motion may repeat itself, at most.",
    ),
    click.option(
        "--recurrence-tolerance",  # --tolerance is that of a parameter
        "tolerance",
        type=float,
        default=1e-6,
        show_default=True,
        help="To which it has to, relative to the size of each state.",
    ),
    click.option(
        "--exponents",
        type=click.Choice(EXPONENTS),
        default=EXPONENTS[0],
        show_default=True,
        help="Of which motions the largest Lyapunov exponent is computed; it tells chaotic from "
        "quasi-periodic ones.",
    ),
    click.option(
        "--chaos-persistence",
        type=float,
        default=16.0,
        show_default=True,
        help="Times --transient and --periods after which a chaotic motion has to be so still.",
    ),
)

study_options = apply_decorators(
    click.option(
        "--store",
        type=click.Path(),
        metavar="DIR",
        help="Keep points there as they are done; the same command goes on from them.",
    ),
    click.option(
        "--executor",
        type=click.Choice(EXECUTORS),
        show_default=EXECUTORS[0],
        help="What computes: threads, or processes of their own.",
    ),
    workers_option("How many of them.", show_default="as many as there are cores"),
)

integrator_options = _integrator(Options.method, Options.rtol, Options.atol)
# Those of `mems_impact.analysis.orbit` and `attractor`, which are slow to import.
orbit_integrator_options = _integrator("auto", 1e-11, 1e-13)
study_integrator_options = _integrator("auto", Options.rtol, Options.atol)


guess_options = apply_decorators(
    initial_option,
    transient_option("Forcing periods to run before the orbit is looked for.", 300, float),
    click.option(
        "--periods",
        type=int,
        default=None,
        help="Forcing periods after which the orbit closes; recognised by default.",
    ),
)


directory_option = click.option(
    "--output",
    type=click.Path(),
    default="out",
    show_default=True,
    metavar="DIR",
    help="Where tables and figure go; created if need be.",
)


def _wanted(_ctx: click.Context, _parameter: click.Parameter, asked: bool | None) -> bool:
    return not quiet() if asked is None else asked


progress_option = click.option(
    "--progress/--no-progress",
    default=None,
    callback=_wanted,
    show_default="progress, unless --quiet",
    help="Say how far the work is: on a terminal a bar, elsewhere a line now and then.",
)

output_options = apply_decorators(
    directory_option,
    click.option(
        "--figure",
        type=click.Path(dir_okay=False),
        metavar="FILE",
        show_default="a PNG in DIR",
        help="Where the figure goes: .png, .pdf or .svg.",
    ),
    click.option("--no-figure", is_flag=True, help="Draw no figure."),
)


def actuator_from(device: str, changes: dict[str, float]) -> Actuator:
    """Load the device and apply what ``--set`` changes."""
    from mems_impact.actuator.parameters import load_actuator

    refuse_system(device)
    actuator = load_actuator(device)
    return actuator.setting(changes)


def refuse_system(device: str) -> None:
    """Refuse the name of a system where a device is wanted, and Python code without a name."""
    from pathlib import Path

    from mems_impact.actuator.system_files import is_system_name

    if device.endswith(".py"):
        problem = "Python code; name the system in it, such as"
        raise click.UsageError(f"{device}: {problem} {device}:oscillator")
    if is_system_name(device) and not Path(device).exists():
        raise click.UsageError(
            f"{device}: a system, where this command takes a device; simulate and explore take "
            "systems, map, basins and tolerances those of a study file, and Python's verbs any"
        )


def state_from(initial: Initial, actuator: Actuator) -> State:
    """Return the state that ``--initial`` describes."""
    from mems_impact.actuator.automaton import STATES
    from mems_impact.actuator.system import kicked_state
    from mems_impact.systems.state import state_from as state_of

    if initial == KICKED:
        return kicked_state(actuator)
    assert isinstance(initial, dict)
    for name in initial:
        if name not in (*STATES, "time"):
            raise click.UsageError(f"--initial {name}: must be one of {', '.join(STATES)}, time")
    components = {name: value for name, value in initial.items() if name != "time"}
    return state_of(components, time=initial.get("time", 0.0))


# --- The options that describe a voltage, and the drive that is made of them.

KEY = "mems_impact.drive"
DRIVE_PREFIX = "drive_"  # lest an option of the command has the same name

# A waveform whose parameters are all among these can be described by options; others need a
# file.
NUMBERS: dict[str, tuple[str, str | None]] = {
    "amplitude": ("Amplitude f of the voltage; top of a square wave or pulse [V].", None),
    "omega": ("Angular frequency of the voltage [rad/s].", None),
    "frequency": ("The same as omega/(2 pi) [Hz].", None),
    "bias": ("Constant part of a sine or trapezoid [V].", "0"),
    "phase": ("How far the voltage is ahead [rad].", "0"),
    "duty": ("Share of the period that a square wave is high.", "0.5"),
    "rise": ("Rise time of a square wave (both flanks) or pulse [s].", "0"),
    "fall": ("Fall time of a pulse [s].", "0"),
    "low": ("Voltage between the pulses [V].", "0"),
    "flat": ("Share of the period that a trapezoid is flat.", "0.5"),
    "width": ("Width of a pulse [s].", None),
    "period": ("Period of pulses, or of a measured voltage [s].", None),
}
"""What each number is, and its default in words."""

FIELD_NAMES = {"frequency": "omega"}
"""The field that a number sets, where it is not the field itself."""

OPTION_NAMES = {"period": "--drive-period"}
"""The option of a number, where it is not the name: --periods counts, and is a letter away."""


def option_of(name: str) -> str:
    """Return the option that sets a field of a drive."""
    return OPTION_NAMES.get(name, f"--{name}")


def _collect(ctx: click.Context, parameter: click.Parameter, value: Any) -> None:
    if value is not None:
        assert parameter.name is not None
        ctx.meta.setdefault(KEY, {})[parameter.name.removeprefix(DRIVE_PREFIX)] = value


def _number(name: str) -> Decorator:
    text, default = NUMBERS[name]
    return click.option(
        option_of(name),
        f"{DRIVE_PREFIX}{name}",
        type=float,
        callback=_collect,
        expose_value=False,
        show_default=default,
        help=text,
    )


drive_options = apply_decorators(
    click.option(
        "--drive",
        f"{DRIVE_PREFIX}choice",
        metavar="KIND|FILE",
        callback=_collect,
        expose_value=False,
        show_default="the table [drive] of the device's file, else a sine",
        help=f"Waveform of the voltage: its kind ({', '.join(WAVEFORMS)}) where the numbers below "
        "describe it, or a file: TOML with a table [drive], or a measured voltage as CSV. Numbers "
        "besides a file take the place of those in it.",
    ),
    click.option(
        "--allow-code",
        f"{DRIVE_PREFIX}allow_code",
        is_flag=True,
        callback=_collect,
        expose_value=False,
        help="Run the Python code that a file names. It can do all that you can: read it first.",
    ),
    *map(_number, NUMBERS),
)


def drive_from(varied: Mapping[str, float] | None = None) -> Drive:
    """Return the drive that the options of the running command describe.

    Parameters
    ----------
    varied : mapping of str to float, optional
        What the command itself varies, and the value to begin with. A parameter that is not one of
        the drive's is left alone.
    """
    given = dict(click.get_current_context().meta.get(KEY, {}))
    given.pop("choice", None)
    choice = drive_choice()
    allow_code = given.pop("allow_code", False)
    for name, value in (varied or {}).items():
        if name == "frequency":
            problem = "vary omega [rad/s], which is 2 pi times the frequency"
            raise click.UsageError(f"{name}: {problem}: {2.0 * math.pi * value:.6g} for {value:g}")
        if name in given:
            raise click.UsageError(f"{option_of(name)} is what is varied; leave it out")
        if name == "omega" and "frequency" in given:
            raise click.UsageError("--frequency sets omega, which is varied; leave it out")
    if described_by_options(choice):
        return _of_kind(choice, given, varied or {})
    return _of_file(choice, given, varied or {}, allow_code)


def drive_choice() -> str:
    """Return the kind or file of the drive; of a device file with a drive, that file."""
    from mems_impact.actuator.drives.files import holds_drive

    context = click.get_current_context()
    chosen: str | None = context.meta.get(KEY, {}).get("choice")
    if chosen is not None:
        return chosen
    device = context.params.get("device")
    return device if isinstance(device, str) and holds_drive(device) else "sine"


def drive_source() -> str:
    """Return the Python that loads the file of `drive_from`; empty where options describe it."""
    from mems_impact.actuator.drives.files import SAMPLE_SUFFIXES

    path = drive_choice()
    if described_by_options(path):
        return ""
    if path.lower().endswith(SAMPLE_SUFFIXES):
        return f"mi.Sampled.from_csv({path!r})"
    return f"mi.load_drive({path!r}{', allow_code=True' if code_is_allowed() else ''})"


def code_is_allowed() -> bool:
    """Return whether the running command may run the Python code that a file names."""
    return bool(click.get_current_context().meta.get(KEY, {}).get("allow_code"))


def in_fields(given: Mapping[str, float]) -> dict[str, float]:
    """Return options as fields of a drive: a frequency as the angular frequency."""
    from mems_impact.errors import InvalidParameter

    values = {name: value for name, value in given.items() if name not in FIELD_NAMES}
    if "frequency" in given:
        if "omega" in given:
            raise click.UsageError("--frequency and --omega exclude each other; leave one out")
        frequency = given["frequency"]
        if not (math.isfinite(frequency) and frequency > 0.0):
            raise InvalidParameter("frequency", frequency, "a finite number > 0")
        values["omega"] = 2.0 * math.pi * frequency
    return values


def described_by_options(kind: str) -> tuple[str, ...]:
    """Return the parameters of a waveform if each has an option, else none."""
    from mems_impact.actuator.drives.files import drive_kinds, drive_of_kind

    names = tuple(drive_of_kind(kind).model_fields) if kind in drive_kinds() else ()
    return names if NUMBERS.keys() >= set(names) else ()


def _of_kind(kind: str, given: dict[str, float], varied: Mapping[str, float]) -> Drive:
    from mems_impact.actuator.drives.files import drive_of_kind
    from mems_impact.errors import InvalidParameter

    known = described_by_options(kind)
    for name in given:
        if FIELD_NAMES.get(name, name) not in known:
            takes = ", ".join(map(option_of, known))
            raise click.UsageError(
                f"{option_of(name)} does not belong to a {kind}, which takes {takes}"
            )
    values = {**in_fields(given), **{name: v for name, v in varied.items() if name in known}}
    try:
        return drive_of_kind(kind)(**values)
    except InvalidParameter as error:
        if error.field in known and error.field not in values:
            either = " or '--frequency'" if error.field == "omega" else ""
            raise click.UsageError(f"missing option '{option_of(error.field)}'{either}") from None
        raise


def _of_file(
    path: str, given: dict[str, float], varied: Mapping[str, float], allow_code: bool
) -> Drive:
    from pathlib import Path

    from mems_impact.actuator.drives.files import SAMPLE_SUFFIXES, drive_kinds, load_drive
    from mems_impact.actuator.drives.sampled import Sampled

    if path in drive_kinds() and not Path(path).exists():
        raise click.UsageError(f"--drive {path}: describe it in a TOML file and give that")
    if Path(path).name == path and not Path(path).suffix and not Path(path).exists():
        kinds = ", ".join(filter(described_by_options, drive_kinds()))
        raise click.UsageError(f"--drive {path}: neither a file nor one of {kinds}")
    if path.lower().endswith(SAMPLE_SUFFIXES):
        measured = {name: given.pop(name) for name in ("period", "phase") if name in given}
        drive: Drive = Sampled.from_csv(path, **measured)
    else:
        drive = load_drive(path, allow_code=allow_code)
    for name in given:
        if FIELD_NAMES.get(name, name) not in drive.names:
            known = ", ".join(drive.names)
            problem = f"is no parameter of the drive in {path}: {known}"
            raise click.UsageError(f"{option_of(name)} {problem}; --drive KIND takes another one")
    values = {**in_fields(given), **{name: v for name, v in varied.items() if name in drive.names}}
    return drive.varied(values) if values else drive


# --- Options that give parameters or quantities a lowest and a highest value.

Pairs = dict[str, tuple[float | None, float | None]]


def ranges(example: str, *, half_open: bool = False) -> Callable[..., Pairs]:
    """Return the callback of an option NAME=LOW:HIGH that may be repeated.

    Parameters
    ----------
    example : str
        For messages.
    half_open : bool, optional
        Whether one of the two may be left out.
    """

    def number(text: str) -> float | None:
        return None if half_open and not text else float(text)

    def read(_ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]) -> Pairs:
        found: Pairs = {}
        for text in texts:
            name, _, limits = (part.strip() for part in text.partition("="))
            low, colon, high = (part.strip() for part in limits.partition(":"))
            try:
                if not name or not colon or not (low or high):
                    raise ValueError
                found[name] = number(low), number(high)
            except ValueError:
                problem = f"{text!r} must be NAME=LOW:HIGH, such as {example}"
                raise click.BadParameter(problem) from None
        return found

    return read


def ranges_option(option: str, example: str, text: str, **settings: Any) -> Callable[[Any], Any]:
    """Return an option NAME=LOW:HIGH that may be repeated; `settings` as of `click.option`."""
    half_open = settings.pop("half_open", False)
    return click.option(
        option,
        multiple=True,
        metavar="NAME=LOW:HIGH",
        callback=ranges(example, half_open=half_open),
        help=f"{text} May be repeated.",
        **settings,
    )
