"""
Impacts and friction
====================

An impact is instantaneous: positions are constant, and the relative speed along the contact becomes

.. math:: v^+ = -e\\,v^-,

with the coefficient of restitution :math:`e`; conservation of momentum gives both velocities. Dry friction
has two laws. While a body slips, the force is :math:`\\mu_d N` against its velocity. While it sticks, the
force balances the load, up to :math:`\\mu_s N`. Sticking and slipping are therefore modes, and the changes
between them events.

The example is a block on a moving belt, held by a spring: it sticks until the spring force exceeds static
friction, slips against the lower sliding friction, and sticks again.
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
# The period of the limit cycle has a closed form, and the computed one agrees to rounding, since no
# regularization and no time step enters.

cycle = mi.find_orbit(block, transient=50)
drop, speed = 0.4, 0.3
closed = math.pi + 2.0 * math.atan2(speed, drop) + 2.0 * drop / speed
print(cycle.period - closed)
assert abs(cycle.period - closed) < 1e-9

# %%
# Simultaneous contacts are solved together. :doc:`/parts` describes Stribeck friction, and :doc:`/terms`
# further laws for the actuator (tabulated restitution, compliant stoppers).
