"""Devices drawn at random, whose frame slips before the block strikes, through the whole design."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.design import chart_construction, thresholds
from tests.actuator.slipping import LIGHT, PULLED, SLIPPING, random_device

pytestmark = pytest.mark.nightly
SEEDS = range(2)


def test_a_frame_that_slips_without_blows():
    drive = mi.Sine(amplitude=30.0, omega=2.0 * math.pi * 480.0)
    run = mi.simulate(SLIPPING, drive, 100, window=(50, 100))
    found = run.blow_statistics
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
    struck = run.blow_statistics
    assert struck.count == 100
    per_period = struck.displacement_per_blow
    assert per_period == pytest.approx(run.statistics["displacement per period"], rel=1e-9)
    balance = mi.energy(run).table.groupby("kind")["energy per period"].sum()
    assert balance["in"] == pytest.approx(balance["lost"] + balance.get("stored", 0.0), rel=1e-6)
    assert 0.0 < mi.life(run, wear=1e-15, area=1e-8, depth=1e-7).time < math.inf
    duty = mi.duty_cycle(orbit)
    assert duty.forward + duty.backward + duty.stuck == pytest.approx(1.0)
    curve = mi.force_curve(device, drive, [0.0, 1e-7], initial=orbit.state, transient=300)
    assert curve.table["mean speed"].iloc[0] == pytest.approx(speed, rel=1e-6)
    response = mi.frequency_response(device, drive, [drive.omega], transient=100, periods=10)
    assert np.isfinite(response.table["deflection"]).all()
    speeds = mi.speed_over_voltage(device, drive, [drive.amplitude], initial=orbit.state)
    assert speeds.table["mean speed"].iloc[0] == pytest.approx(speed, rel=1e-6)


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
    window = mi.period_one_window(device, drive, (0.3 * volts, 1.6 * volts))
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
    fitted = mi.fit(start, [target], ["alpha"], transient=300, periods=20, initial=orbit.state)
    assert fitted.system.alpha == pytest.approx(device.alpha, rel=1e-6)
    spread = mi.tolerance_analysis(
        orbit.system, over={"d": "0.05%", "mu_d": "0.05%"}, samples=16, indices=True,
        initial=orbit.state,
    )  # fmt: skip
    assert np.isfinite(spread.table["mean speed"]).all()


FLOATING = mi.Actuator.from_design(
    frequency=42.2e3, quality=36, proof_mass=4.71e-6, frame_mass=3.23e-6, gap=16.3e-6,
    travel=7.22e-6, pull_in=47.9, friction=(0.349, 0.194), restitution=0.427,
)  # fmt: skip
"""A device that friction would stop after some 50,000 oscillations only."""


def test_a_kick_gives_such_a_device_no_momentum():
    kick = mi.kicked_state(FLOATING)
    momentum = FLOATING.m1 * kick.v1 + FLOATING.m2 * (kick.v1 + kick.v2)
    assert momentum == pytest.approx(0.0, abs=1e-12 * FLOATING.m2 * kick.v2)
    held = mi.kicked_state(mi.load_actuator("mita2003"))
    assert held == mi.State(v2=held.v2)
    drive = mi.Sine(amplitude=57.4, frequency=2110.0)
    speeds = [
        mi.simulate(FLOATING, drive, 60, window=(40, 60), initial=state).statistics["mean speed"]
        for state in (mi.State(), kick)
    ]
    assert speeds[1] == pytest.approx(speeds[0], rel=1e-4)
    assert abs(speeds[0]) < 1e-4  # with the momentum of a kick: 2.2 m/s


def test_a_report_waits_until_friction_has_ended_the_drift():
    device = mi.Actuator.from_design(
        frequency=26.5e3, quality=288, proof_mass=5.52e-8, frame_mass=2.91e-7, gap=7.33e-6,
        travel=2.3e-6, pull_in=112, friction=(0.605, 0.588), restitution=0.769,
    )  # fmt: skip
    drive = mi.Square(amplitude=126.3, frequency=6100.0)
    page = mi.report(device, drive, only=["Motion"])
    orbit = mi.find_orbit(mi.simulate(device, drive, 2000, keep="statistics"))
    assert orbit.stable
    assert page.facts["motion"] == "periodic, period 1, stable"
    number, unit = page.facts["step per cycle"].split()
    assert unit == "nm"
    assert float(number) == pytest.approx(1e9 * orbit.step, rel=5e-3)
    early = mi.report(device, drive, only=["Motion"], transient=20, periods=5)
    assert early.facts["motion"] == "periodic, period 1, stable"
    number, unit = early.facts["step per cycle"].split()
    assert unit == "nm"
    assert float(number) == pytest.approx(1e9 * orbit.step, rel=5e-3)


def test_a_chart_whose_frame_slips_between_its_ends_only():
    device = LIGHT.replace(mu_s=2.3, mu_d=2.3, e=0.6)
    chart = mi.operating_chart(device, frequency=(591, 612), crises=3, periods=100, workers=1)
    assert chart.notes == ()
    slips = chart.table[chart.table["boundary"] == "slip"]
    assert 591 < slips["frequency"].min() <= slips["frequency"].max() < 612


SLIDING = mi.Actuator.from_design(
    frequency=21e3, damping_ratio=0.05, stiffness=42.0, mass_ratio=8, gap=3.8e-6, travel=2.6e-6,
    capacitance=5e-14, friction=(0.5, 0.4), restitution=0.6,
)  # fmt: skip
"""A device whose frame slips from a thirtieth of the pull-in voltage on."""


def test_impacts_far_above_the_onset_of_slip_begin_where_an_orbit_ends(monkeypatch):
    """The end of the orbit without impacts is continued, and simulations only lead to it."""
    amplitudes = []
    settled = thresholds.settled

    def counted(system, *more):
        amplitudes.append(system.drive.amplitude)
        return settled(system, *more)

    monkeypatch.setattr(thresholds, "settled", counted)
    monkeypatch.setattr(chart_construction, "FREQUENCY_COLUMNS", 3)
    chart = mi.operating_chart(SLIDING, frequency=(9937.5, 10500.0), crises=0)
    on = chart.table[chart.table["boundary"] == "on"]
    assert set(on["kind"]) == {"fold", "grazing"}
    assert on["frequency"].is_unique
    assert len(amplitudes) < 40 * 3  # at three frequencies
    system = SLIDING.under(mi.Sine(amplitude=1.0, frequency=9937.5))
    (fold,) = on.loc[np.isclose(on["frequency"], 9937.5, rtol=1e-9), "amplitude"]
    state = mi.State()
    for part in (0.3, 0.6, 0.9, 0.97, 0.99, 0.999, 0.9999, 1.001):
        there = system.changed(amplitude=part * fold)
        run = mi.simulate(there, periods=500, initial=state, keep="statistics")
        state = run.final
        assert (run.statistics["impacts per period"] > 0.0) == (part > 1.0)


def test_a_frame_that_slips_far_below_pull_in():
    """The onset of slip at a thirtieth of the pull-in voltage is that of linear response."""
    device = SLIDING
    chart = mi.operating_chart(device, frequency=(9e3, 10.5e3), crises=2, periods=20)
    slip = chart.table[chart.table["boundary"] == "slip"]
    assert slip["frequency"].min() == 9e3
    holding = device.mu_s * (device.m1 + device.m2) * device.g
    for frequency in (9e3, 10.5e3):
        ratio = 2.0 * frequency / 21e3  # of the force, at twice the frequency of the voltage
        transmitted = ratio**2 / math.hypot(1.0 - ratio**2, 2.0 * 0.05 * ratio)
        linear = math.sqrt(2.0 * holding * device.d**2 / (device.alpha * transmitted))
        found = slip.loc[np.isclose(slip["frequency"], frequency), "amplitude"]
        assert found.iloc[0] == pytest.approx(linear, rel=2e-3)


def test_an_interrupted_chart_keeps_the_finished_frequencies(monkeypatch):
    onset, begun = chart_construction.onset, []

    def interrupted(*arguments):
        begun.append(arguments)
        if len(begun) == 3:
            raise KeyboardInterrupt
        return onset(*arguments)

    monkeypatch.setattr(chart_construction, "onset", interrupted)
    with pytest.raises(mi.Interrupted, match="after 2 of 3 parts") as caught:
        mi.operating_chart(SLIPPING, frequency=(470, 500), crises=3, periods=300, workers=1)
    table = caught.value.partial.table
    assert set(table["boundary"]) == {"slip", "on", "off", "steady from", "steady to"}
    assert table["frequency"].unique() == pytest.approx([470, 485])


def test_windows_of_equal_impacts_heed_interruptions():
    class Stopped(Exception):
        pass

    def watch(amplitude):
        raise Stopped

    system = SLIPPING.under(PULLED)
    orbit = mi.find_orbit(system, guess=mi.kicked_state(SLIPPING), transient=300)
    with pytest.raises(Stopped):
        thresholds.steady(system, 50.0, 90.0, orbit.state, watch)
