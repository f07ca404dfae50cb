r"""
The drive that walks fastest
============================

The microactuator of the paper walks at :math:`f = 0.24` and :math:`\omega = 0.5` with one step in
each period of the force. Which of its numbers matter most? Is there a better drive, and how near is
that to the edge of what works? An orbit answers, since it is known with its derivatives.
"""

import numpy as np
from matplotlib.figure import Figure

import mems_impact as mi

zhao = mi.load_actuator("zhao2004")
paper = mi.find_orbit(zhao, mi.Sine(amplitude=0.24, omega=0.5), transient=300)

# %%
# What matters
# ------------
# ``sensitivity`` differentiates step, speed, impact speed and the rest by all numbers of device and
# drive: by the variational equations along the orbit, without a single neighbouring run.

found = mi.sensitivity(paper)
elasticity = found.table.set_index(["quantity", "parameter"])["elasticity"]["mean speed"]
print(elasticity.round(2))
mi.plot_sensitivity(found, "mean speed").figure.savefig("optimal_drive_tornado.png", dpi=150)

# %%
# One per cent of the frequency makes 16 % of the speed, one per cent of the mass of the block or of
# its spring 8 %: what counts is how near the device is to resonance. The friction of the frame
# counts a tenth of that, and the static friction nothing, since each blow tears the frame off
# anyway.
#
# Gaps are etched to half a per cent, and springs, whose stiffness goes with the third power of
# their width, to three. To first order the standard deviation of the speed is then a quarter.

tolerances = {"delta": 0.0025, "d": 0.005, "k": 0.03}
deviation = found.standard_deviations(tolerances).set_index("quantity").loc["mean speed"]
print(deviation)

# %%
# A better drive
# --------------
# ``optimize`` goes along the gradient, with the orbit, which has to stay stable.

best = mi.optimize(
    paper, maximize="mean speed", over={"amplitude": (0.2, 0.3), "omega": (0.45, 0.6)}
)
print(best.history)
print(best.values, best.active)
print(best.margins)
gain = best.value / (paper.step / paper.period)
print(f"{gain:.2f} times as fast")

# %%
# The voltage stands at its bound, the frequency does not: beyond it the speed falls, and a little
# farther the orbit ends in a fold, 1.3 % of the frequency away. The multipliers tell of that only
# at the last moment. So ``margins`` follows the orbit to where it really ends. With 4 % to
# the fold the device is slower by 8 %, and still 4.6 times as fast as before.

up = best.margins.query("parameter == 'omega' and direction == 'up'").iloc[0]
safe = mi.find_orbit(
    zhao, mi.Sine(amplitude=0.3, omega=0.96 * up["at"]), guess=best.orbit.state, transient=300
)
print(f"{safe.step / safe.period / best.value:.3f} of the speed at omega = {0.96 * up['at']:.4f}")

# %%
# Over the frequency, at the best voltage and at the paper's: lines are the orbit, solid where it is
# stable; marks are runs, swept up, which know nothing of it. The large ones are the two orbits.

with mi.style():
    axes = Figure(layout="constrained").subplots()
    for orbit, marker, color in ((paper, "o", "#00224e"), (best.orbit, "s", "#b3901f")):
        amplitude = orbit.system.value("amplitude")
        for stop in (0.46, 0.6):
            table = mi.continue_orbit(orbit, "omega", stop).table
            speed = table["step"] * table["omega"] / np.pi  # the force has half the period of v
            for stable, line in ((True, "-"), (False, "--")):
                part = speed.where((table["stable"] == stable) & (table["impacts"] == 1))
                axes.plot(table["omega"], 1e4 * part, line, color=color)
        values = np.arange(0.48, 0.59, 0.005)
        drive = mi.Sine(amplitude=amplitude, omega=0.48)
        swept = mi.sweep_summary(
            mi.sweep(zhao, drive, "omega", values, direction="up", transient=200, periods=40)
        )
        axes.plot(
            swept["omega"], 1e4 * swept["mean speed"], marker, color=color, markersize=3,
            label=f"$f$ = {amplitude:g}",
        )  # fmt: skip
        here, speed = orbit.system.value("omega"), orbit.step / orbit.period
        axes.plot(here, 1e4 * speed, marker, color="white", markeredgecolor=color, markersize=7)
    axes.set(xlabel=r"$\omega$", ylabel="mean speed [$10^{-4}$]", xlim=(0.46, 0.59))
    axes.legend()
axes.figure.savefig("optimal_drive_branch.png")

# %%
# What speed costs
# ----------------
# The energy that the impacts take, period by period, wears the stoppers. Which drive gives the most
# speed for it? A Pareto front tells for each loss the highest speed.

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
# The paper's point is not far off: the best drive of its speed saves 5 % of the energy. Speed costs
# energy nearly in proportion, whatever the drive. What the best drives between the ends have in
# common is that they stand as near to the fold as they may.
#
# Check
# -----
# The derivatives are those of orbits that are found anew. The best drive walks as fast in a run
# that does not know the orbit, and no value of the sweeps is better. Its margin ends at the fold
# that ``continue_orbit`` finds.

gradient = found.gradient("mean speed")
for name in ("omega", "k", "e"):
    here, h = paper.system.value(name), 1e-4 * paper.system.value(name)
    speeds = []
    for value in (here - h, here + h):
        there = mi.find_orbit(paper.system.changed(**{name: value}), guess=paper.state)
        speeds.append(there.step / there.period)
    assert abs((speeds[1] - speeds[0]) / (2 * h) / gradient[name] - 1) < 1e-4

run = mi.simulate(zhao, mi.Sine(**best.values), 500, window=(300, 500), initial=best.orbit.state)
assert abs(run.statistics["mean speed"] / best.value - 1) < 1e-6
assert swept["mean speed"].max() < best.value * (1 + 1e-9)
assert gain > 5
fold = mi.continue_orbit(best.orbit, "omega", 0.6).special_points[0]
assert fold.label == "CF"
assert abs(fold.value - up["at"]) < 1e-9
