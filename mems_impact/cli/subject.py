"""What a command is about: a device under a voltage, or a system of the user's own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import click

from mems_impact.cli.drives import KEY, drive_from, option_of
from mems_impact.cli.options import KICKED, Initial, actuator_from, state_from

if TYPE_CHECKING:
    import mems_impact as mi


def subject_from(
    name: str, changes: Mapping[str, float], initial: Initial
) -> tuple[mi.System, mi.State | None]:
    """Return the system of a name or path, and where it starts; None for its own start.

    Parameters
    ----------
    name : str
        Of a device, or of a system as `mems_impact.load_system` takes it.
    changes : mapping of str to float
        What ``--set`` changes.
    initial : mapping of str to float or "kicked"
        What ``--initial`` says.
    """
    from pathlib import Path

    from mems_impact.actuator.own_system import is_system_name, load_system

    if not is_system_name(name) or Path(name).exists():
        actuator = actuator_from(name, dict(changes))
        return actuator.under(drive_from()), state_from(initial, actuator)
    refuse_drive(name)
    if initial == KICKED:
        raise click.UsageError(f"--initial {KICKED}: of devices; {name} takes NAME=NUMBER")
    assert isinstance(initial, dict)
    system = load_system(name).changed(**changes) if changes else load_system(name)
    if not initial:
        return system, None
    for component in initial:
        known = (*system.states, "time")
        if component not in known:
            raise click.UsageError(f"--initial {component}: must be one of {', '.join(known)}")
    start: mi.State = system.initial.replace(**initial)
    return system, start


def refuse_drive(name: str) -> None:
    """Refuse options of a drive beside a system of that name."""
    for option, value in click.get_current_context().meta.get(KEY, {}).items():
        if value is not False:  # a flag that was not given
            raise click.UsageError(f"{option_of(option)}: of devices; {name} has no voltage")
