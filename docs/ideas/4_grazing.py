"""
Grazing
=======

An orbit *grazes* where it touches a stopper at zero velocity. A slightly larger orbit strikes the stopper,
and even the weakest impact changes the dynamics: the map over one period has a square root there,

.. math:: x_{n+1} - x^* \\approx -\\beta\\sqrt{x_n - x^*} + \\ldots

so that its slope is unbounded (Nordmark, 1991). A grazing may therefore end an attractor abruptly, or
lead directly to chaos.
"""

import math

import numpy as np

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"c": 0.1, "k": 1.0, "d": 1.0, "e": 0.8, "A": 0.3, "omega": 0.8},
    parts=[mi.Stopper("stop", "x", "v", upper="d", restitution="e")],
)
quiet = mi.find_orbit(oscillator, transient=200)

# %%
# The orbit without impacts ends where its largest deflection equals the gap. The branch continues as an
# orbit with one impact, unstable at first, since the square root makes the largest multiplier unbounded at the
# grazing. The orbit becomes stable at a period doubling (PD), far away.

branch = mi.continue_solution(quiet, "A", stop=0.6, back=0.3)
grazing = branch.special_points[0]
print(grazing.label, grazing.value, grazing.type)
assert abs(grazing.value - math.hypot(1.0 - 0.8**2, 0.1 * 0.8)) < 1e-10

# %%
# A sweep shows the attractors beyond the orbit without impacts.

dots = mi.sweep(
    oscillator, "A", np.linspace(0.32, 0.44, 61), direction="both", transient=150, periods=20
)
mi.plot_branch(branch, sweep=dots).figure.savefig("grazing.png")

# %%
# This oscillator is the demo ``impact`` of COCO (MATLAB). With larger amplitudes the orbit with one impact
# grazes in turn, and continues with two.

longer = mi.continue_solution(quiet, "A", stop=3.0, back=0.1)
print(longer.special_table[["label", "A", "impacts"]])
assert [special.label for special in longer.special_points[:3]] == ["G", "PD", "G"]

# %%
# The type of a grazing states how the attractor changes: continuously, with a jump, or not at all, if the
# stable orbit ends in a fold before. The points of codimension two between these types separate
# the paper's types I, II and III: :doc:`/orbits`.
