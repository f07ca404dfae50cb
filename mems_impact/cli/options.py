"""Options that commands share: drives, ranges, studies.

Click's context collects the options, so that a command need not name each option.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial, wraps
from typing import TYPE_CHECKING, Any, Literal

import click
from click.shell_completion import CompletionItem

from mems_impact._util.quantities import QuantityError, has_unit, magnitude
from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES
from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.cli.output import Output
from mems_impact.cli.runtime import STORE, quiet
from mems_impact.cli.wording import DRIVE_PREFIX
from mems_impact.integrators.options import ENGINES, METHODS, Options

if TYPE_CHECKING:
    from mems_impact.actuator.drives.base import Drive
    from mems_impact.actuator.parameters import Actuator
    from mems_impact.systems.state import State

# --- Shared options

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


def assignment(text: str) -> tuple[str, Any]:
    """Return name and number of a text such as e=0.7."""
    name, _, number = (part.strip() for part in text.partition("="))
    unit = parameter_unit(name)
    try:
        value = number_of(number, unit)
    except QuantityError as error:
        if unit or not name:
            raise click.BadParameter(f"{text!r}: {name} must be {error}") from None
        return name, number  # a parameter of a system, whose unit is known later
    except ValueError:
        name = ""
    if not name:
        example = "such as e=0.7 or k='11 N/m'"
        raise click.BadParameter(f"{text!r} must be NAME=NUMBER, {example}")
    return name, value


WITH_UNIT = "mems_impact.with_unit"  # the first text with a unit, in the context of click


def number_of(text: str, unit: str) -> float:
    """Return a text such as 70 or "70 V" as a number in `unit`; ValueError for other text."""
    if not has_unit(text):
        return float(text)
    context = click.get_current_context(silent=True)
    if context is not None:
        context.meta.setdefault(WITH_UNIT, text)
    return magnitude(text, unit)


def parameter_unit(name: str) -> str:
    """Return the SI unit of a parameter of device, drive or term, or of a state of the device."""
    from mems_impact.actuator.terms.files import term_names, term_type
    from mems_impact.actuator.units import PARAMETER_UNITS

    owner, dot, attribute = name.partition(".")
    if dot and owner in term_names():
        return term_type(owner).units.get(attribute, "")
    if name in QUANTITIES:
        return QUANTITIES[name].unit
    states = {"x1": "m", "x2": "m", "v1": "m/s", "v2": "m/s", "time": "s"}
    units = {**states, **PARAMETER_UNITS, **NUMBER_UNITS}
    return units.get(attribute if dot else name, "")


def symbol_of(name: str) -> str:
    """Return the symbol of a parameter of a device that a data sheet names; others unchanged.

    The frequency is that of the drive.
    """
    from mems_impact.actuator.parameters import parameter_named

    return name if name in NUMBER_UNITS else parameter_named(name)


class QuantityType(click.ParamType):
    """A number, or a text with a unit such as "0.6 kHz", of a parameter with this unit.

    Without a unit, texts stay texts, for parameters known later.
    """

    name = "quantity"  # in help

    def __init__(self, unit: str | None = None) -> None:
        self.unit = unit

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float | str:
        """Return the number, or the text if the unit of the parameter is unknown."""
        if not isinstance(value, str):
            return float(value)
        if self.unit is None and has_unit(value):
            return value
        try:
            if self.unit == "V" and has_unit(value):
                return self._of_drive(value)
            return number_of(value, self.unit or "")
        except QuantityError as error:
            self.fail(f"{value!r} must be {error}", param, ctx)
        except ValueError:
            self.fail(f"{value!r} must be a number, or a number with a unit", param, ctx)

    def _of_drive(self, value: str) -> str:
        """Return the text of a voltage, or of a charge: the device determines which."""
        _voltage_or_charge(value)
        return value

    def number(self, value: Any) -> float:
        """Return the number in SI, also of a voltage or a charge."""
        number = self.convert(value, None, None)
        return _voltage_or_charge(number) if isinstance(number, str) else number


def _voltage_or_charge(value: str) -> float:
    """Return the number of a text with a unit of the voltage, or of the charge, of a drive."""
    try:
        return number_of(value, "V")
    except QuantityError as error:
        try:
            return number_of(value, "C")
        except QuantityError:
            raise error from None


def _assignments(
    _ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> dict[str, float]:
    return dict(map(assignment, texts))


def _tolerances(
    _ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> dict[str, float | str]:
    """Return tolerances by name; tolerances in per cent as text."""
    tolerances: dict[str, float | str] = {}
    for text in texts:
        name, _, number = (part.strip() for part in text.partition("="))
        tolerances |= {name: number} if name and number.endswith("%") else dict([assignment(text)])
    return tolerances


def _devices(_ctx: click.Context, _parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Return the shell completions of DEVICE: presets and files."""
    from mems_impact.actuator.parameters import preset_names

    names = [CompletionItem(name) for name in preset_names() if name.startswith(begun)]
    return [*names, CompletionItem(begun, type="file")]


