"""`mems-impact orbit`: one periodic orbit."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from mems_impact._util.formatting import stability_name
from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, device_system
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import (
    Output,
    OutputValue,
    add_json_tables,
    add_json_values,
    show,
    show_table,
    show_values,
)

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorOrbit

MAX_TABLE_ROWS = 20  # per table: a chatter sequence has dozens of impacts

FUNCTION = "mems_impact.studies.engine.config:orbit_from"


@click.command(cls=Command, short_help="Find a periodic orbit and its stability.")
@device_options
@function_options(FUNCTION)
@drive_options
@output_options
def command(*, device: str, changes: dict[str, float], output: Callable[[str], Output]) -> None:
    """Find a periodic orbit of DEVICE and its stability.

    \b
    Example:
      mems-impact orbit zhao2004 --amplitude 0.24 --omega 0.5

    The search starts at the end of a run from the initial state. The command shows state,
    multipliers, segments and impacts of the orbit, and writes impacts, segments and one period of
    samples as CSV tables and the motion as a figure.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.studies.engine.config import orbit_from

    system = device_system(device, changes)
    arguments = arguments_for(FUNCTION, system)
    with output("orbit") as files:
        orbit: Any = orbit_from(system, **arguments)
        samples = orbit.samples(400)
        files.tables({"impacts": orbit.impacts, "segments": orbit.segments, "samples": samples})
        files.draw(lambda: mi.plot_orbit(orbit).figure)
        _show(orbit)
        files.show()


def _show(orbit: ActuatorOrbit) -> None:
    state = orbit.state
    multipliers = ", ".join(f"{m:.9g}" if m.imag else f"{m.real:.9g}" for m in orbit.multipliers)
    stability = stability_name(orbit.stable)
    closes = f"closes after {orbit.periods} forcing period{'s' if orbit.periods > 1 else ''}"
    components = {"x2": "m", "v2": "m/s", "v1": "m/s"}
    lines = {
        "orbit": OutputValue(stability, text=f"{stability}, {closes}"),
        "forcing period": OutputValue(orbit.period, "s"),
        **{
            name: OutputValue(getattr(state, name), unit, f"{getattr(state, name):.12g}")
            for name, unit in components.items()
        },
        "multipliers": OutputValue(orbit.multipliers, text=multipliers),
        "step": OutputValue(orbit.step, "m"),
        "residual, dimensionless": OutputValue(orbit.residual, text=f"{orbit.residual:.2g}"),
        "method": OutputValue(orbit.options.method),
    }
    show_values(lines, in_units=orbit.system.units.scales.named)
    add_json_values({"periods": OutputValue(orbit.periods)})
    show("")
    add_json_tables({"segments": orbit.segments, "impacts": orbit.impacts})
    for name, table, digits in (
        ("segments", orbit.segments, 9),
        ("impacts", orbit.impacts.drop(columns=["phase"]), 6),
    ):
        if len(table) > MAX_TABLE_ROWS:
            show(f"First of {len(table)} {name}:")
        show_table(
            name, table.head(MAX_TABLE_ROWS), digits=digits, empty_message=f"No {name[:-1]}."
        )
