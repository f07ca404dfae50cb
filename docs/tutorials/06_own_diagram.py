"""
6. Draw its bifurcation diagram
===============================

This tutorial continues a periodic orbit of the previous oscillator over the amplitude of its forcing, compares
the branch with a sweep, and continues a bifurcation in two parameters.
"""

import math

import numpy as np

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v


def gap(mode, t, y, p):
    return p.d - y.x


def rebound(mode, t, y, p):
    return mode, (p.d, -p.e * y.v)


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"c": 0.1, "k": 1.0, "d": 1.0, "e": 0.8, "A": 0.6, "omega": 0.8},
    guards=[mi.Impact("stop", gap, rebound)],
)
orbit = mi.find_orbit(oscillator, transient=300)
branch = mi.continue_orbit(orbit, "A", stop=0.3, back=0.8)
print(branch.special_table[["label", "A", "impacts"]].to_string(index=False))

# %%
# Downwards the orbit doubles its period (PD), and loses its impact in a grazing (G). The grazing has a
# closed form: the amplitude of the linear oscillator equals the gap.

grazing = branch.special_points[-1]
closed = math.sqrt((1.0 - 0.8**2) ** 2 + (0.1 * 0.8) ** 2)
print(grazing.value - closed)
assert grazing.label == "G"
assert abs(grazing.value - closed) < 1e-9

# %%
# ``switch_branch`` continues the orbit of twice the period. Solid lines are stable, dashed lines
# unstable; dots are a sweep.

doubling = branch.special_points[0]
twice = mi.switch_branch(doubling, bounds=(0.3, 0.8))
dots = mi.sweep(
    oscillator, "A", np.linspace(0.3, 0.8, 60), direction="both", transient=150, periods=20
)
mi.plot_branch([branch, twice], sweep=dots).figure.savefig("own_diagram_branch.png")

# %%
# ``continue_curve`` continues a special point in a second parameter, here the doubling over the
# coefficient of restitution.

curve = mi.continue_curve(doubling, "e", stop=0.6, back=0.95)
mi.plot_curve(curve).figure.savefig("own_diagram_curve.png")
print(curve.table[["e", "A"]].iloc[[0, -1]])
assert doubling.label == "PD"
