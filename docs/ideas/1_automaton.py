"""
The automaton
=============

A machine with impacts and dry friction moves smoothly between events, by the equations of its current
mode: the body flies or rests, the frame sticks or slips. Such a system is a *hybrid automaton*. Each of its
modes has a flow

.. math:: \\dot y = f_m(t, y; p).

A guard ends the flow when its margin :math:`h(t, y; p)`, positive before, falls through zero.
The transition of that guard gives the next mode and its initial state:

.. math:: (m, y) \\mapsto (m', R(t, y; p)).

Impact, slip and stick, rest and release, and switched sources are all guards with transitions. The
example is a ball that bounces and comes to rest.
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
# A run is a list of arcs: each is smooth, in one mode, and ended by one event. An integration step that
# passes a zero of a margin is cut there, so that no event is lost between steps.

print(run.events[["t", "event", "mode before", "mode after"]].iloc[[0, 1, -2, -1]])
mi.plot_run(run).figure.savefig("automaton.png")
assert run.final.mode == "resting"

# %%
# Vertical lines in the figure are impacts, and shading marks a mode. :doc:`/hybrid`
# explains how to write such a system, :doc:`/parts` lists ready-made parts, and :doc:`/equations`
# describes the automaton of the actuator.
