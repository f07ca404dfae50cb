r"""
Lorenz system: an unstable cycle in the attractor
=================================================

The Lorenz system is a model of convection in three numbers:

.. math::

   \dot x = \sigma (y - x), \qquad \dot y = x (\rho - z) - y, \qquad \dot z = x y - \beta z.

At a large :math:`\rho` there is a symmetric cycle that attracts. On the way down it loses its
symmetry and its stability, but it goes on: at :math:`\rho = 28` it is the shortest of the cycles
in the chaotic attractor, which no run would show.
"""

import numpy as np
import pandas as pd

import mems_impact as mi


def flow(mode, t, y, p):
    return p.sigma * (y.y - y.x), y.x * (p.rho - y.z) - y.y, y.x * y.y - p.beta * y.z


convection = mi.System(
    states=("x", "y", "z"),
    flow=flow,
    parameters={"sigma": 10.0, "rho": 350.0, "beta": 8.0 / 3.0},
    section=("x", 0.0),
    initial={"x": 10.0, "y": 10.0, "z": 300.0},
)

# %%
# A run at the usual :math:`\rho = 28` is chaotic.

chaos = mi.simulate(convection.changed(rho=28.0), duration=30.0, initial={"x": 1.0, "z": 20.0})
mi.plot_run(chaos, states=["x", "z"]).figure.savefig("lorenz_run.png")

# %%
# The cycle is found where it attracts, and followed down to 28. (Steps are lengths in the units of
# the states, which are large here.)

cycle = mi.find_orbit(convection, transient=40.0)
steps = mi.StepControl(initial=0.1, largest=8.0)
branch = mi.continue_orbit(cycle, "rho", stop=28.0, steps=steps)
hidden = branch.orbits[-1]
print(hidden.period, hidden.multipliers)
mi.plot_orbit(hidden, x="x", y="z").figure.savefig("lorenz_orbit.png")

# %%
# Brute force, a run at each value, is drawn below the branch.

dots = []
for rho in np.linspace(28.0, 350.0, 162):
    run = mi.simulate(convection.changed(rho=rho), duration=30.0)
    dots.append(run.section(1).query("t > 20").assign(rho=rho)[["rho", "z"]])
axes = mi.plot_branch(branch, sweep=pd.concat(dots), quantity="z")
axes.figure.savefig("lorenz_branch.png")

# %%
# Check
# -----
# Periods of this attractor's cycles are known to many digits (D. Viswanath, *Nonlinearity* 16,
# 1035, 2003); the multipliers' product is :math:`e^{-(\sigma + 1 + \beta) T}`, since the flow
# shrinks volumes evenly.

assert abs(hidden.period - 1.5586522107161747) < 1e-9
shrinking = np.exp(-(10.0 + 1.0 + 8.0 / 3.0) * cycle.period)
assert abs(np.prod(cycle.multipliers).real - shrinking) < 1e-9
