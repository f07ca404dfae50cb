r"""
A contact switch: bounces and soft landing
==========================================

An RF switch is an actuator whose frame keeps its place: the block is the armature, the right stopper
the contact. The preset ``abdulrahim2016`` has the numbers of F. Abdul Rahim and M. I. Younis,
"Control of bouncing in MEMS switches using double electrodes", *Math. Probl. Eng.* 2016, 3479752,
Table 1. This page compares them with ours, computes the bounces under a step, and finds the pulse
that closes the contact at zero speed.
"""

import math

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.integrate import quad
from scipy.optimize import brentq

import mems_impact as mi

switch = mi.load_actuator("abdulrahim2016")

# %%
# Published numbers and ours
# --------------------------
# The table of the paper gives the stiffness and, as :math:`\epsilon A/2m`, the electrode per mass.
# The natural frequency, "2.1e4 [Hz]", then gives mass and electrode:

permittivity = 8.854e-12
for reading, omega in {"hertz": 2 * math.pi * 21e3, "rad/s": 21e3}.items():
    mass = 42.0 / omega**2
    side = math.sqrt(2 * 1.9e-11 * mass / permittivity)
    pull_in = math.sqrt(4 * omega**2 * switch.d**3 / (27 * 1.9e-11))
    print(f"{reading}: {mass * 1e9:.1f} ug, electrode {side * 1e3:.2f} mm square, {pull_in:.1f} V")

# %%
# The preset takes the unit as printed: the electrode is then 0.10 mm square, in rad/s 0.64 mm.
#
# The contact differs. The paper's has a natural frequency of 61 kHz and a damping ratio of 0.2. A
# spring of that frequency, from the contact point on, holds the electrodes apart up to 62.7 V only,
# below the pull-in voltage. The preset therefore has a rigid contact, with the restitution of a
# linear contact with that damping ratio, :math:`\exp(-\pi\zeta/\sqrt{1-\zeta^2})`. Its bounces
# consist of flights alone; the bounces of the paper include contacts of about half a period, 8 us.

sheet = switch.datasheet
damping = -math.log(switch.e)
contact_ratio = damping / math.hypot(math.pi, damping)
rows = [
    ("natural frequency [Hz]", "2.1e4", f"{sheet['frequency']:g}", ""),
    ("damping ratio", "0.02", f"{sheet['damping_ratio']:g}", ""),
    ("gap [m]", "3.8e-6", f"{switch.d:g}", ""),
    ("maximum travel [m]", "2.6e-6", f"{switch.delta:g}", ""),
    ("epsilon A/2m [F m/kg]", "1.9e-11", f"{switch.alpha / switch.m2:.7g}", ""),
    ("spring constant [N/m]", "42", f"{switch.k:g}", ""),
    ("frequency in contact [Hz]", "6.1e4", "none", "rigid contact"),
    ("damping ratio in contact", "0.2", f"{contact_ratio:.4f}", f"as restitution {switch.e:g}"),
    ("frame", "fixed", f"{switch.m1 / switch.m2:g} m2", "heavy chip, held by friction"),
]
table = pd.DataFrame(rows, columns=["quantity", "published", "ours", "difference"])
print(table.to_string(index=False))
print(f"pull-in at {mi.pull_in_voltage(switch):.1f} V, not published")
print(f"by a step at {mi.pull_in_voltage(switch, dynamic=True):.1f} V")

# %%
# No measured closing is published for this switch. R. C. Tung et al., *J. Microelectromech. Syst.*
# 23, 137 (2014), measure bounces within bounces on other switches, at the frequencies of higher
# modes of the beam; one block cannot have them.
#
# Closing under a step
# --------------------

volts = 110.0
step = mi.closing(switch, mi.VoltageStep(amplitude=volts))
print(step)
print(step.table.head(4).to_string(index=False, float_format="{:.4g}".format))