def device_argument(**attributes: Any) -> Decorator:
    """Return the argument that names the device of a command."""
    return click.argument("device", shell_complete=_devices, **attributes)


changes_option = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="NAME=NUMBER",
    callback=_assignments,
    help="Set a parameter of the device, such as e=0.7 or k='11 N/m', or of a term, such as "
    "tilt.angle=0.1; the term is added if the device lacks it. May be repeated.",
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
    "since the forcing period began. May be repeated. Or kicked: the block starts at the middle, "
    "fast enough to strike a stopper.",
    show_default="0 each",
)

parameter_option = click.option(
    "--parameter",
    required=True,
    metavar="NAME",
    help="Parameter to vary: of drive, device or term, such as tilt.angle.",
)


tolerance_option = click.option(
    "--tolerance",
    "tolerances",
    multiple=True,
    metavar="NAME=NUMBER[%]",
    callback=_tolerances,
    help="Standard deviation of a parameter, such as delta=0.005, or relative to its value, such "
    "as delta=2%. May be repeated.",
)


def range_options(start: str, stop: str, defaults: tuple[str, str] | None = None) -> Decorator:
    """Return the options --start and --stop of a varied parameter.

    Parameters
    ----------
    start, stop : str
        Their help texts.
    defaults : tuple of str, optional
        Default of each, in words; without it both options are required.
    """
    default_texts = defaults or (None, None)
    return apply_decorators(
        *(
            click.option(
                option,
                type=QuantityType(),
                required=defaults is None,
                show_default=default,
                help=text,
            )
            for option, text, default in zip(
                ("--start", "--stop"), (start, stop), default_texts, strict=True
            )
        ),
        _with_numbers,
    )


def _with_numbers(command: Any) -> Any:
    """Return a command that gets start and stop as numbers in the unit of its parameter."""

    @wraps(command)
    def converted(*arguments: Any, **options: Any) -> Any:
        kind = QuantityType(parameter_unit(options.get("parameter", "frequency")))
        for name in ("start", "stop", "back"):
            if isinstance(options.get(name), str):
                options[name] = kind.number(options[name])
        return command(*arguments, **options)

    return converted


def periods_option(text: str, default: float, kind: type = int) -> Decorator:
    """Return the option --periods."""
    return click.option("--periods", type=kind, default=default, show_default=True, help=text)


def transient_option(text: str, default: float, kind: type = int) -> Decorator:
    """Return the option --transient."""
    return click.option("--transient", type=kind, default=default, show_default=True, help=text)


def workers_option(text: str, **attributes: Any) -> Decorator:
    """Return the option --workers."""
    attributes = {"show_default": True, **attributes}
    return click.option("--workers", type=click.IntRange(1, 64), help=text, **attributes)


SUITED = "adams; auto with a term that may be stiff"


