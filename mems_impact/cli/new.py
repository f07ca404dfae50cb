"""`mems-impact new`: a device of a data sheet, or a template of a device, drawing or system."""

from __future__ import annotations

import os
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import click

from mems_impact._util.files import replacing
from mems_impact._util.formatting import label, stem
from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES, Entry
from mems_impact.cli.options import apply_decorators
from mems_impact.cli.output import add_json_files, show
from mems_impact.cli.runtime import PROGRAM, warn

TEMPLATES = {
    "device": ("device.toml", "simulate {}"),
    "drawing": ("drawing.toml", "datasheet {}"),
    "system": ("system.py", "simulate {}:oscillator"),
}
"""By kind: template, which is the default name of the file, and a first command for it."""

OPTION_QUANTITIES = {
    **QUANTITIES,
    "friction": Entry("", "coefficient of friction, or static and dynamic: 0.4,0.3"),
}


def _option_of(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _quantity_option(name: str) -> Callable[[Any], Any]:
    unit, meaning, _ = OPTION_QUANTITIES[name]
    text = f"{meaning[0].upper()}{meaning[1:]}{f' [{unit}]' if unit else ''}."
    return click.option(_option_of(name), name, metavar="QUANTITY", help=text)


class NewCommand(click.Command):
    """A command with an option of one or two values, static and dynamic friction."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse arguments, two coefficients of friction as one."""
        if "--friction" in args:
            first = args.index("--friction") + 1
            pair = args[first : first + 2]
            if len(pair) == 2 and all(isinstance(_value(each), float) for each in pair):
                args = [*args[:first], " ".join(pair), *args[first + 2 :]]
        return super().parse_args(ctx, args)


@click.command(cls=NewCommand, short_help="Write a file of a device or a system.")
@click.argument("kind", type=click.Choice(list(TEMPLATES)))
@click.argument("file", type=click.Path(), required=False)
@apply_decorators(*map(_quantity_option, OPTION_QUANTITIES))
def command(*, kind: str, file: str | None, **quantities: str | None) -> None:
    """Write FILE: the device of a data sheet, or a template of a device, a drawing or a system.

    \b
    Examples:
      mems-impact new device mine.toml --frequency 1.2kHz --quality 30 \\
        --proof-mass 0.2mg --frame-mass 1mg --gap 4um --travel 2.5um \\
        --pull-in 70V --static-friction 0.35 --dynamic-friction 0.28 \\
        --restitution 0.65
      mems-impact simulate mine.toml
      mems-impact new system oscillator.py

    Any consistent set of quantities that determines the device is accepted, as numbers in SI or
    with units; the drive makes the frame walk, or a warning says why none does and what would
    change that. Without quantities, the file is a commented template that runs as it stands; that
    of a drawing has the parts of a device and the process. A clamp by a voltage is a table of the
    file, [clamp_electrode]. FILE is device.toml, drawing.toml or
    system.py by default. An existing file is never overwritten.
    """  # noqa: D301 - click looks for the backspace itself
    texts = {name: text for name, text in quantities.items() if text is not None}
    if texts and kind != "device":
        raise click.UsageError(f"{_option_of(next(iter(texts)))}: of a device only")
    template, first = TEMPLATES[kind]
    path = Path(file or template)
    ending = Path(template).suffix
    if path.suffix != ending:
        raise click.UsageError(f"{path}: the name must end in {ending}")
    text = (files("mems_impact.cli") / "templates" / template).read_text("utf-8")
    if texts:
        text = _with_design(text, texts)
    text = text.replace("FILE", label(str(path)))
    text = text.replace('name = "mine"', f"name = {_toml(stem(path))}")
    if os.path.lexists(path):
        raise click.ClickException(f"{path}: already exists; choose another name")
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    add_json_files([path])
    show(f"written: {path}; try it: {PROGRAM} {first.format(path)}")


def _with_design(template: str, texts: dict[str, str]) -> str:
    """Return the template of a device with the table [design] of a data sheet.

    Raises InvalidParameter if the quantities determine no device.
    """
    from mems_impact._util.units import si_amount
    from mems_impact.actuator.actuator import Actuator
    from mems_impact.actuator.design.walking_drive import find_walk, snap_drive
    from mems_impact.actuator.plausibility import check_plausible_device, check_plausible_drive
    from mems_impact.errors import OrbitError

    values: dict[str, Any] = {name: _value(text) for name, text in texts.items()}
    if "friction" in texts:
        values["friction"] = _friction(texts["friction"])
    actuator = Actuator.from_design(**values)
    check_plausible_device(actuator)
    try:
        drive, step = find_walk(actuator)
        way = "forward" if step > 0.0 else "backward"
        found = f"by simulation: one blow in a forcing period, {si_amount(abs(step), 'm')} {way}"
    except OrbitError as error:
        drive, found = snap_drive(actuator), "no drive was found under which the frame walks"
        warn(f"the frame walks under no drive that was tried: {error}")
    check_plausible_drive(actuator, drive)
    lines = [f"{name} = {_toml(value)}" for name, value in values.items()]
    above, _, rest = template.partition("[parameters]")
    _, _, below = rest.partition("[drive]")
    below = below.replace("amplitude = 100.0", f"# {found}\namplitude = {drive.amplitude:g}", 1)
    volts = f"{0.8 * drive.amplitude:.3g}:{1.2 * drive.amplitude:.3g}:9"
    above = above.replace("20:100:9", volts)
    below = below.replace("frequency = 50.0", f"frequency = {drive.number('frequency'):g}", 1)
    return f"{above}[design]\n" + "\n".join(lines) + f"\n\n[drive]{below}"


def _value(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def _friction(text: str) -> Any:
    """Return a coefficient, or a pair of them."""
    values = [_value(part) for part in text.replace(",", " ").split()]
    return values if len(values) == 2 else _value(text)


def _toml(value: float | str | list[float]) -> str:
    import json

    return repr(value) if isinstance(value, float) else json.dumps(value, ensure_ascii=False)
