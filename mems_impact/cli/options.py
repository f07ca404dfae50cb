"""Options that commands share: device, drive, files.

Click's context collects the options of a drive, so that a command need not name each option.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial, wraps
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.cli.output import DIRECTORY, STANDARD_OUTPUT, Output
from mems_impact.cli.runtime import DRIVE_PREFIX
from mems_impact.cli.value_types import NUMBER_UNITS, WITH_UNIT, AssignmentType, QuantityType

if TYPE_CHECKING:
    from mems_impact.actuator.actuator import Actuator
    from mems_impact.actuator.drives.base import Drive

# --- Shared options

Decorator = Callable[[Any], Any]


def apply_decorators(*decorators: Decorator) -> Decorator:
    """Return one decorator that applies `decorators`, the first outermost."""

    def decorate(function: Any) -> Any:
        for decorator in reversed(decorators):
            function = decorator(function)
        return function

    return decorate


def _devices(_ctx: click.Context, _parameter: click.Parameter, begun: str) -> list[CompletionItem]:
    """Return the shell completions of DEVICE: presets and files."""
    from mems_impact.actuator.device_files import preset_names

    names = [CompletionItem(name) for name in preset_names() if name.startswith(begun)]
    return [*names, CompletionItem(begun, type="file")]


def device_argument(**attributes: Any) -> Decorator:
    """Return the argument that names the device of a command."""
    return click.argument("device", shell_complete=_devices, **attributes)


changes_option = click.option(
    "--set",
    "changes",
    multiple=True,
    type=AssignmentType(),
    callback=lambda _ctx, _parameter, pairs: dict(pairs),
    help="Set a parameter of the device, such as e=0.7 or k='11 N/m' (devices lists the "
    "names), or of a term, such as tilt.angle=0.1; the term is added if the device lacks it. May "
    "be repeated.",
)

device_options = apply_decorators(device_argument(), changes_option)

directory_option = click.option(
    "--output",
    type=click.Path(),
    show_default=f"{DIRECTORY}; {STANDARD_OUTPUT} with --json",
    metavar="DIR",
    help="Directory of tables and figure; created if needed. -: no files.",
)


def _with_output(command: Any) -> Any:
    """Return a command that gets as `output` a function that makes its `Output`, by name."""

    @wraps(command)
    def gathered(
        *arguments: Any, output: str | None, figure: str | None, no_figure: bool, **rest: Any
    ) -> Any:
        return command(*arguments, **rest, output=partial(Output, output, figure, no_figure))

    return gathered


figure_options = apply_decorators(
    click.option(
        "--figure",
        type=click.Path(dir_okay=False),
        metavar="FILE",
        show_default="a PNG in DIR",
        help="File of the figure: .png, .pdf or .svg.",
    ),
    click.option("--no-figure", is_flag=True, help="Skip the figure."),
)

output_options = apply_decorators(directory_option, figure_options, _with_output)


def actuator_from(device: str, changes: dict[str, float]) -> Actuator:
    """Load the device and apply the values of ``--set``."""
    from mems_impact.actuator.device_files import load_actuator

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
            help="Run the Python code that a file names, with all your permissions: read the "
            "code first.",
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

    `varied` has first values of parameters that the command varies; parameters that the drive lacks
    are ignored. `default_kind` applies if neither an option nor the file of the device names one.
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
    from mems_impact.actuator.device_files import names_in_file

    context = click.get_current_context()
    chosen: str | None = context.meta.get(KEY, {}).get("choice")
    if chosen is not None:
        return chosen
    device = context.params.get("device")
    return device if isinstance(device, str) and "drive" in names_in_file(device) else default_kind


def drive_source() -> str:
    """Return the Python code that loads the drive's file; empty if options describe the drive."""
    from mems_impact.actuator.device_files import names_in_file
    from mems_impact.actuator.drives.files import SAMPLE_SUFFIXES

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
        period, phase = file_values.pop("period", None), file_values.pop("phase", 0.0)
        drive: Drive = Sampled.from_csv(path, period=period, phase=phase)
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