# %%
# Soft landing
# ------------
# A pulse of the same voltage accelerates the block, which coasts to the contact and is held there.
# ``soft_landing`` varies the width of the pulse and the pause.

pulse = mi.PulseAndHold(amplitude=volts, width=1.2e-5, pause=1e-5, hold=90.0)
bounds = {"width": ("5 us", "20 us"), "pause": ("1 us", "20 us")}
soft = mi.soft_landing(switch, pulse, over=bounds)
print(soft)

# %%
# The impact speed has a cusp at this pulse: after a shorter pulse the block turns back and is pulled
# from there, after a longer pulse the block arrives with energy left. A pulse that is 1 % too short
# gives 0.21 of the speed under the step, a pulse that is 1 % too long 0.40. The parameters of the device have
# the same effect, so that each specimen needs its own pulse.

errors = np.linspace(-0.2, 0.2, 61) * np.abs(np.linspace(-0.2, 0.2, 61))
speeds = []
for error in errors:
    drive = soft.drive.replace(width=(1 + error) * soft.drive.width)
    speeds.append(mi.closing(switch, drive).table["impact speed"].max())

with mi.style():
    figure = Figure(figsize=(6.4, 5.6), layout="constrained")
    above, middle, below = figure.subplots(3, height_ratios=(3, 2, 3))
    for found, name, line in ((step, "step", "--"), (soft.closing, "pulse and hold", "-")):
        period = found.run.system.forcing_period
        share = 4e-5 / period
        samples = found.run.samples(math.ceil(2000 / share), 0.0, share)
        time = 1e6 * samples["t"]
        above.plot(time, 1e6 * samples["x2"], line, label=name)
        middle.plot(time, found.run.drive.value(samples["t"]), line)
    above.axhline(1e6 * switch.delta, color="0.6", linewidth=0.8, zorder=0)
    above.set(ylabel="block [um]", xlim=(0, 40))
    above.legend(loc="lower right")
    middle.set(ylabel="voltage [V]", xlabel="time [us]", xlim=(0, 40))
    below.plot(100 * errors, speeds)
    below.axhline(step.table["impact speed"].max(), color="0.6", linestyle="--")
    below.set(xlabel="error of the width [%]", ylabel="impact speed [m/s]", ylim=(0, None))
    figure.savefig("contact_switch_landing.png", dpi=150)

# %%
# Check
# -----
# Without damping, the work of the electrode up to the end of the pulse is the energy of the spring
# at the contact: :math:`\alpha v^2 (1/(d - x) - 1/d) = k\delta^2/2`. It gives the place :math:`x`
# and, by the time of flight to there and from there, width and pause.

undamped = switch.replace(c=0.0)
found = mi.soft_landing(undamped, pulse, over=bounds)


def work(x):
    """Return the work of the electrode on the block up to x."""
    return switch.alpha * volts**2 * (1 / (switch.d - x) - 1 / switch.d)


def speed(x):
    """Return the speed of the block under the pulse."""
    return math.sqrt(2 / switch.m2 * (work(x) - switch.k * x**2 / 2))


place = brentq(lambda x: work(x) - switch.k * switch.delta**2 / 2, 0, switch.delta)
width = quad(lambda u: 2 * u / speed(u**2), 0, math.sqrt(place), epsabs=0, epsrel=1e-11)[0]
pause = math.acos(place / switch.delta) / math.sqrt(switch.k / switch.m2)
assert math.isclose(found.drive.width, width, rel_tol=1e-6)
assert math.isclose(found.drive.pause, pause, rel_tol=1e-5)
assert found.speed < 1e-6 * found.step_speed
assert math.isclose(contact_ratio, 0.2, rel_tol=1e-3)
ratios = np.interp([-0.01, 0.01], errors, np.array(speeds)) / soft.step_speed
assert np.allclose(ratios, [0.21, 0.40], atol=0.01)
print(f"width {width * 1e6:.3f} us, pause {pause * 1e6:.3f} us by energy")
