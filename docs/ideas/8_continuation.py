"""
Continuation
============

With the parameter as a further unknown, the orbits form a curve. Pseudo-arclength continuation predicts
along its tangent and corrects across it, so that folds are regular points. Zeros of *test functions* are
the special points: a multiplier at 1 (fold, CF), at -1 (period doubling, PD), a pair on the unit circle
(torus, NS), a margin with a double zero (grazing, G).
"""

import numpy as np

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.29, omega=0.45)
orbit = mi.find_orbit(actuator, drive, guess=mi.kicked_state(actuator), transient=300)
branch = mi.continue_solution(orbit, "amplitude", stop=0.22)
print(branch.special_table[["label", "amplitude", "impacts"]].to_string(index=False))

# %%
# Newton's method locates each special point to ten digits, with its condition as a further equation. At
# the doubling a multiplier is -1:

(doubling,) = [special for special in branch.special_points if special.label == "PD"]
print(doubling.value, doubling.orbit.multipliers.real)
assert np.abs(doubling.orbit.multipliers + 1.0).min() < 1e-7

# %%
# A branch of twice the period begins there. The doubling itself can be continued in voltage and
# frequency: two parameters and one condition give a curve.

twice = mi.switch_branch(doubling)
mi.plot_branch([branch, twice]).figure.savefig("continuation.png")

curve = mi.continue_curve(doubling, "omega", stop=0.455, back=0.448)
print(curve.table[["omega", "amplitude"]].iloc[[0, -1]])

# %%
# ``branch.ended`` states why a branch ends; the orbits up to there are returned.

print(branch.ended)

# %%
# The signature of an orbit, the sequence of its modes and events, comes from a run, and is determined again
# where it changes on the branch: :doc:`/orbits`.
