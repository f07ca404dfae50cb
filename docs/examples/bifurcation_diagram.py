r"""
Bifurcation diagram of an impact oscillator
===========================================

A linear oscillator under a harmonic force strikes a rigid wall at :math:`x = 1`:

.. math:: \ddot x = -x - 0.1\,\dot x + A \cos 0.6\,t, \qquad \dot x \to -0.8\,\dot x
   \ \text{at}\ x = 1.

One call computes the bifurcation diagram over the amplitude: it finds attractors by runs, continues
each orbit both ways, stable or unstable, and switches to the branches that emanate.
"""

import math

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, -y.x - 0.1 * y.v + p.A * math.cos(p.w * t)


def gap(mode, t, y, p):
    return 1.0 - y.x


def bounce(mode, t, y, p):
    return mode, (1.0, -0.8 * y.v)


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    guards=[mi.Impact("wall", gap, bounce)],
    period=lambda p: 2.0 * math.pi / p.w,
    parameters={"A": 0.5, "w": 0.6},
)

diagram = mi.bifurcation_diagram(oscillator, "A", (0.5, 1.5), depth=2, longest=8)
print(diagram.tree)
mi.plot_diagram(diagram).figure.savefig("bifurcation_diagram_branch.png")

# %%
# The orbit without impacts grazes (G) and continues as an orbit with one impact per period, stable
# from the period doubling (PD) on. The orbits of twice the period fold (CF) and graze as well. The
# tree shows each branch below the one from which it emanates; ``diagram.branches`` holds the
# branches, ``diagram.attractors`` the attractors found by runs at each amplitude.

print(diagram.special_table[["label", "A", "branch"]])

# %%
# Check
# -----
# Without impacts the system is the linear oscillator, which reaches :math:`x = 1` at

w = oscillator.parameters["w"]
touch = math.hypot(1.0 - w**2, 0.1 * w)
grazings = [special.value for special in diagram.special_points if special.label == "G"]
assert min(abs(value - touch) for value in grazings) < 1e-9

# %%
# Every periodic attractor lies on a branch.

repeating = diagram.attractors[diagram.attractors["motion"].isin(["periodic", "off"])]
assert (repeating["branch"] >= 0).all()
