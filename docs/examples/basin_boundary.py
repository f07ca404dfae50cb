r"""
Basin boundary: the stable manifold of a saddle
===============================================

An oscillator with a stop at :math:`x = \sigma` is forced far above its resonance,

.. math::

   \ddot x + 2 \zeta \dot x + x = \cos \omega t, \qquad \dot x \to -e\,\dot x \ \text{at}\ x = \sigma.

It oscillates freely, or strikes the stop in every third period. A saddle orbit with one impact in
three periods lies between the two motions. Its stable manifold is the boundary of their basins.
"""

import math

import numpy as np

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, math.cos(p.omega * t) - 2.0 * p.zeta * y.v - y.x


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"omega": 5.6, "zeta": 0.05, "sigma": 0.1, "e": 0.8},
    parts=[mi.Stopper("stop", "x", "v", upper="sigma", restitution="e")],
)

# %%
# The basins, at the start of a forcing period.

x, v = np.linspace(-0.6, 0.0999, 60), np.linspace(-1.2, 1.2, 60)
recurrence = mi.RecurrenceOptions(transient=600, exponents="none")
basins = mi.basins(oscillator, x=("x", x), y=("v", v), recurrence=recurrence)
print(basins.attractors[["attractor", "share"]])
print(basins.entropy(), basins.uncertainty_exponent().exponent)

# %%
# The edge state between two initial states is the saddle: bisection and edge tracking lead to it.

edge = mi.edge_state(oscillator, {"x": -0.2, "v": 0.9}, {"x": -0.2, "v": 0.1})
saddle = edge.orbit
assert isinstance(saddle, mi.Orbit)  # neither an equilibrium nor None
print(saddle, saddle.multipliers)

# %%
# The orbit has three points in the section. The manifolds integrate through all impacts. Where the
# stable manifold (dashed) meets the stop, it continues at the velocity on the other side of the
# impact. So it also bounds the parts of the basin that are not connected in the section. The
# unstable manifold (solid) leads towards both attractors; farther on, impacts fold it again and
# again.

boundary = mi.manifold(saddle, "stable", length=3.0, distance=0.04)
outgoing = mi.manifold(saddle, "unstable", length=0.6, distance=0.04)
ax = mi.plot_basins(basins)
mi.plot_manifold([outgoing, boundary], ax)
ax.figure.savefig("basin_boundary_basins.png")

# %%
# Check
# -----
# Between impacts the motion is linear. So the impact speeds of orbits with one impact in three
# periods have a closed form (S. W. Shaw and P. J. Holmes, *Journal of Sound and Vibration* 90, 129,
# 1983): the free part leads from just after an impact at the phase :math:`t_0` to just before the
# next. The impacts of the saddle and of the attractor fulfil this condition.

p = oscillator.parameters
driven = 1.0 / complex(1.0 - p["omega"] ** 2, 2.0 * p["zeta"] * p["omega"])
root, time = math.sqrt(1.0 - p["zeta"] ** 2), 3.0 * saddle.period
cos, sin, decay = math.cos(root * time), math.sin(root * time), math.exp(-p["zeta"] * time)


def misses(orbit):
    """Return how far the free motion misses the next impact, in position and velocity."""
    (start,), (speed,) = orbit.impacts["time"], orbit.impacts["v before"]
    forced = driven * np.exp(1j * p["omega"] * start)
    position, rate = forced.real, (1j * p["omega"] * forced).real
    c, d = p["sigma"] - position, -p["e"] * speed - rate
    end = decay * (c * cos + (d + p["zeta"] * c) / root * sin) + position
    velocity = decay * (d * cos - (p["zeta"] * d + c) / root * sin) + rate
    return end - p["sigma"], velocity - speed


attractor = mi.find_orbit(oscillator, guess=basins.state("period 3"), periods=3)
for orbit in (saddle, attractor):
    assert np.abs(misses(orbit)).max() < 1e-9
assert attractor.stable
assert abs(saddle.multipliers[0]) > 1.0 > abs(saddle.multipliers[1])
