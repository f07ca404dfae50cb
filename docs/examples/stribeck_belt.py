r"""
Stribeck belt: a subcritical Hopf bifurcation
=============================================

A damped mass on a spring rubs on a belt of speed :math:`V`, with a Stribeck friction that falls
with the sliding speed :math:`w = V - \dot x`:

.. math::

   \ddot x + c\,\dot x + x = F(V - \dot x), \qquad F(w) = F_d + (F_s - F_d)\,e^{-w / v_s} .

At rest on the running belt, falling friction acts as negative damping. The equilibrium is
stable on a fast belt, and unstable below a Hopf point. The cycle that is born there is
unstable and grows with :math:`V` until it reaches the speed of the belt. From there on the mass
sticks once per cycle, and the cycle is large and stable. Between the Hopf point and this corner
rest and squeal coexist.
"""

import math

import numpy as np
import pandas as pd

import mems_impact as mi

SLIPS, STICKS = mi.modes("slips", "sticks")


def friction(w, p):
    return p.F_d + (p.F_s - p.F_d) * math.exp(-w / p.v_s)


def flow(mode, t, y, p):
    return y.v, 0.0 if mode == STICKS else friction(p.V - y.v, p) - p.c * y.v - y.x


def lag(mode, t, y, p):
    return p.V - y.v


def hold(mode, t, y, p):
    return p.F_s - p.c * p.V - y.x


def stick(mode, t, y, p):
    return STICKS, (y.x, p.V)


def slip(mode, t, y, p):
    return SLIPS, (y.x, p.V)


belt = mi.System(
    states=("x", "v"),
    flow=flow,
    parameters={"V": 0.3, "F_s": 1.0, "F_d": 0.5, "v_s": 0.3, "c": 0.4},
    guards=[
        mi.Guard("sticks", lag, stick, modes=(SLIPS,)),
        mi.Guard("slips", hold, slip, modes=(STICKS,)),
    ],
    section=("v", 0.0),
    initial={"x": 0.9},
)

# %%
# A run settles to the limit cycle, which is then computed as an orbit.

run = mi.simulate(belt, duration=60.0)
mi.plot_run(run).figure.savefig("stribeck_belt_run.png")
squeal = mi.find_orbit(run)
mi.plot_orbit(squeal).figure.savefig("stribeck_belt_orbit.png")

# %%
# The branch of equilibria has a Hopf point (H); the branch of cycles that begins there leads to the
# large cycle.

resting = mi.find_equilibria(belt.changed(V=0.7), guess={"x": 0.6})[0]
rest = mi.continue_solution(resting, "V", 0.1, steps=mi.StepControl(max_step=0.01))
(hopf,) = rest.special_points
born = mi.switch_branch(hopf, bounds=(0.1, 0.7))
print(resting, rest, born, sep="\n")

# %%
# Brute force is one run per value, down from rest and up from the squeal. A mass at rest crosses no
# section; then its last state is drawn.

dots = []
for values, start in (
    (np.linspace(0.7, 0.1, 61), resting.state),
    (np.linspace(0.1, 0.7, 61), None),
):
    for V in values:
        run = mi.simulate(belt.changed(V=V), duration=200.0, initial=start)
        start = run.final.replace(v=run.final.v - 0.011, mode="slips")  # no rest is perfect
        seen = run.section(1).query("t > 190")[["x"]]
        dots.append((seen if len(seen) else pd.DataFrame({"x": [run.final.x]})).assign(V=V))
sweep = pd.concat(dots)[["V", "x"]]
axes = mi.plot_branch([rest, born], sweep=sweep)
axes.figure.savefig("stribeck_belt_branch.png")

# %%
# Check
# -----
# At the Hopf point the slope of the friction cancels the damping, :math:`F'(V) = -c`, so
# :math:`V = v_s \ln \frac{F_s - F_d}{c\,v_s}`; the cycles begin with the natural frequency 1.
# (On such laws: J. J. Thomsen and A. Fidlin, *International Journal of Non-Linear
# Mechanics* 38, 389, 2003.)

p = belt.parameters
assert abs(hopf.value - p["v_s"] * math.log((p["F_s"] - p["F_d"]) / (p["c"] * p["v_s"]))) < 1e-9
assert abs(born.orbits[0].period / (2.0 * math.pi) - 1.0) < 1e-4
assert not born.orbits[0].stable
assert born.orbits[-1].stable
