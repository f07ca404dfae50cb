"""Estimates of devices with terms, against roots and quadratures written out here."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

import mems_impact as mi
from mems_impact.actuator.terms.base import Term, TermContribution

ZHAO = mi.load_actuator("zhao2004")
MITA = mi.load_actuator("mita2003")
INTERPRETED = mi.Options(method="dop853", engine="interpreted")


class Stretched(Term):
    """A force of a state of its own that follows the square of the block's position."""

    @classmethod
    def states(cls, shape):
        return ("stretch",)

    @classmethod
    def contribution(cls, indices, shape):
        stretch = indices.y["stretch"]
        return TermContribution(
            force=lambda y, p: -0.1 * y[stretch],
            rates=(lambda y, p: y[2] ** 2 - y[stretch],),
        )


class Drifting(Stretched):
    """One that never rests."""

    @classmethod
    def contribution(cls, indices, shape):
        return TermContribution(rates=(lambda y, p: 1.0,))


def top(square, low, high=0.5):
    found = minimize_scalar(lambda x: -square(x), bounds=(low, high), options={"xatol": 1e-11})
    return math.sqrt(max(-found.fun, square(high)))


@pytest.mark.parametrize(
    ("terms", "force"),
    [
        ([mi.CubicStiffness(k3=0.8)], lambda x: x + 0.8 * x**3),
        ([mi.CubicStiffness(k3=-1.5)], lambda x: x - 1.5 * x**3),
        ([mi.Tilt(angle=0.02)], lambda x: x + 9.81 * math.sin(0.02)),
        ([mi.Tilt(angle=-0.02), mi.SeriesResistance(resistance=3.0)],
         lambda x: x - 9.81 * math.sin(0.02)),
        ([Stretched()], lambda x: x + 0.1 * x**2),
        ([mi.FrameForce(force=0.1), mi.DielectricCharging(share=0.5, time=1.0)], lambda x: x),
    ],
)  # fmt: skip
def test_voltages_are_those_of_the_statics(terms, force):
    device = ZHAO.adding(*terms)
    start = brentq(force, -0.5, 0.5)

    def square(x):
        return force(x) * (1.0 - x) ** 2

    assert mi.pull_in_voltage(device) == pytest.approx(top(square, start), rel=1e-9)
    assert mi.resting_voltage(device) == pytest.approx(math.sqrt(square(0.5)), rel=1e-12)


def test_a_term_that_adds_nothing_leaves_the_formulas():
    for device in (ZHAO, MITA, MITA.replace(delta=1e-6)):
        other = device.adding(mi.CubicStiffness(k3=0.0))
        for estimate in (mi.pull_in_voltage, mi.resting_voltage):
            assert estimate(other) == pytest.approx(estimate(device), rel=1e-12)
        speeds, volts = MITA.delta * np.array([300.0, 900.0]), np.array([0.0, 20.0])
        np.testing.assert_allclose(
            mi.step_length(other, speeds, volts), mi.step_length(device, speeds, volts), rtol=1e-12
        )


def test_a_hardening_spring_holds_the_block_behind_the_first_fold():
    # The curve of the voltage has a maximum, and rises again to a higher value at the stopper.
    device = ZHAO.replace(delta=0.9).adding(mi.CubicStiffness(k3=60.0))
    places = np.linspace(0.0, 0.9, 200_001)
    squares = (places + 60.0 * places**3) * (1.0 - places) ** 2
    assert mi.pull_in_voltage(device) == pytest.approx(math.sqrt(squares.max()), rel=1e-8)


def test_a_slope_that_is_steep_enough_needs_no_voltage():
    downhill = ZHAO.adding(mi.Tilt(angle=-0.1))
    assert mi.pull_in_voltage(downhill) == mi.resting_voltage(downhill) == 0.0


def test_states_that_never_rest_are_refused():
    for estimate in (mi.pull_in_voltage, mi.resting_voltage):
        with pytest.raises(mi.InvalidParameter, match="simulate instead"):
            estimate(ZHAO.adding(Drifting()))


def test_step_on_a_slope_with_a_load():
    # Equations (1), (3) and (5) by hand.
    angle, load, speed, volts = 0.03, 0.4, 0.5, 0.2
    device = ZHAO.adding(
        mi.Tilt(angle=angle), mi.FrameForce(force=load), mi.CubicStiffness(k3=0.6),
        mi.SeriesResistance(resistance=2.0),
    )  # fmt: skip
    after = 1.8 / 6.0 * speed
    push = 0.5 + 0.6 * 0.125 - 0.04 * 0.8 * speed - (volts / 0.5) ** 2
    push -= load + 5.0 * 9.81 * math.sin(angle)
    slowing = (0.27 * 6.0 * 9.81 * math.cos(angle) - push) / 5.0
    assert mi.step_length(device, speed, volts) == pytest.approx(
        after**2 / (2.0 * slowing), rel=1e-12
    )
    assert mi.step_length(device, [speed, 0.0], volts).tolist()[1] == 0.0
    slippery = ZHAO.replace(mu_d=0.0).adding(mi.FrameForce(force=-9.0))
    assert mi.step_length(slippery, 0.1) == math.inf


def test_steps_of_a_run_beside_the_formula():
    device = ZHAO.adding(mi.Tilt(angle=0.01), mi.SeriesResistance(resistance=0.05))
    drive = mi.Sine(amplitude=0.3, omega=0.5)
    start = mi.State(v2=0.5, charge=0.5)
    run = mi.simulate(device, drive, periods=2, initial=start, options=INTERPRETED)
    table = run.step_lengths()
    assert len(table) > 0
    np.testing.assert_allclose(table["ratio"], 1.0, atol=1e-4)


def test_no_formula_for_forces_with_a_past():
    with pytest.raises(mi.InvalidParameter, match=r"no formula for the step .* states of terms"):
        mi.step_length(ZHAO.adding(Stretched()), 0.1)
