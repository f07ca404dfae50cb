"""`mems-impact simulate`: one run of the actuator."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mems_impact._util.units import si_amount
from mems_impact._util.warning_scopes import collected_warnings
from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, load_subject
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import (
    Output,
    OutputValue,
    add_json_values,
    filled,
    show,
    show_table,
    show_values,
)
from mems_impact.cli.runtime import FAILED

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

FIRST_ROWS = 6

FUNCTION = "mems_impact.analysis.simulate:simulate"


@click.command(cls=Command, short_help="Simulate a device under a voltage.")
@device_options
@function_options(FUNCTION, omit=("until", "keep"))
@click.option(
    "--verify",
    is_flag=True,
    help="Repeat the run by an independent method at tighter tolerances and compare all events.",
)
@click.option(
    "--animate",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Write an animation of the last 6 forcing periods: .mp4, .gif or .html.",
)
@drive_options
@output_options
@click.pass_context
def command(
    ctx: click.Context,
    *,
    device: str,
    changes: dict[str, float],
    verify: bool,
    animate: str | None,
    output: Callable[[str], Output],
) -> None:
    """Simulate DEVICE under a voltage.

    \b
    Examples:
      mems-impact simulate zhao2004 --amplitude 0.24 --omega 0.5 --periods 300
      mems-impact new system
      mems-impact simulate system.py:oscillator --set A=0.7 --periods 300

    Without --drive the voltage is bias + amplitude cos(omega t). The command shows the statistics,
    the first impacts and the first blows (a sequence of impacts that ends in sticking contact is
    one blow), and writes impacts, blows, events and statistics as CSV tables, and the last periods
    of the motion as a figure or, with --animate, as an animation. With --verify the exit status is
    1 if the second run disagrees.

    A system of your own can replace DEVICE: FILE.py:NAME or MODULE:NAME, whose Python code is run,
    or the name of a system that another package adds.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    system = load_subject(device, changes)
    arguments = arguments_for(FUNCTION, system)
    with output("simulate") as files:
        files.moving(animate)
        try:
            run = mi.simulate(system, **arguments)
        except (mi.RunError, mi.Interrupted) as error:
            if isinstance(error.partial, mi.Run):
                with collected_warnings():  # the error says more
                    files.tables(_tables(error.partial))
            raise
        files.tables(_tables(run))
        verification = run.verify() if verify else None
        if verification is not None:
            files.tables({"verification": verification.table})
        files.draw(lambda: mi.plot_run(run).figure)
        files.animate(animate, lambda: mi.animate(run), arguments["progress"])
        _show(run)
        if verification is not None:
            add_json_values({"agrees": OutputValue(verification.agrees)})
            show("Comparison with an independent method:")
            show_table("verification", verification.table, digits=2)
            show(filled(verification.verdict) + "\n")
        files.show()
    if verification is not None and not verification.agrees:
        ctx.exit(FAILED)


def _show(run: mi.Run) -> None:
    from mems_impact.actuator.results import ActuatorRun

    first, last = run.window
    over, unit = (
        ("forcing periods", "")
        if run.system.forced
        else ("times", run.system.units.get("time", ""))
    )
    show(f"Statistics over {over} {first:g} to {last:g}{f' {unit}' if unit else ''}:")
    units = run.statistics.attrs["units"]
    settling = run.settling
    values = {
        str(name): OutputValue(value, units.get(name, ""), settling.text(str(name), value))
        for name, value in run.statistics.items()
    }
    add_json_values(values)
    # Without impacts there is no impact speed: undefined values are omitted.
    defined = run.statistics.drop(["window first", "window last"], errors="ignore").dropna()
    show_values({name: values[name] for name in defined.index})
    add_json_values({"settling": OutputValue(str(settling))})
    if settling.kind != "settled":
        show(filled(f"  {settling}"))
    show("")
    impacts = run.impacts
    if impacts.empty:
        show(f"{filled(_no_impact(run))}\n")
        return
    show(f"First of {len(impacts)} impacts:")
    show_table("impacts", impacts.head(FIRST_ROWS), digits=6)
    if not isinstance(run, ActuatorRun):
        return
    if len(run.blows) == len(impacts):
        show("Each impact is a blow of its own.\n")
    else:
        show(f"First of the {len(run.blows)} blows into which the impacts are grouped:")
        show_table("blows", run.blows.head(FIRST_ROWS), digits=6)


def _no_impact(run: mi.Run) -> str:
    """Return that a run has no impact, for a device with the voltage that would strike."""
    from mems_impact.actuator.design.static_forces import contact_amount
    from mems_impact.actuator.results import ActuatorRun

    if not isinstance(run, ActuatorRun):
        return "No impact."
    half = 0.5 * math.sqrt(run.actuator.k / run.actuator.m2)
    named = run.actuator.scales.named
    where = si_amount(0.5 * half / math.pi, "Hz") if named else f"omega = {half:.4g}"
    return (
        f"No impact. A slowly rising voltage strikes at {contact_amount(run.actuator)}; at half "
        f"the resonance ({where}), or with --initial kicked, less may do."
    )


def _tables(run: mi.Run) -> dict[str, pd.DataFrame]:
    from mems_impact.actuator.results import ActuatorRun

    units = run.statistics.attrs["units"]
    statistics = run.statistics.rename_axis("quantity").reset_index(name="value")
    statistics["unit"] = [units.get(name, "") for name in statistics["quantity"]]
    blows = {"blows": run.blows} if isinstance(run, ActuatorRun) else {}
    return {"impacts": run.impacts, **blows, "events": run.events, "statistics": statistics}
