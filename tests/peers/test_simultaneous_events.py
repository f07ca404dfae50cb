"""Events of one instant, and conditions that stay at zero."""

import math

import numpy as np
import pytest

import mems_impact as mi

NEITHER, FIRST, SECOND, BOTH = mi.modes("neither", "first", "second", "both")


def reach(name, level, change, *, before, order=None):
    """Return a guard that carries out `change` once `s` has come to `level`."""
    modes = tuple(before)

    def transition(mode, t, y, p):
        return before_to[mode], change(y)

    before_to = tuple(before.get(mode, mode) for mode in (NEITHER, FIRST, SECOND, BOTH))
    return mi.Guard(name, lambda mode, t, y, p: level - y.s, transition, modes=modes, order=order)


def pair(level, first, second, orders=(None, None)):
    return [
        reach("first", level, first, before={NEITHER: FIRST, SECOND: BOTH}, order=orders[0]),
        reach("second", level, second, before={NEITHER: SECOND, FIRST: BOTH}, order=orders[1]),
    ]


# DiffEqBase.jl #889: the same condition twice, looped for ever. Backwards in time: s = -t.
def test_the_same_condition_twice(options):
    twice = mi.System(
        states=("u", "s"),
        flow=lambda mode, t, y, p: (y.u - math.sin(y.s), 1.0),
        guards=pair(2.95, lambda y: (y.u + 2.0, y.s), lambda y: (y.u + 2.0, y.s)),
        initial={"u": 1.0},
    )
    run = mi.simulate(twice, duration=10.0, options=options)
    assert run.events["event"].tolist() == ["first", "second"]
    assert run.events["t"].to_numpy() == pytest.approx([2.95, 2.95], rel=1e-12)
    free = 0.5 * (math.exp(10.0) + math.sin(10.0) + math.cos(10.0))
    assert run.final.u == pytest.approx(free + 4.0 * math.exp(10.0 - 2.95), rel=1e-7)


# DiffEqBase.jl PR #1229: of two doses at t = 1 one was given.
def test_two_doses_in_one_instant(options):
    doses = mi.System(
        states=("a", "b", "s"),
        flow=lambda mode, t, y, p: (-y.a, -y.b, 1.0),
        guards=pair(1.0, lambda y: (y.a + 1.0, y.b, y.s), lambda y: (y.a, y.b + 1.0, y.s)),
        initial={"a": 1.0, "b": 1.0},
    )
    run = mi.simulate(doses, duration=5.0, options=options)
    both = math.exp(-5.0) + math.exp(-4.0)
    assert (run.final.a, run.final.b) == pytest.approx((both, both), abs=1e-9)


# AMICI #2804 (and #2861): a root after reinitialization; priorities say which comes first.
@pytest.mark.parametrize("orders", [(2, 1), (1, 2)])
def test_two_events_at_one_time_by_priority(orders, options):
    model = mi.System(
        states=("target1", "target2", "s"),
        flow=lambda mode, t, y, p: (1.0, 1.0, 1.0),
        guards=pair(
            1000.0,
            lambda y: (y.target1 + 10.0, y.target2, y.s),
            lambda y: (y.target1, y.target2 + 10.0, y.s),
            orders,
        ),
        initial={"target1": 1.0, "target2": 2.0},
        time_scale=2000.0,
    )
    run = mi.simulate(model, duration=2000.0, options=options)
    expected = ["first", "second"] if orders == (1, 2) else ["second", "first"]
    assert run.events["event"].tolist() == expected
    assert run.events["t"].to_numpy() == pytest.approx([1000.0, 1000.0], rel=1e-12)
    assert (run.final.target1, run.final.target2) == pytest.approx((2011.0, 2012.0), rel=1e-12)


# DiffEqBase.jl #837: oscillations in step, whose thresholds are crossed together; no end of it.
@pytest.mark.parametrize("apart", [0.0, 1e-9, 0.1])
def test_two_oscillations_in_step(apart, options):
    waves = mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (math.cos(t), math.cos(t)),
        period=2.0 * math.pi,
        guards=[
            mi.Guard("x up", lambda mode, t, y, p: 0.5 - y.x),
            mi.Guard("y up", lambda mode, t, y, p: 0.5 - y.y),
        ],
        initial={"y": apart},
    )
    run = mi.simulate(waves, periods=5, options=options)
    for name, start in (("x up", 0.0), ("y up", apart)):
        expected = math.asin(0.5 - start) + 2.0 * math.pi * np.arange(5)
        found = run.events.loc[run.events["event"] == name, "t"].to_numpy()
        assert found == pytest.approx(expected, abs=1e-7)


# OrdinaryDiffEq.jl #3594: cos t falls where cos 3t rises; told the wrong way round.
def test_one_rises_where_the_other_falls(options):
    waves = mi.System(
        states=("a", "b"),
        flow=lambda mode, t, y, p: (-math.sin(t), -3.0 * math.sin(3.0 * t)),
        period=2.0 * math.pi,
        guards=[
            mi.Guard("a falls", lambda mode, t, y, p: y.a),
            mi.Guard("b falls", lambda mode, t, y, p: y.b),
            mi.Guard("b rises", lambda mode, t, y, p: -y.b),
        ],
        initial={"a": 1.0, "b": 1.0},
    )
    run = mi.simulate(waves, duration=math.pi, options=options)
    sixth = math.pi / 6.0
    expected = [("a falls", 3), ("b falls", 1), ("b falls", 5), ("b rises", 3)]
    found = sorted(zip(run.events["event"], run.events["t"] / sixth, strict=True))
    assert [name for name, _ in found] == [name for name, _ in expected]
    assert [at for _, at in found] == pytest.approx([at for _, at in expected], abs=1e-7)


# OrdinaryDiffEq.jl #3627: a condition stays at zero, and the next event is never reached.
def test_a_condition_that_stays_at_zero(options):
    surface = mi.Guard("surface", lambda mode, t, y, p: 1.0 - y.b, lambda mode, t, y, p: (BOTH, y))
    mark = mi.Guard("mark", lambda mode, t, y, p: 5.0 - y.a)
    sticking = mi.System(
        states=("a", "b"),
        flow=lambda mode, t, y, p: (0.5, 1.0 if mode == NEITHER else 0.0),
        guards=[mark, surface],
        modes=(NEITHER, FIRST, SECOND, BOTH),
    )
    run = mi.simulate(sticking, duration=20.0, options=options)
    assert run.events["event"].tolist() == ["surface", "mark"]
    assert run.events["t"].to_numpy() == pytest.approx([1.0, 10.0], rel=1e-12)
    assert run.final.as_dict() == pytest.approx({"a": 10.0, "b": 1.0}, rel=1e-12)


# SUNDIALS #881: a root function that is zero from its root on.
@pytest.mark.nightly
def test_a_root_function_that_is_zero_from_its_root_on(options):
    run = mi.simulate(
        mi.System(
            states=("s",),
            flow=lambda mode, t, y, p: (1.0,),
            guards=[
                mi.Guard("at 20", lambda mode, t, y, p: max(20.0 - y.s, 0.0)),
                mi.Guard("at 30", lambda mode, t, y, p: 30.0 - y.s),
            ],
        ),
        duration=40.0,
        options=options,
    )
    assert run.events["event"].tolist() == ["at 20", "at 30"]
    assert run.events["t"].to_numpy() == pytest.approx([20.0, 30.0], rel=1e-9)
