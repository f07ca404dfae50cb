"""
Guards and rates
================

A margin :math:`h` is watched along the motion. Looking only for a change of its sign from one step
to the next loses events in pairs: a step may begin and end above zero, and dip below it in between.
So the engine watches the *rate* as well,

.. math:: \\dot h = \\nabla h \\cdot f + \\partial_t h,

whose zero is the lowest point of the margin. The step is cut there, too, and if the margin is
negative at its lowest point, the crossing before it is located. What touches zero without crossing
it is a *grazing*, and does not count.
"""

import mems_impact as mi


def circle(mode, t, y, p):
    return y.v, -y.x


def gap(mode, t, y, p):
    return p.level - y.x


# %%
# A point on a circle of radius one, and a level that it passes for a short while: the shallower,
# the shorter. Every passage is seen, with steps that are much longer than it, down to where the arc
# itself is no more accurate.

fine = mi.Options(method="dop853", rtol=1e-13, atol=1e-15)

for depth in (1e-1, 1e-3, 1e-6, 1e-9):
    point = mi.System(
        states=("x", "v"),
        flow=circle,
        parameters={"level": 1.0 - depth},
        guards=[mi.Guard("level", gap)],
        initial={"v": 1.0},
    )
    run = mi.simulate(point, duration=18.0, options=fine)
    steps = run.trajectory.steps
    print(f"depth {depth:.0e}: {len(run.events)} passages in {steps} steps")
    assert len(run.events) == 3

# %%
# A level that the point misses by as little is not passed:

beyond = point.changed(level=1.0 + 1e-6)
assert mi.simulate(beyond, duration=18.0, options=fine).events.empty

# %%
# The rate is taken by differences along the flow if the system gives none (``rate=``), and one that
# is given is checked. :doc:`/peers` collects threads in which other solvers lost such events.
