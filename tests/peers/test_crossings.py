"""Crossings that lie within one step, or on its end; each before a closed form."""

import itertools

import numpy as np
import pytest

import mems_impact as mi


def recorded(margins, flow, states, initial, *, until, options, time_scale=None, **more):
    """Return the run of a system whose guards only record: one a margin, by name."""
    system = mi.System(
        states=states,
        flow=flow,
        guards=[mi.Guard(name, margin) for name, margin in margins.items()],
        initial=initial,
        time_scale=time_scale,
        **more,
    )
    return mi.simulate(system, duration=until, options=options)


# DifferentialEquations.jl #258: of two thresholds one was not seen, at steps of 1e-6.
@pytest.mark.parametrize("time_scale", [None, 16e-6], ids=["free", "steps of 1e-6"])
def test_two_thresholds_of_a_ramp(time_scale, options):
    run = recorded(
        {"second": lambda mode, t, y, p: 0.002 - y.u, "first": lambda mode, t, y, p: 0.001 - y.u},
        lambda mode, t, y, p: (1.0,),
        ("u",),
        {},
        until=0.05 if time_scale is None else 0.003,
        time_scale=time_scale,
        options=options,
    )
    assert run.events["event"].tolist() == ["first", "second"]
    assert run.events["t"].to_numpy() == pytest.approx([0.001, 0.002], rel=1e-12)


# DiffEqBase.jl #271 and #487: pairs of zeros, and nine of them, on the ends of steps of 0.1.
def product(mode, t, y, p):
    value = 1.0
    for zero in p:
        value *= y.s - zero
    return value


def minus_product(mode, t, y, p):
    return -product(mode, t, y, p)


NINE = tuple(0.1 * k for k in range(1, 10))


@pytest.mark.parametrize("zeros", [(0.5, 0.6), NINE], ids=["two", "nine"])
@pytest.mark.parametrize("time_scale", [1.6, 10.0], ids=["steps of 0.1", "longer steps"])
def test_zeros_where_steps_end(zeros, time_scale, options):
    run = recorded(
        {"down": product, "up": minus_product},
        lambda mode, t, y, p: (1.0,),
        ("s",),
        {},
        parameters={f"zero{k}": zero for k, zero in enumerate(zeros)},
        until=1.0,
        time_scale=time_scale,
        options=options,
    )
    assert np.sort(run.events["t"].to_numpy()) == pytest.approx(zeros, abs=1e-10)
    first = "down" if len(zeros) % 2 == 0 else "up"
    other = {"down": "up", "up": "down"}[first]
    expected = itertools.islice(itertools.cycle((first, other)), len(zeros))
    assert run.events["event"].tolist() == list(expected)


# SciPy #9228: of three zeros of a cubic two were stepped over.
def cubic(mode, t, y, p):
    return 3.0 * y.x * y.x + 12.0 * y.x - 4.0, 1.0


@pytest.mark.parametrize("time_scale", [1.0, 100.0])
def test_three_zeros_of_a_cubic(time_scale, options):
    run = recorded(
        {"down": lambda mode, t, y, p: y.y, "up": lambda mode, t, y, p: -y.y},
        cubic,
        ("y", "x"),
        {"y": -120.0, "x": -8.0},
        until=12.0,
        time_scale=time_scale,
        options=options,
    )
    assert run.events["event"].tolist() == ["up", "down", "up"]
    assert run.events["x"].to_numpy() == pytest.approx([-6.0, -2.0, 2.0], abs=1e-8)


def test_three_zeros_of_a_cubic_as_a_section(options):
    start = {"y": -120.0, "x": -8.0}
    run = recorded(
        {}, cubic, ("y", "x"), start, until=12.0, time_scale=12.0, options=options,
        section=("y", 0.0),
    )  # fmt: skip
    assert run.section()["x"].to_numpy() == pytest.approx([-6.0, -2.0, 2.0], abs=1e-8)


# CyRK #98: two zeros around t = 5, closer together than any step.
@pytest.mark.parametrize("apart", [1.0, 1e-3, 1e-6])
def test_two_zeros_close_together(apart, options):
    run = recorded(
        {"down": lambda mode, t, y, p: y.y, "up": lambda mode, t, y, p: -y.y},
        lambda mode, t, y, p: (2.0 * (y.s - 5.0), 1.0),
        ("y", "s"),
        {"y": 25.0 - 0.25 * apart * apart},
        until=10.0,
        time_scale=100.0,
        options=options,
    )
    assert run.events["event"].tolist() == ["down", "up"]
    half = 0.5 * apart
    accuracy = 1e-8 * 25.0 / half
    assert run.events["t"].to_numpy() == pytest.approx([5.0 - half, 5.0 + half], abs=accuracy)


@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_two_crossings_of_a_section_close_together(method):
    run = recorded(
        {}, lambda mode, t, y, p: (2.0 * (y.s - 5.0), 1.0), ("y", "s"), {"y": 25.0 - 25e-6},
        until=10.0, section=("y", 0.0),
        options=mi.Options(engine="interpreted", method=method),
    )  # fmt: skip
    assert run.section()["s"].to_numpy() == pytest.approx([4.995, 5.005], abs=1e-4)


# diffrax #639: of two events in one step the one listed last was taken for the first.
@pytest.mark.parametrize("order", [(1.0, 0.5), (0.5, 1.0)])
def test_the_first_of_two_events_ends_the_run(order, options):
    late, early = (lambda mode, t, y, p: 1.0 - y.s), (lambda mode, t, y, p: 0.5 - y.s)
    listed = {1.0: ("late", late), 0.5: ("early", early)}
    run = recorded(
        dict(listed[when] for when in order), lambda mode, t, y, p: (1.0,), ("s",), {},
        until=2.0, time_scale=32.0, options=options,
    )  # fmt: skip
    assert run.events["event"].tolist() == ["early", "late"]
    assert run.events["t"].to_numpy() == pytest.approx([0.5, 1.0], rel=1e-12)


# diffrax #507: a straight line through a cubic of y; two of its zeros in one step.
def test_zeros_of_a_cubic_on_a_straight_line(options):
    run = recorded(
        {
            "down": lambda mode, t, y, p: (2.5 - y.y) * (5.0 - y.y) * -y.y,
            "up": lambda mode, t, y, p: (2.5 - y.y) * (5.0 - y.y) * y.y,
        },
        lambda mode, t, y, p: (1.0,),
        ("y",),
        {"y": -1.0},
        until=7.0,
        time_scale=100.0,
        options=options,
    )
    assert run.events["event"].tolist() == ["down", "up", "down"]
    assert run.events["t"].to_numpy() == pytest.approx([1.0, 3.5, 6.0], abs=1e-9)
