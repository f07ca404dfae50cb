"""
Chatter and rest contact
========================

A ball with :math:`e < 1` bounces infinitely often in finite time (Zeno behaviour): its flights shorten by
the factor :math:`e`, and their sum is finite,

.. math:: t_\\infty = \\sqrt{\\frac{2h}{g}}\\,\\frac{1 + e}{1 - e}.

No event loop can compute all flights, and truncation after some impact leaves an error. The body then
rests on the stopper until the contact force vanishes, which is an event as well.
"""

import math

import mems_impact as mi


def fall(mode, t, y, p):
    return y.v, -p.g


ball = mi.System(
    states=("x", "v"),
    flow=fall,
    parameters={"g": 9.81, "e": 0.5},
    parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
    initial={"x": 1.0},
)
run = mi.simulate(ball, duration=2.0)

# %%
# Once the flights are short, the event loop completes the chatter sequence in closed form: one event
# "chatter ends", at the accumulation point.

ends = run.events.query("event == 'chatter ends'")["t"].iloc[0]
closed = math.sqrt(2.0 / 9.81) * 1.5 / 0.5
print(len(run.impacts), "impacts, then rest at", ends, "closed form", closed)
assert abs(ends - closed) < 1e-10
mi.plot_run(run).figure.savefig("chatter_and_rest.png")

# %%
# In the actuator one *blow*, as observed in a microscope, is such a sequence: about twenty impacts, then
# rest contact until the voltage falls.

mita = mi.load_actuator("mita2003")
cycle = mi.simulate(mita, mi.Sine(amplitude=100, omega=2 * math.pi), periods=6, window=(2, 6))
print(cycle.statistics[["impacts per period", "blows per period", "displacement per blow"]])
assert cycle.statistics["blows per period"] == 1.0

# %%
# :doc:`/device` explains the quantities per blow and per impact, :doc:`/promises` the accuracy of the
# accumulation point.
