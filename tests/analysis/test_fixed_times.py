"""What happens at fixed times: a blow once a period, by a switch that settles; no guard can."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

import mems_impact as mi

PLAIN = mi.Options(method="dop853", rtol=1e-11, atol=1e-13, engine="interpreted")
PERIOD = 2.0 * math.pi


def swing(mode, t, y, p):
    return y.v, -y.x - 0.2 * y.v


def blow(mode, t, y, p):
    return mode, (y.x, y.v + p.J)


def clock(mode, t, y, p):
    return math.cos(t - 1.0)


def step(mode, t, y, p):
    return 1.0 if t % PERIOD < 3.0 else -1.0


def struck(**how):
    return mi.System(states=("x", "v"), flow=swing, period=PERIOD, parameters={"J": 1.0}, **how)


def test_a_blow_once_a_period_against_its_closed_form():
    """Just before the blow y = M (y + J), with the matrix M of the motion over a period."""
    system = struck(switches=[1.0], switch_transition=blow)
    run = mi.simulate(system, periods=4, options=PLAIN)
    assert run.events["time"].tolist() == [1.0] * 4
    orbit = mi.find_orbit(system, options=PLAIN)
    flow = np.array([[0.0, 1.0], [-1.0, -0.2]])
    around = expm(PERIOD * flow)
    kick = np.array([0.0, 1.0])
    before = np.linalg.solve(np.eye(2) - around, around @ kick)
    start = expm((PERIOD - 1.0) * flow) @ (before + kick)
    assert [orbit.state.x, orbit.state.v] == pytest.approx(start.tolist(), abs=1e-9)
    assert np.abs(orbit.multipliers) == pytest.approx(math.exp(-0.1 * PERIOD), abs=1e-8)


@pytest.mark.parametrize("kind", [mi.Guard, mi.Impact])
def test_as_a_guard_it_is_told_why_not(kind):
    with pytest.raises(
        mi.FunctionError, match=r"depends on time alone, .* switches= .* switch_transition="
    ):
        struck(guards=[kind("hammer", clock, blow)])


@pytest.mark.parametrize("kind", [mi.Guard, mi.Impact])
def test_and_so_where_only_a_run_meets_it(kind):
    """A margin that jumps through zero has no rate that a check could look at."""
    system = struck(guards=[kind("hammer", step, blow)])
    options = mi.Options(engine="interpreted", max_events=50)
    with pytest.raises(mi.RunError, match=r"max_events = 50 .* depends on time alone") as caught:
        mi.simulate(system, periods=1, options=options)
    assert "restitution" not in str(caught.value)
