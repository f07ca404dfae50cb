r"""
Where the actuator walks: an operating map
==========================================

The actuator of Zhao et al. under :math:`V = f \cos\omega t`: at which amplitude and frequency does
it walk, how long is its step, and where is its motion chaotic? Every point of the map is a run
that starts with a kick against a stopper and lasts until the motion is recognized as periodic.
The curves over the map are computed independently: `operating_chart` continues grazings and folds
of periodic orbits, as in Fig. 7 of the paper.
"""

import numpy as np

import mems_impact as mi

actuator = mi.load_actuator("zhao2004")
drive = mi.Sine(amplitude=0.24, omega=0.5)

found = mi.operating_map(
    actuator,
    drive,
    x=("omega", np.linspace(0.44, 0.51, 30)),
    y=("amplitude", np.linspace(0.16, 0.30, 30)),
    initial=mi.kicked_state(actuator),
)
print(found.motions.round(4).to_string(index=False))

# %%
# Periodic points cost few forcing periods, since they end as soon as they have settled. All others
# cost at least ``transient`` and ``periods`` (see `RecurrenceOptions`), and a Lyapunov exponent that
# detects chaos.

print(found.table.groupby("motion")["returns"].mean().round(1))

# %%
# The boundaries
# --------------
# ``crises=0`` omits the boundary at a crisis, which is simulated and not continued.

chart = mi.operating_chart(actuator, drive, omega=(0.44, 0.51), crises=0)
mi.plot_map(found, boundaries=chart).figure.savefig("operating_map_motions.png", dpi=200)

# %%
# Above the boundary "on" there is no stable orbit without impacts: the device walks from any initial
# state. Between "off" and "on", at high frequencies, an attractor with impacts and one without
# coexist, and the kick decides which one a point of the map reaches. Periodic walking has one impact
# per forcing period. At low frequencies and amplitudes walking is chaotic: the steps scatter, but
# their mean is constant. A thin strip of period doublings lies between.
#
# The speed
# ---------

mi.plot_map(found, "mean speed", boundaries=chart).figure.savefig(
    "operating_map_speed.png", dpi=200
)

# %%
# Check
# -----
# No point of the map that is more than a cell beyond the curves contradicts the chart.

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
# A point of period 1 has the step of the orbit computed by `find_orbit`.

periodic = table[(table["motion"] == "periodic") & (table["period"] == 1)]
point = periodic.iloc[len(periodic) // 2]
there = drive.varied({"amplitude": point["amplitude"], "omega": point["omega"]})
orbit = mi.find_orbit(actuator, there, guess=mi.kicked_state(actuator), transient=300)
print(orbit.step, point["displacement per period"])
assert abs(point["displacement per period"] / orbit.step - 1.0) < 1e-5
