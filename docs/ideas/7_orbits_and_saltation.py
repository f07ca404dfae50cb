"""
Orbits and saltation
====================

A periodic orbit solves a boundary value problem: the unknowns are the states at the beginning of each arc
and the times of the events, and Newton's method makes the arcs meet. The linearized map over a period gives the
stability. Along an arc a perturbation follows the linearized flow; at an event it jumps by the *saltation
matrix*

.. math::
   S = R_y + \\frac{(f^+ - R_y f^- - R_t)\\, \\nabla h^{\\mathsf T}}
   {\\nabla h \\cdot f^- + h_t},

since the neighbouring motion meets the guard slightly earlier or later (Müller, 1995; Leine and
Nijmeijer, 2004). The product over all arcs and events is the monodromy matrix. Its eigenvalues
are the Floquet multipliers.
"""

import math

import numpy as np

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"c": 0.1, "k": 1.0, "d": 1.0, "e": 0.8, "A": 0.6, "omega": 0.8},
    parts=[mi.Stopper("stop", "x", "v", upper="d", restitution="e")],
)
orbit = mi.find_orbit(oscillator, transient=300)
mi.plot_orbit(orbit, x="x", y="v").figure.savefig("orbits_and_saltation.png")

# %%
# For this impact the determinant of :math:`S` is :math:`e^2`, and the determinant of the flow over a period
# :math:`\exp(-cT)`. The product of the multipliers therefore has a closed form:

product = np.prod(orbit.multipliers).real
closed = 0.8 ** (2 * len(orbit.impacts)) * math.exp(-0.1 * orbit.period)
print(product, closed)
assert abs(product - closed) < 1e-9

# %%
# Differences of neighbouring runs give the same multipliers:

start, small = orbit.state, 1e-7
options = mi.Options(method="dop853", rtol=1e-13, atol=1e-15)
ends = [
    mi.simulate(oscillator, periods=orbit.periods, initial=each, options=options).final
    for each in (start, start.replace(x=start.x + small), start.replace(v=start.v + small))
]
columns = [((end.x - ends[0].x) / small, (end.v - ends[0].v) / small) for end in ends[1:]]
brute = np.linalg.eigvals(np.array(columns).T)
print(np.sort_complex(brute), np.sort_complex(orbit.multipliers))
assert np.allclose(np.sort_complex(brute), np.sort_complex(orbit.multipliers), atol=1e-4)

# %%
# :doc:`/orbits` describes orbits and their errors. The same matrices enter Lyapunov exponents:
# :doc:`/lyapunov`.
