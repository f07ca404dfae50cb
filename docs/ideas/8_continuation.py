"""
Continuation
============

One more unknown, the parameter, makes a curve of the orbits: it is followed by predicting along its
tangent and correcting across it, so that folds are points like others. On the way *test functions*
are watched whose zeros are the special points: a multiplier at 1 (fold, CF), at -1 (period
doubling, PD), a pair on the unit circle (torus, NS), a margin that is touched (grazing, G).
"""

import numpy as np

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.29, omega=0.45)
orbit = mi.find_orbit(actuator, drive, guess=mi.kicked_state(actuator), transient=300)
branch = mi.continue_orbit(orbit, "amplitude", stop=0.22)
print(branch.special_table[["label", "amplitude", "impacts"]].to_string(index=False))

# %%
# Each special point is located by Newton's method with its condition, to ten digits, not read off
# the nearest point of the branch. At the doubling a multiplier is -1:

(doubling,) = [special for special in branch.special_points if special.label == "PD"]
print(doubling.value, doubling.multipliers.real)
assert np.abs(doubling.multipliers + 1.0).min() < 1e-7

# %%
# There another branch begins, of twice the period. And the voltage of the doubling itself can be
# followed over the frequency: two parameters, one condition, again a curve.

twice = branch.switch(doubling)
mi.plot_branch([branch, twice]).figure.savefig("continuation.png")

curve = mi.continue_curve(doubling, "omega", stop=0.455, back=0.448)
print(curve.table[["omega", "amplitude"]].iloc[[0, -1]])

# %%
# Whatever ends a branch is named in ``branch.ended``, and the orbits found so far are returned.

print(branch.ended)

# %%
# The signature of an orbit, its modes and events in their order, is read off a run, and read anew
# where it changes on the branch: :doc:`/orbits`.
