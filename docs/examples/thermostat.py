r"""
Thermostat: a switch with hysteresis
====================================

A heater of temperature :math:`h` warms a room of temperature :math:`\theta`, which loses its heat
to the outside; a thermostat switches at :math:`\theta = 19` and 21 degrees. Time in hours:

.. math:: \dot h = 8\,(P\,\text{if on}) - 8\,(h - \theta), \qquad
   \dot \theta = 2\,(h - \theta) - 0.5\,(\theta - \theta_o).

The heater responds with a delay, so that the room temperature overshoots both thresholds. The
period of the cycle and its share of heating depend on the outside temperature.
"""

import numpy as np
import pandas as pd
from scipy.linalg import expm
from scipy.optimize import fsolve

import mems_impact as mi

OFF, ON = mi.modes("off", "on")


def flow(mode, t, y, p):
    heating = p.P if mode == ON else 0.0
    return 8.0 * (heating - (y.h - y.room)), 2.0 * (y.h - y.room) - 0.5 * (y.room - p.outside)


def too_cold(mode, t, y, p):
    return y.room - p.low


def too_warm(mode, t, y, p):
    return p.high - y.room


def switch_on(mode, t, y, p):
    return ON, (y.h, y.room)


def switch_off(mode, t, y, p):
    return OFF, (y.h, y.room)


house = mi.System(
    states=("h", "room"),
    flow=flow,
    parameters={"P": 10.0, "outside": 0.0, "low": 19.0, "high": 21.0},
    guards=[
        mi.Guard("too cold", too_cold, switch_on, modes=(OFF,)),
        mi.Guard("too warm", too_warm, switch_off, modes=(ON,)),
    ],
    section=("room", 20.0),
    initial={"h": 10.0, "room": 10.0},
    units={"h": "°C", "room": "°C", "outside": "°C", "time": "h"},
)

# %%
# The run begins with a cold room.

run = mi.simulate(house, duration=6.0)
mi.plot_run(run).figure.savefig("thermostat_run.png")

# %%
# The temperature settles to a limit cycle.

cycle = mi.find_orbit(run)
print(cycle.period, cycle.multipliers)
print(cycle.segments)
mi.plot_orbit(cycle, x="room", y="h").figure.savefig("thermostat_orbit.png")

# %%
# The branch shows the heater's temperature as the room passes 20 degrees upwards. At -19 degrees
# outside the room no longer reaches 21, and the period grows beyond bounds. Brute force is one run
# per value.

colder = mi.continue_solution(cycle, "outside", stop=-25.0)
warmer = mi.continue_solution(cycle, "outside", stop=18.5)
dots = []
for outside in np.linspace(-25.0, 18.5, 88):
    settled = mi.simulate(house.changed(outside=outside), duration=20.0)
    seen = settled.section(1).query("t > 15").assign(outside=outside)
    dots.append(seen[["outside", "h"]])
axes = mi.plot_branch([colder, warmer], sweep=pd.concat(dots), quantity="h")
axes.figure.savefig("thermostat_branch.png")

# %%
# Check
# -----
# Under permanent heating, the room is :math:`4 P` warmer than the outside. Each mode is
# linear, so that the two durations and the heater's temperature at the two switches solve four
# equations in closed form, as in the theory of relays (Ya. Z. Tsypkin, *Relay Control Systems*,
# Cambridge University Press, 1984).

p = house.parameters
coldest = colder.table["outside"].iloc[-1]
assert abs(coldest - (p["high"] - 4.0 * p["P"])) < 1e-9

A = np.array([[-8.0, 8.0], [2.0, -2.5]])
rest_on = -np.linalg.solve(A, [8.0 * p["P"], 0.5 * p["outside"]])
rest_off = -np.linalg.solve(A, [0.0, 0.5 * p["outside"]])


def closes(unknowns):
    """Return the residual of a closed cycle: two temperatures after each switch."""
    on, off, h_low, h_high = unknowns
    warm = rest_on + expm(A * on) @ ([h_low, p["low"]] - rest_on)
    cold = rest_off + expm(A * off) @ ([h_high, p["high"]] - rest_off)
    return np.concatenate([warm - [h_high, p["high"]], cold - [h_low, p["low"]]])


on, off, *_ = fsolve(closes, [0.4, 0.4, 20.0, 28.0], xtol=1e-13)
assert abs(cycle.period - on - off) < 1e-9