def _integrator(method: str | None, rtol: float, atol: float) -> Decorator:
    return apply_decorators(
        click.option(
            "--method",
            type=click.Choice(METHODS),
            default=method,
            show_default=method or SUITED,
            help="CVODE's Adams or BDF formulas, or DOP853, a one-step method of order 8; auto: "
            "DOP853, and BDF where the system is stiff.",
        ),
        click.option(
            "--rtol", type=float, default=rtol, show_default=True, help="Relative tolerance."
        ),
        click.option(
            "--atol",
            type=float,
            default=atol,
            show_default=True,
            help="Absolute tolerance of the dimensionless state.",
        ),
        click.option(
            "--engine",
            type=click.Choice(ENGINES),
            default=Options.engine,
            show_default=True,
            help="Compiled or interpreted (slower) code; auto: compiled if available.",
        ),
        _with_options,
    )


def _with_options(command: Any) -> Any:
    """Return a command that gets the options of the integrator as one argument."""

    @wraps(command)
    def gathered(
        *arguments: Any, method: Any, rtol: float, atol: float, engine: Any, **rest: Any
    ) -> Any:
        chosen = Options(method=method, rtol=rtol, atol=atol, engine=engine)
        return command(*arguments, **rest, options=chosen)

    return gathered


AXIS_TYPE = click.Tuple([str, QuantityType(), QuantityType(), click.IntRange(1, 1_000_000)])


def _axis(
    _ctx: click.Context, _parameter: click.Parameter, axis: tuple[str, Any, Any, int] | None
) -> tuple[str, float, float, int] | None:
    """Return an axis with its ends as numbers in the unit of its parameter."""
    if axis is None:
        return None
    name, start, stop, count = axis
    kind = QuantityType(parameter_unit(name))
    return symbol_of(name), kind.number(start), kind.number(stop), count


def axis_options(first: str, second: str) -> Decorator:
    """Return the options --x and --y of a study, with these help texts."""
    return apply_decorators(
        *(
            click.option(
                option,
                type=AXIS_TYPE,
                callback=_axis,
                metavar="NAME START STOP POINTS",
                help=text,
            )
            for option, text in (("--x", first), ("--y", second))
        )
    )


def sample_options(samples: int, sampling: str) -> Decorator:
    """Return the options of how a study samples its points, with these defaults."""
    return apply_decorators(
        click.option(
            "--samples", type=int, default=samples, show_default=True, help="Number of samples."
        ),
        click.option(
            "--sampling",
            type=click.Choice(SAMPLING_NAMES),
            default=sampling,
            show_default=True,
            help="Sampling method: Sobol sequence, Latin hypercube, or independent random points.",
        ),
        click.option("--seed", type=int, default=0, show_default=True, help="Seed of the samples."),
    )


recurrence_options = apply_decorators(
    transient_option("Forcing periods within which a motion may become periodic.", 300),
    periods_option("Forcing periods over which an aperiodic motion is then measured.", 100),
    click.option(
        "--longest",
        type=int,
        default=16,
        show_default=True,
        help="Longest period of a motion to be recognized, in forcing periods.",
    ),
    click.option(
        "--recurrence-tolerance",  # --tolerance is that of a parameter
        "tolerance",
        type=float,
        default=1e-6,
        show_default=True,
        help="Relative tolerance for recognizing a periodic motion.",
    ),
    click.option(
        "--exponents",
        type=click.Choice(EXPONENTS),
        default=EXPONENTS[0],
        show_default=True,
        help="Motions whose largest Lyapunov exponent is computed; it separates chaotic from "
        "quasi-periodic motions.",
    ),
    click.option(
        "--chaos-persistence",
        type=float,
        default=16.0,
        show_default=True,
        help="A motion is called chaotic if it still is after this multiple of --transient plus "
        "--periods.",
    ),
)


def _store(ctx: click.Context, _parameter: click.Parameter, path: str | None) -> str | None:
    ctx.meta[STORE] = path
    return path


