"""Drives that jump: the arc before a jump does not see it, the one after it starts at it."""

import math

import numpy as np
import pytest

from mems_impact.hybrid.event_loop import workspace
from tests.hybrid.systems import (
    COULOMB,
    ENGINES,
    FLYING,
    RESTING,
    SQUARE,
    STOP,
    STUCK,
    TAU,
    at,
    coulomb,
    problem,
    run,
    simulate,
    stop,
    times,
)

pytestmark = pytest.mark.usefixtures("each_method")

FAR = 50.0  # a stop that is never reached


def swing(x, v, force, t):
    """x'' + x = force, exactly."""
    return (
        force + (x - force) * math.cos(t) + v * math.sin(t),
        v * math.cos(t) - (x - force) * math.sin(t),
    )


def driven(omega, periods, amplitude=0.5):
    """x'' + x = square wave, from rest: the exact states at its switches."""
    states = [(0.0, 0.0)]
    for half in range(2 * periods):
        force = amplitude if half % 2 == 0 else -amplitude
        states.append(swing(*states[-1], force, math.pi / omega))
    return np.array(states)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("omega", [0.3, 1.0, 1.7])
def test_square_wave_in_closed_form(omega, engine):
    p = stop(amplitude=0.5, omega=omega, square=1.0, d=FAR)
    settings = {"period": TAU / omega, "switches": SQUARE, "engine": engine, "rtol": 1e-12}
    run_ = simulate(STOP, p, [0.0, 0.0], 5.0, atol=1e-13, **settings)
    switches = run_.events[run_.events.kind == workspace.SWITCH]
    exact = driven(omega, 5)
    # The run starts at a switch. It ends at another, and leaves it to whoever goes on.
    assert switches.before == pytest.approx(exact[:10], abs=1e-9)
    assert run_.final.y == pytest.approx(exact[10], abs=1e-9)
    assert np.array_equal(switches.time[1::2], np.full(5, 0.5 * run_.period))
    assert np.array_equal(switches.time[::2], np.zeros(5))
    assert np.array_equal(switches.cycle[::2], np.arange(5))


def test_the_cost_of_a_switch_is_that_of_a_restart():
    """An arc that sees the jump would fight it with many small steps."""
    p = stop(amplitude=0.5, omega=1.0, square=1.0, d=FAR)
    told = simulate(STOP, p, [0.0, 0.0], 5.0, switches=SQUARE)
    smooth = simulate(STOP, stop(amplitude=0.5, d=FAR), [0.0, 0.0], 5.0)
    assert told.steps < 3 * smooth.steps


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_in_two_parts_is_the_run(engine):
    """The first part ends at a switch, which breaks a stuck body away."""
    p = coulomb(0.5, 1.0, 1.0, 1.0)
    setup = problem(COULOMB, p, switches=SQUARE, engine=engine)
    start = at([1.2, 0.0], STUCK)
    whole = run(setup, start, 2.0)
    for parts in ((1.0, 1.0), (0.5, 1.5), (1.5, 0.5), (0.25, 1.75)):
        final, jumps = start, []
        for part in parts:
            piece = run(setup, final, part)
            final = piece.final
            jumps += times(piece, workspace.SWITCH).tolist()
        assert final.y == pytest.approx(whole.final.y, abs=1e-8)
        assert (final.cycle, final.mode) == (whole.final.cycle, whole.final.mode)
        assert jumps == pytest.approx(times(whole, workspace.SWITCH))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_run_may_start_at_a_switch(engine):
    """Stuck at x = 0.4 under -1, the load being 1.4; the wave turns to +1, a load of 0.6."""
    p = coulomb(1.0, 1.0, 1.0, 1.0)
    settings = {"switches": SQUARE, "engine": engine}
    held = simulate(COULOMB, p, [0.4, 0.0], 0.4, mode=STUCK, **settings)
    assert held.final.y.tolist() == [0.4, 0.0]
    loose = simulate(COULOMB, p, [0.4, 0.0], 0.4, mode=STUCK, time=math.pi, **settings)
    assert loose.final.y[0] < 0.0


