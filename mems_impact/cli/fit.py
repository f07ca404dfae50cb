"""`mems-impact fit`: parameters of a device or system from measurements."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mems_impact._util.quantities import has_unit
from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, load_subject
from mems_impact.cli.options import (
    actuator_from,
    device_options,
    directory_option,
    drive_from,
    drive_options,
)
from mems_impact.cli.output import OutputValue, add_json_values, filled, show, show_table
from mems_impact.cli.runtime import FAILED
from mems_impact.cli.value_types import AssignmentType, assignment

if TYPE_CHECKING:
    import mems_impact as mi

TARGET = "QUANTITY=VALUE[+-TOLERANCE][ at NAME=NUMBER,…]"

FUNCTION = "mems_impact.studies.fit:fit"


@click.command(cls=Command, short_help="Fit parameters of a device to measurements.")
@device_options
@click.option(
    "--target", "targets", multiple=True, metavar=TARGET,
    help="A measured value, such as 'displacement per blow=20 nm+-5%', 'mean speed' [m/s], "
    "'pull-in voltage' [V], 'resonance' [rad/s]; '1.2 kHz' is a resonance, too. May be repeated.",
)  # fmt: skip
@click.option(
    "--record", "records", multiple=True, type=click.Path(exists=True, dir_okay=False),
    help="A CSV file with a column t, and columns of states, or a column event. May be repeated.",
)  # fmt: skip
@click.option(
    "--error", "errors", multiple=True, type=AssignmentType(),
    help="Standard error of a column of the records, such as x2=1e-9. May be repeated.",
)  # fmt: skip
@function_options(FUNCTION)
@drive_options
@directory_option
@click.pass_context
def command(
    ctx: click.Context,
    *,
    device: str,
    changes: dict[str, float],
    targets: tuple[str, ...],
    records: tuple[str, ...],
    errors: tuple[tuple[str, float], ...],
    output: str | None,
) -> None:
    """Fit parameters of DEVICE to measurements.

    \b
    Example:
      mems-impact fit mita2003 --free k --amplitude 100 --frequency 1 \\
        --target "displacement per blow=15e-9+-1e-9"

    \b
    Quantities that depend on the voltage of the options:
      displacement per blow, displacement per impact, displacement per period,
      blows per period, impacts per period, mean speed
    Quantities of the device alone:
      pull-in voltage, resting voltage, resonance

    A sequence of impacts that ends in sticking contact is one blow; every bounce is an impact.
    Periods are forcing periods. The tolerance is the standard error of the value, by default 1 % of
    it. Parameters after "at" change the voltage for that target, such as "at amplitude=60". The
    search starts at the values of DEVICE.

    With --record, DEVICE may be a system of your own, FILE.py:NAME or MODULE:NAME. Besides
    parameters, --free takes initial states (x0.x2), the delay of the clock of the record, and
    offsets of its columns (offset.x2).

    The command shows parameters and residuals and writes them as CSV tables and a figure. The exit
    status is 1 if the fit misses the data or these do not determine a parameter.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.actuator.actuator import Actuator
    from mems_impact.cli.output import Output

    if not targets and not records:
        raise click.UsageError("--target, or --record: required")
    system = _subject(device, changes)
    arguments = arguments_for(FUNCTION, system)
    data: list[Any] = [_target(text) for text in targets]
    data += [_record(path, dict(errors)) for path in records]
    if records and isinstance(system, Actuator):
        arguments["drive"] = drive_from()
    with Output(output, None, not records, "fit") as files:
        result = mi.fit(system, data, **arguments)
        files.tables({"parameters": result.parameters, "residuals": result.residuals})
        if records:
            files.draw(lambda: mi.plot_fit(result).figure)
        add_json_values(
            {name: OutputValue(getattr(result, name)) for name in ("verdict", "note", "misfit")}
        )
        if result.verdict == "good":  # a warning tells any other verdict
            show(filled(f"{result.verdict}: {result.note}") + "\n")
        show_table("parameters", result.parameters, digits=6)
        if not records:
            show_table("residuals", result.residuals, digits=6)
        parameters = {n: v for n, v in result.values.items() if n in result.shared_parameters}
        options = " ".join(f"--set {n}={v!r}" for n, v in {**changes, **parameters}.items())
        show(f"Fitted device, for other commands: {device} {options}\n")
        files.show()
    if result.verdict != "good":
        ctx.exit(FAILED)


def _subject(device: str, changes: dict[str, float]) -> Any:
    """Return a device without a drive, or a system."""
    from mems_impact.actuator.system_files import is_system_name

    if is_system_name(device) and not Path(device).exists():
        return load_subject(device, changes)
    return actuator_from(device, changes)


def _record(path: str, errors: dict[str, float]) -> mi.Record:
    import mems_impact as mi
    from mems_impact.studies.records import table_of

    table = table_of("record", path)
    field = "events" if "event" in table else "samples"
    known = {name: error for name, error in errors.items() if name in table}
    return mi.Record(**{field: table}, errors=known)


def _target(text: str) -> mi.Target:
    import mems_impact as mi
    from mems_impact.actuator.design.targets import OF_RUN

    target, _, under = text.partition(" at ")
    quantity, _, number = (part.strip() for part in target.partition("="))
    middle, _, scatter = number.partition("+-")
    value: Any
    tolerance: Any
    try:
        value, tolerance = (
            each if has_unit(each) else float(each) if each else None for each in (middle, scatter)
        )
        if value is None:
            raise ValueError
    except ValueError:
        raise click.UsageError(f"--target {text!r} must be {TARGET}") from None
    if quantity not in OF_RUN:
        if under:
            raise click.UsageError(f"--target {text!r}: {quantity} needs no drive")
        return mi.Target(quantity=quantity, value=value, tolerance=tolerance)
    drive = drive_from()
    changes = dict(map(assignment, under.split(","))) if under else {}
    for name in changes:
        if name not in (*drive.names, *type(drive).model_fields):
            allowed = ", ".join(drive.names)
            raise click.UsageError(f"--target {text!r}: {name} must be one of {allowed}")
    drive = drive.varied(changes)
    return mi.Target(quantity=quantity, value=value, tolerance=tolerance, drive=drive)
