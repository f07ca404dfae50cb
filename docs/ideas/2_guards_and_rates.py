"""
Guards and rates
================

An event is a zero of a margin :math:`h` along the motion. A search for sign changes between steps loses
events in pairs: the margin may be positive at both ends of a step and negative in between. The engine
therefore evaluates the *rate* as well,

.. math:: \\dot h = \\nabla h \\cdot f + \\partial_t h,

whose zero is the minimum of the margin. The engine cuts the step there, too; if the margin is negative at
its minimum, the engine locates the crossing before. A margin that touches zero without crossing it *grazes*, which
is no event.
"""

import mems_impact as mi


def circle(mode, t, y, p):
    return y.v, -y.x


def gap(mode, t, y, p):
    return p.level - y.x


# %%
# A point on a circle of radius one passes a level for a short time. The engine detects every passage,
# with much longer steps, down to the accuracy of the arc.

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
# A level just beyond the circle gives no event:

beyond = point.changed(level=1.0 + 1e-6)
assert mi.simulate(beyond, duration=18.0, options=fine).events.empty

# %%
# The rate is an exact derivative (:doc:`/methods/derivatives`).
# :doc:`/comparison` counts published cases in which other solvers lost such events.
