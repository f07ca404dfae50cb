"""
1. Simulate one run
===================

A frame lies on the ground, held by friction. A block (proof mass) hangs on a spring in the frame, and an
electrode pulls it by a voltage. When the block strikes the stopper, the impact moves the frame forward by a
small step.

A device is a preset or a file, a drive is a waveform, and a run is the simulated motion.
"""

import mems_impact as mi

actuator = mi.load_actuator("zhao2004")  # the paper's device, dimensionless
drive = mi.Sine(amplitude=0.24, omega=0.5)
run = mi.simulate(actuator, drive, periods=300)

# %%
# Statistics cover the second half of the run, after the transient.

print(run.statistics[["impacts per period", "displacement per period", "mean speed"]])

# %%
# Each forcing period has one impact, always with the same step. Tables are pandas, with one row per
# event; these are the last impacts, with the velocity of the block before and after.

print(run.impacts[["t", "stopper", "v2 before", "v2 after", "x1"]].tail(3))

# %%
# In the last four forcing periods the block oscillates between its stoppers, and each impact moves the
# frame.

mi.plot_run(run, first=296).figure.savefig("first_run.png")

# %%
# ``periods`` counts *forcing* periods. The force is proportional to the square of the voltage, so a
# sine without bias forces twice per period of the voltage.

assert abs(drive.period * drive.omega / 3.141592653589793 - 1.0) < 1e-15
assert run.statistics["impacts per period"] == 1.0

# %%
# The same on the command line: ``mems-impact simulate zhao2004 --amplitude 0.24 --omega 0.5``.
# The next tutorial determines the voltages at which the device walks.
