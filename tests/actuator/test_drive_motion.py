"""Motion under drives that switch, pull from both sides, or are off for a while."""

import math

import numpy as np
import pytest

import mems_impact as mi
from tests.actuator.waveforms import DRIVES, cosine

ZHAO = mi.load_actuator("zhao2004")
SHARP = mi.Options(rtol=1e-10, atol=1e-12)
KICK = mi.State(v2=0.5)
# For motions that are compared with each other: less time than the compilation of each drive.
PLAIN = mi.Options(method="dop853", engine="interpreted")


@pytest.mark.parametrize("phase", [0.3, 1.0, 3.0, 5.9])
def test_a_phase_is_a_later_start(phase):
    """Switches in the middle of the period; none at its end."""
    drive = mi.Square(amplitude=0.3, omega=0.5, duty=0.3, phase=phase)
    ahead = phase / drive.omega
    plain = drive.replace(phase=0.0)
    turned = mi.simulate(ZHAO, drive, 6, initial=KICK, options=SHARP)
    start = mi.State(v2=0.5, time=ahead)
    later = mi.simulate(ZHAO, plain, 6, initial=start, options=SHARP)
    assert len(turned.impacts) == len(later.impacts) > 3
    for name in ("x1", "v1", "x2", "v2"):
        assert getattr(turned.final, name) == pytest.approx(getattr(later.final, name), abs=1e-8)
    counts = turned.events["event"].value_counts()
    assert counts["drive switches"] == 12


def swapped(run):
    return run.final.x1, run.final.v1, run.final.x2, run.final.v2


@pytest.mark.slow
def test_half_a_period_later_on_the_other_side():
    """Right at phase 0 and left half a period later, then the other way round."""
    pulse = mi.Pulse(amplitude=0.33, period=12, width=4)
    half = pulse.replace(phase=math.pi)
    weak, weak_half = pulse.replace(amplitude=0.1), half.replace(amplitude=0.1)
    one = mi.simulate(
        ZHAO, mi.Voltages(right=pulse, left=weak_half), 8, initial=KICK, options=PLAIN
    )
    start, pair = mi.State(v2=-0.5, time=6.0), mi.Voltages(right=weak, left=half)
    other = mi.simulate(ZHAO, pair, 8, initial=start, options=PLAIN)
    np.testing.assert_allclose(swapped(one), -np.array(swapped(other)), rtol=0, atol=1e-7)
    assert one.statistics["displacement per period"] > 1e-4
    assert other.statistics["displacement per period"] < -1e-4


def test_two_sided_with_nothing_on_the_left_is_one_sided():
    sine = mi.Sine(amplitude=0.24, omega=0.5)
    pair = mi.Voltages(right=sine, left=sine.replace(amplitude=0.0))
    one, two = (mi.simulate(ZHAO, each, 10, initial=KICK, options=PLAIN) for each in (sine, pair))
    assert pair.period == sine.period
    np.testing.assert_allclose(swapped(one), swapped(two), rtol=0, atol=1e-12)


def test_a_burst_is_its_wave_while_it_lasts():
    wave = mi.Square(amplitude=0.3, omega=0.5, duty=0.3, phase=1.0)
    burst = mi.Burst(wave=wave, on=7, off=5)
    options = mi.Options(method="dop853", engine="interpreted", rtol=SHARP.rtol, atol=SHARP.atol)
    plain = mi.simulate(ZHAO, wave, 6.5, initial=KICK, options=options)
    cut = mi.simulate(ZHAO, burst, 6.5 / 12, initial=KICK, options=options)
    assert len(plain.impacts) == len(cut.impacts) > 3
    np.testing.assert_allclose(swapped(plain), swapped(cut), rtol=0, atol=1e-8)


def sampled(knots, periods=2):
    """A record of that many periods of v^2 of the sine."""
    sine = mi.Sine(amplitude=0.24, omega=0.5)
    times = np.arange(knots) * periods * sine.period / knots
    return sine, mi.Sampled(times=times, voltages=sine.value(times))


