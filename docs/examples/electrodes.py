r"""
Plate, wedge and comb
=====================

Between parallel plates, the attraction grows faster than the spring: the block snaps to the stopper
at the pull-in voltage, and is released at a lower voltage. The force of a comb drive does not depend on
the position, so that the deflection is reversible. Here the preset ``mita2003`` has its own plates,
plates that are tilted by 1 degree, and a comb, with more damping, under a voltage that rises and
falls within two seconds.
"""

import math

import numpy as np
from matplotlib.figure import Figure

import mems_impact as mi

mita = mi.load_actuator("mita2003").replace(e=0.3, c=2e-3)
comb = mi.CombDrive(fingers=100, gap="2 um", thickness="20 um", overlap="30 um")
devices = {
    "parallel plates": mita,
    "tilted plates": mita.adding(mi.TiltedPlate(angle="1 deg", length="0.2 mm")),
    "comb": mita.adding(comb),
}
drive = mi.Sine(amplitude="20 V", bias="20 V", frequency="0.5 Hz", phase=math.pi)

runs = {name: mi.simulate(device, drive, periods=1) for name, device in devices.items()}

# %%
# Deflection over voltage. Triangles that point down are at the pull-in voltages, those that point up
# at the voltages of release, both from statics.

with mi.style():
    figure = Figure(figsize=(3.4, 2.6), layout="constrained")
    ax = figure.subplots()
    for (name, run), line in zip(runs.items(), ("-", "--", "-."), strict=True):
        samples = run.samples(4000)
        volts = drive.value(samples["t"].to_numpy())
        ax.plot(volts, 1e6 * samples["x2"], line, linewidth=0.9, label=name)
        ax.plot(mi.resting_voltage(devices[name]), 1e6 * mita.delta, "k^", markersize=4)
        if name != "comb":
            ax.plot(mi.pull_in_voltage(devices[name]), 1e6 * mita.delta, "kv", markersize=4)
    ax.set(xlabel="voltage [V]", ylabel=r"deflection $x_2$ [$\mu$m]", ylim=(-0.1, 2.9))
    ax.legend(loc="upper left")
    figure.savefig("electrodes_pull_in.png", dpi=300)

# %%
# Check
# -----
# The closed forms of the plates (:math:`4 k d^3/(27 \alpha)`), of the wedge
# (:math:`k x ((d - x)^2 - w^2)/\alpha`, with half the difference :math:`w` of the gaps at its ends)
# and of the comb (:math:`2 k \delta/C'`) give the squared voltages.

wedge = 0.5 * 2e-4 * math.radians(1.0)
x = np.linspace(0.0, mita.delta, 100001)
squared = {
    "parallel plates": 4.0 * mita.k * mita.d**3 / (27.0 * mita.alpha),
    "tilted plates": (mita.k * x * ((mita.d - x) ** 2 - wedge**2) / mita.alpha).max(),
}
for name, value in squared.items():
    assert abs(mi.pull_in_voltage(devices[name]) ** 2 / value - 1.0) < 1e-8
slope = 2.0 * comb.fingers * comb.permittivity * comb.thickness / comb.gap
contact = math.sqrt(2.0 * mita.k * mita.delta / slope)
assert abs(mi.resting_voltage(devices["comb"]) / contact - 1.0) < 1e-12

# %%
# In the runs the block strikes at most 2.5 % above the static voltage, since it leaves the vanishing
# equilibrium slowly.

for name, run in runs.items():
    hit = drive.value(run.impacts["time"].iloc[0])
    expected = contact if name == "comb" else mi.pull_in_voltage(devices[name])
    assert abs(hit / expected - 1.0) < 0.025
