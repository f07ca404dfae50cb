"""A source with a slew rate, against closed forms and SciPy's integration."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.drives.slewed import SlewedDrive

ZHAO = mi.load_actuator("zhao2004")
INTERPRETED = mi.Options(engine="interpreted")


def test_ramps_between_the_levels_of_a_square_wave():
    output = SlewedDrive(wave=mi.Square(amplitude=1.0, omega=2.0 * math.pi, duty=0.6), rate=4.0)
    assert output.switches == pytest.approx((0.25, 0.6, 0.85, 1.0), rel=1e-15)
    times = [0.1, 0.25, 0.5, 0.7, 0.85, 0.9]
    np.testing.assert_allclose(output.value(times), [0.4, 1, 1, 0.6, 0, 0], rtol=0, atol=1e-15)


def test_follows_a_sine_up_to_its_rate():
    # v' = -sin t exceeds 0.9 from asin 0.9 on; the ramp meets the sine after its steepest point.
    assert SlewedDrive(wave=mi.Sine(amplitude=1.0, omega=1.0), rate=1.0).switches == ()
    output = SlewedDrive(wave=mi.Sine(amplitude=1.0, omega=1.0), rate=0.9)
    first, last = output.switches
    assert first == pytest.approx(math.asin(0.9), rel=1e-8)
    ramp = math.cos(first) - 0.9 * (last - first)
    assert ramp == pytest.approx(math.cos(last), abs=1e-12)
    # The output changes its sign after each forcing period, as the sine does.
    times = np.linspace(0.0, math.pi, 50)
    np.testing.assert_allclose(output.value(times + math.pi), -output.value(times), atol=1e-15)


def test_a_slow_source_makes_a_triangle():
    # The output crosses the sine where its ramps turn: at the height rate*period/4 of a triangle.
    output = SlewedDrive(wave=mi.Sine(amplitude=1.0, omega=1.0), rate=0.5)
    (turn,) = output.switches
    assert turn == pytest.approx(math.acos(0.25 * math.pi), abs=1e-12)
    assert output.value(turn) == pytest.approx(0.25 * math.pi, abs=1e-12)
    # The sine with a bias has the output of the sine plus the bias.
    biased = SlewedDrive(wave=mi.Sine(amplitude=1.0, omega=1.0, bias=0.3), rate=0.5)
    times = np.linspace(0.0, 6.0, 40)
    np.testing.assert_allclose(biased.value(times), output.value(times) + 0.3, atol=1e-11)


def test_a_square_wave_that_is_never_reached():
    # Between equally long ramps any offset is periodic; a source starts from 0.
    output = SlewedDrive(wave=mi.Square(amplitude=1.0, omega=1.0), rate=0.1)
    assert output.value(math.pi) == pytest.approx(0.1 * math.pi, abs=1e-12)
    assert output.value(0.0) == 0.0


def relaxed(drive, rate, steps):
    """The output by steps of time from 0 over many periods, as a source computes it."""
    times, dt = np.linspace(0.0, drive.period, steps, endpoint=False, retstep=True)
    values, now, found = drive.value(times), 0.0, np.empty(steps)
    for _ in range(60):
        for i, value in enumerate(values):
            now += min(max(value - now, -rate * dt), rate * dt)
            found[i] = now
    return times, found, dt


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    "drive",
    [
        mi.Pulse(amplitude=0.35, period=12.0, width=3.8, rise=0.5, phase=2.0),
        mi.Trapezoid(amplitude=0.3, omega=0.5, bias=0.1),
        mi.Burst(wave=mi.Square(amplitude=0.3, omega=0.5, rise=1.0), on=2, off=1),
        mi.Sampled(times=np.arange(8.0), voltages=[0.0, 0.1, 0.5, 0.4, 0.45, 0.2, -0.1, 0.0]),
    ],
)
def test_agrees_with_small_steps(drive):
    for rate in (0.03, 0.15, 0.4):
        output = SlewedDrive(wave=drive, rate=rate)
        times, expected, dt = relaxed(drive, rate, 800)
        np.testing.assert_allclose(output.value(times), expected, rtol=0, atol=3.0 * rate * dt)
        steps = np.diff(output.value(times)) / dt
        assert np.abs(steps).max() <= rate * (1.0 + 1e-9)
        assert output.switches == tuple(sorted(set(output.switches)))


def test_refuses_a_voltage_whose_sign_is_unknown():
    def wave(t, q):
        return 0.3 * math.cos(0.5 * t)

    drive = mi.Custom(function=wave, period=2.0 * math.pi, switches=(math.pi,))
    with pytest.raises(mi.InvalidParameter, match="changes its sign from one forcing period"):
        ZHAO.adding(mi.SlewRate(rate=0.1)).under(drive)


@pytest.mark.nightly
def test_a_branch_ends_where_the_source_begins_to_limit():
    # The rate of the sine reaches that of the source at amplitude = 0.1/0.8.
    system = ZHAO.replace(mu_s=5.0).adding(mi.SlewRate(rate=0.1)).under(
        mi.Sine(amplitude=0.1, omega=0.8)
    )  # fmt: skip
    orbit = mi.find_orbit(system, options=INTERPRETED, transient=30, periods=1)
    branch = mi.continue_solution(orbit, "amplitude", stop=0.15)
    assert "the forcing has 2 switching times there instead of 0" in branch.ended
    assert branch.orbits[-1].system.parameters["amplitude"] == pytest.approx(0.125, rel=0.02)
    with pytest.raises(mi.InvalidParameter, match="no chart with slew_rate: its switching times"):
        mi.operating_chart(system.actuator)


def test_a_voltage_that_an_importer_sets_has_no_ramps_in_advance(tmp_path):
    device = ZHAO.adding(mi.SlewRate(rate=0.1))
    with pytest.raises(mi.InvalidParameter, match=r"inputs.*limits the rate of its drive; omit"):
        device.to_fmu(tmp_path / "a.fmu", mi.Sine(amplitude=0.2, omega=0.5), inputs=["voltage"])
