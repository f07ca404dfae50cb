r"""
Bouncing ball on a vibrating table
==================================

A ball falls on a table that moves as :math:`s = A \cos t`, in laboratory coordinates, with
accelerations in units of gravity. An impact reverses the relative velocity:

.. math:: \ddot x = -1, \qquad \dot x - \dot s \to -e\,(\dot x - \dot s) \ \text{at}\ x = s.

Above a minimum amplitude there is an orbit with one impact per period, at the phase where the
table returns the energy that an impact dissipates. This orbit is born in a fold and leads to chaos
by period doublings. A ball at rest stays at rest as long as :math:`A < 1`; above, the table throws
it up in every period.
"""

import math

import numpy as np

import mems_impact as mi

FLYING, RESTING = mi.modes("flying", "resting")


def table(t, p):
    return p.A * math.cos(t), -p.A * math.sin(t)


def flow(mode, t, y, p):
    if mode == FLYING:
        return y.v, -1.0
    # At rest the ball moves with the table. Where a sweep has just changed A, it relaxes to it.
    s, ds = table(t, p)
    return ds - (y.x - s), -p.A * math.cos(t) - (y.v - ds)


def gap(mode, t, y, p):
    return y.x - table(t, p)[0]


def bounce(mode, t, y, p):
    ds = table(t, p)[1]
    return FLYING, (y.x, ds - p.e * (y.v - ds))


def rest(mode, t, y, p):
    return RESTING, table(t, p)


def pressure(mode, t, y, p):
    return 1.0 - p.A * math.cos(t)


def lift_off(mode, t, y, p):
    return FLYING, table(t, p)


ball = mi.System(
    states=("x", "v"),
    flow=flow,
    period=2.0 * math.pi,
    parameters={"A": 0.8, "e": 0.8},
    guards=[
        mi.Impact("table", gap, bounce, rest=rest, modes=(FLYING,)),
        mi.Guard("lift-off", pressure, lift_off, modes=(RESTING,)),
    ],
    initial={"x": 5.0, "v": 3.0},
)

# %%
# At a small amplitude a chatter sequence ends in sticking contact.

slow = mi.simulate(ball.changed(A=0.3), periods=8)
mi.plot_run(slow, first=0).figure.savefig("bouncing_ball_run.png")

# %%
# At a larger amplitude there is an orbit with one impact per period.

orbit = mi.find_orbit(ball, transient=200)
print(orbit.multipliers)
mi.plot_orbit(orbit).figure.savefig("bouncing_ball_orbit.png")

# %%
# The branch continues through the period doubling (PD) and, downwards, through the fold (CF). A
# third branch holds the orbits of twice the period. Brute force sweeps up from rest and down from
# a bouncing motion.

up = mi.continue_solution(orbit, "A", stop=1.4)
down = mi.continue_solution(orbit, "A", stop=0.2, back=1.4)
(doubling,), (fold,) = up.special_points, down.special_points
twice = mi.switch_branch(doubling, bounds=(1.0, 1.4))

bouncing = mi.find_orbit(
    ball.changed(A=1.2), guess=twice.orbits[-1].state, periods=2, transient=200
)
starts = {"up": mi.State(x=0.2, mode="resting"), "down": bouncing.state}
values = np.linspace(0.2, 1.4, 121)
sweep = mi.sweep(ball, "A", values, direction="both", transient=100, periods=30, initial=starts)
mi.plot_branch([up, down, twice], sweep=sweep).figure.savefig("bouncing_ball_branch.png")

# %%
# Check
# -----
# At the impact the table moves at the speed :math:`\pi (1 - e)/(1 + e)`, which cannot exceed
# :math:`A`. The upper end of stability has a closed form as well (A. C. J.
# Luo and R. P. S. Han, *Nonlinear Dynamics* 10, 1, 1996).

e = ball.parameters["e"]
needed = math.pi * (1.0 - e) / (1.0 + e)
assert abs(fold.value - needed) < 1e-9
assert abs(doubling.value - math.hypot(needed, 2.0 * (1.0 + e**2) / (1.0 + e) ** 2)) < 1e-9
