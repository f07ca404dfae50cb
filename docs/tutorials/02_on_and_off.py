"""
2. Sweep the voltage: on and off
================================

At some voltages two attractors coexist: the device rests or walks, depending on the initial state. A
sweep varies the voltage slowly, up and down, and shows this hysteresis.
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
# Each value of a sweep starts from the last state of the previous value. The sweep up starts at rest,
# the sweep down with a kick.

sweep = mi.sweep(
    actuator, drive, "amplitude", np.linspace(0.16, 0.24, 33),
    direction="both", transient=200, periods=20,
)  # fmt: skip
mi.plot_sweep(sweep).figure.savefig("on_and_off.png")

# %%
# The statistics have one row per value. The lowest voltage with impacts in each direction follows.

on = sweep.statistics.query("impacting").groupby("direction")["amplitude"].min()
print(on)

# %%
# Between 0.1765 and 0.2272 the device stays *on* or *off*. A sweep resolves these voltages to its
# spacing, here 0.0025. The next tutorial computes them to ten digits, and explains the hysteresis.

assert np.isclose(on["up"], 0.2275)
assert np.isclose(on["down"], 0.1775)
