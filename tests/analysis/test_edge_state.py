"""Edge states against closed forms, another package's test, and orbits of Newton's method."""

import math
from dataclasses import replace

import pytest

import mems_impact as mi
from mems_impact.analysis import edge_state as module
from tests.analysis.systems import oscillator
from tests.studies.one_impact import OneImpact


def _still(mode, t, y, p):
    return (0.0,)


def _cubic(mode, t, y, p):
    return mode, (p.a * y.x - y.x**3,)


CUBIC = mi.System(
    states=("x",),
    flow=_still,
    parameters={"a": 1.8},
    switch_transition=_cubic,
    switches=(0.5,),
    period=1.0,
)


@pytest.mark.slow
def test_the_saddle_of_a_cubic_map():
    """Attractors of x -> 1.8 x - x^3 at -sqrt(0.8) and sqrt(0.8), edge state at 0."""
    found = mi.edge_state(CUBIC, {"x": 0.7}, {"x": -1.1})
    assert found.settled
    assert abs(found.state.x) < 1e-5
    assert found.orbit.multipliers[0].real == pytest.approx(1.8, rel=1e-9)
    rest = math.sqrt(0.8)
    assert [each.x for each in found.attractors] == pytest.approx([rest, -rest], abs=1e-6)
    assert (found.table["distance"] <= 2e-5).all()


@pytest.mark.slow
def test_a_motion_that_settles_slowly_is_no_third_attractor():
    """Multipliers: 0.98 of the attractors at -0.1 and 0.1, 1.01 of the saddle."""
    found = mi.edge_state(CUBIC.changed(a=1.01), {"x": 0.1}, {"x": -0.13})
    assert abs(found.state.x) < 1e-5
    assert found.orbit.multipliers[0].real == pytest.approx(1.01, rel=1e-9)
    assert [each.x for each in found.attractors] == pytest.approx([0.1, -0.1], abs=1e-5)


@pytest.mark.slow
def test_a_slow_approach_to_the_saddle_settles_near_it():
    """The distance of y from the saddle at 1 is 20 times its change per return at the rate 0.05."""
    system = mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (y.x - y.x**3, 0.05 * (1.0 - y.y)),
    )
    found = mi.edge_state(system, {"x": 1.0}, {"x": -0.9}, tolerance=0.02)
    assert found.settled
    assert found.state.x == pytest.approx(0.0, abs=1e-4)
    assert found.state.y == pytest.approx(1.0, abs=0.03)


def test_a_motion_that_stays_at_the_saddle_is_no_third_attractor():
    """From x = 0.5 the motion reaches the right attractor; at 0 it stays."""
    problem = CUBIC.problem(module.ORBIT_OPTIONS)
    recurrence = mi.RecurrenceOptions(exponents="none")
    tracking = module._Tracking(
        CUBIC, recurrence, module.ORBIT_OPTIONS, problem, 1.0, 1e-8, 1e-5, 1e-6
    )
    begin = [CUBIC.state_space.instant({"x": x}, problem) for x in (0.5, -0.5, 0.0)]
    tracking.known = [tracking.reached(each)[1] for each in begin[:2]]
    assert [tracking.reached(each)[0] for each in begin] == [0, 1, module.UNCLEAR]


def test_a_motion_that_leaves_the_boundary(monkeypatch):
    advance = module._Tracking.advance

    def pushed(self, at):
        end = advance(self, at)
        return replace(end, y=end.y + 1e-3)  # as errors of the integration

    monkeypatch.setattr(module._Tracking, "advance", pushed)
    with pytest.raises(mi.OrbitError, match="the motion has left the boundary"):
        mi.edge_state(CUBIC, {"x": 0.7}, {"x": -1.1})


def _pushed(mode, t, y, p):
    push = 20.0 * (y.x - 0.1) if mode == CONTACT else 0.0
    return y.v, math.cos(4.0 * t) - 0.1 * y.v - y.x - push


APART, CONTACT = mi.modes("apart", "contact")
BILINEAR = mi.System(
    states=("x", "v"),
    flow=_pushed,
    period=0.5 * math.pi,
    guards=[
        mi.Guard("touch", lambda mode, t, y, p: 0.1 - y.x, lambda mode, t, y, p: (CONTACT, y),
                 modes=(APART,)),
        mi.Guard("part", lambda mode, t, y, p: y.x - 0.1, lambda mode, t, y, p: (APART, y),
                 modes=(CONTACT,)),
    ],
)  # fmt: skip


@pytest.mark.slow
def test_the_edge_state_of_a_bilinear_oscillator():
    """Attractors of periods 1, 3 and 9, whose boundaries are fractal."""
    found = mi.edge_state(BILINEAR, {"x": 0.0363, "v": 0.0973}, {"x": -0.0666, "v": 0.0071})
    attractors = [mi.find_orbit(BILINEAR, guess=each, transient=0) for each in found.attractors]
    assert all(each.stable for each in attractors)
    if found.settled:  # the motion wanders for a hundred returns or more
        assert found.orbit.periods == 6
        assert found.orbit.multipliers[0].real > 1.0


def test_arguments_of_the_edge_state():
    with pytest.raises(mi.InvalidParameter, match="the same attractor as first"):
        mi.edge_state(CUBIC, {"x": 0.7}, {"x": 0.8})
    with pytest.raises(mi.InvalidParameter, match="above min_distance"):
        mi.edge_state(CUBIC, {"x": 0.7}, {"x": -0.8}, max_distance=1e-9)
    with pytest.raises(mi.InvalidParameter, match="the system has a forcing period"):
        mi.edge_state(CUBIC, {"x": 0.7}, {"x": -0.8}, step=0.1)


def _fitzhugh(mode, t, y, p):
    return 10.0 * (y.u - y.u**3 - y.w), -3.0 * y.w + y.u


@pytest.mark.nightly
def test_the_edge_state_of_fitzhugh_and_nagumo():
    """The second test of Attractors.jl: the saddle at the origin."""
    system = mi.System(states=("u", "w"), flow=_fitzhugh)
    found = mi.edge_state(system, {"u": -1.0, "w": 0.2}, {"u": 1.0, "w": 0.2})
    assert found.settled
    assert max(abs(found.state.u), abs(found.state.w)) < 1e-6
    assert isinstance(found.orbit, mi.Equilibrium)
    eigenvalue = 3.5 + math.sqrt(32.25)  # of the matrix (10, -10; 1, -3)
    assert found.orbit.eigenvalues[0].real == pytest.approx(eigenvalue, rel=1e-9)
    rest = math.sqrt(2.0 / 3.0)
    assert [each.u for each in found.attractors] == pytest.approx([-rest, rest], rel=1e-6)


@pytest.mark.nightly
def test_the_saddle_between_rest_and_impacts():
    """The saddle with one impact in three periods has a closed form."""
    parameters = {"A": 1.0, "omega": 5.6, "zeta": 0.05, "wall": 0.1, "e": 0.8}
    one = max(OneImpact(**parameters).orbits(3), key=lambda each: each.multiplier)
    found = mi.edge_state(oscillator(**parameters), {"x": -0.2, "v": 0.9}, {"x": -0.2, "v": 0.1})
    assert found.settled
    assert found.orbit.periods == 3
    assert abs(found.orbit.multipliers[0]) == pytest.approx(one.multiplier, rel=1e-6)
    (speed,) = found.orbit.impacts["v before"]
    assert speed == pytest.approx(one.speed, rel=1e-8)
