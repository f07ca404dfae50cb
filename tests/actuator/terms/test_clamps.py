"""Clamps: the normal force in momentum, break-away, life and data sheet."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mems_impact as mi

SLOW = mi.Options(method="dop853", engine="interpreted", rtol=1e-10, atol=1e-12)
ZHAO, MITA = mi.load_actuator("zhao2004"), mi.load_actuator("mita2003")
WEIGHT = (ZHAO.m1 + ZHAO.m2) * ZHAO.g
OFF = mi.Sine(amplitude=0.0, omega=0.5)
PULL = 80.0
AREA, GAP, PERMITTIVITY = 2.0, 0.5, 3.0
PLATE = {"area": AREA, "gap": GAP, "permittivity": PERMITTIVITY}
PER_SQUARE = 0.5 * PERMITTIVITY * AREA / GAP**2


@pytest.mark.parametrize("beyond", [False, True])
@pytest.mark.parametrize(
    "clamp", [mi.Clamp(force=7.0), mi.ClampElectrode(**PLATE, voltage=math.sqrt(7.0 / PER_SQUARE))]
)
def test_a_clamp_adds_to_what_static_friction_holds(clamp, beyond):
    load = (1.001 if beyond else 0.999) * ZHAO.mu_s * (WEIGHT + 7.0)
    device = ZHAO.adding(clamp, mi.FrameForce(force=load))
    run = mi.simulate(device, OFF, periods=0.2, options=SLOW)
    assert (run.final["v1"] < -1e-3) is beyond


SQUARE = mi.Square(amplitude=1.2, omega=2.0, duty=0.25)
FOLLOWING = {  # drive, the voltage followed, and the integral of its square to time t
    "right": (
        mi.Sine(amplitude=0.3, omega=2.0),
        lambda t: 0.09 * (0.5 * t + math.sin(4.0 * t) / 8.0),
    ),
    "left": (
        mi.Voltages(right=OFF, left=mi.Sine(amplitude=0.3, omega=2.0)),
        lambda t: 0.09 * (0.5 * t + math.sin(4.0 * t) / 8.0),
    ),
    "clamp": (
        mi.Voltages(right=OFF, clamp=SQUARE),
        lambda t: 1.44 * (t // math.pi * 0.25 * math.pi + min(t % math.pi, 0.25 * math.pi)),
    ),
}


@pytest.mark.parametrize("follows", FOLLOWING)
def test_the_momentum_of_a_slide_under_a_driven_clamp(follows):
    drive, integral = FOLLOWING[follows]
    clamp = mi.ClampElectrode(**PLATE, follows=follows)
    device = ZHAO.adding(clamp, mi.FrameForce(force=PULL))
    run = mi.simulate(device, drive, duration=7.0, options=SLOW)
    samples = run.samples(per_period=13)
    t = samples["t"].to_numpy()
    momentum = (ZHAO.m1 + ZHAO.m2) * samples["v1"] + ZHAO.m2 * samples["v2"]
    squares = np.array([integral(each) for each in t])
    pushed = (PULL - ZHAO.mu_d * WEIGHT) * t - ZHAO.mu_d * PER_SQUARE * squares
    assert set(samples["mode"].str.split("-").str[0][1:]) == {"backward"}
    np.testing.assert_allclose(momentum, -pushed, rtol=0, atol=1e-7)


def test_a_frame_slips_while_its_clamp_is_off_and_comes_to_rest_while_it_is_on():
    on = mi.Square(amplitude=3.0, omega=2.0, duty=0.75)
    drive = mi.Voltages(right=OFF, clamp=on)
    load = 1.1 * ZHAO.mu_s * WEIGHT
    device = ZHAO.replace(k=100.0, c=10.0).adding(
        mi.ClampElectrode(**PLATE, follows="clamp"), mi.FrameForce(force=load)
    )
    run = mi.simulate(device, drive, duration=3 * math.pi, options=SLOW)
    samples = run.samples(per_period=200)
    pressed = on.value(samples["t"]) > 0.0
    since = (samples["t"] - 0.75 * math.pi) % math.pi  # the clamp lets go
    stuck = samples["mode"].str.startswith("stuck")
    # The speed at the end of the slip and the time in which friction takes it.
    gained = (load - ZHAO.mu_d * WEIGHT) * 0.25 * math.pi
    stopping = gained / (ZHAO.mu_d * (WEIGHT + 9.0 * PER_SQUARE) - load)
    slips = (since < 0.25 * math.pi + 0.9 * stopping) & (samples["t"] > 0.75 * math.pi)
    assert not stuck[slips].any()
    assert stuck[pressed & (since > 0.25 * math.pi + 1.2 * stopping)].all()


def test_life_under_a_driven_clamp_takes_the_mean_normal_force_of_the_slip_path():
    drive, _ = FOLLOWING["right"]
    clamp = mi.ClampElectrode(**PLATE, follows="right")
    device = ZHAO.adding(clamp, mi.FrameForce(force=PULL))
    run = mi.simulate(device, drive, periods=2, window=(0, 2), options=SLOW)
    samples = run.samples(per_period=4000)
    speed = np.abs(samples["v1"].to_numpy())
    t = samples["t"].to_numpy()
    normal = WEIGHT + PER_SQUARE * drive.value(t) ** 2
    expected = np.trapezoid(normal * speed, t) / np.trapezoid(speed, t)
    found = mi.life(run, wear=1e-6, area=1.0, depth=1e-3).normal_force
    assert found == pytest.approx(expected, rel=1e-6)


def test_a_data_sheet_tells_the_clamp_by_forces_and_coefficients():
    sheet = dict(MITA.datasheet)
    weight = (MITA.m1 + MITA.m2) * MITA.g
    by_force = {**sheet, "static_friction_force": 3.0 * MITA.mu_s * weight}
    for name in ("normal_force", "dynamic_friction_force"):
        del by_force[name]
    device = mi.Actuator.from_design(**by_force)
    assert device.term("clamp").force == pytest.approx(2.0 * weight, rel=1e-12)
    assert device.datasheet["normal_force"] == pytest.approx(3.0 * weight, rel=1e-12)
    assert mi.Actuator.from_design(**device.datasheet) == device
    for name in ("static_friction", "dynamic_friction"):
        del by_force[name]
    given = {**by_force, "normal_force": 3.0 * weight,
             "dynamic_friction_force": 3.0 * MITA.mu_d * weight}  # fmt: skip
    other = mi.Actuator.from_design(**given)
    np.testing.assert_allclose(other.to_array(), device.to_array(), rtol=1e-12)
    del given["normal_force"]
    given["static_friction_force"] = 50.0 * weight
    with pytest.raises(mi.InvalidParameter, match=r"50 times the weight of .* N; give static_fr"):
        mi.Actuator.from_design(**given)


REFUSED = [
    (mi.ClampElectrode(area=1e-8, gap=1e-6, follows="left"), mi.Sine(amplitude=9, frequency=1),
     "follows = 'left': the drive has no such voltage"),
    (mi.Clamp(force=1e-3), mi.Voltages(right=mi.Sine(amplitude=9, frequency=1),
                                       clamp=mi.Sine(amplitude=9, frequency=1)),
     "clamp: nothing follows it"),
]  # fmt: skip


@pytest.mark.parametrize(("clamp", "drive", "message"), REFUSED)
def test_a_clamp_without_its_voltage_is_refused(clamp, drive, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        MITA.adding(clamp).under(drive)
