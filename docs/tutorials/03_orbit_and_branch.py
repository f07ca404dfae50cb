"""
3. The orbit behind it, and its branch
======================================

What the device does at a voltage is a periodic orbit. It can be found as such, stable or not, and
followed over the voltage: that shows why the device switches where it does.
"""

import numpy as np

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
orbit = mi.find_orbit(actuator, drive, transient=300)
print(orbit.stable, abs(orbit.multipliers))
print(orbit.segments[["mode", "start", "end", "ends with"]])

# %%
# A small deviation changes by the factors of the *Floquet multipliers* in a period; if all are below
# one in modulus, the orbit attracts. The phase plane of the block, with the impact as a dashed line:

mi.plot_orbit(orbit, x="x2", y="v2").figure.savefig("orbit_and_branch_orbit.png")

# %%
# Followed to lower voltages the orbit turns round in a fold (CF), goes on as an unstable orbit, and
# loses its impact where it only grazes the stopper (G).

branch = mi.continue_orbit(orbit, "amplitude", stop=0.16)
print(branch.special_table[["label", "amplitude"]].to_string(index=False))

# %%
# So the device switches off at the fold: below it there is no walking orbit. It switches on at the
# grazing: there the orbit without impacts ends. Dots are a sweep both ways.

dots = mi.sweep(
    actuator, drive, "amplitude", np.linspace(0.16, 0.24, 33),
    direction="both", transient=200, periods=5,
)  # fmt: skip
mi.plot_branch(branch, sweep=dots).figure.savefig("orbit_and_branch_branch.png")

fold, grazing = branch.special_points
assert abs(fold.value - 0.17651544063) < 1e-9
assert abs(grazing.value - 0.2271775831) < 1e-9
