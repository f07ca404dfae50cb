"""`mems-impact orbit`: one periodic orbit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from mems_impact.cli.drives import drive_from, drive_options
from mems_impact.cli.failures import show_warnings_briefly
from mems_impact.cli.options import (
    Initial,
    actuator_from,
    device_options,
    guess_options,
    orbit_integrator_options,
    output_options,
    state_from,
)
from mems_impact.cli.showing import show_lines, text_of

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorOrbit


@click.command(short_help="Find a periodic orbit and its stability.")
@device_options
@drive_options
@guess_options
@orbit_integrator_options
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    initial: Initial,
    transient: float,
    periods: int | None,
    method: str,
    rtol: float,
    atol: float,
    engine: str,
    output: str,
    figure: str | None,
    no_figure: bool,
) -> None:
    """Find the periodic orbit of DEVICE that a run from the initial state leads to.

    Shows its state, stability, segments and impacts, and writes impacts, segments and one period
    of samples as CSV tables and the motion as a figure.

    \b
    Example:
      mems-impact orbit zhao2004 --amplitude 0.24 --omega 0.5
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.cli.output import Output

    show_warnings_briefly()
    actuator = actuator_from(device, changes)
    drive = drive_from()
    guess = state_from(initial, actuator)
    options = mi.Options(method=method, rtol=rtol, atol=atol, engine=engine)
    with Output(output, figure, no_figure, "orbit") as files:
        orbit = mi.find_orbit(
            actuator, drive, guess=guess, periods=periods, transient=transient, options=options
        )
        samples = orbit.samples(400)
        files.tables({"impacts": orbit.impacts, "segments": orbit.segments, "samples": samples})
        files.draw(lambda: mi.plot_orbit(orbit).figure)
        _show(orbit)
        click.echo(files.said())


def _show(orbit: ActuatorOrbit) -> None:
    state = orbit.state
    multipliers = ", ".join(f"{m:.9g}" if m.imag else f"{m.real:.9g}" for m in orbit.multipliers)
    label = orbit.system.scales.label
    lines = {
        "orbit": f"{'stable' if orbit.stable else 'unstable'}, closes after {orbit.periods} "
        f"forcing period{'s' if orbit.periods > 1 else ''}",
        label("forcing period", "s"): f"{orbit.period:.9g}",
        label("x2", "m"): f"{state.x2:.12g}",
        label("v2", "m/s"): f"{state.v2:.12g}",
        label("v1", "m/s"): f"{state.v1:.12g}",
        "multipliers": multipliers,
        label("step", "m"): f"{orbit.step:.9g}",
        "residual, dimensionless": f"{orbit.residual:.2g}",
        "method": orbit.options.method,
    }
    show_lines(lines)
    click.echo("\n" + text_of(orbit.segments, 9))
    if orbit.impacts.empty:
        click.echo("\nNo impact.\n")
    else:
        shown = orbit.impacts.drop(columns=["phase"])
        click.echo("\n" + text_of(shown, 6) + "\n")
