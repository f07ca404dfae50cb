"""What find_orbit says where there is no orbit: inadmissible solutions, diverging motions."""

import math
from dataclasses import replace

import pytest

import mems_impact as mi

PLAIN = mi.Options(method="dop853", rtol=1e-11, atol=1e-13, engine="interpreted")
COMPILED = replace(PLAIN, engine="compiled")


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
    with pytest.raises(
        mi.OrbitError, match=r"segment 0 .* passes the margin of wall .* -0\.0012"
    ) as caught:
        mi.find_orbit(WALL, periods=1, options=PLAIN)
    found = caught.value.partial
    assert isinstance(found, mi.Orbit)
    assert not found.admissible
    assert found.residual < 1e-8
    assert all(defect in str(caught.value) for defect in found.defects)


def middle(mode, t, y, p):
    return y.x


@pytest.mark.slow
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
        (runaway(repelled, 2.0 * math.pi), {"transient": 5}, "diverged: v = .* at t = 31.4159265;"),
        (runaway(blown_up, 2.0 * math.pi), {}, "diverged: v = .* at t = 2.1777"),
        (runaway(spiral), {"transient": 100.0}, "diverged: . = .* at t = 100;"),
    ],
)
def test_a_run_that_diverges_is_reported_with_value_and_time(system, arguments, told):
    with pytest.raises(mi.OrbitError, match=told) as caught:
        mi.find_orbit(system, options=PLAIN, **arguments)
    reached = caught.value.partial
    assert isinstance(reached, mi.State)
    assert max(abs(reached.x), abs(reached.v)) > 1e7


def test_a_diverged_run_is_no_guess():
    run = mi.simulate(runaway(repelled, 2.0 * math.pi), periods=20, options=PLAIN)
    with pytest.raises(mi.OrbitError, match=r"diverged: v = .* in the guess; give a guess near"):
        mi.find_orbit(run, options=PLAIN)


def drags(mode, t, y, p):
    return y.v, -0.5 * y.v + math.cos(t) + p.load


def weakly_held(mode, t, y, p):
    return y.v, -1e-3 * y.x - 0.5 * y.v + math.cos(t) + p.load


def two(mode, t, y, p):
    pull = y.x - y.z
    return y.v, -0.4 * y.v + math.cos(t) + p.load - pull, y.w, -0.3 * y.w + pull


def pushed(flow, states, period=2.0 * math.pi, **more):
    return mi.System(states=states, flow=flow, period=period, parameters={"load": 0.3}, **more)


@pytest.mark.slow
def test_a_state_that_drifts_is_to_be_cyclic():
    """Its mean speed is the load by the damping: 0.6, 1.2 pi a period."""
    with pytest.raises(mi.OrbitError, match=r"x grows by 3\.77 a period, .* in cyclic=\['x'\]"):
        mi.find_orbit(pushed(drags, ("x", "v")), transient=10, options=PLAIN)
    orbit = mi.find_orbit(pushed(drags, ("x", "v"), cyclic=("x",)), transient=10, options=PLAIN)
    assert orbit.gains["x"] == pytest.approx(1.2 * math.pi, rel=1e-9)


def test_what_drifts_is_reported_in_the_units_of_the_system():
    def fast(mode, t, y, p):
        return y.v, -0.5e6 * y.v + 1e9 * math.cos(1e6 * t) - p.load * 1e9

    typical = {"x": 1e-3, "v": 1e3, "time": 1e-6}
    system = pushed(fast, ("x", "v"), 2e-6 * math.pi, typical=typical, units={"x": "m"})
    with pytest.raises(mi.OrbitError, match=r"x falls by 0\.00377 m a period"):
        mi.find_orbit(system, periods=1, options=PLAIN)


@pytest.mark.nightly
def test_two_bodies_that_drift_together():
    """Mean speed: the load by the sum of both dampings."""
    rate = 0.3 / 0.7 * 2.0 * math.pi
    told = rf"x grows by {rate:.4g} and z grows by {rate:.4g} a period, .* distances"
    with pytest.raises(mi.OrbitError, match=told):
        mi.find_orbit(pushed(two, ("x", "v", "z", "w")), options=PLAIN)


def test_a_weak_spring_holds():
    """It is no drift: the orbit lies where the spring bears the load."""
    found = mi.find_orbit(pushed(weakly_held, ("x", "v")), transient=40, options=PLAIN)
    assert found.samples(64)["x"].mean() == pytest.approx(300.0, abs=0.2)


@pytest.mark.nightly
@pytest.mark.parametrize("period", [None, 1.7])
def test_drift_without_forcing(period):
    """A body at its final speed, one behind a cycle, a pendulum that goes round."""

    def behind_a_cycle(mode, t, y, p):
        return p.load + y.w * y.w, y.w, (1.0 - y.u * y.u) * y.w - y.u

    def even(mode, t, y, p):
        return y.v, -0.5 * y.v + p.load

    systems = {
        r"x grows by 0\.6 in a unit of time, .* cyclic": pushed(even, ("x", "v"), None),
        r"x grows by 2\.\d+ in a unit of time, .* cyclic": pushed(
            behind_a_cycle, ("x", "u", "w"), None, initial={"u": 1.0}
        ),
        r"angle grows by 7\.\d+ in a unit of time, .* guards at pi": pushed(
            lambda mode, t, y, p: (y.w, -0.2 * y.w - math.sin(y.angle) + 1.5),
            ("angle", "w"),
            None,
            initial={"w": 4.0},
        ),
    }
    for told, system in systems.items():
        # The search for a period of the pendulum takes longer than the compiler.
        options = COMPILED if "angle" in told else PLAIN
        with pytest.raises(mi.OrbitError, match=told):
            mi.find_orbit(system, period=period, options=options)


def loaded(mode, t, y, p):
    return y.v, p.load - y.x - 0.5 * y.v


def cruise(mode, t, y, p):
    return y.v + p.load, -2.0 * mode.line - 0.5 * y.v


@pytest.mark.nightly
@pytest.mark.parametrize("transient", [140, 300])
def test_a_motion_that_is_at_rest_to_the_last_digit_has_reached_an_equilibrium(transient):
    """Where rounding errors alone are left of the flow, free or along a switching surface."""
    surface = mi.SwitchingSurface("line", {"x": 1.0, "v": 1.0})
    for system in (
        pushed(loaded, ("x", "v"), None, initial={"x": 1.0}),
        pushed(cruise, ("x", "v"), None, initial={"x": 1.0}, parts=[surface]),
    ):
        with pytest.raises(mi.OrbitError, match="an equilibrium was reached"):
            mi.find_orbit(system, transient=transient, options=COMPILED)
