"""Short times, steep conditions, pulses between two steps, and what is no number."""

import math
from dataclasses import replace

import pytest
from scipy import constants

import mems_impact as mi

BEFORE, DURING, AFTER = mi.modes("before", "during", "after")


# SciPy #15262: an electron crosses a micrometre in 1e-13 s; less than the root finder tells apart.
# By default 1e-11 m and steps of 1/16 s are allowed; it is good to ten digits where both fit.
@pytest.mark.parametrize(
    ("atol", "time_scale", "accuracy"), [(1e-11, None, 1e-5), (1e-18, 1e-12, 1e-9)]
)
def test_an_electron_crosses_a_micrometre(atol, time_scale, accuracy, options):
    field, gap = 1e9, 1e-6
    push = constants.e / constants.m_e * field
    electron = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, p.push),
        parameters={"push": push, "d": gap},
        time_scale=time_scale,
    )
    run = mi.simulate(
        electron,
        duration=1e-12,
        until=lambda mode, t, y, p: p.d - y.x,
        options=replace(options, atol=atol),
    )
    assert run.ended == "until"
    arrival = math.sqrt(2.0 * gap / push)
    assert run.events["t"].tolist() == pytest.approx([arrival], rel=accuracy, abs=0.0)
    assert run.final.x == pytest.approx(gap, rel=1e-12)
    assert run.final.v == pytest.approx(push * arrival, rel=accuracy)


# SciPy #17066 and #19418: the event lies on the end of a step, and is steep there.
# A rate that is taken by differences says little of such a one: it may be early by 1e-6 of a step.
@pytest.mark.parametrize(("time_scale", "accuracy"), [(1.0, 1e-9), (1600.0, 1e-6)])
def test_a_steep_condition_ends_a_throw(time_scale, accuracy, options):
    def cube_root(mode, t, y, p):
        return math.copysign(abs(y.x) ** (1.0 / 3.0), y.x)

    throw = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -0.5),
        initial={"v": 10.0},
        time_scale=time_scale,
    )
    run = mi.simulate(throw, duration=100.0, until=cube_root, options=options)
    assert run.ended == "until"
    assert run.events["t"].tolist() == pytest.approx([40.0], rel=accuracy)
    assert run.final.v == pytest.approx(-10.0, rel=2.0 * accuracy)


# SciPy #18039: a source in pieces; the second of two pulses is stepped over.
def test_two_pulses_of_a_source(options):
    pulses = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (1.0 if 1.0 <= t < 2.0 or 80.0 <= t < 80.5 else 0.0,),
        period=100.0,
        switches=(1.0, 2.0, 80.0, 80.5),
    )
    run = mi.simulate(pulses, periods=1, options=options)
    assert run.final.x == pytest.approx(1.5, rel=1e-12)


# PyBaMM #2789: 500 s of current, a rest, and 10 s that are not seen; the charge, and a relaxation.
def current(t):
    """Return the current of the thread's table of 2 s, interpolated."""
    if t < 500.0:
        return 1.0
    if t < 502.0:
        return 1.0 - 0.5 * (t - 500.0)
    if t < 998.0:
        return 0.0
    if t < 1000.0:
        return 0.5 * (t - 998.0)
    if t < 1010.0:
        return 1.0
    return max(0.0, 1.0 - 0.5 * (t - 1010.0))


def test_a_pulse_of_ten_seconds_after_a_rest(options):
    tau = 30.0
    cell = mi.System(
        states=("charge", "lag"),
        flow=lambda mode, t, y, p: (current(t), (current(t) - y.lag) / p.tau),
        parameters={"tau": tau},
        period=1100.0,
        switches=(500.0, 502.0, 998.0, 1000.0, 1010.0, 1012.0),
    )
    run = mi.simulate(cell, periods=1, options=options)
    assert run.final.charge == pytest.approx(501.0 + 12.0, rel=1e-12)

    def ramp(since):  # the answer to a current that grows by 1/2 A a second
        return 0.5 * (since - tau + tau * math.exp(-since / tau))

    corners = ((500, -1), (502, 1), (998, 1), (1000, -1), (1010, -1), (1012, 1))
    lag = 1.0 - math.exp(-1100.0 / tau) + sum(sign * ramp(1100.0 - at) for at, sign in corners)
    assert run.final.lag == pytest.approx(lag, abs=1e-8)


# SUNDIALS #881, its example: "if t > 20 and t < 20.1 then 10000 else 0".
def test_a_pulse_between_two_times(options):
    short = mi.System(
        states=("x", "s"),
        flow=lambda mode, t, y, p: (10000.0 if mode == DURING else 0.0, 1.0),
        guards=[
            mi.Guard("on", lambda mode, t, y, p: 20.0 - y.s, lambda mode, t, y, p: (DURING, y),
                     modes=(BEFORE,)),
            mi.Guard("off", lambda mode, t, y, p: 20.1 - y.s, lambda mode, t, y, p: (AFTER, y),
                     modes=(DURING,)),
        ],
        time_scale=40.0,
    )  # fmt: skip
    run = mi.simulate(short, duration=40.0, options=options)
    assert run.final.x == pytest.approx(1000.0, rel=1e-9)


# SUNDIALS #722: y' = the fraction of t; "tout too close to t0" where a root lies on an output.
def test_a_saw_tooth_in_time(options):
    saw = mi.System(
        states=("y",), flow=lambda mode, t, y, p: (t % 1.0,), period=1.0, switches=(1.0,)
    )
    run = mi.simulate(saw, periods=10, options=options)
    assert run.final.y == pytest.approx(5.0, rel=1e-12)
    assert run.samples(per_period=1)["y"].tolist() == pytest.approx([0.5 * k for k in range(11)])


# SUNDIALS #258: a root function is no number, and the root finder never returns.
@pytest.mark.parametrize("until", [0.5, 2.0])
def test_a_condition_that_is_no_number_is_an_error(until, options):
    lost = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (-1.0,),
        guards=[mi.Guard("lost", lambda mode, t, y, p: y.x if y.x > 0.25 else math.nan)],
        initial={"x": 1.0},
    )
    if until < 0.75:
        assert len(mi.simulate(lost, duration=until, options=options).events) == 0
    else:
        with pytest.raises(mi.RunError, match="margin of a guard is not a number"):
            mi.simulate(lost, duration=until, options=options)
