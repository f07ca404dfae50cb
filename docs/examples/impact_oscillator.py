r"""
Impact oscillator: period adding after a grazing
================================================

A heavily damped, forced mass on a spring has a stop at :math:`x = 1`:

.. math::

   \ddot x + c\,\dot x + x = A \cos \omega t, \qquad \dot x \to -e\,\dot x \ \text{at}\ x = 1.

At :math:`A = A_G` the motion without impacts grazes the stop. Beyond it every impact throws the
mass off the old orbit, and the deviation decays by the factor :math:`\lambda = e^{-T/2}` per
period. The number of periods until the next impact grows as :math:`A` approaches :math:`A_G`. So
windows of orbits with one impact in 6, 5, 4, … periods follow one another, with chaos between
them: period adding.
"""

import math

import numpy as np
from scipy.linalg import expm

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.c * y.v - y.x


def gap(mode, t, y, p):
    return 1.0 - y.x


def strike(mode, t, y, p):
    return mode, (1.0, -p.e * y.v)


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"A": 24.0, "omega": 4.5, "c": 2.5, "e": 0.8},
    guards=[mi.Impact("stop", gap, strike)],
)

# %%
# At this amplitude every fifth period has an impact.

run = mi.simulate(oscillator, periods=200)
mi.plot_run(run, first=190).figure.savefig("impact_oscillator_run.png")

# %%
# The orbit has these multipliers and this impact.

five = mi.find_orbit(run, periods=5)
print(five.multipliers)
print(five.impacts[["time", "v before", "v after"]])
mi.plot_orbit(five).figure.savefig("impact_oscillator_orbit.png")

# %%
# Branches over brute force: the orbit that grazes (G), and the orbits with one impact in 4, 5 and 6
# periods, continued downwards from the upper end of their windows. At the lower end their period
# doubles (PD); the unstable orbits continue to the grazing, where all of them begin.

silent = mi.find_orbit(oscillator.changed(A=21.5), transient=100)
branches = [mi.continue_solution(silent, "A", stop=22.5, back=21.5)]
for periods, A in ((4, 27.0), (5, 24.8), (6, 22.88)):
    settled = mi.simulate(oscillator.changed(A=A), periods=300)
    orbit = mi.find_orbit(settled, periods=periods)
    branches.append(mi.continue_solution(orbit, "A", stop=22.29))
    print(periods, branches[-1].special_table[["label", "A", "impact speed"]])

sweep = mi.sweep(oscillator, "A", np.linspace(21.5, 27.0, 221), transient=100, periods=60)
mi.plot_branch(branches, sweep=sweep).figure.savefig("impact_oscillator_branch.png")

# %%
# Check
# -----
# Between impacts the motion is linear. So :math:`A_G` has a closed form, and so has the impact speed
# :math:`v` of an orbit with one impact in *n* periods (S. W. Shaw and P. J. Holmes,
# *Journal of Sound and Vibration* 90, 129, 1983): the free part :math:`h` of the motion leads from
# :math:`(1 - P, -e v - \dot P)` to :math:`(1 - P, v - \dot P)`, where the forced part :math:`P` at
# the impact satisfies :math:`P^2 + \dot P^2 / \omega^2 = (A / A_G)^2`.

p = oscillator.parameters
grazing = math.hypot(1.0 - p["omega"] ** 2, p["c"] * p["omega"])
assert abs(branches[0].special_points[0].value / grazing - 1.0) < 1e-10

free = expm(5 * five.period * np.array([[0.0, 1.0], [-1.0, -p["c"]]]))
h, dP = np.linalg.solve(np.eye(2) - free, free @ [0.0, -p["e"]] - [0.0, 1.0]) * [1.0, -1.0]
# In multiples of v: (1 - h v)^2 + (dP v / omega)^2 = (A / A_G)^2
roots = np.roots([h**2 + (dP / p["omega"]) ** 2, -2.0 * h, 1.0 - (p["A"] / grazing) ** 2])
assert abs(five.impacts["v before"][0] - roots.max()) < 1e-9

# %%
# The windows shrink towards the grazing by :math:`\lambda^2`, since the deviation after an impact
# is proportional to the square root of :math:`A - A_G`.

doublings = [branch.special_points[0].value - grazing for branch in branches[1:]]
print(np.divide(doublings[1:], doublings[:-1]), math.exp(-five.period))
assert np.allclose(np.divide(doublings[1:], doublings[:-1]), math.exp(-five.period), rtol=0.03)
