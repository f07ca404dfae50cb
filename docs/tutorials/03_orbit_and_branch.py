"""
3. Find a periodic orbit and continue its branch
================================================

The walking device has a periodic orbit. ``find_orbit`` computes it, stable or unstable, and
``continue_solution`` continues it over the voltage. The branch explains the switching voltages.
"""

import numpy as np

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
orbit = mi.find_orbit(actuator, drive, transient=300)
print(orbit.stable, abs(orbit.multipliers))
print(orbit.segments[["mode", "start", "end", "ends with"]])

# %%
# Small perturbations grow by the *Floquet multipliers* in each period; if all are below one in
# modulus, the orbit is stable. The phase plane of the block shows the impact as a dashed line:

mi.plot_orbit(orbit, x="x2", y="v2").figure.savefig("orbit_and_branch_orbit.png")

# %%
# Towards lower voltages the branch folds back (CF), continues as an unstable orbit, and loses its
# impact where the orbit grazes the stopper (G).

branch = mi.continue_solution(orbit, "amplitude", stop=0.16)
print(branch.special_table[["label", "amplitude"]].to_string(index=False))

# %%
# The device switches off at the fold, below which no walking orbit exists, and on at the grazing,
# where the orbit without impacts ends. Dots are a sweep up and down.

dots = mi.sweep(
    actuator, drive, "amplitude", np.linspace(0.16, 0.24, 33),
    direction="both", transient=200, periods=5,
)  # fmt: skip
mi.plot_branch(branch, sweep=dots).figure.savefig("orbit_and_branch_branch.png")

fold, grazing = branch.special_points
assert abs(fold.value - 0.17651544063) < 1e-9
assert abs(grazing.value - 0.2271775831) < 1e-9
