"""Duty cycle, life and ring-down, against closed forms and by hand."""

import math

import numpy as np
import pytest

import mems_impact as mi
from tests.actuator.slipping import SLIPPING

ZHAO = mi.load_actuator("zhao2004")
MITA = mi.load_actuator("mita2003")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
OPTIONS = mi.Options(method="dop853", engine="interpreted")
FINE = mi.Options(method="dop853", engine="interpreted", rtol=1e-11, atol=1e-13)


@pytest.fixture(scope="module")
def run():
    return mi.simulate(
        ZHAO, DRIVE, 14.5, initial=mi.kicked_state(ZHAO), window=(3.2, 14.1), options=OPTIONS
    )


@pytest.fixture(scope="module")
def orbit(run):
    return mi.find_orbit(run, options=FINE)


def test_duty_cycle_of_a_run(run):
    found = mi.duty_cycle(run)
    slipping = run.statistics["share slipping"]
    assert found.forward + found.backward == pytest.approx(slipping, rel=1e-9)
    assert found.in_contact == run.statistics["share resting"] == 0.0
    assert found.stuck == pytest.approx(1.0 - slipping, rel=1e-12)
    assert found.table["share"].sum() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.slow
def test_duty_cycle_of_an_orbit(orbit, tmp_path):
    found = mi.duty_cycle(orbit)
    slips = orbit.segments[orbit.segments["mode"] == "forward-free"]
    lasted = (slips["end"] - slips["start"]).sum()
    assert found.forward == pytest.approx(lasted / orbit.period, rel=1e-12)
    assert found.flying == pytest.approx(1.0, rel=1e-12)
    found.save(tmp_path / "duty.zip")
    assert mi.load(tmp_path / "duty.zip") == found


@pytest.mark.slow
def test_a_block_that_rests_is_in_contact():
    run = mi.simulate(MITA, mi.Sine(amplitude=100, omega=2 * math.pi), 1, window=(0, 1),
                      options=OPTIONS)  # fmt: skip
    found = mi.duty_cycle(run)
    # Between pull-in, on the way up, and the voltage at which it lets go, on the way down.
    on = math.acos(mi.resting_voltage(MITA) / 100) / math.pi
    off = math.acos(mi.pull_in_voltage(MITA) / 100) / math.pi
    # Less some milliseconds of 500, in which it snaps to the stopper and bounces there.
    assert 0.98 * (on + off) < found.in_contact < on + off
    assert found.table.attrs["units"] == {"time": "s"}


@pytest.mark.slow
def test_life_by_hand(orbit):
    # Archard: volume = wear rate x normal force x path; the frame slips forward only.
    found = mi.life(orbit, wear=2e-6, area=0.5, depth=1e-3)
    force = 6.0 * 9.81
    volume = 2e-6 * force * orbit.step
    assert found.normal_force == pytest.approx(force, rel=1e-12)
    assert found.slip_per_blow == pytest.approx(orbit.step, rel=1e-8)
    assert found.volume_per_blow == pytest.approx(volume, rel=1e-8)
    assert found.blows == pytest.approx(0.5 * 1e-3 / volume, rel=1e-8)
    assert found.time == pytest.approx(found.blows * orbit.period, rel=1e-8)
    assert found.distance == pytest.approx(0.5 * 1e-3 / (2e-6 * force), rel=1e-8)


@pytest.mark.slow
def test_friction_larger_than_the_weight_asks_for_the_normal_force():
    clamped = MITA.replace(g=MITA.g / 100.0, mu_s=100.0 * MITA.mu_s, mu_d=100.0 * MITA.mu_d)
    one, other = (
        mi.simulate(each, mi.Sine(amplitude=100, omega=2 * math.pi), 2, options=OPTIONS)
        for each in (MITA, clamped)
    )
    assumed = {"wear": 1e-13, "area": 1e-8, "depth": 1e-7}
    exact = mi.life(one, **assumed)
    with pytest.raises(mi.InvalidParameter, match=r"N is 40 times the weight.*normal_force="):
        mi.life(other, **assumed)
    found = mi.life(other, **assumed, normal_force=exact.normal_force)
    assert found.time == pytest.approx(exact.time, rel=1e-6)


def test_life_of_a_run(run):
    found = mi.life(run, wear=2e-6, area=0.5, depth=1e-3)
    grid = run.samples(400, 3.2, 14.1)
    path = np.abs(np.diff(grid["x1"])).sum()
    assert found.slip_per_period == pytest.approx(path / 10.9, rel=1e-3)
    still = mi.simulate(ZHAO, mi.Sine(amplitude=0.05, omega=0.5), 4, options=OPTIONS)
    assert mi.life(still, wear=2e-6, area=0.5, depth=1e-3).blows == math.inf
    with pytest.raises(mi.InvalidParameter, match="wear"):
        mi.life(run, wear=0.0, area=0.5, depth=1e-3)