def store_option(metavar: str, text: str) -> Decorator:
    """Return the option --store; `text` is its help."""
    return click.option("--store", type=click.Path(), metavar=metavar, callback=_store, help=text)


study_options = apply_decorators(
    store_option(
        "DIR", "Directory in which finished points are kept; the same command resumes from them."
    ),
    click.option(
        "--executor",
        type=click.Choice(EXECUTORS),
        show_default=EXECUTORS[0],
        help="Compute in threads or in processes.",
    ),
    workers_option("Number of threads or processes.", show_default="number of cores"),
)

integrator_options = _integrator(Options.method, Options.rtol, Options.atol)
# Those of `mems_impact.analysis.orbit` and `attractor`, which are slow to import.
orbit_integrator_options = _integrator("auto", 1e-11, 1e-13)
study_integrator_options = _integrator("auto", Options.rtol, Options.atol)


guess_options = apply_decorators(
    initial_option,
    transient_option("Forcing periods simulated before the search for the orbit.", 300, float),
    click.option(
        "--periods",
        type=int,
        default=None,
        help="Period of the orbit in forcing periods; recognized by default.",
    ),
)


directory_option = click.option(
    "--output",
    type=click.Path(),
    default="out",
    show_default=True,
    metavar="DIR",
    help="Directory of tables and figure; created if needed.",
)


def _progress_default(
    _ctx: click.Context, _parameter: click.Parameter, requested: bool | None
) -> bool:
    return not quiet() if requested is None else requested


progress_option = click.option(
    "--progress/--no-progress",
    default=None,
    callback=_progress_default,
    show_default="progress, unless --quiet",
    help="Show progress: a bar on a terminal, otherwise a line at intervals.",
)


def _with_output(command: Any) -> Any:
    """Return a command that gets as `output` a function that makes its `Output`, by name."""

    @wraps(command)
    def gathered(
        *arguments: Any, output: str, figure: str | None, no_figure: bool, **rest: Any
    ) -> Any:
        return command(*arguments, **rest, output=partial(Output, output, figure, no_figure))

    return gathered


output_options = apply_decorators(
    directory_option,
    click.option(
        "--figure",
        type=click.Path(dir_okay=False),
        metavar="FILE",
        show_default="a PNG in DIR",
        help="File of the figure: .png, .pdf or .svg.",
    ),
    click.option("--no-figure", is_flag=True, help="Skip the figure."),
    _with_output,
)


def actuator_from(device: str, changes: dict[str, float]) -> Actuator:
    """Load the device and apply the values of ``--set``."""
    from mems_impact.actuator.parameters import load_actuator

    refuse_system(device)
    actuator = load_actuator(device)
    text = click.get_current_context().meta.get(WITH_UNIT)
    if text is not None and not actuator.scales.named:
        problem = f"{device} is dimensionless; give a number without a unit"
        raise click.UsageError(f"{text!r}: {problem}")
    return actuator.changed(**changes)


