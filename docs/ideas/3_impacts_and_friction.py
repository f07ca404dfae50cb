"""
Impacts and friction
====================

An impact takes no time: positions stay, and the speeds of the two bodies along the contact become

.. math:: v^+ = -e\\,v^-,

with the coefficient of restitution :math:`e`; momentum decides the rest. Dry friction has two laws
in one. While a body slips, the force is :math:`\\mu_d N` against its velocity. While it sticks, the
force is whatever holds it, up to :math:`\\mu_s N`. So sticking and slipping are modes, and the
change between them are events.

A block on a moving belt, held by a spring: it sticks until the spring overcomes static friction,
slips against less, and sticks again.
"""

import math

import mems_impact as mi


def spring(mode, t, y, p):
    return y.v, -y.x


block = mi.System(
    states=("x", "v"),
    flow=spring,
    parameters={"belt": 0.3, "mu_s": 1.0, "mu_d": 0.6},
    parts=[mi.Friction("friction", "v", mu="mu_d", static="mu_s", surface="belt")],
    initial={"x": 0.0, "v": 0.1},
)
run = mi.simulate(block, duration=30.0)
print(run.events[["t", "event", "mode after"]].tail(4))
mi.plot_run(run).figure.savefig("impacts_and_friction.png")

# %%
# The cycle is known in closed form (the drop of the friction over the speed of the belt), and comes
# out to rounding: no regularization smears it, and no step size enters.

cycle = mi.find_orbit(block, transient=50)
drop, speed = 0.4, 0.3
closed = math.pi + 2.0 * math.atan2(speed, drop) + 2.0 * drop / speed
print(cycle.period - closed)
assert abs(cycle.period - closed) < 1e-9

# %%
# Where several contacts hold at once, they are solved together. More laws are described in
# :doc:`/parts` (Stribeck friction) and, for the actuator, in :doc:`/terms` (tabulated restitution,
# yielding stoppers).
