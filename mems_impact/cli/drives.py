"""The options that describe a voltage, and the drive that is made of them.

They are collected in click's context, so that a command need not name each of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.cli.options import Decorator, combined

if TYPE_CHECKING:
    from mems_impact.actuator.drives import Drive

KEY = "mems_impact.drive"
PREFIX = "drive_"  # lest an option of the command has the same name

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

FIELDS = {"frequency": "omega"}
"""The field that a number sets, where it is not the field itself."""

OPTIONS = {"period": "--drive-period"}
"""The option of a number, where it is not the name: --periods counts, and is a letter away."""


def option_of(name: str) -> str:
    """Return the option that sets a field of a drive."""
    return OPTIONS.get(name, f"--{name}")


def _collect(ctx: click.Context, parameter: click.Parameter, value: Any) -> None:
    if value is not None:
        assert parameter.name is not None
        ctx.meta.setdefault(KEY, {})[parameter.name.removeprefix(PREFIX)] = value


def _number(name: str) -> Decorator:
    text, default = NUMBERS[name]
    return click.option(
        option_of(name),
        f"{PREFIX}{name}",
        type=float,
        callback=_collect,
        expose_value=False,
        show_default=default,
        help=text,
    )


drive_options = combined(
    click.option(
        "--drive",
        f"{PREFIX}choice",
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
        f"{PREFIX}allow_code",
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
    from mems_impact.actuator.drives.files import TABLES

    path = drive_choice()
    if described_by_options(path):
        return ""
    if path.lower().endswith(TABLES):
        return f"mi.Sampled.from_csv({path!r})"
    return f"mi.load_drive({path!r}{', allow_code=True' if code_is_allowed() else ''})"


def code_is_allowed() -> bool:
    """Return whether the running command may run the Python code that a file names."""
    return bool(click.get_current_context().meta.get(KEY, {}).get("allow_code"))


def in_fields(given: Mapping[str, float]) -> dict[str, float]:
    """Return options as fields of a drive: a frequency as the angular frequency."""
    from mems_impact.errors import InvalidParameter

    values = {name: value for name, value in given.items() if name not in FIELDS}
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
        if FIELDS.get(name, name) not in known:
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

    from mems_impact.actuator.drives import Sampled, load_drive
    from mems_impact.actuator.drives.files import TABLES, drive_kinds

    if path in drive_kinds() and not Path(path).exists():
        raise click.UsageError(f"--drive {path}: describe it in a TOML file and give that")
    if Path(path).name == path and not Path(path).suffix and not Path(path).exists():
        kinds = ", ".join(filter(described_by_options, drive_kinds()))
        raise click.UsageError(f"--drive {path}: neither a file nor one of {kinds}")
    if path.lower().endswith(TABLES):
        measured = {name: given.pop(name) for name in ("period", "phase") if name in given}
        drive: Drive = Sampled.from_csv(path, **measured)
    else:
        drive = load_drive(path, allow_code=allow_code)
    for name in given:
        if FIELDS.get(name, name) not in drive.names:
            known = ", ".join(drive.names)
            problem = f"is no parameter of the drive in {path}: {known}"
            raise click.UsageError(f"{option_of(name)} {problem}; --drive KIND takes another one")
    values = {**in_fields(given), **{name: v for name, v in varied.items() if name in drive.names}}
    return drive.varied(values) if values else drive