def refuse_system(device: str) -> None:
    """Refuse a system where a device is required, and a Python file without a system's name."""
    from pathlib import Path

    from mems_impact.actuator.system_files import is_system_name

    if device.endswith(".py"):
        problem = "a Python file; add the name of a system in it, such as"
        raise click.UsageError(f"{device}: {problem} {device}:oscillator")
    if is_system_name(device) and not Path(device).exists():
        raise click.UsageError(
            f"{device}: a system, but this command takes a device; simulate and explore take "
            "systems, map, basins and tolerances take study files, and Python functions take any"
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


# --- Options of the drive

KEY = "mems_impact.drive"
DEFAULT_KIND = "sine"

# Options can describe a waveform whose parameters are all among these; others need a file.
NUMBERS: dict[str, tuple[str, str | None]] = {
    "amplitude": ("Amplitude of the voltage; top of a square wave, pulse or step [V].", None),
    "omega": ("Angular frequency of the voltage [rad/s].", None),
    "frequency": ("Frequency of the voltage, omega/(2 pi) [Hz].", None),
    "bias": ("Constant part of a sine or trapezoid [V].", "0"),
    "phase": ("Phase lead of the voltage [rad].", "0"),
    "duty": ("Duty cycle of a square wave.", "0.5"),
    "rise": ("Rise time of a square wave (both flanks), pulse or step [s].", "0"),
    "fall": ("Fall time of a pulse [s].", "0"),
    "low": ("Voltage between pulses, or after a pulse [V].", "0"),
    "flat": ("Share of the period in which a trapezoid is constant.", "0.5"),
    "width": ("Width of a pulse [s].", None),
    "period": ("Period of pulses, or of a measured voltage [s].", None),
    "pause": ("Pause between pulse and hold [s].", "0"),
    "hold": ("Voltage that holds the block after pulse and pause [V].", None),
    "duration": ("Time after which a step, or pulse and hold, starts again [s].", "never"),
}
"""Help text of each number, and its default in words."""

EQUIVALENT = {"omega": "frequency", "frequency": "omega"}
"""Numbers that exclude each other."""

OPTION_NAMES = {
    "period": "--drive-period",
    "duration": "--drive-duration",
    "choice": "--drive",
    "allow_code": "--allow-code",
}
"""The option of an entry of a drive, where their names differ.

``--period`` would resemble ``--periods``; ``--duration`` is the length of a run.
"""


NUMBER_UNITS = {
    "amplitude": "V", "omega": "rad/s", "frequency": "Hz", "bias": "V", "phase": "rad",
    "rise": "s", "fall": "s", "low": "V", "width": "s", "period": "s",
    "pause": "s", "hold": "V", "duration": "s",
}  # fmt: skip
"""SI units of these numbers."""


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
        type=QuantityType(NUMBER_UNITS.get(name, "")),
        callback=_collect,
        expose_value=False,
        show_default=default,
        help=text,
    )


def _drive_options(default_kind: str) -> Decorator:
    """Return the options of a drive, of a kind if neither an option nor a file names one."""
    return apply_decorators(
        click.option(
            "--drive",
            f"{DRIVE_PREFIX}choice",
            metavar="KIND|FILE",
            callback=_collect,
            expose_value=False,
            show_default=f"the table [drive] of the device's file, else a {default_kind}",
            help=f"Waveform of the voltage: a kind ({', '.join(WAVEFORMS)}), described by the "
            "numbers below, or a file: TOML with a table [drive], or a measured voltage as CSV. "
            "Numbers given beside a file replace those in it.",
        ),
        click.option(
            "--allow-code",
            f"{DRIVE_PREFIX}allow_code",
            is_flag=True,
            callback=_collect,
            expose_value=False,
            help="Run the Python code that a file names. It has all your permissions: read it "
            "first.",
        ),
        *map(_number, NUMBERS),
    )


drive_options = _drive_options(DEFAULT_KIND)
step_options = _drive_options("voltage-step")
pulse_and_hold_options = _drive_options("pulse-and-hold")


def drive_from(
    varied: Mapping[str, float] | None = None, *, default_kind: str = DEFAULT_KIND
) -> Drive:
    """Return the drive that the options of the running command describe.

    Parameters
    ----------
    varied : mapping of str to float, optional
        Parameters that the command varies, and their first values. Parameters that the drive lacks
        are ignored.
    default_kind : str, optional
        Kind of the drive if neither an option nor the file of the device names one.
    """
    values = dict(click.get_current_context().meta.get(KEY, {}))
    values.pop("choice", None)
    choice = drive_choice(default_kind)
    allow_code = values.pop("allow_code", False)
    for name in varied or {}:
        if name in values:
            raise click.UsageError(f"{option_of(name)} is the varied parameter; omit the option")
        if EQUIVALENT.get(name) in values:
            other = option_of(EQUIVALENT[name])
            raise click.UsageError(f"{other} sets {name}, which is varied; omit the option")
    if described_by_options(choice):
        return _of_kind(choice, values, varied or {})
    return _of_file(choice, values, varied or {}, allow_code)


