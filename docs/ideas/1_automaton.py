"""
The automaton
=============

A machine with impacts and dry friction moves smoothly most of the time, each time by other
equations: the body flies or rests, the frame sticks or slips. Such a system is a *hybrid
automaton*. It has modes, and in each of them a flow

.. math:: \\dot y = f_m(t, y; p).

A guard ends the flow where its margin :math:`h(t, y; p)`, positive until then, falls through zero.
The transition of that guard gives the next mode and the state in which it begins:

.. math:: (m, y) \\mapsto (m', R(t, y; p)).

Impact, slip and stick, rest and release, and switched sources are all written as guards with
transitions. Below is a ball that bounces and comes to rest.
"""

import mems_impact as mi

FLYING, RESTING = mi.modes("flying", "resting")


def fall(mode, t, y, p):
    return (y.v, -p.g) if mode == FLYING else (0.0, 0.0)


def height(mode, t, y, p):
    return y.x


def bounce(mode, t, y, p):
    return FLYING, (0.0, -p.e * y.v)


def rest(mode, t, y, p):
    return RESTING, (0.0, 0.0)


ball = mi.System(
    states=("x", "v"),
    flow=fall,
    parameters={"g": 9.81, "e": 0.6},
    guards=[mi.Impact("floor", height, bounce, rest=rest, modes=(FLYING,))],
    initial={"x": 1.0},
)
run = mi.simulate(ball, duration=3.0)

# %%
# A run is a list of arcs: each one smooth, in one mode, and ended by one event. Nothing is lost
# between two steps of the integration, since every step that passes a zero of a margin is cut
# there.

print(run.events[["t", "event", "mode before", "mode after"]].iloc[[0, 1, -2, -1]])
mi.plot_run(run).figure.savefig("automaton.png")
assert run.final.mode == "resting"

# %%
# In the figure vertical lines are impacts, and a shaded stretch is a mode that lasts. :doc:`/hybrid`
# explains how to write such a system, :doc:`/parts` lists ready-made parts, and :doc:`/equations`
# describes the automaton of the actuator.
