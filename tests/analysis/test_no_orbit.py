"""What find_orbit says where there is no orbit: inadmissible solutions, diverging motions."""

import math

import pytest

import mems_impact as mi

PLAIN = mi.Options(method="dop853", rtol=1e-11, atol=1e-13, engine="interpreted")


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(t) - 0.2 * y.v - 2.0 * y.x


def gap(mode, t, y, p):
    return 1.0 - y.x


def strike(mode, t, y, p):
    return mode, (1.0, -0.5 * y.v)


WALL = mi.System(
    states=("x", "v"),
    flow=flow,
    period=2.0 * math.pi,
    parameters={"A": 1.1},
    guards=[mi.Impact("wall", gap, strike)],
)


def test_a_solution_that_is_no_orbit_is_an_error_and_kept():
    """The run from rest strikes once; the orbit that its equations have begins beyond the wall."""
    with pytest.raises(mi.OrbitError, match=r"segment 0 .* passes the wall .* -0\.0012") as caught:
        mi.find_orbit(WALL, periods=1, options=PLAIN)
    found = caught.value.partial
    assert isinstance(found, mi.Orbit)
    assert not found.admissible
    assert found.residual < 1e-8
    assert all(defect in str(caught.value) for defect in found.defects)


@pytest.mark.slow
def test_where_the_motion_settles_an_orbit_is_found_instead():
    orbit = mi.find_orbit(WALL, options=PLAIN)
    assert orbit.admissible
    assert orbit.stable
    settled = mi.simulate(WALL, periods=60, options=PLAIN).final
    assert orbit.state.x == pytest.approx(settled.x, abs=1e-6)


def middle(mode, t, y, p):
    return y.x


def test_a_guard_that_only_records_forbids_nothing():
    system = mi.System(
        states=("x", "v"),
        flow=flow,
        period=2.0 * math.pi,
        parameters={"A": 0.5},
        guards=[mi.Guard("middle", middle)],
    )
    orbit = mi.find_orbit(system, transient=10, options=PLAIN)
    assert orbit.admissible
    assert orbit.events["event"].tolist() == ["middle"]
    assert orbit.samples(100)["x"].min() < -0.4


def repelled(mode, t, y, p):
    return y.v, 2.0 * y.x + math.cos(t)


def blown_up(mode, t, y, p):
    return y.v, y.x**3 + math.cos(t)


def spiral(mode, t, y, p):
    return y.v, 0.5 * y.v - y.x


def runaway(function, period=None):
    return mi.System(states=("x", "v"), flow=function, period=period, initial={"x": 0.5})


@pytest.mark.filterwarnings("ignore::mems_impact.StiffnessWarning")
@pytest.mark.parametrize(
    ("system", "arguments", "told"),
    [
        (runaway(repelled, 2.0 * math.pi), {"transient": 5}, "diverged: v = .* at t = 31.4159;"),
        (runaway(blown_up, 2.0 * math.pi), {}, "diverged: v = .* at t = 2.1777"),
        (runaway(spiral), {"transient": 100.0}, "diverged: . = .* at t = 100;"),
    ],
)
def test_a_run_that_diverges_is_told_with_value_and_time(system, arguments, told):
    with pytest.raises(mi.OrbitError, match=told) as caught:
        mi.find_orbit(system, options=PLAIN, **arguments)
    reached = caught.value.partial
    assert isinstance(reached, mi.State)
    assert max(abs(reached.x), abs(reached.v)) > 1e7


def test_a_diverged_run_is_no_guess():
    run = mi.simulate(runaway(repelled, 2.0 * math.pi), periods=20, options=PLAIN)
    with pytest.raises(mi.OrbitError, match=r"diverged: v = .* in the guess; give a guess near"):
        mi.find_orbit(run, options=PLAIN)
