"""
5. A system of your own
=======================

Whatever switches between smooth modes is a ``System``: functions that read like its equations. Here
a mass on a spring, forced, that strikes a rigid stop.
"""

import math

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v


# %%
# A *guard* ends the smooth motion where its margin falls through zero: here the gap to the stop.
# What happens then is the *transition*: the mode after it, and the state.


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
# All verbs take it. The functions are plain Python, tried once when the system is made, and
# compiled when it runs: the first run of a new system takes some seconds, all others milliseconds.

run = mi.simulate(oscillator, periods=300)
print(run.impacts[["t", "event", "v before", "v after"]].tail(3))
mi.plot_run(run, first=295).figure.savefig("own_system.png")

# %%
# Is it the same impact in each period? The orbit answers that, with its stability.

orbit = mi.find_orbit(run)
print(orbit.periods, len(orbit.impacts), orbit.stable)
assert orbit.stable

# %%
# Mistakes are told in one sentence, with the line and the remedy, before anything runs:

try:
    mi.System(states=("x", "v"), flow=lambda mode, t, y, p: (y.v,))
except mi.FunctionError as error:
    print(error)

# %%
# Friction, stops, relays and switching surfaces are ready-made :doc:`parts </parts>`. Next: the
# bifurcation diagram of this oscillator.
