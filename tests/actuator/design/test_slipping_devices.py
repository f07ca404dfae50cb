"""Devices drawn at random, whose frame slips before the block strikes, through the whole design."""

import math

import numpy as np
import pytest

import mems_impact as mi
from tests.actuator.slipping import SLIPPING, random_device

pytestmark = pytest.mark.slow
SEEDS = range(8)


def test_a_frame_that_slips_without_blows():
    drive = mi.Sine(amplitude=30.0, omega=2.0 * math.pi * 480.0)
    run = mi.simulate(SLIPPING, drive, 100, window=(50, 100))
    found = mi.blows(run)
    assert (found.count, found.per_period, len(run.blows)) == (0, 0.0, 0)
    assert math.isnan(found.displacement_per_blow)  # it walks, and no blow is to be divided by
    worn = mi.life(run, wear=1e-15, area=1e-8, depth=1e-7)
    assert worn.blows == 0.0
    assert 0.0 < worn.time < math.inf
    assert mi.energy(run).by_blow.empty


@pytest.mark.parametrize("seed", SEEDS)
def test_readings(seed):
    device, orbit = random_device(seed)
    drive = orbit.system.drive
    run = mi.simulate(device, drive, 500, initial=orbit.state, window=(400, 500))
    speed = run.statistics["mean speed"]
    found = mi.ring_down(run)
    assert found.quality == pytest.approx(math.sqrt(device.k * device.m2) / device.c, rel=1e-8)
    struck = mi.blows(run)
    assert struck.count == 100
    per_period = struck.displacement_per_blow
    assert per_period == pytest.approx(run.statistics["displacement per period"], rel=1e-9)
    balance = mi.energy(run).table.groupby("kind")["energy per period"].sum()
    assert balance["in"] == pytest.approx(balance["lost"] + balance.get("stored", 0.0), rel=1e-6)
    assert 0.0 < mi.life(run, wear=1e-15, area=1e-8, depth=1e-7).time < math.inf
    duty = mi.duty_cycle(orbit)
    assert duty.forward + duty.backward + duty.stuck == pytest.approx(1.0)
    curve = mi.load_curve(device, drive, [0.0, 1e-7], initial=orbit.state, transient=300)
    assert curve.table["mean speed"].iloc[0] == pytest.approx(speed, rel=1e-6)
    response = mi.frequency_response(device, drive, [drive.omega], transient=100, periods=10)
    assert np.isfinite(response["deflection"]).all()
    speeds = mi.speed_over_voltage(device, drive, [drive.amplitude], initial=orbit.state)
    assert speeds["mean speed"].iloc[0] == pytest.approx(speed, rel=1e-6)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_follows_the_orbit(seed):
    device, orbit = random_device(seed)
    drive = orbit.system.drive
    volts = drive.amplitude

    def speed(amplitude, state):
        there = drive.replace(amplitude=amplitude)
        run = mi.simulate(device, there, 600, initial=state, window=(500, 600), keep="statistics")
        return run.statistics["mean speed"]

    table = mi.sensitivity(orbit, ["amplitude"], ["mean speed"]).table
    step = 1e-5 * volts
    slope = speed(volts + step, orbit.state) - speed(volts - step, orbit.state)
    assert table["derivative"].iloc[0] == pytest.approx(slope / (2.0 * step), rel=1e-3)
    window = mi.period_one_window(device, drive, low=0.3 * volts, high=1.6 * volts)
    assert window.low < volts < window.high
    down = mi.bifurcation_margins(orbit, ["amplitude"]).iloc[0]
    if down["what"] == window.low_kind:
        assert down["at"] == pytest.approx(window.low, rel=1e-8)
    best = mi.optimize(
        orbit, maximize="mean speed", over={"amplitude": (0.97 * volts, 1.03 * volts)}
    )
    assert best.value >= table["value"].iloc[0]
    assert best.converged or best.active
    there = speed(best.values["amplitude"], best.orbit.state)
    assert there == pytest.approx(best.value, rel=1e-5)
    start = device.replace(alpha=1.003 * device.alpha)
    target = mi.Target(quantity="mean speed", value=speed(volts, orbit.state), drive=drive)
    with pytest.warns(mi.FitWarning, match="has not settled"):
        mi.fit(start, [target], ["alpha"])
    fitted = mi.fit(start, [target], ["alpha"], transient=300, periods=20, initial=orbit.state)
    assert fitted.actuator.alpha == pytest.approx(device.alpha, rel=1e-6)
    spread = mi.tolerance_analysis(
        orbit.system, over={"d": "0.05%", "mu_d": "0.05%"}, samples=16, indices=True,
        initial=orbit.state,
    )  # fmt: skip
    assert np.isfinite(spread.table["mean speed"]).all()