def drive_choice(default_kind: str = DEFAULT_KIND) -> str:
    """Return the kind or file of the drive; for a device file with a drive, that file."""
    from mems_impact.actuator.parameters import names_in_file

    context = click.get_current_context()
    chosen: str | None = context.meta.get(KEY, {}).get("choice")
    if chosen is not None:
        return chosen
    device = context.params.get("device")
    return device if isinstance(device, str) and "drive" in names_in_file(device) else default_kind


def drive_source() -> str:
    """Return the Python code that loads the drive's file; empty if options describe the drive."""
    from mems_impact.actuator.drives.files import SAMPLE_SUFFIXES
    from mems_impact.actuator.parameters import names_in_file

    path = drive_choice()
    if described_by_options(path):
        return ""
    if path.lower().endswith(SAMPLE_SUFFIXES):
        return f"mi.Sampled.from_csv({path!r})"
    of_device = ".drive" if names_in_file(path) & {"parameters", "design"} else ""
    return f"mi.load({path!r}{', allow_code=True' if code_is_allowed() else ''}){of_device}"


def code_is_allowed() -> bool:
    """Return whether the running command may run the Python code that a file names."""
    return bool(click.get_current_context().meta.get(KEY, {}).get("allow_code"))


def _check_frequency(values: Mapping[str, float]) -> None:
    if set(EQUIVALENT) <= set(values):
        raise click.UsageError("--frequency and --omega exclude each other; leave one out")


def described_by_options(kind: str) -> tuple[str, ...]:
    """Return the parameters of a waveform if each has an option, else an empty tuple."""
    from mems_impact.actuator.drives.files import drive_kinds, drive_of_kind

    names = tuple(drive_of_kind(kind).model_fields) if kind in drive_kinds() else ()
    return names if NUMBERS.keys() >= set(names) else ()


def _of_kind(kind: str, values: dict[str, float], varied: Mapping[str, float]) -> Drive:
    from mems_impact.actuator.drives.files import drive_of_kind
    from mems_impact.errors import InvalidParameter

    allowed = described_by_options(kind)
    for name in values:
        if name not in allowed:
            takes = ", ".join(map(option_of, allowed))
            raise click.UsageError(
                f"{option_of(name)} is not an option of a {kind}, which takes {takes}"
            )
    _check_frequency(values)
    all_values = {**values, **{name: v for name, v in varied.items() if name in allowed}}
    try:
        return drive_of_kind(kind)(**all_values)
    except InvalidParameter as error:
        if error.field in allowed and error.field not in all_values:
            either = (
                " or '--frequency'" if error.field == "omega" and "frequency" in allowed else ""
            )
            raise click.UsageError(f"missing option '{option_of(error.field)}'{either}") from None
        raise


def _of_file(
    path: str, file_values: dict[str, float], varied: Mapping[str, float], allow_code: bool
) -> Drive:
    from pathlib import Path

    from mems_impact.actuator.drives.files import SAMPLE_SUFFIXES, drive_kinds, load_drive
    from mems_impact.actuator.drives.sampled import Sampled

    if path in drive_kinds() and not Path(path).exists():
        raise click.UsageError(f"--drive {path}: describe this waveform in a TOML file")
    if Path(path).name == path and not Path(path).suffix and not Path(path).exists():
        kinds = ", ".join(filter(described_by_options, drive_kinds()))
        raise click.UsageError(f"--drive {path}: neither a file nor one of {kinds}")
    if path.lower().endswith(SAMPLE_SUFFIXES):
        measured = {
            name: file_values.pop(name) for name in ("period", "phase") if name in file_values
        }
        drive: Drive = Sampled.from_csv(path, **measured)
    else:
        drive = load_drive(path, allow_code=allow_code)
    fields = {*drive.names, *(EQUIVALENT.keys() & type(drive).model_fields.keys())}
    for name in file_values:
        if name not in fields:
            allowed = ", ".join(drive.names)
            problem = f"is not a parameter of the drive in {path}: {allowed}"
            raise click.UsageError(f"{option_of(name)} {problem}; --drive KIND selects others")
    _check_frequency(file_values)
    values = {**file_values, **{name: v for name, v in varied.items() if name in fields}}
    return drive.varied(values) if values else drive


