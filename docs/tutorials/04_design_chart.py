"""
4. Compute the operating chart
==============================

The fold and the grazing of the previous tutorial, continued over the frequency, bound the region in which the
device walks: its operating chart, Fig. 7 of the paper. This tutorial computes the chart, and design
quantities at one point of it.
"""

import numpy as np

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
chart = mi.operating_chart(actuator, drive, omega=(0.475, 0.505), crises=0)
print(chart.types.to_string(index=False))
mi.plot_chart(chart).figure.savefig("design_chart.png")

# %%
# Right of 0.488 the device switches on with a jump, and off at a lower voltage (type I); it keeps its
# state during a dip of the voltage. Between 0.480 and 0.488 it switches on and off at the same
# voltage (type II).
#
# At omega = 0.5, the window of stable period-one walking, and the bifurcation at each end:

window = mi.period_one_window(actuator, drive, (0.16, 0.3))
print(f"{window.low:.4f} ({window.low_kind}) to {window.high:.4f} ({window.high_kind})")

# %%
# "bound" is the bound of the search, beyond which the orbit exists.

# %%
# Speed and steps over that window, and the finest step, the resolution of the device:

speeds = mi.characteristic(
    actuator, drive, "amplitude", np.linspace(0.18, 0.25, 8), direction="down"
)
print(speeds.table[["amplitude", "displacement per blow", "mean speed"]].to_string(index=False))
print(f"finest step {speeds.resolution():.2e}")

# %%
# The tornado chart shows the elasticities of the speed: its change in per cent for one per cent of each
# parameter.

orbit = mi.find_orbit(actuator, drive, transient=300)
mi.plot_sensitivity(mi.sensitivity(orbit), "mean speed").figure.savefig("design_chart_tornado.png")

assert window.low_kind == "fold"
assert list(chart.types["type"]) == ["III", "II", "I"]