def test_a_sampled_sine_is_the_sine_to_the_interpolation_error():
    errors = []
    for knots in (50, 200, 800):
        sine, record = sampled(knots)
        exact = mi.simulate(ZHAO, sine, 20, initial=KICK, options=SHARP)
        run = mi.simulate(ZHAO, record, 10, initial=KICK, options=SHARP)
        assert len(run.impacts) == len(exact.impacts)
        errors.append(abs(run.final.x2 - exact.final.x2) + abs(run.final.v2 - exact.final.v2))
    # Between second order (at the crests) and third.
    assert errors[1] < errors[0] / 8
    assert errors[2] < errors[1] / 8
    assert errors[2] < 1e-5


def test_a_narrow_spike_in_a_record_is_not_passed_over():
    """1/200 of the period, in a record of 4000 samples; the block rests and steps are long."""
    times = np.linspace(0.0, 200.0, 4001)
    voltages = 0.4 * np.exp(-(((times - 133.3) / 0.5) ** 2))
    record = mi.Sampled(times=times, voltages=voltages)
    run = mi.simulate(ZHAO, record, 1)
    force = 0.16 * ZHAO.alpha / ZHAO.d**2 * 0.5 * math.sqrt(math.pi / 2.0)
    assert 0 < len(record.switches) < 200
    assert run.samples(4000)["v2"].max() == pytest.approx(force, rel=0.2)


def test_custom_is_the_sine():
    values = {"amplitude": 0.24, "omega": 0.5}
    sine = mi.Sine(**values)
    custom = mi.Custom(function=cosine, period=sine.period, values=values)
    one, two = (
        mi.simulate(ZHAO, drive, 30, initial=KICK, options=PLAIN) for drive in (sine, custom)
    )
    np.testing.assert_allclose(swapped(one), swapped(two), rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    "name",
    [
        "square with flanks",
        "sampled",
        pytest.param("burst of pulses", marks=pytest.mark.slow),
        pytest.param("voltages", marks=pytest.mark.slow),
        pytest.param("jumping custom", marks=pytest.mark.slow),
    ],
)
def test_engines_agree(name):
    drive = DRIVES[name]
    periods = min(2.0, 30.0 / drive.period)
    runs = [
        mi.simulate(ZHAO, drive, periods, initial=KICK, options=mi.Options(engine=engine))
        for engine in ("compiled", "interpreted")
    ]
    assert list(runs[0].events["event"]) == list(runs[1].events["event"])
    np.testing.assert_allclose(swapped(runs[0]), swapped(runs[1]), rtol=0, atol=1e-7)


@pytest.mark.parametrize("name", ["square with flanks", "burst of pulses", "voltages", "custom"])
def test_a_device_in_si_moves_as_the_dimensionless_one(name):
    """Any scales will do: the drive is scaled with the device."""
    from mems_impact.actuator.units import DeviceScales

    time, voltage = 2e-4, 300.0
    length, mass = 2e-6, 1e-8
    scales = DeviceScales(
        mass=mass, stiffness=mass / time**2, length=length,
        alpha=mass / time**2 * length**3 / voltage**2, time=time, voltage=voltage,
    )  # fmt: skip
    device, drive = ZHAO.to_si(scales), DRIVES[name].scaled(1.0 / voltage, 1.0 / time)
    periods = min(3.0, 60.0 / DRIVES[name].period)
    plain = mi.simulate(ZHAO, DRIVES[name], periods, initial=KICK, options=PLAIN)
    kick = mi.State(v2=0.5 * length / time)
    si = mi.simulate(device, drive, periods, initial=kick, options=PLAIN)
    assert len(si.impacts) == len(plain.impacts)
    assert si.final.x2 / length == pytest.approx(plain.final.x2, abs=1e-8)


def test_a_sweep_over_the_duty():
    square = mi.Square(amplitude=0.3, omega=0.5, duty=0.3)
    sweep = mi.sweep(ZHAO, square, "duty", [0.05, 0.3], direction="up", transient=40, periods=5)
    summary = sweep.statistics
    assert list(summary["duty"]) == [0.05, 0.3]
    assert list(summary["impacting"]) == [False, True]


@pytest.mark.slow
def test_a_sweep_over_a_number_of_a_drive_within():
    table = mi.sweep(
        ZHAO, DRIVES["burst of pulses"], "wave.width", [2.0, 3.0], transient=1, periods=1
    ).table
    assert table.columns[0] == "wave.width"
    assert set(table["status"]) == {"ok"}
