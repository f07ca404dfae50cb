"""`mems-impact pull-in`: pull-in voltage, resting voltage and resonance."""

from __future__ import annotations

import math

import click

from mems_impact.cli.options import actuator_from, device_options
from mems_impact.cli.output import OutputValue, filled, show, show_values


@click.command("pull-in", short_help="Compute pull-in voltage, resting voltage and resonance.")
@device_options
def command(*, device: str, changes: dict[str, float]) -> None:
    """Compute pull-in voltage, resting voltage and resonance of DEVICE from its parameters.

    \b
    Example:
      mems-impact pull-in mita2003

    Under a slowly rising voltage, the block snaps to the right stopper at the pull-in voltage. It
    stays there until the voltage falls below the resting voltage. The resonance is that of the
    block in a fixed frame. A comb drive has no pull-in.
    """  # noqa: D301 - click looks for the backspace itself
    from mems_impact.actuator.design.fit import OF_DEVICE
    from mems_impact.errors import InvalidParameter

    actuator = actuator_from(device, changes)
    named = actuator.scales.named
    values, reason = {}, ""
    for name, (compute, unit) in OF_DEVICE.items():
        try:
            values[name] = OutputValue(compute(actuator), unit)
        except InvalidParameter as error:
            if name != "pull-in voltage":
                raise
            reason = error.problem or str(error)
    if named:
        values["resonance frequency"] = OutputValue(
            values["resonance"].value / (2.0 * math.pi), "Hz"
        )
    if reason:
        show(filled(reason.replace("resting_voltage", "the resting voltage")))
    show_values(values, named=named)
