"""Transitions that are piecewise by an `if`, a `max` or an `abs`, along a branch."""

import math
import warnings

import pytest

import mems_impact as mi


def nordmark(mode, t, y, p):
    return mode, (0.5 * y.x + p.rho if y.x < 0.0 else p.rho - math.sqrt(y.x),)


def tent(mode, t, y, p):
    return mode, (0.5 * y.x + p.rho if y.x < 0.0 else p.rho - 0.3 * y.x,)


def largest(mode, t, y, p):
    return mode, (p.rho + max(0.2 * y.x, 0.6 * y.x),)


def modulus(mode, t, y, p):
    return mode, (p.rho - 0.7 * abs(y.x - 0.1),)


def jump(mode, t, y, p):
    return mode, (0.5 * y.x + p.rho if y.x < 0.3 else p.rho - 0.3 * y.x,)


def smooth(mode, t, y, p):
    return mode, (p.rho + 0.5 * math.sin(y.x),)


# The fixed point meets the border at this value.
BORDERS = {tent: 0.0, largest: 0.0, modulus: 0.1, nordmark: 0.0, jump: 0.15}


def warned(step):
    system = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (0.0,), period=1.0, switches=(1.0,),
        switch_transition=step, parameters={"rho": -0.1}, initial={"x": -0.1},
    )  # fmt: skip
    orbit = mi.find_orbit(system, transient=60)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mi.continue_solution(orbit, "rho", stop=0.3)
    return [str(each.message) for each in caught if each.category is mi.DiscontinuityWarning]


@pytest.mark.slow
@pytest.mark.parametrize("step", BORDERS)
def test_a_border_within_a_transition_is_warned_of(step):
    (message,) = warned(step)
    assert message.startswith("switch_transition is not smooth near x = ")
    value = float(message.partition("rho = ")[2].partition(":")[0])
    assert value == pytest.approx(BORDERS[step], abs=5e-3)


@pytest.mark.slow
def test_a_smooth_transition_is_not():
    assert warned(smooth) == []


def test_a_border_that_a_branch_stops_before_is_warned_of():
    """It ends within 1e-6 of the border, where the slope becomes infinite."""

    def step(mode, t, y, p):
        x = y.x - 0.3
        return mode, (0.3 + (0.6 * x + p.rho if x < 0.0 else p.rho - 2.0 * math.sqrt(x)),)

    (message,) = warned(step)
    assert float(message.partition("rho = ")[2].partition(":")[0]) == pytest.approx(0.0, abs=1e-4)
