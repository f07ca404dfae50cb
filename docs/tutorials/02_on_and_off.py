"""
2. On and off: a sweep of the voltage
=====================================

The same voltage may leave the device at rest or let it walk; it depends on where the motion comes
from. A sweep changes the voltage slowly, up and down, and shows both.
"""

import numpy as np

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
between = drive.replace(amplitude=0.2)

from_rest = mi.simulate(actuator, between, periods=300)
strong = mi.simulate(actuator, drive, periods=300)
walking = mi.simulate(actuator, between, periods=300, initial=strong.final)
print(from_rest.statistics["impacts per period"], walking.statistics["impacts per period"])
assert from_rest.statistics["impacts"] == 0
assert walking.statistics["impacts per period"] == 1.0

# %%
# Each value of a sweep starts from the last state of the one before. Upwards it starts at rest,
# downwards with a kick.

table = mi.sweep(
    actuator, drive, "amplitude", np.linspace(0.16, 0.24, 33),
    direction="both", transient=200, periods=20,
)  # fmt: skip
mi.plot_sweep(table).figure.savefig("on_and_off.png")

# %%
# The summary has one row a value. From it follows the lowest voltage with impacts, either way.

summary = mi.sweep_summary(table)
on = summary[summary["impacting"]].groupby("direction")["amplitude"].min()
print(on)

# %%
# Between 0.1765 and 0.2272 the device is *on* or *off* as it was before. A sweep knows these
# voltages to its spacing, 0.0025 here. The next page knows them to ten digits, and why it is so.

assert np.isclose(on["up"], 0.2275)
assert np.isclose(on["down"], 0.1775)
