"""
5. Write your own system and draw its bifurcation diagram
=========================================================

A ``System`` switches between smooth modes; its functions read like its equations. The example is a forced
mass on a spring that strikes a rigid stop.
"""

import math

import numpy as np

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v


# %%
# A *guard* ends the smooth motion when its margin, here the gap to the stop, falls through zero. Its
# *transition* returns the next mode and state.


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

# %%
# All functions of the package take such a system. The functions of a system are plain Python, checked by the
# constructor and compiled at the first run, which takes some seconds; later runs take milliseconds.

run = mi.simulate(oscillator, periods=300)
print(run.impacts[["t", "event", "v before", "v after"]].tail(3))
mi.plot_run(run, first=295).figure.savefig("own_system.png")

# %%
# The periodic orbit has one impact per period, and is stable:

orbit = mi.find_orbit(run)
print(orbit.periods, len(orbit.impacts), orbit.stable)
assert orbit.stable

# %%
# A mistake raises an error before the run, with the line and the remedy:

try:
    mi.System(states=("x", "v"), flow=lambda mode, t, y, p: (y.v,))
except mi.FunctionError as error:
    print(error)

# %%
# ``continue_solution`` continues the orbit over the amplitude of the forcing. Downwards the orbit doubles its
# period (PD), and loses its impact in a grazing (G). The grazing has a closed form: the amplitude of the
# linear oscillator equals the gap.

branch = mi.continue_solution(orbit, "A", stop=0.3, back=0.8)
print(branch.special_table[["label", "A", "impacts"]].to_string(index=False))
doubling, grazing = branch.special_points[0], branch.special_points[-1]
assert (doubling.label, grazing.label) == ("PD", "G")
assert abs(grazing.value - math.sqrt((1.0 - 0.8**2) ** 2 + (0.1 * 0.8) ** 2)) < 1e-9

# %%
# ``switch_branch`` continues the orbit of twice the period. Solid lines are stable, dashed lines
# unstable; dots are a sweep.

twice = mi.switch_branch(doubling, bounds=(0.3, 0.8))
dots = mi.sweep(
    oscillator, "A", np.linspace(0.3, 0.8, 60), direction="both", transient=150, periods=20
)
mi.plot_branch([branch, twice], sweep=dots).figure.savefig("own_system_branch.png")

# %%
# ``continue_curve`` continues a special point in a second parameter, here the doubling over the
# coefficient of restitution.

curve = mi.continue_curve(doubling, "e", stop=0.6, back=0.95)
mi.plot_curve(curve).figure.savefig("own_system_curve.png")
print(curve.table[["e", "A"]].iloc[[0, -1]])

# %%
# Stops, friction, relays and switching surfaces are ready-made :doc:`parts </parts>`: the functions ``gap``
# and ``rebound`` of this oscillator are also ``mi.Stopper("stop", "x", "v", upper="d", restitution="e")``.
