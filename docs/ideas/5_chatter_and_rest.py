"""
Chatter and rest
================

A ball with :math:`e < 1` bounces infinitely often in a finite time: its flights shorten by the
factor :math:`e`, and their sum is finite,

.. math:: t_\\infty = \\sqrt{\\frac{2h}{g}}\\,\\frac{1 + e}{1 - e}.

No event loop can follow all of them, and stopping at some last impact leaves an error. The body then
lies on the stopper until the contact force vanishes, which is an event again.
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
# Once the flights are short, the sequence is completed in closed form, with its sum: one event
# "chatter ends", at the right time.

ends = run.events.query("event == 'chatter ends'")["t"].iloc[0]
closed = math.sqrt(2.0 / 9.81) * 1.5 / 0.5
print(len(run.impacts), "impacts, then rest at", ends, "closed form", closed)
assert abs(ends - closed) < 1e-10
mi.plot_run(run).figure.savefig("chatter_and_rest.png")

# %%
# In the actuator one *blow*, as a microscope sees it, is such a sequence: some twenty impacts, then
# rest until the voltage lets go.

mita = mi.load_actuator("mita2003")
cycle = mi.simulate(mita, mi.Sine(amplitude=100, omega=2 * math.pi), periods=6, window=(2, 6))
print(cycle.statistics[["impacts per period", "blows per period", "displacement per blow"]])
assert cycle.statistics["blows per period"] == 1.0

# %%
# :doc:`/device` explains what that means for counting steps, and :doc:`/promises` how exact the end
# of a sequence is.