@pytest.mark.parametrize("engine", ENGINES)
def test_a_switch_releases_a_resting_body(engine):
    """Pressed by +1 against a stop at 0.2 of a spring of stiffness 1; released when it is -1."""
    p = stop(amplitude=1.0, omega=1.0, square=1.0, d=0.2, e=0.0)
    run_ = simulate(STOP, p, [0.2, 0.0], 0.75, mode=RESTING, switches=SQUARE, engine=engine)
    assert run_.final.y == pytest.approx(swing(0.2, 0.0, -1.0, math.pi / 2), abs=1e-9)
    assert times(run_, workspace.SWITCH) == pytest.approx([0.0, math.pi])
    assert run_.final.mode == FLYING


# From rest at -1 under +1 in a spring of stiffness 1: x = 1 - 2 cos t, at 1 when t = pi/2.


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("shift", [0.0, 1e-16, -1e-16, 1e-15, -1e-15, 1e-13, -1e-13, 1e-9, -1e-9])
def test_a_switch_at_an_impact(shift, engine):
    """The wave turns at the very impact: what follows is the same, whichever comes first."""
    omega = 2.0
    p = stop(amplitude=1.0, omega=omega, square=1.0, d=1.0 + 2.0 * shift, e=0.5)
    run_ = simulate(
        STOP, p, [-1.0, 0.0], 0.75, period=math.pi, switches=SQUARE, engine=engine, rtol=1e-12
    )
    events = run_.events[run_.events.kind <= workspace.SWITCH]
    assert sorted(events.kind) == [workspace.TRANSITION, workspace.SWITCH, workspace.SWITCH]
    expected = swing(1.0, -1.0, -1.0, math.pi / 4.0)
    assert run_.final.y == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("ulps", [1, 2, 5, 50, 1000])
def test_a_start_just_before_a_switch(ulps, engine, capfd):
    start = 0.5 * TAU - ulps * np.spacing(0.5 * TAU)
    p = stop(amplitude=0.5, square=1.0, d=FAR)
    run_ = simulate(
        STOP, p, [0.0, 0.0], 0.25, time=start, switches=SQUARE, engine=engine, rtol=1e-12
    )
    assert run_.final.y == pytest.approx([-0.5, -0.5], abs=1e-9)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("engine", ENGINES)
def test_what_rests_at_a_guard_is_not_pushed_before_a_switch(engine):
    """In equilibrium at the stop, up to the switch: whether it will go on is no longer seen."""
    p, start = stop(amplitude=0.5, square=1.0, d=-0.5), 0.98 * TAU
    run_ = simulate(STOP, p, [-0.5, 0.0], 0.1, time=start, switches=SQUARE, engine=engine)
    assert run_.events.kind.tolist() == [workspace.SWITCH]
    assert run_.events.mode_after.tolist() == [RESTING]


@pytest.mark.quick(15)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("shift", [0.0, 1e-12, -1e-12, 1e-7, -1e-7, 1e-5, -1e-5])
def test_a_switch_at_the_end_of_a_chatter(shift, engine):
    """Constant push 1 (k = 0): bounces of e = 0.5 from 1 accumulate after 3 sqrt 2."""
    end = 3.0 * math.sqrt(2.0) + shift
    p = stop(k=0.0, amplitude=1.0, omega=math.pi / end, square=1.0, d=0.0, e=0.5)
    run_ = simulate(STOP, p, [-1.0, 0.0], 0.75, period=2.0 * end, switches=SQUARE, engine=engine)
    assert len(run_.events) < 100
    assert run_.final.y == pytest.approx([-((end / 2.0) ** 2) / 2.0, -end / 2.0], abs=1e-4)
