r"""
Rocking block: impacts on two corners
=====================================

A slender rigid block stands on a shaking ground. The block rocks about one of its two lower corners;
each time it passes the upright position it changes corners and keeps the fraction :math:`r` of its
speed. With the tilt :math:`x` in units of the angle of balance, and time scaled by the growth rate
there:

.. math::

   \ddot x = x - \mathrm{sgn}\,x + \beta \cos \omega t, \qquad
   \dot x \to r\,\dot x \ \text{at}\ x = 0.

The block begins to rock at :math:`\beta = 1`. The orbit has one impact on each corner and is
symmetric. At stronger forcing it loses stability at a branch point, where two asymmetric orbits
begin, mirror images of each other; their period doubles shortly before the block topples. The
symmetric orbit is born in a fold far below :math:`\beta = 1`, where a block at rest stays at rest
and a rocking block keeps rocking.
"""

import math

import numpy as np

import mems_impact as mi

STANDING, LEFT, RIGHT = mi.modes("standing", "left", "right")


def flow(mode, t, y, p):
    if mode == STANDING:
        return 0.0, 0.0
    return y.v, y.x - (1.0 if mode == RIGHT else -1.0) + p.beta * math.cos(p.omega * t)


def tilt(mode, t, y, p):
    return y.x if mode == RIGHT else -y.x


def strike(mode, t, y, p):
    return (LEFT if mode == RIGHT else RIGHT), (0.0, p.r * y.v)


def stand(mode, t, y, p):
    return STANDING, (0.0, 0.0)


def holds_right(mode, t, y, p):
    return 1.0 - p.beta * math.cos(p.omega * t)


def holds_left(mode, t, y, p):
    return 1.0 + p.beta * math.cos(p.omega * t)


def tip_right(mode, t, y, p):
    return RIGHT, (0.0, 0.0)


def tip_left(mode, t, y, p):
    return LEFT, (0.0, 0.0)


block = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"beta": 2.0, "omega": 3.0, "r": 0.8},
    guards=[
        mi.Impact("base", tilt, strike, rest=stand, modes=(LEFT, RIGHT)),
        mi.Guard("tips right", holds_right, tip_right, modes=(STANDING,)),
        mi.Guard("tips left", holds_left, tip_left, modes=(STANDING,)),
    ],
)

# %%
# The block tips over a corner at once, and the motion becomes periodic.

run = mi.simulate(block, periods=60)
mi.plot_run(run, first=0, last=8).figure.savefig("rocking_block_run.png")

# %%
# A symmetric and an asymmetric orbit; the figure shows the asymmetric orbit.

orbit = mi.find_orbit(run)
gentle = mi.find_orbit(block.changed(beta=0.8), guess=orbit.state, transient=60)
tilted = mi.find_orbit(block.changed(beta=5.5), guess=orbit.state, transient=300)
print(orbit.multipliers, tilted.multipliers, sep="\n")
mi.plot_orbit(tilted).figure.savefig("rocking_block_orbit.png")

# %%
# Beyond the branch point (BP) the symmetric orbit is unstable. The asymmetric branch passes through
# the branch point into its mirror image. Dots are brute force.

branches = [
    mi.continue_solution(gentle, "beta", stop=0.1, back=0.95),
    mi.continue_solution(gentle, "beta", stop=7.0),
    mi.continue_solution(tilted, "beta", stop=4.5, back=7.0),
    mi.continue_solution(tilted, "beta", stop=7.0),
]
for branch in branches:
    print(branch)
sweep = mi.sweep(block, "beta", np.linspace(0.12, 6.92, 137), transient=200, periods=30)
mi.plot_branch(branches, sweep=sweep).figure.savefig("rocking_block_branch.png")

# %%
# Check
# -----
# Between impacts the motion is linear, and one half period of the symmetric orbit mirrors the other.
# So the orbit has a closed form (S. J. Hogan, *Proceedings of the Royal Society of London A* 425,
# 441, 1989): with :math:`x = 1 - u \cos\omega t + w \sin\omega t + a \cosh t + b \sinh t`, the
# block is upright at both ends of the half period, and :math:`\dot x` at its beginning is
# :math:`-r` times that at its end. The remaining equation is
# :math:`u^2 + w^2 = \beta^2 / (1 + \omega^2)^2`; the fold is its double root.

omega, r = (block.parameters[name] for name in ("omega", "r"))
half = math.pi / omega
ch, sh = math.cosh(half), math.sinh(half)
# Of u: (a, b, w), as a line
rows = np.array([[1.0, 0.0, 0.0], [ch, sh, 0.0], [r * sh, 1.0 + r * ch, omega * (1.0 - r)]])
offset = np.linalg.solve(rows, [-1.0, -1.0, 0.0])
slope = np.linalg.solve(rows, [1.0, -1.0, 0.0])
square = np.array([1.0 + slope[2] ** 2, 2.0 * offset[2] * slope[2], offset[2] ** 2])

smallest = math.sqrt(square[2] - square[1] ** 2 / (4.0 * square[0])) * (1.0 + omega**2)
assert abs(branches[0].special_points[0].value - smallest) < 1e-9

u = np.roots(square - [0.0, 0.0, (block.parameters["beta"] / (1.0 + omega**2)) ** 2])
a, b, w = offset[:, None] + slope[:, None] * u
speeds = abs(b + omega * w) / r  # of the stable orbit and of the unstable one
assert np.allclose(orbit.impacts["v before"].abs(), speeds.max(), rtol=1e-9)