# --- Bounds of parameters and quantities

Pairs = dict[str, tuple[float | str | None, float | str | None]]


def ranges(example: str, *, half_open: bool = False) -> Callable[..., Pairs]:
    """Return the callback of an option NAME=LOW:HIGH that may be repeated.

    Parameters
    ----------
    example : str
        For messages.
    half_open : bool, optional
        Whether one bound may be omitted.
    """

    def number(text: str) -> float | str | None:
        if has_unit(text):
            return text  # the unit of the parameter is known later
        return None if half_open and not text else float(text)

    def read(_ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]) -> Pairs:
        bounds: Pairs = {}
        for text in texts:
            name, _, limits = (part.strip() for part in text.partition("="))
            low, colon, high = (part.strip() for part in limits.partition(":"))
            try:
                if not name or not colon or not (low or high):
                    raise ValueError
                bounds[name] = number(low), number(high)
            except ValueError:
                problem = f"{text!r} must be NAME=LOW:HIGH, such as {example}"
                raise click.BadParameter(problem) from None
        return bounds

    return read


def ranges_option(option: str, example: str, text: str, **attributes: Any) -> Callable[[Any], Any]:
    """Return an option NAME=LOW:HIGH that may be repeated; `attributes` as of `click.option`."""
    half_open = attributes.pop("half_open", False)
    return click.option(
        option,
        multiple=True,
        metavar="NAME=LOW:HIGH",
        callback=ranges(example, half_open=half_open),
        help=f"{text} May be repeated.",
        **attributes,
    )


# --- Tolerances and specifications


def _distributions(
    _ctx: click.Context, _parameter: click.Parameter, texts: tuple[str, ...]
) -> dict[str, list[Any] | str]:
    distributions: dict[str, list[Any] | str] = {}
    for text in texts:
        name, _, description = text.partition("=")
        kind, *numbers = (part.strip() for part in description.split(":"))
        width = numbers[-1] if numbers else kind
        if name.strip() and len(numbers) <= 1 and has_unit(width):
            distributions[name.strip()] = description
            continue
        try:
            amounts = [each if has_unit(each) else float(each) for each in numbers]
            distributions[name.strip()] = [kind, *amounts]
        except ValueError:
            distributions = {}
        if not (distributions.get(name.strip()) and name.strip() and kind and numbers):
            problem = f"{text!r} must be NAME=DISTRIBUTION:NUMBERS, such as e=norm:0.8:0.02, or "
            problem += "NAME=PER CENT, such as d=5%"
            raise click.BadParameter(problem)
    return {symbol_of(name): value for name, value in distributions.items()}


def distribution_option(
    option: str, name: str, text: str, default: str | None
) -> Callable[[Any], Any]:
    """Return an option NAME=DISTRIBUTION that may be repeated; `default` in words."""
    return click.option(
        option,
        name,
        multiple=True,
        metavar="NAME=DISTRIBUTION",
        callback=_distributions,
        show_default=default or False,
        help=f"{text}, by its name in scipy.stats and the arguments: e=norm:0.8:0.02, "
        "delta=uniform:0.35:0.01. About the device's value: d=5% or d='0.1 um' is normal with this "
        "standard deviation, d=uniform:5% is uniform within plus or minus 5 %. May be repeated.",
    )


def specification_option(default: str | None) -> Callable[[Any], Any]:
    """Return the option --specification; `default` in words."""
    return ranges_option(
        "--specification",
        "'displacement per period=1e-4:'",
        "Bounds of a column of the table; one bound may be omitted.",
        half_open=True,
        show_default=default or False,
    )
