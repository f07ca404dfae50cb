r"""
Relief valve: Hopf points, grazing cycles, and two parameters
=============================================================

The equilibrium of a pressure relief valve on a chamber of fluid loses stability at a Hopf point, and
the growing limit cycle hits the seat at :math:`x = 0`. With the position :math:`x` and the pressure
:math:`p`,

.. math:: \ddot x + \kappa \dot x + x + \delta = p, \qquad \dot p = \beta (q - x \sqrt{p}),

and an impact on the seat reverses the velocity with the coefficient of restitution :math:`r`
(C. J. Hős and A. R. Champneys, *Physica D* 241, 2012). The inflow :math:`q` is the parameter of the
branches, the damping :math:`\kappa` the second one of the curves.
"""

import math

import numpy as np

import mems_impact as mi


def flow(mode, t, y, p):
    pressure = p.beta * (p.q - y.x * math.sqrt(y.p))
    return y.v, -p.kappa * y.v - (y.x + p.delta) + y.p, pressure


def opening(mode, t, y, p):
    return y.x


def rebound(mode, t, y, p):
    return mode, (0.0, -p.r * y.v, y.p)


valve = mi.System(
    states=("x", "v", "p"),
    flow=flow,
    parameters={"kappa": 1.25, "beta": 20.0, "delta": 10.0, "q": 9.0, "r": 0.8},
    guards=[mi.Impact("seat", opening, rebound)],
    initial={"x": 2.5, "p": 12.5},
)

# %%
# At a low inflow the oscillation grows until the valve hits its seat.

run = mi.simulate(valve.changed(q=7.0), duration=60.0)
mi.plot_run(run).figure.savefig("relief_valve_run.png")

# %%
# The branch of limit cycles starts at the Hopf point and grazes the seat. Next to the grazing, the
# cycle with one impact is unstable; a period doubling makes it stable.

(steady,) = mi.find_equilibria(valve)
(hopf,) = mi.continue_solution(steady, "q", stop=6.0).special_points
cycles = mi.switch_branch(hopf, bounds=(6.0, 9.0))
print(cycles.ended)
print(cycles.special_table[["label", "kind", "criticality", "q"]])
grazing, flip = cycles.special_points[:2]
mi.plot_orbit(grazing.orbit).figure.savefig("relief_valve_orbit.png")
mi.plot_branch(cycles).figure.savefig("relief_valve_branch.png")

# %%
# Each point has a curve in two parameters. Cycles start from any point of the Hopf curve. At small
# damping the Hopf bifurcation is subcritical, and the branch of cycles has a fold. Its curve leads
# from the grazing-fold, where the cycle at the fold touches the seat, through a cusp to the Bautin
# point, where the Hopf bifurcation becomes supercritical.

curves = [
    mi.continue_curve(special, "kappa", stop)
    for special in (hopf, grazing, flip)
    for stop in (1.0, 1.4)
]
weak = mi.continue_curve(hopf, "kappa", 1.07).points[-1]
print(weak.criticality)
subcritical = mi.switch_branch(weak, bounds=(8.0, 11.0))
fold = next(point for point in subcritical.special_points if point.kind == "fold")
curves += [
    mi.continue_curve(fold, "kappa", 1.05),
    mi.continue_curve(fold, "kappa", 1.2, steps=mi.StepControl(max_points=100)),
]
for curve in curves:
    for point in curve.special_points:
        print(point)
mi.plot_curve(curves).figure.savefig("relief_valve_curves.png")

# %%
# Check
# -----
# BifurcationKit.jl gives the values of :math:`q` at the Hopf point, the grazing and the period
# doubling. The characteristic polynomial gives the Hopf curve:
# :math:`(\kappa + a)(1 + \kappa a) = a + \beta \sqrt{c}` with :math:`c = x + \delta`,
# :math:`a = \beta x / (2 \sqrt{c})` and :math:`q = x \sqrt{c}`. The curve of folds, computed from
# cycles, ends near the Bautin point, computed from the Lyapunov coefficient of the equilibrium.

assert abs(hopf.value - 8.4911176352) < 1e-9
assert abs(grazing.value - 7.55721097) < 1e-8
assert abs(flip.value - 6.06651454) < 1e-8

for curve in curves[:2]:
    x, q, kappa = (curve.table[name].to_numpy() for name in ("x", "q", "kappa"))
    root = np.sqrt(x + 10.0)
    a = 20.0 * x / (2.0 * root)
    assert abs(q / (x * root) - 1.0).max() < 1e-9
    assert abs((kappa + a) * (1.0 + kappa * a) / (a + 20.0 * root) - 1.0).max() < 1e-9

(bautin,) = curves[0].special_points
last = curves[-1].table.iloc[-1]
assert math.hypot(last["kappa"] - bautin.values["kappa"], last["q"] - bautin.values["q"]) < 0.03
