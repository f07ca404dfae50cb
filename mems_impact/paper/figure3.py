"""Fig. 3: the real device, driven slowly: displacement per blow over the voltage."""

from __future__ import annotations

import math

import numpy as np

from mems_impact.actuator.design.estimates import pull_in_voltage
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.impacts import blows
from mems_impact.actuator.parameters import Actuator
from mems_impact.actuator.results import ActuatorRun
from mems_impact.actuator.verbs import simulate
from mems_impact.paper import tables
from mems_impact.paper.displacement import plot_displacement
from mems_impact.paper.outcome import Devices, Effort, Outcome

VOLTS, HERTZ = 100.0, 1.0
WAIT, MEASURE = 2, 4  # forcing periods


def compute(devices: Devices, effort: Effort) -> Outcome:
    """Return displacement per blow over the voltage, and one cycle of the voltage."""
    device = devices.real
    pull_in = pull_in_voltage(device)
    above = np.geomspace(1.002 * pull_in, 1.5 * VOLTS, effort.of(60, 12))
    volts = np.unique(np.concatenate([[0.5 * pull_in, 0.998 * pull_in], above, [VOLTS]]))
    rows = []
    for hertz in (HERTZ, 0.1 * HERTZ, 10.0 * HERTZ):
        for amplitude in volts.tolist():
            found = blows(_run(device, amplitude, hertz))
            rows.append((hertz, amplitude, found.displacement_per_blow, found.per_period))
    table = tables.displacement(rows)
    run = _run(device, VOLTS, HERTZ)
    at = blows(run)
    cycle = 2.0 * math.pi / (2.0 * math.pi * HERTZ) / run.drive.period  # in forcing periods
    quasi = table.loc[(table.iloc[:, 0] == 0.1 * HERTZ) & (table.iloc[:, 2] > 0.0)].iloc[0, 2]
    return Outcome(
        values={
            "3.displacement": at.displacement_per_blow * 1e9,
            "3.two-impacts": at.per_period * cycle,
        },
        tables={"displacement": table, "impacts": run.impacts},
        draw=lambda: plot_displacement(table, run, pull_in)[0].figure,
        notes=(
            f"Below pull-in ({pull_in:.1f} V) the block never reaches the stopper. Pulled in "
            f"infinitely slowly it would strike with a speed that the voltage of the drive has no "
            f"part in ({quasi * 1e9:.1f} nm just above pull-in at 0.1 Hz). The faster the voltage "
            "rises through pull-in, the more it has risen by the time the block arrives: that is "
            "why the displacement grows with the amplitude, and with the frequency.",
            "The paper's Fig. 3 is missing from the text at hand: its curve cannot be compared, "
            "only the numbers beside it.",
        ),
    )


def _run(device: Actuator, amplitude: float, hertz: float) -> ActuatorRun:
    drive = Sine(amplitude=amplitude, omega=2.0 * math.pi * hertz)
    return simulate(device, drive, WAIT + MEASURE, window=(WAIT, WAIT + MEASURE))
