"""Orbits and equilibria on known branches, where these fold."""

import math

import pytest

import mems_impact as mi
from mems_impact.continuation.orbit_identity import equilibrium_on_branch, orbit_on_branch

# The map x -> a - x^2, with a fold of fixed points at a = -1/4.
DOP853 = mi.Options(method="dop853")
MAP = mi.System(
    states=("x", "w"),
    flow=lambda mode, t, y, p: (0.0, -y.w),
    switch_transition=lambda mode, t, y, p: (mode, (p.a - y.x * y.x, y.w)),
    switches=(0.5,),
    period=1.0,
    parameters={"a": 0.5},
)


def fixed_point(a, side):
    guess = {"x": 0.5 * (side * math.sqrt(1.0 + 4.0 * a) - 1.0), "w": 0.0}
    return mi.find_orbit(MAP.changed(a=a), periods=1, guess=guess, options=DOP853)


@pytest.mark.nightly
def test_orbits_within_a_step_across_a_fold():
    steps = mi.StepControl(initial_step=0.1, max_step=0.4)
    whole = mi.continue_solution(fixed_point(0.5, 1.0), "a", -1.0, steps=steps)
    assert [special.label for special in whole.special_points] == ["CF"]
    reached = whole.table["a"].min()
    assert reached > -0.249
    for a in (-0.2499, 0.5 * (reached - 0.25), reached, 0.1):
        for side in (1.0, -1.0):
            assert orbit_on_branch(whole.numeric, fixed_point(a, side).numeric)
    half = mi.continue_solution(fixed_point(0.5, 1.0), "a", -1.0, steps=steps, stop_at="CF")
    assert orbit_on_branch(half.numeric, fixed_point(0.1, 1.0).numeric)
    assert not orbit_on_branch(half.numeric, fixed_point(0.1, -1.0).numeric)


def test_equilibria_on_both_sides_of_a_fold():
    system = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (p.a - y.x**2,), parameters={"a": 1.0}
    )

    def equilibrium(a, x):
        return mi.find_equilibria(system.changed(a=a), guess={"x": x})[0]

    upper = equilibrium(1.0, 1.0)
    whole = mi.continue_solution(upper, "a", -1.0)
    half = mi.continue_solution(upper, "a", -1.0, stop_at="LP")
    for a in (1e-3, 0.1, 0.9):
        for x, is_on_half in ((math.sqrt(a), True), (-math.sqrt(a), False)):
            state = equilibrium(a, x).numeric
            assert equilibrium_on_branch(whole.numeric, state)
            assert equilibrium_on_branch(half.numeric, state) == is_on_half
