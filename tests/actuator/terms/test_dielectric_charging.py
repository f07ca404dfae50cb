"""Charge that creeps into the insulation, against closed forms."""

import math

import numpy as np
import pytest

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
INTERPRETED = mi.Options(method="dop853", engine="interpreted")


def test_a_resting_block_lets_go_when_the_offset_has_grown():
    share, time, volts = 0.3, 40.0, 0.4
    device = ZHAO.adding(mi.DielectricCharging(share=share, time=time))
    least = mi.resting_voltage(ZHAO)
    # volts (1 - share (1 - exp(-t/time))) = least
    expected = -time * math.log(1.0 - (1.0 - least / volts) / share)
    dc = mi.Sine(amplitude=0.0, omega=1.0, bias=volts)
    run = mi.simulate(device, dc, periods=4, initial=mi.State(x2=0.5), options=INTERPRETED)
    release = run.events[run.events["event"] == "release"].iloc[0]
    assert release["t"] == pytest.approx(expected, abs=1e-8)


def test_pull_in_drifts_with_the_charge():
    # Trapped charge stands against the voltage: the force is that of the difference.
    share, offset = 0.3, 0.05
    limit = mi.pull_in_voltage(ZHAO)
    device = ZHAO.replace(mu_s=9.0, c=2.0).adding(mi.DielectricCharging(share=share, time=1e9))
    start = mi.State(x2=1.0 / 3.0, offset=offset)
    for volts, falls in ((0.995, False), (1.005, True)):
        dc = mi.Sine(amplitude=0.0, omega=1.0, bias=volts * limit + offset)
        run = mi.simulate(device, dc, periods=10, initial=start, options=INTERPRETED)
        assert (len(run.impacts) > 0) is falls
    # The sign of the voltage matters: the other one is strengthened.
    other = mi.Sine(amplitude=0.0, omega=1.0, bias=-0.995 * limit)
    run = mi.simulate(device, other, periods=10, initial=start, options=INTERPRETED)
    assert len(run.impacts) > 0


def test_alternating_voltage_leaves_no_mean():
    share, time, omega, amplitude = 0.4, 2.0, 3.0, 0.1
    device = ZHAO.replace(m2=1e12).adding(mi.DielectricCharging(share=share, time=time))
    drive = mi.Sine(amplitude=amplitude, omega=omega)
    lag = math.atan(omega * time)
    start = mi.State(offset=share * amplitude * math.cos(lag) ** 2)
    run = mi.simulate(device, drive, periods=2, initial=start, options=INTERPRETED)
    samples = run.samples(64)
    expected = share * amplitude * math.cos(lag) * np.cos(omega * samples["t"] - lag)
    np.testing.assert_allclose(samples["offset"], expected, rtol=0, atol=1e-9)
    assert abs(samples["offset"][:-1].mean()) < 1e-9
    assert run.system.forcing_period == pytest.approx(2.0 * math.pi / omega, rel=1e-14)


@pytest.mark.parametrize(
    ("values", "field"),
    [({"share": 1.1, "time": 1.0}, "share"), ({"share": 0.1, "time": 0.0}, "time")],
)
def test_refuses_what_no_dielectric_does(values, field):
    with pytest.raises(mi.InvalidParameter, match=field):
        mi.DielectricCharging(**values)
