r"""
Two-stop rattler: a ball in a driven box
========================================

A lightly damped box on a spring is forced at its resonance. A ball of mass ratio *m* flies
between its two walls, at the clearance *d*, and every impact dissipates energy. Such impact
dampers reduce vibrations of chimneys and turbine blades.

.. math:: \ddot x + 2 \zeta \dot x + x = \cos \omega t, \qquad \ddot z = 0 .

At the best clearance the ball strikes each wall once per period, symmetrically. A smaller clearance
leads to more impacts; at a larger one the orbit loses stability at a Neimark-Sacker point (NS), and
the amplitude is modulated. A chatter sequence ends with the ball resting on a wall until the box
recedes.
"""

import math

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

import mems_impact as mi

LOOSE, LEFT, RIGHT = mi.modes("loose", "left", "right")


def drive(t, y, p):
    return math.cos(p.omega * t) - 2.0 * p.zeta * y.v - y.x


def flow(mode, t, y, p):
    if mode == LOOSE:
        return y.v, drive(t, y, p), y.w, 0.0
    together = drive(t, y, p) / (1.0 + p.m)
    return y.v, together, y.w, together


def gap_left(mode, t, y, p):
    return y.z - y.x + 0.5 * p.d


def gap_right(mode, t, y, p):
    return 0.5 * p.d - (y.z - y.x)


def strike(mode, t, y, p):
    blow = (1.0 + p.e) * (y.w - y.v) / (1.0 + p.m)
    return LOOSE, (y.x, y.v + p.m * blow, y.z, y.w - blow)


def lie_left(mode, t, y, p):
    v = (y.v + p.m * y.w) / (1.0 + p.m)
    return LEFT, (y.x, v, y.x - 0.5 * p.d, v)


def lie_right(mode, t, y, p):
    v = (y.v + p.m * y.w) / (1.0 + p.m)
    return RIGHT, (y.x, v, y.x + 0.5 * p.d, v)


def pressure(mode, t, y, p):
    return drive(t, y, p) if mode == LEFT else -drive(t, y, p)


def leave(mode, t, y, p):
    return LOOSE, (y.x, y.v, y.z, y.w)


box = mi.System(
    states=("x", "v", "z", "w"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"omega": 1.0, "zeta": 0.05, "m": 0.1, "e": 0.7, "d": 18.0},
    guards=[
        mi.Impact("left wall", gap_left, strike, rest=lie_left, modes=(LOOSE,)),
        mi.Impact("right wall", gap_right, strike, rest=lie_right, modes=(LOOSE,)),
        mi.Guard("leaves", pressure, leave, modes=(LEFT, RIGHT)),
    ],
    initial={"v": 1.0, "w": 2.0},
)

# %%
# In the run, the ball starts in the middle and moves to the right.

run = mi.simulate(box, periods=400)
mi.plot_run(run, first=0, last=40, states=["x", "z"]).figure.savefig("two_stop_rattler_run.png")

# %%
# The figure shows the orbit in the phase plane of the box.

orbit = mi.find_orbit(run)
print(orbit.multipliers)
mi.plot_orbit(orbit).figure.savefig("two_stop_rattler_orbit.png")

# %%
# Two branches start from this clearance, one in each direction; dots are brute force.

up = mi.continue_solution(orbit, "d", stop=32.0, steps=mi.StepControl(max_points=140))
down = mi.continue_solution(orbit, "d", stop=6.0)
print(up, down, sep="\n")
sweep = mi.sweep(box, "d", np.linspace(6.0, 30.0, 121), transient=200, periods=30)
mi.plot_branch([up, down], sweep=sweep).figure.savefig("two_stop_rattler_branch.png")

# %%
# Check
# -----
# One half period of this orbit mirrors the other, which gives it a closed form (S. F. Masri and T.
# K. Caughey, *Journal of Applied Mechanics* 33, 586, 1966). The ball leaves the right wall, where
# the box is at :math:`x_0`, at the speed :math:`w`, and reaches the left one after half a period,
# in which the box moves from :math:`(x_0, v)` to :math:`(-x_0, v')`. Momentum, restitution and
# flight give :math:`w, v, v'`, and the deviation from the forced motion is a free oscillation of the
# box. The remaining equation for :math:`x_0` is quadratic; the fold (CF) is its double root.

p = box.parameters
half = math.pi / p["omega"]
free = expm(half * np.array([[0.0, 1.0], [-1.0, -2.0 * p["zeta"]]]))


def forced(d, x):
    """Return the forced part of (x, v) just after the ball has left the right wall."""
    w = -(2.0 * x + d) / half
    v = w * (1.0 - p["e"] - 2.0 * p["m"] * p["e"]) / (1.0 + p["e"])
    before = -v - 2.0 * p["m"] * w
    return np.linalg.solve(np.eye(2) + free, free @ [x, v] + [x, -before])


def quadratic(d):
    """Return the coefficients of |forced|^2 - |response|^2 as a polynomial of x."""
    at, slope = forced(d, 0.0), forced(0.0, 1.0)
    size = np.array([1.0, 1.0 / p["omega"] ** 2])
    response = (1.0 - p["omega"] ** 2) ** 2 + (2.0 * p["zeta"] * p["omega"]) ** 2
    return size @ slope**2, 2.0 * size @ (slope * at), size @ at**2 - 1.0 / response


def turning(d):
    a, b, c = quadratic(d)
    return b**2 - 4.0 * a * c


places = np.roots(quadratic(p["d"]))
assert np.allclose(orbit.impacts["x after"].abs(), places.max(), rtol=1e-9)
(fold,) = (found for found in up.special_points if found.label == "CF")
assert abs(fold.value - brentq(turning, 25.0, 35.0)) < 1e-8
