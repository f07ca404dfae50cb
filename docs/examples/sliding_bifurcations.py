r"""
Sliding bifurcations of a friction oscillator
=============================================

A block on a spring slides with Coulomb friction under two harmonics of a force
:math:`F(t) = A \cos \omega t + B \sin 2 \omega t`:

.. math:: \ddot x + x + \operatorname{sgn} \dot x = F(t).

At :math:`\dot x = 0` it sticks while the load :math:`r = F - x` lies within :math:`|r| \le 1`. At
:math:`r = 1` the field of forward motion is tangent to :math:`\dot x = 0`, at :math:`r = -1` that of
backward motion. An orbit meets these two points in four ways, the sliding bifurcations of
di Bernardo, Kowalczyk and Nordmark (2002). All four lie on one branch.
"""

import math

import numpy as np
from matplotlib.figure import Figure
from scipy.optimize import root

import mems_impact as mi

W = 0.7


def force(t, p):
    return p.A * math.cos(W * t) + p.B * math.sin(2.0 * W * t)


def flow(mode, t, y, p):
    return y.v, force(t, p) - y.x


block = mi.System(
    states=("x", "v"),
    flow=flow,
    period=2.0 * math.pi / W,
    parameters={"A": 1.7, "B": 0.1},
    parts=[mi.Friction("ground", "v", mu=1.0)],
)

# %%
# With a stronger second harmonic, the block sticks twice per period.

run = mi.simulate(block.changed(B=1.2), periods=20)
mi.plot_run(run, first=16, states=["x", "v"]).figure.savefig("sliding_bifurcations_run.png")

# %%
# The branch over B passes crossing-sliding (CS), grazing-sliding (GS), switching-sliding (SS) and
# adding-sliding (AS). Each changes the number of sticks or slips, as brute force confirms: dots are
# runs.

branch = mi.continue_solution(mi.find_orbit(block, transient=200), "B", stop=2.0)
print(branch.special_table[["type", "kind", "B"]])
dots = mi.sweep(block, "B", np.linspace(0.1, 2.0, 96), transient=200, periods=4)
axes = mi.plot_branch(branch, sweep=dots)
axes.figure.savefig("sliding_bifurcations_branch.png")

# %%
# Orbits before, at and after each point, in the plane of load and speed near the boundary of the
# sliding region (thick). ``type`` gives the modes in which an orbit arrives and departs,
# and the derivatives of the speed along the tangent field: positive at visible tangencies (CS, GS),
# negative at an invisible one (SS), zero at a cubic one (AS).

first = {}
for special in branch.special_points:
    first.setdefault(special.type, special)
first["adding-sliding"] = branch.special_points[4]  # the one at which a slip appears
WINDOWS = {  # distances in B on both sides, half-widths in r and v
    "grazing-sliding": (0.01, 0.02, 0.25, 0.04),
    "crossing-sliding": (0.06, 0.1, 0.25, 0.02),
    "switching-sliding": (0.005, 0.002, 0.16, 0.002),
    "adding-sliding": (0.05, 0.08, 0.3, 0.04),
}
with mi.style():
    figure = Figure(figsize=(6.4, 7.2), layout="constrained")
    panels = figure.subplots(4, 3)
for row, (name, (below, above, wide, high)) in zip(panels, WINDOWS.items(), strict=True):
    special = first[name]
    found = special.type
    print(f"{found:18} {found.modes}, {found.tangency}: {found.second:.6f}, {found.third:.6f}")
    values = (special.value - below, special.value, special.value + above)
    for panel, value in zip(row, values, strict=True):
        near = (branch.table.B - value).abs().argmin()
        orbit = special.orbit if value == special.value else branch.orbits[near]
        path, p = orbit.samples(4000), orbit.system.parameters
        load = p["A"] * np.cos(W * path.t) + p["B"] * np.sin(2.0 * W * path.t) - path.x
        # The boundary at which this point lies.
        edge = 1.0 if found.tangent == "forward" else -1.0
        panel.plot([-1.0, 1.0], [0.0, 0.0], color="0.75", linewidth=5, solid_capstyle="butt")
        panel.plot(load, path.v, linewidth=1.2)
        panel.plot(edge, 0.0, "o", markersize=4, color="k")
        panel.set_xlim(edge - wide, edge + wide)
        panel.set_ylim(-high, high)
        panel.set_title(f"B = {p['B']:.4g}", fontsize=8)
    row[0].set_ylabel(f"{name}\nv", fontsize=8)
for panel in panels[-1]:
    panel.set_xlabel("load r")
figure.savefig("sliding_bifurcations_orbit.png")

# %%
# Check
# -----
# Below the first point the block slips throughout. It moves backwards from :math:`t_0`, where the
# load is -1 in crossing-sliding, and forwards from :math:`t_1`. Each slip is a harmonic motion
# about the forced motion.


def slip(begin, end, x, friction, B):
    """Return x and v at the end of a slip from rest."""

    def forced(t):
        one, two = 1.7 / (1.0 - W * W), B / (1.0 - 4.0 * W * W)
        rate = -W * one * math.sin(W * t) + 2.0 * W * two * math.cos(2.0 * W * t)
        return one * math.cos(W * t) + two * math.sin(2.0 * W * t), rate

    (here, rate), (there, moves), lasts = forced(begin), forced(end), end - begin
    c, s, apart = math.cos(lasts), math.sin(lasts), x - friction - here
    return friction + apart * c - rate * s + there, moves - apart * s - rate * c


def equations(unknowns):
    B, x, t0, t1 = unknowns
    turned, speed = slip(t0, t1, x, 1.0, B)
    last, rest = slip(t1, t0 + 2.0 * math.pi / W, turned, -1.0, B)
    load = 1.7 * math.cos(W * t0) + B * math.sin(2.0 * W * t0) - x
    return speed, rest, last - x, load + 1.0


exact = root(equations, (0.16, 2.6, 0.7, 5.4), tol=1e-14).x[0]
print(exact, first["crossing-sliding"].value - exact)
assert abs(first["crossing-sliding"].value - exact) < 1e-9
