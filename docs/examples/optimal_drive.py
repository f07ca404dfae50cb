r"""
The fastest drive
=================

The microactuator of the paper walks at :math:`f = 0.24` and :math:`\omega = 0.5` with one step per
forcing period. Which parameters matter most? Which drive is faster, and how far is it from a
bifurcation? The periodic orbit and its derivatives answer these questions.
"""

import numpy as np
from matplotlib.figure import Figure

import mems_impact as mi

zhao = mi.load_actuator("zhao2004")
paper = mi.find_orbit(zhao, mi.Sine(amplitude=0.24, omega=0.5), transient=300)

# %%
# Sensitivities
# -------------
# ``sensitivity`` differentiates step, speed, impact speed and other quantities by all parameters of
# device and drive, by the variational equations along the orbit.

found = mi.sensitivity(paper)
elasticity = found.table.set_index(["quantity", "parameter"])["elasticity"]["mean speed"]
print(elasticity.round(2))
mi.plot_sensitivity(found, "mean speed").figure.savefig("optimal_drive_tornado.png", dpi=150)

# %%
# One per cent of the frequency changes the speed by 16 %, one per cent of the mass of the block or of
# its spring by 8 %: the distance from resonance dominates. The friction of the frame has a tenth of
# that effect, and static friction none, since each impact breaks the frame loose.
#
# With a tolerance of half a per cent on gaps, and of three on springs, whose stiffness goes with the
# third power of their width, the standard deviation of the speed is a quarter, to first order.

tolerances = {"delta": 0.0025, "d": 0.005, "k": 0.03}
deviation = found.standard_deviations(tolerances).set_index("quantity").loc["mean speed"]
print(deviation)

# %%
# A better drive
# --------------
# ``optimize`` maximizes the speed of the orbit, which has to stay stable.

best = mi.optimize(
    paper, maximize="mean speed", over={"amplitude": (0.2, 0.3), "omega": (0.45, 0.6)}
)
print(best.history)
print(best.values, best.active)
print(best.margins)
gain = best.value / (paper.step / paper.period)
print(f"{gain:.2f} times as fast")

# %%
# The optimum has the largest voltage and a frequency within its bounds: above it the speed falls,
# and 1.3 % above it the orbit ends in a fold. Multipliers change only close to the fold, so the
# bifurcation margins, ``best.margins``, continue the orbit to its end. At 4 % below the fold
# the device is slower by 8 %, and still 4.6 times as fast as before.

up = best.margins.query("parameter == 'omega' and direction == 'up'").iloc[0]
safe = mi.find_orbit(
    zhao, mi.Sine(amplitude=0.3, omega=0.96 * up["at"]), guess=best.orbit.state, transient=300
)
print(f"{safe.step / safe.period / best.value:.3f} of the speed at omega = {0.96 * up['at']:.4f}")

# %%
# The speed over the frequency, at the best voltage and at the paper's. Lines are the orbits, solid
# where stable; small markers are an independent upward sweep; large markers are the two orbits.

with mi.style():
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    for orbit, marker, color in ((paper, "o", "#00224e"), (best.orbit, "s", "#b3901f")):
        amplitude = orbit.system.parameters["amplitude"]
        for stop in (0.46, 0.6):
            table = mi.continue_solution(orbit, "omega", stop).table
            speed = table["step"] * table["omega"] / np.pi  # the force has half the period of v
            for stable, line in ((True, "-"), (False, "--")):
                part = speed.where((table["stable"] == stable) & (table["impacts"] == 1))
                axes.plot(table["omega"], 1e4 * part, line, color=color)
        values = np.arange(0.48, 0.59, 0.005)
        drive = mi.Sine(amplitude=amplitude, omega=0.48)
        swept = mi.sweep(zhao, drive, "omega", values, transient=200, periods=40).statistics
        axes.plot(
            swept["omega"], 1e4 * swept["mean speed"], marker, color=color, markersize=3,
            label=f"$f$ = {amplitude:g}",
        )  # fmt: skip
        here, speed = orbit.system.parameters["omega"], orbit.gains["x1"] / orbit.period
        axes.plot(here, 1e4 * speed, marker, color="white", markeredgecolor=color, markersize=7)
    axes.set(xlabel=r"$\omega$", ylabel="mean speed [$10^{-4}$]", xlim=(0.46, 0.59))
    axes.legend()
figure.savefig("optimal_drive_branch.png")

# %%
# Speed against energy
# --------------------
# The energy dissipated by impacts wears the stoppers. A Pareto front gives the highest speed for
# each loss per period.

front = mi.pareto_front(
    paper,
    {"mean speed": "maximize", "energy lost per period": "minimize"},
    over={"amplitude": (0.2, 0.3), "omega": (0.48, 0.58)},
    subject_to={"largest multiplier": (None, 0.8)},
    points=6,
)
print(front.table.drop(columns="held by").round(6).to_string(index=False))
mi.plot_pareto(front).figure.savefig("optimal_drive_front.png", dpi=150)

# %%
# The paper's point is close to the front: the best drive of its speed saves 5 % of the energy. The
# energy is nearly proportional to the speed. The best drives between the ends are as close to the
# fold as the constraint allows.
#
# Check
# -----
# The derivatives agree with differences of orbits. The best drive has the same speed in an ordinary
# run, and no value of the sweeps is better. Its margin ends at the fold that ``continue_solution``
# locates.

gradient = found.gradient("mean speed")
for name in ("omega", "k", "e"):
    here, h = paper.system.parameters[name], 1e-4 * paper.system.parameters[name]
    speeds = []
    for value in (here - h, here + h):
        there = mi.find_orbit(paper.system.changed(**{name: value}), guess=paper.state)
        speeds.append(there.gains["x1"] / there.period)
    assert abs((speeds[1] - speeds[0]) / (2 * h) / gradient[name] - 1) < 1e-4

run = mi.simulate(zhao, mi.Sine(**best.values), 500, window=(300, 500), initial=best.orbit.state)
assert abs(run.statistics["mean speed"] / best.value - 1) < 1e-6
assert swept["mean speed"].max() < best.value * (1 + 1e-9)
assert gain > 5
fold = mi.continue_solution(best.orbit, "omega", 0.6).special_points[0]
assert fold.label == "CF"
assert abs(fold.value - up["at"]) < 1e-9
