r"""
Resonant grazing: folds and period doublings tangent to a grazing curve
=======================================================================

A forced mass on a damped spring has a stop at :math:`x = 1`, with the restitution :math:`e`:

.. math:: \ddot x + c\,\dot x + x = A \cos \omega t .

At :math:`A = A_G(\omega)` the orbit without impacts grazes the stop. A weak impact changes the velocity,
and in general also the position a period later, so that the stable orbit ends there. At resonance,
where a forcing period is half a period :math:`\pi/\nu` of the damped motion (or a multiple of it), the
position is unchanged. From that point of the grazing curve, a curve of folds (CF) and one of period
doublings (PD) of the orbit with one impact per period emanate, tangent to it.
"""

import math

import numpy as np
from matplotlib.figure import Figure

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.omega * t) - p.c * y.v - y.x


def gap(mode, t, y, p):
    return 1.0 - y.x


def strike(mode, t, y, p):
    return mode, (1.0, -p.e * y.v)


oscillator = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"A": 2.5, "omega": 1.93, "c": 0.3, "e": 0.8},
    guards=[mi.Impact("stop", gap, strike)],
)
c, e = (oscillator.parameters[name] for name in "ce")
resonance = math.sqrt(4.0 - c**2)  # twice the damped frequency nu

# %%
# Below the resonance, the branch of the orbit without impacts passes the grazing and folds at a
# smaller amplitude, a jump with hysteresis. Above it, the orbit with one impact becomes stable at a
# period doubling beyond the grazing. The curve of each point leads to the resonance.

silent = mi.find_orbit(oscillator, transient=100)
below = mi.continue_solution(silent, "A", stop=3.0)
silent = mi.find_orbit(oscillator.changed(omega=2.03), transient=100)
above = mi.continue_solution(silent, "A", stop=3.4)
for branch in (below, above):
    print(branch.special_table[["label", "A", "impact speed"]])

grazing, fold = below.special_points
doubling = above.special_points[1]
steps = mi.StepControl(max_step=0.01)
curves = [
    mi.continue_curve(special, "omega", stop, steps=steps)
    for special, stop in ((grazing, 2.03), (fold, 2.03), (doubling, 1.93))
]
for curve in curves:
    print(curve)

# %%
# Check
# -----
# In closed form, with :math:`T = 2\pi/\omega` and the factor :math:`m = -e^{-cT/2}` by which the
# motion decays in a period,
#
# .. math::
#
#    \frac{A_{CF}}{A_G} &= 1 - \frac{\sigma^2}{2\,(1 + e m)^2}, \qquad
#    \sigma = \frac{(1 + e)\,m\,T}{1 - m}\,(\omega - 2\nu), \\
#    \frac{A_{PD}}{A_G} &= 1 + \frac{\sigma^2}{2}\,
#    \frac{2\,(1 - e m)^2 + (1 + e m)^2}{(1 - e m)^4},
#
# up to terms of higher order (dashed in the figure). D. J. W. Simpson and I. Ghosh,
# arXiv 2602.22797 (2026), prove the tangency for one-degree-of-freedom oscillators.

T = 2.0 * math.pi / resonance
m = -math.exp(-0.5 * c * T)
plus, minus = (1.0 + e * m) ** 2, (1.0 - e * m) ** 2
half = 0.5 * ((1.0 + e) * m * T / (1.0 - m)) ** 2
coefficients = {"CF": -half / plus, "PD": half * (2.0 * minus + plus) / minus**2}

with mi.style():
    figure = Figure(figsize=(5.0, 3.2), layout="constrained")
    ax = figure.subplots()
    places = {"G": (1.935, 1.0004), "CF": (1.9375, 0.9878), "PD": (2.016, 1.0045)}
    colors = {"G": "tab:blue", "CF": "tab:red", "PD": "black"}
    for curve in curves:
        omega, A = (curve.table[name].to_numpy() for name in ("omega", "A"))
        ratio, h = A / np.hypot(1.0 - omega**2, c * omega), omega - resonance
        color = colors[curve.label]
        ax.plot(omega, ratio, color=color)
        ax.annotate(curve.label, places[curve.label], color=color, ha="right", va="bottom")
        if curve.label == "G":
            assert np.abs(ratio - 1.0).max() < 1e-9
            continue
        parabola = coefficients[curve.label]
        ax.plot(omega, 1.0 + parabola * h**2, "--", color=color, linewidth=0.8)
        apart = abs(h) > 2e-3
        near = np.polynomial.polynomial.polyfit(h[apart], ((ratio - 1.0) / h**2)[apart], 3)
        print(curve.label, near[0], parabola)
        assert abs(near[0] / parabola - 1.0) < 1e-3
    ax.plot(resonance, 1.0, "o", color="black", markersize=4)
    ax.text(1.945, 1.0035, "one impact per period")
    ax.text(1.937, 0.997, "both orbits")
    ax.text(1.985, 0.99, "no impact")
    ax.set(xlabel=r"$\omega$", ylabel="$A / A_G$", xlim=(1.93, 2.03))
figure.savefig("resonant_grazing_curves.png")

for curve in curves:
    assert abs(curve.special_points[-1].values["omega"] - resonance) < 1e-7
