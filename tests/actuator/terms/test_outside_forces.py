"""Tilt, load and spring of the frame: momentum, what static friction holds, energy."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mems_impact as mi

SLOW = mi.Options(method="dop853", engine="interpreted", rtol=1e-10, atol=1e-12)
OFF = mi.Sine(amplitude=0.0, omega=0.5)
ON = mi.Sine(amplitude=0.24, omega=0.5)
ZHAO = mi.load_actuator("zhao2004")
WEIGHT = (ZHAO.m1 + ZHAO.m2) * ZHAO.g


def momentum(samples):
    return (ZHAO.m1 + ZHAO.m2) * samples["v1"] + ZHAO.m2 * samples["v2"]


def test_momentum_of_a_device_that_slides_downhill():
    angle = 0.6
    device = ZHAO.adding(mi.Tilt(angle=angle))
    run = mi.simulate(device, OFF, periods=1, initial={"v2": 1.0}, options=SLOW)
    samples = run.samples(per_period=50)
    assert len(run.impacts) > 5
    pull = WEIGHT * (math.sin(angle) - ZHAO.mu_d * math.cos(angle))
    expected = ZHAO.m2 * 1.0 - pull * samples["t"].to_numpy()
    assert samples["v1"].iloc[-1] < -10.0
    assert np.allclose(momentum(samples).to_numpy()[1:], expected[1:], rtol=1e-8)


@pytest.mark.parametrize("beyond", [False, True])
@pytest.mark.parametrize(
    "term",
    [
        lambda share: mi.Tilt(angle=math.atan(share * ZHAO.mu_s)),
        lambda share: mi.FrameForce(force=share * ZHAO.mu_s * WEIGHT),
        lambda share: mi.FrameSpring(k1=share * ZHAO.mu_s * WEIGHT),
    ],
)
def test_what_static_friction_holds(term, beyond):
    device = ZHAO.adding(term(1.001 if beyond else 0.999))
    start = {"x1": 1.0 if device.term("frame_spring") else 0.0}
    if device.term("tilt"):  # the block where spring and weight balance
        start["x2"] = -ZHAO.m2 * ZHAO.g * math.sin(device.term("tilt").angle) / ZHAO.k
        device = device.replace(k=30.0)
        start["x2"] /= 30.0
    run = mi.simulate(device, OFF, periods=0.2, initial=start, options=SLOW)
    assert (run.final["v1"] < -1e-3) is beyond
    assert beyond or run.final["x1"] == start["x1"]


def test_a_spring_brings_the_frame_back_and_friction_takes_its_energy():
    stretch, k1 = 1.0, 60.0
    device = ZHAO.adding(mi.FrameSpring(k1=k1)).replace(c=0.0, mu_s=0.3)
    run = mi.simulate(device, OFF, periods=1, initial={"x1": stretch}, options=SLOW)
    samples = run.samples(per_period=4000)
    v = samples["v1"].to_numpy()
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(samples["x1"])))])
    energy = (
        0.5 * ZHAO.m1 * v**2
        + 0.5 * ZHAO.m2 * (v + samples["v2"].to_numpy()) ** 2
        + 0.5 * ZHAO.k * samples["x2"].to_numpy() ** 2
        + 0.5 * k1 * samples["x1"].to_numpy() ** 2
    )
    before = samples["t"].to_numpy() < (run.impacts["t"].iloc[0] if len(run.impacts) else 99.0)
    assert before.sum() > 200
    spent = ZHAO.mu_d * WEIGHT * way[before]
    assert np.allclose(energy[before] + spent, 0.5 * k1 * stretch**2, rtol=1e-4)


def test_orbits_with_a_spring_close_in_the_position_of_the_frame():
    system = ZHAO.adding(mi.FrameSpring(k1=0.1)).under(ON)
    assert system.automaton.cyclic == ()
    assert ZHAO.adding(mi.FrameForce(force=0.1)).under(ON).automaton.cyclic == (0,)
