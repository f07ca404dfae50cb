"""Soft landing, against the energy in closed form."""

import math
import pickle

import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import mems_impact as mi

SWITCH = mi.load_actuator("abdulrahim2016")
PULSE = mi.PulseAndHold(amplitude=110.0, width=1.2e-5, pause=1e-5, hold=90.0)
OVER = {"width": (5e-6, 2e-5), "pause": (1e-6, 2e-5)}


def landing(device, volts):
    """Return width and pause of a landing at zero speed without damping, in a fixed frame.

    The work of the electrode up to x is the spring energy at the stopper; then the block coasts.
    """

    def work(x):
        return device.alpha * volts**2 * (1.0 / (device.d - x) - 1.0 / device.d)

    def speed(x):
        return math.sqrt(2.0 / device.m2 * (work(x) - 0.5 * device.k * x**2))

    x = brentq(lambda x: work(x) - 0.5 * device.k * device.delta**2, 0.0, device.delta)
    # With x = u^2, since the speed is proportional to the square root of x at the start.
    width = quad(lambda u: 2.0 * u / speed(u * u), 0.0, math.sqrt(x), epsabs=0.0, epsrel=1e-11)[0]
    return width, math.acos(x / device.delta) / math.sqrt(device.k / device.m2)


@pytest.fixture(scope="module")
def found():
    return mi.soft_landing(SWITCH.replace(c=0.0), PULSE, over=OVER)


@pytest.mark.slow
def test_landing_at_zero_speed_is_that_of_the_energy(found):
    width, pause = landing(SWITCH, 110.0)
    assert found.drive.width == pytest.approx(width, rel=1e-6)
    assert found.drive.pause == pytest.approx(pause, rel=1e-5)
    assert found.speed < 1e-6 * found.step_speed
    assert found.summary()["speed"] == f"below {1e-3 * found.step_speed:.2g}"
    assert found.converged
    assert found.closing.bounces == 0
    assert found.closing.closing_time == pytest.approx(width + pause, rel=1e-5)


def test_the_pulse_of_the_energy_lands_at_zero_speed():
    """Without any search; the error of the speed is the square root of that of the energy."""
    undamped = SWITCH.replace(c=0.0)
    width, pause = landing(undamped, 110.0)
    drive = PULSE.replace(width=width * (1.0 + 1e-9), pause=pause)
    landed = mi.closing(undamped, drive, options=mi.Options(rtol=1e-11, atol=1e-13))
    step = mi.closing(undamped, mi.VoltageStep(amplitude=110.0))
    assert landed.table["impact speed"].max() < 3e-3 * step.impact_speed
    late = mi.closing(undamped, drive.replace(width=1.01 * width))
    assert late.impact_speed > 0.05 * step.impact_speed


@pytest.mark.slow
def test_values(found, tmp_path):
    assert pickle.loads(pickle.dumps(found)) == found
    found.save(tmp_path / "landing.zip")
    assert mi.load(tmp_path / "landing.zip") == found
    assert found.values == {name: found.drive.number(name) for name in OVER}
    assert found.history["impact speed"].is_monotonic_decreasing
    assert found.history.attrs["units"] == {"width": "s", "pause": "s", "impact speed": "m/s"}
    assert "width=1.62087e-05 s" in repr(found)
    assert "width [s]" in found._repr_html_()


@pytest.mark.slow
def test_defaults_without_units():
    """From the device alone: 1.2 times the pull-in voltage."""
    bare = mi.soft_landing(mi.load_actuator("zhao2004"))
    volts = 1.2 * mi.pull_in_voltage(mi.load_actuator("zhao2004"))
    assert bare.drive.amplitude == bare.drive.hold == pytest.approx(volts, rel=1e-12)
    assert bare.speed < 1e-3 * bare.step_speed
    assert " m/s" not in repr(bare)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"over": {}}, "one or more parameters with their bounds"),
        ({"over": {"height": (0, 1)}}, "over = 'height': must be among amplitude, width"),
        ({"over": {"width": (2e-5, 1e-5)}}, "over width = .*lowest, highest"),
        ({"over": {"width": 3.0}}, "over width = 3: must be .lowest, highest"),
        ({"over": {"width": ("5 V", "6 V")}}, "over width = '5 V'"),
        ({"over": {"width": (-1.0, 1e-5)}}, "width = -1: must be a finite number > 0"),
        ({"drive": mi.VoltageStep(amplitude=90.0)}, "drive = .*must be a PulseAndHold"),
        ({"actuator": 3}, "actuator = 3: must be an Actuator"),
        ({"iterations": 0}, "iterations = 0"),
        ({"drive": PULSE.replace(amplitude=20.0, hold=20.0)}, "closes nowhere within these bounds"),
    ],
)
def test_wrong_arguments(arguments, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        mi.soft_landing(**{"actuator": SWITCH, "drive": PULSE, "over": OVER, **arguments})
