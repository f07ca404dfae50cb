"""`mems-impact explore`: a page in the browser with a slider for each parameter."""

from __future__ import annotations

import importlib.util
import webbrowser
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, refuse_drive
from mems_impact.cli.options import (
    EQUIVALENT,
    KEY,
    actuator_from,
    changes_option,
    device_argument,
    drive_choice,
    drive_from,
    drive_options,
    drive_source,
)
from mems_impact.cli.output import OutputValue, add_json_values, show
from mems_impact.cli.runtime import write_message

if TYPE_CHECKING:
    from mems_impact.actuator.actuator import Actuator
    from mems_impact.explorer.session import Subject

DEFAULT_DEVICE, DEFAULT_PORT = "zhao2004", 5006

FUNCTION = "mems_impact.explorer.session:subject_of_device"


@click.command(cls=Command, short_help="Explore a device or a system in the browser.")
@device_argument(default=DEFAULT_DEVICE)
@changes_option
@drive_options
@function_options(FUNCTION, omit=("name", "drive_source"))
@click.option(
    "--port",
    type=click.IntRange(0, 65535),
    default=DEFAULT_PORT,
    show_default=True,
    help="Port of the page, which only this machine can reach; 0: any free port.",
)
@click.option(
    "--browser/--no-browser", default=True, show_default=True, help="Open the page in a browser."
)
def command(*, device: str, changes: dict[str, float], port: int, browser: bool) -> None:
    """Explore DEVICE (zhao2004 by default) on a page in the browser.

    \b
    Examples:
      mems-impact explore zhao2004
      mems-impact new system
      mems-impact explore system.py:oscillator --set A=0.5

    The page has a slider and a number field for every parameter, and shows motion, phase portrait,
    bifurcation diagram, steps and multipliers. A click on the diagram sets its parameter. The
    address holds all settings and can be shared. The default drive is from the file of the
    device, or a sine. Ctrl-C ends the server.

    A system of your own can replace DEVICE: FILE.py:NAME or MODULE:NAME, whose Python code is run,
    or the name of a system that another package adds.
    """  # noqa: D301 - click looks for the backspace itself
    if importlib.util.find_spec("bokeh") is None:
        missing = "explore needs Bokeh, which is not installed"
        raise click.ClickException(f"{missing}: pip install 'mems-impact[explore]'")
    from mems_impact.explorer.server import serve
    from mems_impact.explorer.session import first_setting
    from mems_impact.explorer.snapshot import take_snapshot

    subject = _subject(device, changes)
    # This thread receives Ctrl-C while functions are compiled, and reports a failing run at once.
    take_snapshot(subject, first_setting(subject))

    def ready(address: str) -> None:
        add_json_values({"address": OutputValue(address)})
        show(f"{subject.title}: {address} (Ctrl-C ends the server)")
        if browser and not webbrowser.open(address):
            write_message(f"no browser was found; open {address}")

    serve(subject, port, ready)


def _subject(device: str, changes: dict[str, float]) -> Subject:
    from mems_impact.actuator.system_files import is_system_name
    from mems_impact.explorer.session import subject_of_code, subject_of_device

    arguments = arguments_for(FUNCTION)
    if is_system_name(device) and not Path(device).exists():
        refuse_drive(device)
        return subject_of_code(device, changes, **arguments)
    actuator = actuator_from(device, changes)
    drive_options = click.get_current_context().meta.setdefault(KEY, {})
    drive = drive_from(_usual(drive_options, actuator))
    return subject_of_device(device, actuator, drive, drive_source=drive_source(), **arguments)


def _usual(options: dict[str, Any], actuator: Actuator) -> dict[str, float]:
    """Return default values for the required parameters of a sine that are not given."""
    from mems_impact.actuator.design.walking_drive import first_drive

    if drive_choice() != "sine":
        return {}
    names = {*options, *(EQUIVALENT[name] for name in EQUIVALENT if name in options)}
    if names >= {"amplitude", "omega", "frequency"}:
        return {}
    drive = first_drive(actuator)
    frequency = "omega" if drive.frequency is None else "frequency"
    usual = {each: drive.number(each) for each in ("amplitude", frequency)}
    return {name: value for name, value in usual.items() if name not in names}
