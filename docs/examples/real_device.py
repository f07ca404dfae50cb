r"""
A real device: air, leads, stoppers
===================================

The preset ``mita2003`` makes steps of 20 nm at 100 V and 1 Hz, as measured. It has a constant
damping :math:`c = 0.2\sqrt{k m_2}`, an assumption for the air in its narrow gap; a voltage
without resistance; and stoppers with instantaneous impacts. This page adds, one after the
other, air in the gap, at 1 bar and at 5 Pa; leads of 10 kOhm; and stoppers of
silicon. It shows their effect on the step, on the voltages at which the device walks, and on the
cost of a run.
"""

import math

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.optimize import brentq

import mems_impact as mi

mita = mi.load_actuator("mita2003")
critical = math.sqrt(mita.k * mita.m2)  # c of quality factor 1

# %%
# The devices
# -----------
# The suspension alone is assumed to have a quality factor of 50. The film on a face of 1 mm x
# 0.167 mm provides the rest of the preset's damping of small oscillations. The evacuated device is
# at 5 Pa. At 1 Pa the mean free path is 2,700 times the gap at the stopper, beyond
# the fit of the viscosity, as a ``ValidityWarning`` says; the film has lost its effect long before.
# (The step below is 30.98 nm at 1 Pa, 30.96 nm at 5 Pa.)

film = mi.SqueezeFilm(
    pressure=1e5, length=1e-3, width=1.67e-4, viscosity=1.82e-5, free_path_pressure=6.7e-3
)
bare = mita.replace(c=critical / 50)
air = bare.adding(film)
pumped = bare.adding(film.replace(pressure=5.0))

# %%
# The leads have 10 kOhm and, beside the 35 fF of the electrode, 3 pF. A stopper is a pillar of
# silicon, 10 um square and 160 um long, of the stiffness :math:`E A/L` = 1e5 N/m with :math:`E` =
# 160 GPa. Its damping makes e = 0.8, the preset's, of 0.75 mm/s, the speed of the first impact in
# air.

leads = air.adding(mi.SeriesResistance(resistance=1e4, parasitic_capacitance=3e-12))


def mismatch(b, speed=7.5e-4, e=0.8):
    """Return the residual of Hunt and Crossley's equation for e; b is 3/2 of the damping."""
    return b * (1 + e) * speed - math.log((1 + b * speed) / (1 - b * e * speed))


damping = brentq(mismatch, 10.0, 1500.0) / 1.5
yielding = leads.adding(mi.CompliantStopper(stiffness=1e5, damping=damping))
print(f"damping of the stopper: {damping:.0f} s/m")

devices = {"preset": mita, "air": air, "5 Pa": pumped, "leads": leads, "stoppers": yielding}

# %%
# The step
# --------
# The quality factor of small oscillations comes from their ring-down; the step is at the fitted
# point. The effects are cumulative: leads include air, stoppers include leads.

slow = mi.Sine(amplitude=100.0, omega=2 * math.pi, phase=-math.pi / 2)  # begins at 0 V
bdf = mi.Options(method="bdf")
small = mi.State(x2=5e-8)
quality = {
    name: mi.ring_down(devices[name], slow, initial=small, options=bdf).quality
    for name in ("preset", "air", "5 Pa")
}
print(quality)


