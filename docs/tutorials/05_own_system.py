"""
5. Write your own system
========================

A ``System`` switches between smooth modes; its functions read like its equations. The example is a forced
mass on a spring that strikes a rigid stop.
"""

import math

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
# All functions of the package take it. The functions of a system are plain Python, checked by the
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
# Friction, stops, relays and switching surfaces are ready-made :doc:`parts </parts>`. The next tutorial
# draws the bifurcation diagram of this oscillator.
