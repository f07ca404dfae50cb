r"""
Impact damper: a design by gradient, through impacts
====================================================

A ball of mass :math:`\mu` in a container of clearance :math:`g` takes energy from an oscillator at
each impact, of restitution :math:`e`:

.. math:: \ddot x = -x - 2\zeta\dot x, \qquad \ddot z = 0, \qquad |z - x| \le g/2.

The oscillator is released at :math:`x = 1`. Which clearance, mass and restitution quiet it soonest,
with the least integral of its energy over six periods? The number of impacts is discrete; between
its changes, the integral has a gradient, which is exact.
"""

import math

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import quad
from scipy.optimize import brentq, minimize

import mems_impact as mi

ZETA, END = 0.01, 6 * 2 * math.pi
EXACT = mi.Options(method="dop853")


def flow(mode, t, y, p):
    return y.v, -y.x - 2 * ZETA * y.v, y.w, 0.0, (y.x**2 + y.v**2) / 2


damped = mi.System(
    states=("x", "v", "z", "w", "energy"),
    flow=flow,
    parameters={"g": 1.6, "mu": 0.1, "e": 0.6},
    masses={"v": 1.0, "w": "mu"},
    parts=[
        mi.Stopper(
            "container",
            "z",
            "w",
            lower=lambda p: -p.g / 2,
            upper=lambda p: p.g / 2,
            restitution="e",
            against=("x", "v"),
        )
    ],
    initial={"x": 1.0, "z": 1.0},
)


def integral(run):
    return run.final.energy


# %%
# Integral and slope over the clearance
# -------------------------------------
# Each tangent is one run and its derivatives. Where impacts appear or vanish, the integral has a
# corner or a jump, and the derivative is that of one side.

over_clearance = mi.value_and_jacobian(damped, integral, ["g"], duration=END, options=EXACT)
clearances = np.linspace(1.3, 3.6, 401)
values, slopes = map(np.array, zip(*(over_clearance([g]) for g in clearances), strict=True))
figure = Figure(figsize=(6.4, 4.0), layout="constrained")
axes = figure.subplots()
axes.plot(clearances, values, lw=1)
reach = np.array([-0.03, 0.03])
for k in range(10, len(clearances), 20):
    axes.plot(clearances[k] + reach, values[k] + slopes[k] * reach, "C1")
axes.set(xlabel="clearance g", ylabel="integral of the energy")
figure.savefig("impact_damper_integral.png")

# %%
# Descent from four designs
# -------------------------
# SciPy descends along the exact gradient, from several starts since each sequence of impacts may
# have a minimum of its own.

NAMES = ["g", "mu", "e"]
BOUNDS = [(0.5, 4.0), (0.02, 0.1), (0.3, 0.8)]
simulated = mi.value_and_jacobian(damped, integral, NAMES, duration=END, options=EXACT)
found = []
for clearance in (1.0, 1.5, 2.0, 2.5):
    result = minimize(simulated, [clearance, 0.08, 0.6], jac=True, bounds=BOUNDS)
    found.append(result)
    g, mu, e = result.x
    print(f"g {clearance} -> {g:.4f}, mu {mu:.4f}, e {e:.4f}: {result.fun:.4f}, {result.nfev} runs")

# %%
# The best design:

best = min(found, key=lambda result: result.fun)
design = damped.changed(**dict(zip(NAMES, best.x.tolist(), strict=True)))
run = mi.simulate(design, duration=END)
mi.plot_run(run, states=["x", "z"]).figure.savefig("impact_damper_run.png")

# %%
# Check
# -----
# Between impacts, both motions are known in closed form. A loop over them, with the instants by
# bisection, gives the same integral, and by differences the same gradient.


def closed_form(g, mu, e):
    """Return the integral of the energy."""
    frequency = math.sqrt(1 - ZETA**2)
    t, x, v, z, w, total = 0.0, 1.0, 0.0, 1.0, 0.0, 0.0
    while True:

        def oscillator(s, x=x, v=v):
            c = (v + ZETA * x) / frequency
            cos, sin = math.cos(frequency * s), math.sin(frequency * s)
            fade = math.exp(-ZETA * s)
            place = fade * (x * cos + c * sin)
            return place, fade * frequency * (c * cos - x * sin) - ZETA * place

        def margin(s, z=z, w=w, oscillator=oscillator):
            return g / 2 - abs(z + w * s - oscillator(s)[0])

        times = np.arange(1e-9, END - t, 0.002)
        beyond = [k for k, s in enumerate(times) if margin(s) < 0]
        ends = not beyond
        s = END - t if ends else brentq(margin, *times[[beyond[0] - 1, beyond[0]]], xtol=1e-15)
        total += quad(lambda s, o=oscillator: sum(u**2 for u in o(s)) / 2, 0, s, epsabs=1e-13)[0]
        if ends:
            return total
        (x, v), z, t = oscillator(s), z + w * s, t + s
        impulse = (1 + e) * (w - v) * mu / (1 + mu)
        v, w = v + impulse, w - impulse / mu


at = [1.7, 0.09, 0.55]
value, gradient = simulated(at)
assert abs(value - closed_form(*at)) < 1e-9
for k in range(3):
    up, down = np.array(at), np.array(at)
    up[k], down[k] = up[k] + 1e-5, down[k] - 1e-5
    difference = (closed_form(*up) - closed_form(*down)) / 2e-5
    assert abs(gradient[k] - difference) < 1e-7 * (1 + abs(gradient[k]))
