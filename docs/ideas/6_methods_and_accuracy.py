"""
Methods and accuracy
====================

One event loop serves four integration methods: CVODE's Adams and BDF, an explicit one-step method of
order 8 (``dop853``), and ``auto``, which uses ``dop853`` and changes to BDF in stiff modes. Events are located
to rounding with every method, so the error of a run is the error of its arcs.
"""

import numpy as np
from matplotlib.figure import Figure

import mems_impact as mi

actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
name = "displacement per period"


def step(method, rtol):
    options = mi.Options(method=method, rtol=rtol, atol=rtol / 100)
    return mi.simulate(actuator, drive, periods=300, options=options).statistics[name]


truth = step("dop853", 1e-13)
tolerances = np.array([1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10])
with mi.style():
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    for method, look in (("adams", "o-"), ("bdf", "s--"), ("dop853", "^:")):
        errors = np.array([abs(step(method, rtol) / truth - 1.0) for rtol in tolerances])
        axes.loglog(tolerances, np.maximum(errors, 1e-16), look, label=method)
        assert errors[-1] < 1e-6
    axes.set(xlabel="relative tolerance", ylabel="relative error of the step")
    axes.legend()
figure.savefig("methods_and_accuracy.png")

# %%
# The errors of Adams and BDF decrease with the tolerance, and the errors of ``dop853`` stay far below the tolerance; the
# events do not degrade them. ``verify`` repeats any run with an unrelated method:

run = mi.simulate(actuator, drive, periods=300)
verification = run.verify()
print(verification.verdict)
assert verification.agrees

# %%
# :doc:`/guide` compares the methods and their cost, :doc:`/promises` states the accuracy.
