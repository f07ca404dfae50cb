"""Devices drawn at random, whose frame slips before the block strikes, through the whole design."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.design import chart_construction
from tests.actuator.slipping import SLIPPING

pytestmark = pytest.mark.nightly


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


SLIDING = mi.Actuator.from_design(
    frequency=21e3, damping_ratio=0.05, stiffness=42.0, mass_ratio=8, gap=3.8e-6, travel=2.6e-6,
    capacitance=5e-14, friction=(0.5, 0.4), restitution=0.6,
)  # fmt: skip
"""A device whose frame slips from a thirtieth of the pull-in voltage on."""


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
