"""Dry friction against closed forms, and against SciPy's integrator restarted by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")


def spring(mode, t, y, p):
    return y.v, -y.x


def pulled(mode, t, y, p):
    return y.v, y.load, p.rate


def test_the_amplitude_falls_by_four_mu_a_cycle_and_the_motion_stops():
    parts = [mi.Friction("ground", "v", mu=0.04)]
    block = mi.System(states=("x", "v"), flow=spring, initial={"x": 1.01}, parts=parts)
    run = mi.simulate(block, duration=60.0, options=PLAIN)
    turns = run.events
    # Half a cycle turns about mu on the side that it comes from.
    exact = [(-1.0) ** k * (1.01 - 0.08 * k) for k in range(1, 14)]
    assert turns["x"].tolist() == pytest.approx(exact, abs=1e-8)
    assert turns["t"].tolist() == pytest.approx([math.pi * k for k in range(1, 14)], abs=1e-7)
    assert turns["mode after"].tolist()[:2] == ["forward", "backward"]
    assert turns["mode after"].tolist()[-2:] == ["backward", "stuck"]
    assert run.final.mode == "stuck"
    assert run.final.v == 0.0
    assert abs(run.final.x) <= 0.04


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_body_breaks_away_when_all_other_forces_reach_the_static_limit(sign):
    block = mi.System(
        states=("x", "v", "load"),
        flow=pulled,
        parameters={"rate": 0.5 * sign, "mu_s": 0.3, "mu_d": 0.2},
        parts=[mi.Friction("ground", "v", mu="mu_d", static="mu_s", normal=10.0)],
    )
    run = mi.simulate(block, duration=8.0, options=PLAIN)
    assert run.events["event"].tolist() == ["ground slips"]
    assert run.events["t"].tolist() == pytest.approx([3.0 / 0.5], rel=1e-12)
    # From there v' = load - mu_d N: 1 (t - 6) + 0.25 (t - 6)^2.
    assert run.final.v == pytest.approx(sign * (2.0 + 0.25 * 4.0), rel=1e-9)
    assert run.final.x == pytest.approx(sign * (0.5 * 4.0 + 0.25 / 3.0 * 8.0), rel=1e-8)
    assert run.final.mode == ("forward" if sign > 0 else "backward")


def test_a_body_without_speed_slides_on_where_the_load_is_above_the_static_limit():
    thrown = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -p.load),
        parameters={"load": 1.0, "mu": 0.9},
        initial={"v": 1.9},
        parts=[mi.Friction("ground", "v", mu="mu")],
    )
    run = mi.simulate(thrown, duration=3.0, options=PLAIN)
    assert run.events["mode after"].tolist() == ["backward"]
    assert run.events["t"].tolist() == pytest.approx([1.0], rel=1e-12)
    assert run.final.v == pytest.approx(-0.1 * 2.0, rel=1e-9)
    held = mi.simulate(thrown.changed(mu=1.1), duration=3.0, options=PLAIN)
    assert held.final == mi.State(x=held.final.x, v=0.0, mode="stuck")
    assert held.final.x == pytest.approx(1.9**2 / 2.0 / 2.1, rel=1e-9)


def belt(**changes):
    return mi.System(
        states=("x", "v"),
        flow=spring,
        parameters={"speed": 0.3, "mu_s": 1.0, "mu_d": 0.5, "v_s": 0.4},
        **changes,
    )


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_stick_slip_on_a_belt_has_the_period_of_its_closed_form(direction):
    friction = mi.Friction("belt", "v", mu="mu_d", static="mu_s", surface="speed")
    run = mi.simulate(
        belt(parts=[friction]).changed(speed=0.3 * direction), duration=60.0, options=PLAIN
    )
    slips = run.events.query("event == 'belt slips'")
    exact = math.pi + 2.0 * math.atan2(0.3, 0.5) + 2.0 * 0.5 / 0.3
    assert slips["t"].diff().iloc[1:].tolist() == pytest.approx([exact] * 7, abs=1e-8)
    assert slips["x"].tolist() == pytest.approx([direction] * 8, rel=1e-9)


def test_stribeck_against_scipy_restarted_at_its_events():
    law = mi.Stribeck("mu_s", "mu_d", "v_s", viscous=0.05)
    friction = mi.Friction("belt", "v", mu=law, surface="speed")
    run = mi.simulate(belt(parts=[friction]), duration=30.0, options=PLAIN)
    ours = run.events

    def coefficient(u):
        return 0.5 + 0.5 * math.exp(-u / 0.4) + 0.05 * u

    def slipping(t, y):
        return [y[1], -y[0] + coefficient(0.3 - y[1])]  # behind the belt, which drags it along

    def caught_up(t, y):
        return 0.3 - y[1]

    caught_up.terminal, caught_up.direction = True, -1.0
    t, y, found = 0.0, [0.0, 0.0], []
    while t < 30.0:
        tight = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
        end = min(t + 20.0, 40.0)
        # It leaves with no relative acceleration; a moment later it has one.
        start = [y[0] + 0.3 * 1e-4, 0.3 - 0.0] if found else y
        if found:
            lag = 1e-3
            gone = solve_ivp(slipping, (t, t + lag), y, **tight)
            start, t = gone.y[:, -1].tolist(), t + lag
        arc = solve_ivp(slipping, (t, end), start, events=caught_up, **tight)
        if arc.t_events[0].size == 0:
            break
        t, y = float(arc.t_events[0][0]), arc.y_events[0][0].tolist()
        found.append((t, y[0]))
        stick = (1.0 - y[0]) / 0.3
        t, y = t + stick, [1.0, 0.3]
        found.append((t, 1.0))
    exact = np.array([each for each in found if each[0] < 30.0])
    assert ours["event"].tolist()[:2] == ["belt slip end", "belt slips"]
    assert len(exact) == len(ours) > 6
    assert np.abs(ours["t"].to_numpy() - exact[:, 0]).max() < 1e-6
    assert np.abs(ours["x"].to_numpy() - exact[:, 1]).max() < 1e-6


@pytest.mark.parametrize("heavy", [1.0, 5.0])
def test_a_block_on_a_plate_reaches_its_speed_and_both_continue_together(heavy):
    both = mi.System(
        states=("v", "w", "travel"),
        flow=lambda mode, t, y, p: (0.0, 0.0, y.v - y.w),
        parameters={"m": 2.0, "M": heavy},
        masses={"v": "m", "w": "M"},
        initial={"v": 3.0, "w": -1.0},
        parts=[mi.Friction("plate", "v", mu=0.5, normal=4.0, surface="w")],
    )
    run = mi.simulate(both, duration=20.0, options=PLAIN)
    gain = 2.0 * (1.0 / 2.0 + 1.0 / heavy)
    assert run.events["t"].tolist() == pytest.approx([4.0 / gain], rel=1e-9)
    assert run.final.travel == pytest.approx(4.0**2 / 2.0 / gain, rel=1e-9)
    assert run.final.v == run.final.w
    assert run.final.v == pytest.approx((3.0 * 2.0 - heavy) / (2.0 + heavy), abs=1e-9)
    assert run.final.mode == "stuck"


def test_a_normal_force_may_depend_on_the_state_and_a_law_be_the_users():
    wedge = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, 0.0),
        initial={"v": 1.0},
        parts=[mi.Friction("wedge", "v", mu=lambda u, p: 2.0 * u, normal=lambda t, y, p: 1.0)],
    )
    run = mi.simulate(wedge, duration=1.0, options=PLAIN)
    assert run.final.v == pytest.approx(math.exp(-2.0), rel=1e-8)
    growing = mi.Friction("wedge", "v", mu=0.5, normal=lambda t, y, p: 2.0 * y.x)
    thrust = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, 0.0), initial={"v": 1.0},
        parts=[growing],
    )  # fmt: skip
    run = mi.simulate(thrust, duration=2.0, options=PLAIN)
    # v' = -x from x = 0: a quarter of a cosine.
    assert run.events["t"].tolist() == pytest.approx([math.pi / 2.0], rel=1e-8)
    assert run.final == mi.State(x=run.final.x, v=0.0, mode="stuck")


def test_an_oscillator_under_drive_sticks_for_part_of_each_period():
    # Balance of energy over a period of the steady state: work of the drive and heat.
    driven = mi.System(
        states=("x", "v", "heat", "work"),
        flow=lambda mode, t, y, p: (
            y.v, math.cos(p.omega * t) - y.x, p.mu * abs(y.v), math.cos(p.omega * t) * y.v,
        ),
        period=lambda p: 2.0 * math.pi / p.omega,
        parameters={"omega": 0.25, "mu": 0.5},
        parts=[mi.Friction("ground", "v", mu="mu")],
    )  # fmt: skip
    run = mi.simulate(driven, 12, options=PLAIN)
    assert set(run.events["mode after"]) == {"stuck", "forward", "backward"}
    last = run.final
    stored = 0.5 * (last.x**2 + last.v**2)
    assert last.work - last.heat == pytest.approx(stored, abs=1e-6)
    grid = run.samples(64)
    assert (grid["v"][grid["mode"] == "stuck"] == 0.0).all()
    load = np.cos(0.25 * grid["t"]) - grid["x"]
    assert (abs(load[grid["mode"] == "stuck"]) <= 0.5 + 1e-6).all()


def test_where_stribeck_settles():
    # On a belt that is fast enough the steady slip is stable: x = mu(v_belt).
    law = mi.Stribeck("mu_s", "mu_d", "v_s", viscous=0.6)
    fast = belt(parts=[mi.Friction("belt", "v", mu=law, surface="speed")]).changed(speed=1.5)
    run = mi.simulate(fast, duration=200.0, options=PLAIN)
    assert run.final.x == pytest.approx(0.5 + 0.5 * math.exp(-1.5 / 0.4) + 0.9, abs=1e-6)
    root = brentq(lambda u: -0.5 / 0.4 * math.exp(-u / 0.4) + 0.6, 0.0, 3.0)
    assert 0.0 < root < 1.5  # where the law stops falling


@pytest.mark.slow
def test_an_orbit_that_sticks_has_the_multiplier_of_its_map():
    driven = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, math.cos(p.omega * t) - y.x),
        period=lambda p: 2.0 * math.pi / p.omega,
        parameters={"omega": 0.25, "mu": 0.5},
        parts=[mi.Friction("ground", "v", mu="mu")],
    )
    tight = mi.Options(engine="interpreted", method="dop853", rtol=1e-11, atol=1e-13)
    orbit = mi.find_orbit(mi.simulate(driven, 20, options=tight), periods=1, options=tight)
    assert orbit.state.mode == "stuck"
    around = [
        mi.simulate(driven, 1, initial=orbit.state.replace(x=orbit.state.x + d), options=tight)
        for d in (1e-5, -1e-5)
    ]
    by_differences = (around[0].final.x - around[1].final.x) / 2e-5
    assert orbit.multipliers.real == pytest.approx([by_differences], rel=1e-6)


def test_friction_without_sticking_creeps():
    creeping = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, 0.3),
        parts=[
            mi.Friction(
                "ground", "v", mu=lambda u, p: 0.5 * math.tanh(u / 0.01), normal=2.0, sticks=False
            )
        ],
    )
    run = mi.simulate(
        creeping, duration=2.0, options=mi.Options(engine="interpreted", method="bdf")
    )
    assert run.final.mode == "forward"
    assert run.final.v == pytest.approx(0.01 * math.atanh(0.3), rel=1e-6)
