r"""
Buck converter: chaos under ramp control
========================================

A converter from a supply :math:`E` to about 12 V consists of a coil, a capacitor, a load, and a
switch that connects the supply. A comparator compares the amplified error of the output, relative
to :math:`V_\mathrm{ref}`, with a ramp, and opens the switch while the error is above:

.. math:: C \dot v = i - v / R, \qquad L\,\dot\imath = -v\ (+E \ \text{if on}).

The design value is one switching cycle per ramp. Above a supply of 24.5 V a cycle takes two ramps,
above 31.1 V four; above 32 V the output is chaotic, over a range of a volt.
"""

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

import mems_impact as mi

OFF, ON = mi.modes("off", "on")


def flow(mode, t, y, p):
    supply = p.E if mode == ON else 0.0
    return (y.i - y.v / p.R) / p.C, (supply - y.v) / p.L


def excess(mode, t, y, p):
    ramp = p.V_low + (p.V_high - p.V_low) * (t % p.T) / p.T
    over = p.a * (y.v - p.V_ref) - ramp
    return over if mode == OFF else -over


def toggle(mode, t, y, p):
    return (ON if mode == OFF else OFF), (y.v, y.i)


def ramp_drops(mode, t, y, p):
    return (ON if p.a * (y.v - p.V_ref) < p.V_low else OFF), (y.v, y.i)


converter = mi.System(
    states=("v", "i"),
    modes=(OFF, ON),
    flow=flow,
    period=lambda p: p.T,
    switches=lambda p: (p.T,),
    switch_transition=ramp_drops,
    parameters={
        "E": 22.0, "R": 22.0, "C": 47e-6, "L": 20e-3,
        "a": 8.4, "V_ref": 11.3, "V_low": 3.8, "V_high": 8.2, "T": 400e-6,
    },
    guards=[mi.Guard("comparator", excess, toggle)],
    initial={"v": 12.0, "i": 0.5},
    units={"v": "V", "i": "A", "E": "V", "time": "s"},
)  # fmt: skip

# %%
# The figure shows a run with shaded modes; the orbit is computed from it.

run = mi.simulate(converter, periods=200)
mi.plot_run(run).figure.savefig("buck_converter_run.png")
orbit = mi.find_orbit(run)

# %%
# The branches of the orbits of one and of two ramps, over brute force (PD: period doubling).

once = mi.continue_solution(orbit, "E", stop=35.0)
(doubling,) = once.special_points
twice = mi.switch_branch(doubling, bounds=(22.0, 35.0))
(again,) = twice.special_points
sweep = mi.sweep(converter, "E", np.linspace(22.0, 35.0, 131), transient=100, periods=40)
mi.plot_branch([once, twice], sweep=sweep).figure.savefig("buck_converter_branch.png")

# %%
# The orbit of two ramps at its period doubling.

mi.plot_orbit(again.orbit).figure.savefig("buck_converter_orbit.png")

# %%
# Check
# -----
# Fossas and Olivar (*IEEE Transactions on Circuits and Systems I* 43, 13, 1996) find the doublings
# near 24.5 V and 31.1 V. The first has a closed form: the circuit is linear in each mode, so that
# the closing time of the switch determines the cycle, and Filippov's matrix of the jump of the flow
# there gives the monodromy matrix. One equation remains: this matrix has the eigenvalue -1.

assert abs(doubling.value - 24.5) < 0.05
assert abs(again.value - 31.1) < 0.05

p = converter.parameters
A = np.array([[-1.0 / (p["R"] * p["C"]), 1.0 / p["C"]], [-1.0 / p["L"], 0.0]])
volt = np.array([0.0, 1.0 / p["L"]])  # what each volt of the supply adds to the flow
rise = (p["V_high"] - p["V_low"]) / p["T"]


def cycle(closes):
    """Return E and the monodromy matrix of a cycle that is off until `closes`."""
    off, on = expm(A * closes), expm(A * (p["T"] - closes))
    start = np.linalg.solve(np.eye(2) - on @ off, np.linalg.solve(A, (on - np.eye(2)) @ volt))
    E = (p["V_ref"] + (p["V_low"] + rise * closes) / p["a"]) / (off @ start)[0]
    speed = p["a"] * (A @ off @ start * E)[0] - rise  # of the comparator's input
    jump = np.eye(2) + np.outer(E * volt, [p["a"], 0.0]) / speed
    return E, on @ jump @ off


def from_doubling(closes):
    matrix = cycle(closes)[1]
    return 1.0 + np.trace(matrix) + np.linalg.det(matrix)


closes = brentq(from_doubling, 0.3 * p["T"], 0.7 * p["T"], xtol=1e-18)
assert abs(cycle(closes)[0] - doubling.value) < 1e-8
