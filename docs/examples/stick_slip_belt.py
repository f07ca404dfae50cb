r"""
Stick-slip: a mass on a moving belt
===================================

A mass on a spring lies on a belt that moves at the speed :math:`V`. The mass sticks and moves with the
belt until the spring force exceeds the static friction :math:`F_s`; then it slips under the smaller
dynamic friction :math:`F_d` (and weak damping) until it reaches the speed of the belt again:

.. math:: \dot x = V \ \text{(sticks)}, \qquad \ddot x + c\,\dot x + x = F_d \ \text{(slips)}.

The system is autonomous: the period is computed with the limit cycle. With damping there is a belt
speed above which the mass no longer reaches the speed of the belt, and comes to rest.
"""

import math

import numpy as np
import pandas as pd
from scipy.linalg import expm
from scipy.optimize import brentq

import mems_impact as mi

STICKS, SLIPS = mi.modes("sticks", "slips")


def flow(mode, t, y, p):
    return y.v, 0.0 if mode == STICKS else p.F_d - p.c * y.v - y.x


def hold(mode, t, y, p):
    return p.F_s - p.c * p.V - y.x


def lag(mode, t, y, p):
    return p.V - y.v


def slip(mode, t, y, p):
    return SLIPS, (y.x, p.V)


def stick(mode, t, y, p):
    return STICKS, (y.x, p.V)


belt = mi.System(
    states=("x", "v"),
    flow=flow,
    parameters={"V": 0.1, "F_s": 1.0, "F_d": 0.6, "c": 0.1},
    guards=[
        mi.Guard("slips", hold, slip, modes=(STICKS,)),
        mi.Guard("sticks", lag, stick, modes=(SLIPS,)),
    ],
    section=("v", 0.0),
    initial=mi.State(x=0.0, v=0.1, mode="sticks"),
)

# %%
# A run settles to the limit cycle, which is then computed as an orbit.

run = mi.simulate(belt, duration=60)
mi.plot_run(run).figure.savefig("stick_slip_belt_run.png")
cycle = mi.find_orbit(run)
print(cycle.period, cycle.multipliers)
mi.plot_orbit(cycle).figure.savefig("stick_slip_belt_orbit.png")

# %%
# The branch shows the smallest deflection, up to the largest belt speed that the mass can reach
# ("sticks"). Brute force is one run per value.

branches = [mi.continue_solution(cycle, "V", stop=stop) for stop in (0.02, 0.6)]
print(branches[1].special_table[["label", "V"]], branches[1].ended)
dots = []
for V in np.linspace(0.02, 0.6, 59):
    start = mi.State(x=0.0, v=V, mode="sticks")
    settled = mi.simulate(belt.changed(V=V), duration=300.0, initial=start)
    seen = settled.section(1).query("t > 200").assign(V=V)
    dots.append(seen[["V", "x"]])
axes = mi.plot_branch(branches, sweep=pd.concat(dots))
axes.figure.savefig("stick_slip_belt_branch.png")

# %%
# Check
# -----
# Without damping the period is :math:`\pi + 2\,\mathrm{atan2}(V, D) + 2 D / V` with :math:`D =
# F_s - F_d`: a circular arc, and the sticking phase. With damping, the slipping mass spirals
# about its equilibrium; that it returns to the belt speed tangentially is one equation for the
# ratio of :math:`D` to :math:`V`.

p = belt.parameters
D = p["F_s"] - p["F_d"]
undamped = mi.find_orbit(belt.changed(c=0.0), transient=60.0)
period = math.pi + 2.0 * math.atan2(p["V"], D) + 2.0 * D / p["V"]
assert abs(undamped.period - period) < 1e-9


def back(t):
    """Return the state (x - F_d, v)/V a time t before the touch, where v = V and dv/dt = 0."""
    return expm(-t * np.array([[0.0, 1.0], [-1.0, -p["c"]]])) @ [-p["c"], 1.0]


touch = brentq(lambda t: back(t)[1] - 1.0, 3.0, 6.5)
largest = D / (back(touch)[0] + p["c"])
assert abs(branches[1].special_points[0].value - largest) < 1e-9