def test_ring_down_in_closed_form():
    damped = ZHAO.replace(c=0.2)
    found = mi.ring_down(damped, DRIVE, initial=mi.State(x2=0.4), options=FINE)
    root = math.sqrt(1.0 - 0.1**2)
    assert found.damping_ratio == pytest.approx(0.1, rel=1e-9)
    assert found.decrement == pytest.approx(2.0 * math.pi * 0.1 / root, rel=1e-9)
    assert found.frequency == pytest.approx(root / (2.0 * math.pi), rel=1e-9)
    assert found.time_constant == pytest.approx(10.0, rel=1e-9)
    # From the first swing that is counted, one natural period after the start.
    until = 2.0 * math.pi / root + 10.0 * math.log(100.0)
    assert found.time == pytest.approx(until, rel=1e-9)
    assert found.table["t"].iloc[0] == pytest.approx(2.0 * math.pi / root, rel=1e-9)


def test_ring_down_of_a_run_in_si(tmp_path):
    run = mi.simulate(MITA, mi.Sine(amplitude=20, omega=1500), 20, options=OPTIONS)
    found = mi.ring_down(run, options=OPTIONS)
    zeta = MITA.c / (2.0 * math.sqrt(MITA.k * MITA.m2))
    assert found.damping_ratio == pytest.approx(zeta, rel=1e-4)
    natural = math.sqrt(MITA.k / MITA.m2 * (1 - zeta**2)) / (2.0 * math.pi)
    assert found.frequency == pytest.approx(natural, rel=1e-5)
    assert found.table.attrs["units"] == {"t": "s", "amplitude": "m"}
    found.save(tmp_path / "ring.zip")
    assert mi.load(tmp_path / "ring.zip") == found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("friction", "options"),
    [(0.3, OPTIONS), (0.001, mi.Options(method="dop853"))],
)
def test_ring_down_is_measured_with_the_frame_at_rest(friction, options):
    # The spring moves the frame; with hardly any friction it coasts for longer than a swing lasts.
    soft = SLIPPING.replace(c=7.5e-5, mu_s=friction, mu_d=0.8 * friction)
    found = mi.ring_down(soft, mi.Sine(amplitude=50.0, omega=3000.0), options=options)
    zeta = soft.c / (2.0 * math.sqrt(soft.k * soft.m2))
    assert found.quality == pytest.approx(0.5 / zeta, rel=1e-5)
    natural = math.sqrt(soft.k / soft.m2 * (1 - zeta**2)) / (2.0 * math.pi)
    assert found.frequency == pytest.approx(natural, rel=1e-5)
    # The spring alone holds more than friction beyond this amplitude.
    assert found.table["amplitude"].max() <= friction * (soft.m1 + soft.m2) * soft.g / soft.k


@pytest.mark.parametrize("quality", [300.0, 3e4, 3e6])
def test_ring_down_in_vacuum(quality):
    # The kick makes the frame slip; to the hundredth part takes up to ten million swings.
    light = SLIPPING.replace(c=math.sqrt(SLIPPING.k * SLIPPING.m2) / quality)
    found = mi.ring_down(light, mi.Sine(amplitude=50.0, omega=3000.0))
    assert found.quality == pytest.approx(quality, rel=1e-8)
    natural = math.sqrt(light.k / light.m2 * (1.0 - 0.25 / quality**2))
    assert found.frequency == pytest.approx(natural / (2.0 * math.pi), rel=1e-9)
    begun, ended = found.table["t"].iloc[0], found.time
    decay = 2.0 * light.m2 / light.c
    assert ended - begun == pytest.approx(decay * math.log(100.0), rel=1e-5)
    friction = light.mu_s * (light.m1 + light.m2) * light.g
    assert found.table["amplitude"].max() <= friction / light.k


def test_a_block_that_does_not_swing():
    with pytest.raises(mi.InvalidParameter, match="does not oscillate"):
        mi.ring_down(ZHAO.replace(c=3.0), DRIVE, initial=mi.State(x2=0.3))
    for c in (0.0, 1e-9):  # the decrement is pi c
        with pytest.raises(mi.InvalidParameter, match="decays by less than 1e-08 per cycle"):
            mi.ring_down(ZHAO.replace(c=c), DRIVE, initial=mi.State(x2=0.3))