def settled(device, drive, cycles, options=bdf):
    """Return a run from rest, with statistics of its second half."""
    periods = round(cycles * 2 * math.pi / drive.omega / device.under(drive).forcing_period)
    window = (periods // 2, periods)
    return mi.simulate(
        device, drive, periods=periods, window=window, initial=mi.State(), options=options
    )


rows, steps = [], {}
for name, device in devices.items():
    run = settled(device, slow, 2)
    number = run.statistics
    steps[name] = number["displacement per blow"]
    rows.append(
        {
            "device": name,
            "step [nm]": 1e9 * steps[name],
            "first impact [mm/s]": 1e3 * number["impact speed max"],
            "integrator's steps a cycle": run.summary()["steps"] // 2,
        }
    )
print(pd.DataFrame(rows).round(3).to_string(index=False))

# %%
# The preset's damping holds for small oscillations only. At the stopper the gap is half as wide, and
# the air damps eight times as much: the block arrives more slowly, and the step falls from 20 to
# 8.4 nm. A fit of a constant damping to a ring-down, and of the stiffness to a step, gives a
# wrong stiffness. 10 kOhm change the step by two millionths, since the leads charge within 30 ns.
# Compliant stoppers reduce the step by a tenth, and a run takes thirteen times as many integration
# steps, since the resting block oscillates on a stiff spring.
#
# Evacuated
# ---------
# Without air the step is half as long again as the preset's, and erratic: with a
# quality factor of 50 the block still oscillates at the next pull-in, and the step depends on the
# phase: 9 nm at 5 Hz, 158 nm at 6 Hz. With air at 1 bar the step is a smooth function of frequency up
# to some 5 Hz.

hertz = np.arange(1.0, 13.0)
colors = {"preset": "0.5", "air": "#b3901f", "5 Pa": "#00224e"}
with mi.style():
    figure = Figure(layout="constrained")
    axes = figure.subplots()
    for name, look in (("air", "^-"), ("5 Pa", "o--")):
        found = mi.sweep(
            devices[name], slow, "omega", 2 * math.pi * hertz, transient=4, periods=4, options=bdf
        ).statistics
        size = 1e9 * found["displacement per period"] / found["blows per period"]
        axes.plot(hertz, size, look, color=colors[name], label=name)
        print(name, size.round(1).to_list())
    axes.set(xlabel="frequency [Hz]", ylabel="step [nm]", ylim=0)
    axes.legend()
figure.savefig("real_device_step.png")

# %%
# Voltages at which it walks
# --------------------------
# Near half its resonance of 240 Hz the device walks at far lower voltages. ``operating_chart``
# continues the boundaries of walking, for the preset and for the device with suspension damping
# only. With a film the equations are stiff, and sweeps up and down in steps of 1 V are quicker; so
# for leads and stoppers, at one frequency.

omegas = [650.0, 680.0, 710.0, 740.0]
studies = {  # voltages, frequencies, and periods to settle and to measure
    "air": (np.arange(32.0, 42.0), omegas, 12, 6),
    "5 Pa": (np.arange(9.0, 24.0), omegas, 200, 20),
    "leads": (np.arange(33.0, 41.0), [710.0], 6, 3),
    "stoppers": (np.arange(33.0, 41.0), [710.0], 6, 3),
}
charts = {
    "preset": mi.operating_chart(mita, omega=(640.0, 760.0), crises=0),
    "5 Pa": mi.operating_chart(bare, omega=(640.0, 760.0), crises=0),
}

rows = []
for name, (volts, frequencies, transient, periods) in studies.items():
    for omega in frequencies:
        drive = mi.Sine(amplitude=volts[0], omega=omega)
        sweep = mi.sweep(
            devices[name], drive, "amplitude", volts, direction="both", transient=transient,
            periods=periods, options=bdf,
        )  # fmt: skip
        lowest = sweep.statistics.query("impacting").groupby("direction")["amplitude"].min()
        rows.append({"device": name, "omega": omega, "on": lowest["up"], "off": lowest["down"]})
swept = pd.DataFrame(rows)
print(swept.to_string(index=False))

with mi.style():
    figure = Figure(figsize=(3.4, 3.2), layout="constrained")
    axes = figure.subplots()
    for whose in ("preset", "5 Pa"):
        for boundary, line in (("on", "-"), ("off", ":")):
            part = charts[whose].table.query("boundary == @boundary").sort_values("omega")
            label = "preset" if whose == "preset" else "suspension alone"
            axes.plot(
                part["omega"], part["amplitude"], line, color=colors[whose],
                label=label if boundary == "on" else None,
            )  # fmt: skip
    for name, marker in (("air", "^"), ("5 Pa", "o")):
        part = swept.query("device == @name")
        axes.plot(part["omega"], part["on"], marker, color=colors[name], label=name)
        axes.plot(
            part["omega"], part["off"], marker, color=colors[name], markersize=6.5, fillstyle="none"
        )
    axes.plot([], [], "o-", color="black", label="on")
    axes.plot([], [], "o:", color="black", markersize=6.5, fillstyle="none", label="off")
    axes.set(xlabel=r"$\omega$ [rad/s]", ylabel="amplitude [V]", xlim=(640, 760), ylim=(0, 45))
    figure.legend(ncols=3, loc="outside upper right")
figure.savefig("real_device_chart.png")

# %%
# With air, walking at 710 rad/s begins above 36 V instead of at 28.6 V. Evacuated, the device walks
# from 16 V on, and from 11 V at 740 rad/s, on the same curve as without a film. Below 738 rad/s this
# boundary is a fold, where the orbit without impacts vanishes before it grazes (type III). At
# 680 rad/s walking begins there too, but over the first volt with six impacts in a hundred periods,
# which ten periods do not show. Leads and stoppers shift the boundaries by less than a volt.
#
# Speed and cost
# --------------
# The table shows the speed at 42 V and 710 rad/s, and the integration steps per cycle of the voltage.
# Pressure in the film decays within a microsecond and charge behind the leads within 30 ns, against
# a cycle of 9 ms: Adams' method stops after 20,000 steps for one flight.
# ``method="auto"`` recognizes this; in air it takes 1,905 steps, as many as BDF. The compliant
# stoppers make the device slower by 30 %, since restitution falls with the impact speed: it is 0.8
# at 0.75 mm/s and less at 2.5 mm/s.

brisk = mi.Sine(amplitude=42.0, omega=710.0)
rows = []
for name, device in devices.items():
    row, runs = {"device": name}, {}
    for method in ("adams", "bdf"):
        options = mi.Options(method=method, max_steps=20_000)
        try:
            runs[method] = settled(device, brisk, 20, options)
        except mi.RunError as error:
            print(f"{name}, {method}: {error}"[:72], "...")
            row[method] = "fails"
        else:
            row[method] = runs[method].summary()["steps"] // 20
    row["speed [um/s]"] = 1e6 * runs["bdf"].statistics["mean speed"]
    row["impact [mm/s]"] = 1e3 * runs["bdf"].statistics["impact speed max"]
    rows.append(row)
print(pd.DataFrame(rows).round(2).to_string(index=False))

# %%
# A larger resistance forms a low-pass filter with the parasitic capacitance, and the device walks as
# at the attenuated voltage: 0.2 Gohm reduce the speed by two fifths. With 3 pF it is another 3 %
# slower, since the capacitance of the electrode grows as the gap closes; with 300 pF this effect
# vanishes.

ratios = []
for ohms, farads in ((2e8, 3e-12), (2e6, 3e-10)):
    changed = {
        "series_resistance.resistance": ohms,
        "series_resistance.parasitic_capacitance": farads,
    }
    filtered = settled(leads.changed(**changed), brisk, 20).statistics["mean speed"]
    lag = brisk.omega * ohms * (farads + 2 * mita.alpha / mita.d)
    weaker = brisk.replace(amplitude=brisk.amplitude / math.hypot(1.0, lag))
    direct = settled(air, weaker, 20).statistics["mean speed"]
    print(f"{1e6 * filtered:.2f} um/s through {ohms:g} ohm, {1e6 * direct:.2f} at that voltage")
    ratios.append(filtered / direct)

# %%
# Check
# -----
# The step of the preset is the measured one. The quality factor in air follows from the suspension
# and from the closed form for a plate in slow motion (:math:`\mu L W^3/h^3 (1 - 0.630\,
# W/L)`, J. J. Blech, *J. Lubrication Technology* 105, 615, 1983), with the viscosity of a rarefied
# gas (T. Veijola et al., *J. Microelectromech. Syst.* 4, 109, 1995).

assert abs(steps["preset"] / 20e-9 - 1) < 0.01
length, width = film.length, film.width
knudsen = film.free_path_pressure / (1e5 * mita.d)
viscosity = film.viscosity / (1 + 9.638 * knudsen**1.159)
squeezed = viscosity * length * (width / mita.d) ** 3 * (1 - 0.630 * width / length)
assert math.isclose(quality["air"], critical / (bare.c + squeezed), rel_tol=2e-3)

# %%
# Evacuated, walking begins within 3 % of the curve continued without a film. The small
# resistance changes nothing, and the large one acts as the filter.

on = charts["5 Pa"].table.query("boundary == 'on'").sort_values("omega")
for omega in (650.0, 710.0, 740.0):
    followed = np.interp(omega, on["omega"], on["amplitude"])
    volts = followed * np.array([0.7, 0.97, 1.03])
    drive = mi.Sine(amplitude=volts[0], omega=omega)
    sweep = mi.sweep(pumped, drive, "amplitude", volts, transient=150, periods=150, options=bdf)
    assert sweep.statistics["impacting"].to_list() == [False, False, True]
assert math.isclose(steps["leads"], steps["air"], rel_tol=1e-5)
assert math.isclose(ratios[1], 1.0, rel_tol=1e-3)
