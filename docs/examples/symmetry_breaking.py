r"""
Two stops: a symmetry breaks
============================

A linear oscillator is driven between two rigid stops, at :math:`x = \pm 1`, with the restitution
:math:`e`:

.. math:: \ddot x + 2 \zeta \dot x + x = A \cos \omega t .

The system is symmetric under :math:`(x, \dot x, t) \to (-x, -\dot x, t + T/2)`, half a forcing period
later. At large amplitudes a symmetric orbit, with one impact on each stop, is stable. At smaller
ones it loses its stability at a branch point (BP), a pitchfork, where two asymmetric orbits
bifurcate. Each is the image of the other. At a grazing (G), each loses the impact on one of the stops;
at another grazing, where both branches meet, the motion becomes free of impacts.
"""

import math

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.linalg import expm
from scipy.optimize import brentq

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - 2.0 * p.zeta * y.v - y.x


def gap_right(mode, t, y, p):
    return 1.0 - y.x


def gap_left(mode, t, y, p):
    return 1.0 + y.x


def strike(mode, t, y, p):
    return mode, (y.x, -p.e * y.v)


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"A": 0.69, "omega": 0.7, "zeta": 0.05, "e": 0.7},
    guards=[
        mi.Impact("right stop", gap_right, strike),
        mi.Impact("left stop", gap_left, strike),
    ],
    section=("x", 0.0),
    initial={"v": 1.0},
)

# %%
# In the run, the impacts on the two stops become unequal.

run = mi.simulate(oscillator, periods=60)
mi.plot_run(run, first=0, last=12, states=["x", "v"]).figure.savefig("symmetry_breaking_run.png")

# %%
# ``symmetries`` finds the symmetry of the system, and ``image`` the partner of this orbit. Both orbits
# are stable; the initial state decides which orbit the motion approaches.

orbit = mi.find_orbit(run)
(symmetry,) = mi.symmetries(orbit)
partner = symmetry.image(orbit)
print(symmetry, orbit.multipliers, partner.multipliers, sep="\n")
with mi.style():
    figure = Figure(figsize=(5.0, 2.6), layout="constrained")
    for panel, each in zip(figure.subplots(1, 2), (orbit, partner), strict=True):
        mi.plot_orbit(each, panel, x="x", y="v").set_ylim(-0.9, 0.9)
figure.savefig("symmetry_breaking_orbit.png")

# %%
# The symmetric branch is continued from a large amplitude. At the branch point, ``switch_branch``
# starts the branch with both asymmetric halves. Dots are brute force, from two initial states that
# are images of each other.

symmetric = mi.find_orbit(oscillator.changed(A=0.82), transient=200)
branch = mi.continue_solution(symmetric, "A", stop=0.53)
(fork,) = (special for special in branch.special_points if special.label == "BP")
halves = mi.switch_branch(fork, bounds=(0.42, 0.82))
print(branch, halves, halves.symmetry, sep="\n")

values = np.linspace(0.82, 0.42, 161)
dots = [
    mi.sweep(oscillator, "A", values, transient=100, periods=10, initial=orbit.state).table
    for orbit in (halves.orbits[0], halves.orbits[-1])
]
axes = mi.plot_branch([branch, halves], sweep=pd.concat(dots), quantity="v")
axes.figure.savefig("symmetry_breaking_branch.png")

# %%
# Check
# -----
# Half a period of the symmetric orbit, mirrored, is a map with a fixed point, and this has a closed
# form (S. W. Shaw, *Journal of Applied Mechanics* 52, 453, 1985). After the impact on the right
# stop, at :math:`(1, -e v)`, the motion is a forced part :math:`f` and a free one; half a period
# later it reaches :math:`(-1, -v)`, with the forced part :math:`-f`. The symmetry breaks where a
# multiplier of the mirrored half period is -1.

p = oscillator.parameters
zeta, omega, e = p["zeta"], p["omega"], p["e"]
free = expm(math.pi / omega * np.array([[0.0, 1.0], [-1.0, -2.0 * zeta]]))


def forced(v):
    part = np.linalg.solve(np.eye(2) + free, [0.0, -(1.0 + e) * v])
    return np.array([1.0, -e * v]) - part


def critical(A):
    """Return the characteristic polynomial of the mirrored half period at -1."""
    size = A / abs(1.0 - omega**2 + 2j * zeta * omega)
    v = brentq(lambda v: math.hypot(forced(v)[0], forced(v)[1] / omega) - size, 0.3, 1.0)
    x, rate = forced(v)
    drive = -((1.0 - omega**2) * x + 2.0 * zeta * rate)
    before, after = drive + 2.0 * zeta * v + 1.0, drive - 2.0 * zeta * e * v + 1.0
    impact = np.array([[-e, 0.0], [-(after + e * before) / v, -e]])
    return np.linalg.det(np.eye(2) - impact @ free)


assert abs(fork.value - brentq(critical, 0.7, 0.75)) < 1e-10
