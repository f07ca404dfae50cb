r"""
Van der Pol oscillator: a smooth limit cycle
============================================

A classical limit cycle arises from damping that is negative at small amplitudes and positive at
large ones,

.. math:: \ddot x - \mu\,(1 - x^2)\,\dot x + x = 0.

For small :math:`\mu` the cycle is a circle of radius 2 with the period :math:`2 \pi`; for large
:math:`\mu` it is a relaxation oscillation. The system is smooth and autonomous, and the period is
computed with the cycle.
"""

import math

import numpy as np
import pandas as pd

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.mu * (1.0 - y.x**2) * y.v - y.x


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    parameters={"mu": 1.0},
    section=("x", 0.0),
    initial={"x": 0.1},
)

# %%
# The run begins near the equilibrium.

run = mi.simulate(oscillator, duration=40.0)
mi.plot_run(run).figure.savefig("van_der_pol_run.png")

# %%
# The motion settles to the limit cycle.

cycle = mi.find_orbit(run)
print(cycle.period, cycle.multipliers)
mi.plot_orbit(cycle).figure.savefig("van_der_pol_orbit.png")

# %%
# The branch shows the speed at :math:`x = 0`. Brute force is one run per value.

branches = [mi.continue_solution(cycle, "mu", stop=stop) for stop in (0.05, 6.0)]
dots = []
for mu in np.linspace(0.1, 6.0, 60):
    settled = mi.simulate(oscillator.changed(mu=mu), duration=150.0)
    dots.append(settled.section(1).tail(2).assign(mu=mu)[["mu", "v"]])
axes = mi.plot_branch(branches, sweep=pd.concat(dots), quantity="v")
axes.figure.savefig("van_der_pol_branch.png")

# %%
# Check
# -----
# The period at :math:`\mu = 1` is known to many digits, 6.66328686, and at a small :math:`\mu` its
# frequency is a power series (C. M. Andersen and J. F. Geer, *SIAM Journal on Applied Mathematics*
# 42, 678, 1982). By Liouville's formula the multiplier is the exponential of the integral of
# :math:`\mu (1 - x^2)` over the cycle.

assert abs(cycle.period - 6.66328686) < 1e-8

mu = 0.2
series = 1.0 - mu**2 / 16.0 + 17.0 * mu**4 / 3072.0 + 35.0 * mu**6 / 884736.0
small = mi.find_orbit(oscillator.changed(mu=mu), transient=200.0)
assert abs(small.period * series - 2.0 * math.pi) < 1e-8

x = cycle.samples(2000)["x"].to_numpy()[:-1]
assert abs(np.log(cycle.multipliers[0].real) - np.mean(1.0 - x**2) * cycle.period) < 1e-7
