"""The field beyond the edges, against the integral equation of the charges on two strips."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

import mems_impact as mi
from mems_impact.actuator.model import compose

ZHAO = mi.load_actuator("zhao2004")
INTERPRETED = mi.Options(engine="interpreted")


def electrode(device):
    model = compose(tuple(term.kind for term in device.terms), 1)
    numbers = device.under(mi.Sine(amplitude=0.1, omega=1.0)).numbers()
    return model.electrodes[0], numbers.parameters


def strips(width, gap, count=48):
    """Capacitance per length over permittivity of two thin strips, by collocation.

    Charges as Chebyshev series over the root of the distance from both edges; half a volt on each.
    """
    s = np.cos((np.arange(count) + 0.5) * np.pi / count)
    orders = np.arange(count)
    series = np.cos(np.outer(np.arccos(s), orders))
    half = 0.5 * width
    own = -np.pi * series / np.maximum(orders, 1)
    own[:, 0] = np.pi * math.log(half / 2.0)
    apart = np.log(np.hypot(half * (s[:, None] - s[None, :]), gap))
    other = (apart * np.pi / count) @ series
    charges = np.linalg.solve(-(own - other) / (2.0 * np.pi), np.full(count, 0.5))
    return np.pi * charges[0]


@pytest.mark.parametrize(("ratio", "excess"), [(0.1, 0.0033), (0.25, 0.0143), (0.499, 0.0398)])
def test_force_against_the_charges_on_two_strips(ratio, excess):
    width = 1.0 / ratio  # 2 alpha = 1 for strips as wide as they are: permittivity/width
    device = ZHAO.replace(alpha=0.5 * width, d=1.0, delta=1e-3)
    made, p = electrode(device.adding(mi.Fringing(width=width)))
    h = 1e-4
    exact = (strips(width, 1.0 - h) - strips(width, 1.0 + h)) / (2.0 * h)
    assert made.slope(0.0, p) / exact - 1.0 == pytest.approx(excess, abs=1e-4)


@pytest.mark.parametrize("sizes", [{"width": 3.0}, {"width": 3.0, "length": 5.0}])
def test_force_is_the_slope_of_the_capacitance(sizes):
    made, p = electrode(ZHAO.adding(mi.Fringing(**sizes)))
    for x in (-0.5, 0.0, 0.3, 0.5):
        h = 1e-5
        slope = (made.capacitance(x + h, p) - made.capacitance(x - h, p)) / (2.0 * h)
        assert made.slope(x, p) == pytest.approx(slope, rel=1e-9)
    factor = 1.0
    for size in sizes.values():
        factor *= 1.0 + (1.0 + math.log(2.0 * math.pi * size)) / (math.pi * size)
    assert made.capacitance(0.0, p) == pytest.approx(2.0 * factor, rel=1e-14)


def test_pulls_in_where_statics_say():
    width = 4.0

    def pull(x):
        return (1.0 + (1.0 - x) / (math.pi * width)) / (1.0 - x) ** 2

    top = minimize_scalar(lambda x: -x / pull(x), bounds=(0.1, 0.5), options={"xatol": 1e-10})
    volts = math.sqrt(-top.fun)
    fringing = mi.Fringing(width=width)
    assert mi.pull_in_voltage(ZHAO.adding(fringing)) == pytest.approx(volts, rel=1e-9)
    # Just below it the block rests in equilibrium, just above it goes to the stopper.
    device = ZHAO.replace(mu_s=9.0, c=2.0).adding(fringing)
    below = 0.999 * volts
    rest = brentq(lambda x: x - below**2 * pull(x), 0.0, top.x)
    dc = mi.Sine(amplitude=0.0, omega=1.0, bias=below)
    run = mi.simulate(device, dc, 1, initial=mi.State(x2=rest), options=INTERPRETED)
    assert run.final.x2 == pytest.approx(rest, abs=1e-8)
    above = dc.replace(bias=1.001 * volts)
    run = mi.simulate(device, above, 20, initial=mi.State(x2=top.x), options=INTERPRETED)
    assert len(run.impacts) > 0


def test_electrodes_are_wide_beside_the_gap():
    with pytest.raises(mi.InvalidParameter, match=r"fringing.width .* >= 3"):
        ZHAO.adding(mi.Fringing(width=2.9))
    with pytest.raises(mi.InvalidParameter, match=r"fringing.length .* >= 3"):
        ZHAO.adding(mi.Fringing(width=3.0, length=2.0))
    with pytest.raises(mi.InvalidParameter, match="width"):
        mi.Fringing(width=-1.0)
