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

    Under a slowly rising voltage, the block snaps to the right stopper at the pull-in voltage. The
    block stays there until the voltage falls below the resting voltage. The resonance is the
    frequency of the block in a fixed frame. A comb drive has no pull-in. For a device with a
    charge drive, the command shows the pull-in charge and the resonance.
    """  # noqa: D301 - click looks for the backspace itself
    from mems_impact.actuator.design.estimates import pull_in_charge
    from mems_impact.actuator.design.targets import OF_DEVICE
    from mems_impact.actuator.terms.base import drive_unit
    from mems_impact.errors import InvalidParameter

    actuator = actuator_from(device, changes)
    in_units = actuator.scales.named
    values, reason = {}, ""
    quantities = OF_DEVICE
    if drive_unit(actuator.terms) == "C":
        quantities = {"pull-in charge": (pull_in_charge, "C"), "resonance": OF_DEVICE["resonance"]}
    for name, (compute, unit) in quantities.items():
        try:
            values[name] = OutputValue(compute(actuator), unit)
        except InvalidParameter as error:
            if not name.startswith("pull-in"):
                raise
            reason = error.problem or str(error)
    if in_units:
        values["resonance frequency"] = OutputValue(
            values["resonance"].value / (2.0 * math.pi), "Hz"
        )
    if reason:
        show(filled(reason.replace("resting_voltage", "the resting voltage")))
    show_values(values, in_units=in_units)
