r"""
Coulomb oscillator: forced motion with dry friction
===================================================

A forced mass on a spring slides with dry friction :math:`f` (forces in units of the forcing
amplitude, time in units in which the natural frequency is one):

.. math:: \ddot x + x + f\,\mathrm{sgn}\,\dot x = \cos \omega t.

With little friction the mass reverses twice per period without sticking. With more, it sticks at
each reversal until forcing and spring exceed the friction. Friction alone limits the amplitude.
"""

import math

import numpy as np

import mems_impact as mi

RIGHT, LEFT, STUCK = mi.modes("right", "left", "stuck")


def pull(t, y, p):
    return math.cos(p.omega * t) - y.x


def flow(mode, t, y, p):
    if mode == STUCK:
        return 0.0, 0.0
    return y.v, pull(t, y, p) - (p.f if mode == RIGHT else -p.f)


def speed(mode, t, y, p):
    return y.v if mode == RIGHT else -y.v


def stop(mode, t, y, p):
    if abs(pull(t, y, p)) <= p.f:
        return STUCK, (y.x, 0.0)
    return (RIGHT if pull(t, y, p) > 0.0 else LEFT), (y.x, 0.0)


def hold_right(mode, t, y, p):
    return p.f - pull(t, y, p)


def hold_left(mode, t, y, p):
    return p.f + pull(t, y, p)


def slip_right(mode, t, y, p):
    return RIGHT, (y.x, 0.0)


def slip_left(mode, t, y, p):
    return LEFT, (y.x, 0.0)


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"omega": 0.8, "f": 0.5},
    guards=[
        mi.Guard("stop", speed, stop, modes=(RIGHT, LEFT)),
        mi.Guard("slips right", hold_right, slip_right, modes=(STUCK,)),
        mi.Guard("slips left", hold_left, slip_left, modes=(STUCK,)),
    ],
)

# %%
# With strong friction, the orbit has sticking phases.

run = mi.simulate(oscillator.changed(f=0.93), periods=60)
mi.plot_run(run, first=56).figure.savefig("coulomb_oscillator_run.png")
sticking = mi.find_orbit(run)
mi.plot_orbit(sticking).figure.savefig("coulomb_oscillator_orbit.png")

# %%
# The orbit without sticking is continued up to the friction at which sticking begins, and the one
# with sticking down to where it vanishes: the two points agree. Dots are brute force.

gliding = mi.find_orbit(oscillator, transient=60)
branches = [
    mi.continue_solution(gliding, "f", stop=0.1),
    mi.continue_solution(gliding, "f", stop=0.9),
    mi.continue_solution(sticking, "f", stop=0.1, back=0.97),
    mi.continue_solution(sticking, "f", stop=0.97),
]
for branch in branches[1:3]:
    print(branch.special_table[["label", "f"]])
sweep = mi.sweep(oscillator, "f", np.linspace(0.1, 0.97, 88), transient=60, periods=3)
mi.plot_branch(branches, sweep=sweep).figure.savefig("coulomb_oscillator_branch.png")

# %%
# Check
# -----
# Without sticking, the mass reverses at :math:`\sqrt{V^2 - f^2 U^2}`, with :math:`V = 1/(1 -
# \omega^2)` and :math:`U = \sin(\pi/\omega) / [\omega (1 + \cos(\pi/\omega))]`; this motion exists
# up to :math:`f = V / \sqrt{U^2 + \omega^{-4}}` (J. P. Den Hartog, *Transactions of the ASME* 53,
# APM-53-9, 107, 1931).

omega, f = (oscillator.parameters[name] for name in ("omega", "f"))
V = 1.0 / (1.0 - omega**2)
U = math.sin(math.pi / omega) / (omega * (1.0 + math.cos(math.pi / omega)))
turns = mi.simulate(oscillator, periods=1, initial=gliding.state).events.query("event == 'stop'")
assert np.allclose(turns["x"].abs(), math.sqrt(V**2 - (f * U) ** 2), rtol=1e-8)
for branch in branches[1:3]:
    assert abs(branch.special_points[0].value - V / math.hypot(U, omega**-2)) < 1e-9
