r"""
Friction of a belt, fitted to a record
======================================

A mass on a moving belt sticks and slips. Its positions were recorded with noise; the stiffness
:math:`k` and both coefficients of friction are wanted:

.. math:: \ddot x = -k x - \mu\,\mathrm{sgn}(\dot x - v_0).

The static coefficient acts through the instants at which sticking ends alone, which depend on it
exactly as the derivatives of the run say.
"""

import numpy as np
import pandas as pd

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, -p.k * y.x


belt = mi.System(
    states=("x", "v"),
    flow=flow,
    parameters={"k": 1.0, "v0": 0.2, "mu_s": 1.0, "mu_d": 0.6},
    initial={"x": 0.1, "v": 0.2},
    parts=[mi.Friction("belt", "v", mu="mu_d", static="mu_s", surface="v0")],
)

# %%
# The record
# ----------
# A run at known parameters takes the place of a measurement: 120 positions, with an error of 0.02.

truth = {"k": 1.0, "mu_s": 1.0, "mu_d": 0.6}
times = np.linspace(0.3, 25.0, 120)
run = mi.simulate(belt, duration=25.0)
exact = run.derivatives(["k"]).samples(times)["x"]
noise = np.random.default_rng(3).normal(0.0, 0.02, times.size)
record = pd.DataFrame({"t": times, "x": exact + noise})

# %%
# The fit
# -------
# The search begins 5 % beside the truth. The error of the record is not given, but estimated from
# the residuals.

guess = belt.changed(k=1.05, mu_s=1.05, mu_d=0.57)
found = mi.fit(guess, record, free=list(truth))
print(found)
print(found.parameters[["parameter", "fitted", "standard error", "95 % low", "95 % high"]])
mi.plot_fit(found).figure.savefig("friction_from_a_record_fit.png")

# %%
# Stiffness and static friction are strongly correlated: the period of the cycle depends on both.

print(found.correlations.round(2))
mi.plot_fit(found, kind="ellipses").figure.savefig("friction_from_a_record_ellipses.png")

# %%
# Check
# -----
# The truth is within four standard errors, and so is the error of the record.

table = found.parameters.set_index("parameter")
for name, value in truth.items():
    assert abs(table.loc[name, "fitted"] - value) < 4 * table.loc[name, "standard error"]
assert abs(found.noise["x"] - 0.02) < 4 * 0.02 / np.sqrt(2 * times.size)
