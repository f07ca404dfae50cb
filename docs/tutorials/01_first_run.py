"""
1. One run, impact by impact
============================

A frame lies on the ground, held by friction. In it a block hangs on a spring, and an electrode in
the frame pulls it by a voltage. Where the block strikes the stopper, the blow throws the frame
forward by a small step.

A device is a preset or a file, a drive is a waveform, and a run is the motion that follows from both.
"""

import mems_impact as mi

actuator = mi.load_actuator("zhao2004")  # the paper's device, without units
drive = mi.Sine(amplitude=0.24, omega=0.5)
run = mi.simulate(actuator, drive, periods=300)

# %%
# Statistics are those of the second half of the run, when it has settled.

print(run.statistics[["impacts per period", "displacement per period", "mean speed"]])

# %%
# There is one impact in each forcing period, always with the same step. Tables are pandas, with one
# row an event; these are the last impacts, with the velocity of the block before and after.

print(run.impacts[["t", "stopper", "v2 before", "v2 after", "x1"]].tail(3))

# %%
# In the last four forcing periods the block swings between its stoppers, and each blow moves the
# frame.

mi.plot_run(run, first=296).figure.savefig("first_run.png")

# %%
# ``periods`` counts *forcing* periods. The force goes with the square of the voltage, so that a
# sine without bias forces twice in its own period.

assert abs(drive.period * drive.omega / 3.141592653589793 - 1.0) < 1e-15
assert run.statistics["impacts per period"] == 1.0

# %%
# The same on the command line: ``mems-impact simulate zhao2004 --amplitude 0.24 --omega 0.5``.
# Next: for which voltages does it walk?
