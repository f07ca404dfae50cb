"""Canard explosion of the FitzHugh-Nagumo (van der Pol) oscillator.

Within 1e-8 of the parameter a small cycle grows along the repelling part of the slow manifold,
where errors grow by 1e28. A plane flow has one multiplier, the exponential of its divergence along
the cycle, which is positive: no period doubling.
"""

import math

import pytest
from scipy.integrate import solve_ivp

import mems_impact as mi

EPS = 0.02


def nerve(mode, t, y, p):
    return y.x - y.x**3 / 3.0 - y.y, EPS * (y.x + p.a)


@pytest.mark.nightly
def test_multipliers_are_those_of_the_divergence_and_nothing_bifurcates():
    system = mi.System(
        states=("x", "y"), flow=nerve, parameters={"a": 1.1}, initial={"x": -1.1, "y": -0.656}
    )
    (rest,) = mi.find_equilibria(system)
    (hopf,) = mi.continue_solution(rest, "a", stop=0.9).special_points
    assert hopf.criticality == "supercritical"
    steps = mi.StepControl(max_step=0.4, max_points=90)
    branch = mi.switch_branch(hopf, bounds=(0.5, 1.1), steps=steps)
    assert branch.special_points == ()
    assert all(cycle.stable for cycle in branch.orbits)
    # Beyond the longest cycle, which follows both slow manifolds, the repelling one as far as it
    # goes: errors grow by exp(4/3/EPS).
    periods = [cycle.period for cycle in branch.orbits]
    assert periods[-1] < max(periods) - 5.0
    assert max(periods) > 4.5 / EPS

    for cycle in branch.orbits[::3]:
        a = cycle.system.parameters["a"]

        def extended(t, u, a=a):
            x, y, _ = u
            return x - x**3 / 3.0 - y, EPS * (x + a), 1.0 - x**2

        start = (cycle.state.x, cycle.state.y, 0.0)
        end = solve_ivp(extended, (0.0, cycle.period), start, "DOP853", rtol=1e-12, atol=1e-13)
        if math.dist(end.y[:2, -1], start[:2]) > 1e-6:
            break  # the growth is too large for an integration to follow the cycle
        exact = math.exp(end.y[2, -1])
        assert cycle.multipliers[0].real == pytest.approx(exact, rel=1e-4)
        followed = cycle.period
    assert followed > 100.0
