r"""
Lorenz system: an unstable cycle in the attractor
=================================================

The Lorenz system models convection by three variables:

.. math::

   \dot x = \sigma (y - x), \qquad \dot y = x (\rho - z) - y, \qquad \dot z = x y - \beta z.

At large :math:`\rho` a symmetric cycle is stable. As :math:`\rho` decreases, the symmetric cycle
loses its stability, but it persists: at :math:`\rho = 28` it is the shortest cycle in the chaotic
attractor, and no simulation shows it.
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
# The cycle is computed where it is stable, and continued down to 28. (Lengths in the step control
# have the units of the states, which are large here.)

cycle = mi.find_orbit(convection, transient=40.0)
branch = mi.continue_solution(cycle, "rho", stop=28.0)
hidden = branch.orbits[-1]
print(hidden.period, hidden.multipliers)
mi.plot_orbit(hidden, x="x", y="z").figure.savefig("lorenz_orbit.png")

# %%
# Brute force, one run per value, is drawn below the branch.

dots = []
for rho in np.linspace(28.0, 350.0, 162):
    run = mi.simulate(convection.changed(rho=rho), duration=30.0)
    dots.append(run.section(1).query("t > 20").assign(rho=rho)[["rho", "z"]])
axes = mi.plot_branch(branch, sweep=pd.concat(dots), quantity="z")
axes.figure.savefig("lorenz_branch.png")

# %%
# Check
# -----
# The periods of the cycles in this attractor are known to many digits (D. Viswanath, *Nonlinearity*
# 16, 1035, 2003). The product of the multipliers is :math:`e^{-(\sigma + 1 + \beta) T}`, since the
# divergence of the flow is constant.

assert abs(hidden.period - 1.5586522107161747) < 1e-9
shrinking = np.exp(-(10.0 + 1.0 + 8.0 / 3.0) * cycle.period)
assert abs(np.prod(cycle.multipliers).real - shrinking) < 1e-9
