r"""
Where the actuator walks: an operating map
==========================================

The actuator of Zhao et al. under :math:`V = f \cos\omega t`: at which amplitude and frequency does
it walk, with how long a step, and where is its motion chaotic? Every point of the map is a motion
of its own, which starts with a kick that strikes a stopper and is followed until it repeats itself.
The curves over it are not simulated: `operating_chart` follows grazings and folds of periodic
orbits, as in Fig. 7 of the paper. Both must tell the same.
"""

import numpy as np

import mems_impact as mi

actuator = mi.load_actuator("zhao2004")
drive = mi.Sine(amplitude=0.24, omega=0.5)

found = mi.operating_map(
    actuator,
    drive,
    x=("amplitude", np.linspace(0.16, 0.30, 30)),
    y=("omega", np.linspace(0.44, 0.51, 30)),
    initial=mi.kicked_state(actuator),
)
print(mi.map_summary(found.table).round(4).to_string(index=False))

# %%
# Periodic points cost few forcing periods, since they are left as soon as they have settled; those
# that never repeat themselves cost all of ``transient`` and ``periods`` (see `RecurrenceOptions`), and a
# Lyapunov exponent, which tells whether they are chaotic.

print(found.table.groupby("motion")["returns"].mean().round(1))

# %%
# The boundaries
# --------------
# ``crises=0`` leaves out the boundary that no curve gives, where the walk ends in a crisis: the map
# shows it.

chart = mi.operating_chart(actuator, drive, omega=(0.44, 0.51), crises=0)
mi.plot_map(found, boundaries=chart).figure.savefig("operating_map_motions.png", dpi=200)

# %%
# To the right of "switching on" there is no orbit without impacts: the device walks, wherever it
# starts. Between "switching off" and that, at high frequencies, it may walk or stand still, and the
# kick decides. Where the walk is periodic it makes one impact in every forcing period. Below the
# diagonal it is chaotic: the steps scatter, though their mean is steady. Between lies a thin strip
# of period doublings.
#
# The speed
# ---------

mi.plot_map(found, "mean speed", boundaries=chart).figure.savefig(
    "operating_map_speed.png", dpi=200
)

# %%
# Check
# -----
# Beyond the curves of the chart by more than a cell, no point of the map says otherwise.

table = found.table
cell = 0.14 / 29
ends = {}
for boundary in ("on", "off"):
    rows = chart.table.query("boundary == @boundary").sort_values("omega")
    ends[boundary] = np.interp(
        table["omega"], rows["omega"], rows["amplitude"], left=np.nan, right=np.nan
    )
beyond = table["amplitude"] > ends["on"] + cell
below = table["amplitude"] < np.minimum(ends["off"], ends["on"]) - cell
print(f"{beyond.sum()} points beyond switching on, {below.sum()} below switching off")
assert not (table["motion"][beyond] == "off").any()
assert (table["motion"][below] == "off").all()

# %%
# And a point of period 1 has the step of the orbit that `find_orbit` corrects to rounding.

periodic = table[(table["motion"] == "periodic") & (table["period"] == 1)]
point = periodic.iloc[len(periodic) // 2]
there = drive.varied({"amplitude": point["amplitude"], "omega": point["omega"]})
orbit = mi.find_orbit(actuator, there, guess=mi.kicked_state(actuator), transient=300)
print(orbit.step, point["displacement per period"])
assert abs(point["displacement per period"] / orbit.step - 1.0) < 1e-5
