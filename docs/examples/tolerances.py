r"""
Tolerances: the yield of a wafer
================================

The preset ``mita2003`` makes steps of 20 nm at 100 V and 1 Hz. The devices of a wafer differ by
manufacturing tolerances. What share of them makes steps of 20 nm within a fifth, and which
improvement of the process raises this yield?
"""

import math

import numpy as np
import pandas as pd
from scipy import stats

import mems_impact as mi

mita = mi.load_actuator("mita2003")
drive = mi.Sine(amplitude=100.0, omega=2 * math.pi)
STEP = "displacement per period"  # a forcing period is half a cycle of the voltage: one blow

# %%
# Distributions
# -------------
# These variations are independent of each other:
#
# - *Etching* removes more or less from each edge than intended. Overetch makes beams thinner and gaps
#   wider, by twice the offset per edge; this is the dominant error of geometry
#   (measured by resonators: "MEMS process error characterization using lateral resonant
#   structures", *Proc. SPIE* 5343, 2003; on cantilevers: R. Mirzazadeh, S. Eftekhar Azam and
#   S. Mariani, *Sensors* 18, 1243, 2018). Assumed: a standard deviation of 50 nm per
#   edge, so that line widths deviate by 0.1 um, and by 0.2 um at most.
# - *Thickness*: a commercial process (SOIMUMPs) specifies 25 um of silicon to within 1 um, 4 %.
#   Stiffness, mass, electrode and film are proportional to it.
# - *Restitution* and *friction* depend on surfaces. Assumed: standard deviations of 0.02 each, which
#   is 7 % of the friction; static and dynamic friction vary together.
# - *Voltage*: a supply with a tolerance of 1 %.
#
# A function computes the parameters that depend on a common cause. Beams are assumed to be 5 um wide;
# their stiffness goes with the cube of the width, the damping of a film with the inverse cube of the
# gap.

over = {
    "etch": stats.norm(0.0, 50e-9),
    "thickness": stats.uniform(0.96, 0.08),
    "e": stats.norm(0.8, 0.02),
    "friction": stats.norm(0.27, 0.02),
    "voltage": stats.uniform(99.0, 2.0),
}


def device(etch, thickness, e, friction, voltage, width=5e-6):
    gap = mita.d + 2 * etch
    return {
        "k": mita.k * thickness * (1 - 2 * etch / width) ** 3,
        "m2": mita.m2 * thickness,
        "alpha": mita.alpha * thickness,
        "c": mita.c * thickness * (mita.d / gap) ** 3,
        "d": gap,
        "delta": mita.delta + 2 * etch,
        "e": e,
        "mu_d": friction,
        "mu_s": mita.mu_s * friction / mita.mu_d,
        "amplitude": voltage,
    }


# %%
# Spread and Sobol indices
# ------------------------
# Two samples of 256 devices, and their combinations for the Sobol indices, make 1792 runs. Each ends
# once its motion is recognized as periodic, after four periods.

wanted = {STEP: (16e-9, 24e-9)}
given = {"specification": wanted, "options": mi.Options(method="dop853")}
found = mi.tolerance_analysis(
    mita, drive, over=over, parameters=device, samples=256, indices=True, **given
)
print(found)
print(found.quantiles().loc[[STEP, "impact speed max", "energy lost per period"]])
assert found.indices is not None
indices = found.indices.query("quantity == @STEP").set_index("parameter")
print(indices[["first", "first low", "first high", "total"]].round(3))
mi.plot_tolerance_analysis(found, quantity=STEP).figure.savefig("tolerances_spread.png")

# %%
# One device in five is out of specification. Etching causes two thirds of the variance, friction a
# fifth, restitution a tenth; supply and thickness are good enough. First-order and total indices
# agree within their intervals: the effect of each tolerance hardly depends on the others, so each can
# be treated by itself.
#
# Possible improvements
# ---------------------
# Wider beams, whose stiffness depends less on 50 nm, as textbooks recommend; an etching twice as
# precise; or surfaces whose friction varies half as much.

rows = []
better = {**over, "etch": stats.norm(0.0, 25e-9)}
smooth = {**over, "friction": stats.norm(0.27, 0.01)}
for name, width, drawn in (
    ("as it is", 5e-6, over),
    ("beams of 20 um", 20e-6, over),
    ("beams of 2 um", 2e-6, over),
    ("etched to 25 nm", 5e-6, better),
    ("friction to 0.01", 5e-6, smooth),
):
    some = mi.tolerance_analysis(
        mita, drive, over=drawn, samples=256, **given,
        parameters=lambda width=width, **values: device(**values, width=width),
    )  # fmt: skip
    last = some.yields.iloc[-1]
    step = some.table[STEP]
    rows.append({"device": name, "sd of the step [nm]": 1e9 * step.std(), "yield": last["share"]})
    rows[-1] |= {"from": last["low"], "to": last["high"]}
table = pd.DataFrame(rows).set_index("device")
print(table.round(3))

# %%
# Wider beams reduce the yield. Etching affects the step through the gaps: a wider gap lets
# the block arrive faster. The same overetch softens the beams, which compensates a part of that, more
# so for narrow beams. So the position of the stoppers is the critical dimension, and the better
# etching is worth three times as much as the better surfaces.
#
# Check
# -----
# The nominal device makes 20 nm. Rows of the table agree with ordinary runs. The
# frame slides until friction has dissipated its energy, so that steps go with the inverse of
# friction. The speed of the first impact is independent of friction and
# restitution, and of the thickness, which stiffness, mass, electrode and film share.

names = list(device(0, 1, 0.8, 0.27, 100))
nominal = mi.simulate(mita, drive, periods=6, window=(4, 6)).statistics[STEP]
assert abs(nominal / 20e-9 - 1) < 0.01
for i in (0, 300, 1500):
    system = mita.under(drive).changed(**found.table.loc[i, names])
    run = mi.simulate(system, periods=6, window=(4, 6))
    assert math.isclose(run.statistics[STEP], found.table.loc[i, STEP], rel_tol=1e-6)

base = {"etch": 0.0, "thickness": 1.0, "e": 0.8, "voltage": 100.0}
slides = []
for friction in (0.25, 0.29):
    system = mita.under(drive).changed(**device(**base, friction=friction))
    slides.append(friction * mi.simulate(system, periods=6, window=(4, 6)).statistics[STEP])
print(slides)
assert math.isclose(*slides, rel_tol=0.03)

first = found.indices.query("quantity == 'impact speed max'").set_index("parameter")["total"]
assert (first[["thickness", "e", "friction"]] < 1e-9).all()
assert first["etch"] > 0.9
assert np.isclose(indices["first"].sum(), 1.0, atol=0.1)
