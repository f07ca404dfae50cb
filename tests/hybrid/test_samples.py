"""Samples: on the trajectory, never beyond a stopper, and without effect on the run."""

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.drives import Sine
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import CheckpointGrid, Simulation
from tests.actuator import machine
from tests.hybrid.systems import (
    BALL,
    COULOMB,
    ENGINES,
    STOP,
    TAU,
    at,
    ball,
    coulomb,
    problem,
    run,
    same,
    simulate,
    stop,
)

pytestmark = pytest.mark.usefixtures("each_method")

# name: automaton, parameters, start, mode, period, section
CASES = {
    "impacts": (STOP, stop(c=0.1, amplitude=0.7, omega=0.8), [0.2, 1.5], 0, TAU / 0.8, (0, 0.0, 0)),
    "chatter": (BALL, ball(0.4, 0.9, 1.0), [0.3, 0.0], 0, TAU, (1, 0.01, 0)),
    "friction": (COULOMB, coulomb(0.3, 1.0, 0.3), [0.5, 0.0], 0, TAU / 0.3, (0, 0.1, 0)),
}
CHOICES = [("compiled", 20.0), ("interpreted", 2.0)]


@pytest.fixture(params=CASES)
def case(request):
    automaton, p, y, mode, period, section = CASES[request.param]
    return (automaton, p), at(y, mode), {"period": period, "section": section}


def log(setup, start, periods, per_period):
    """The events of a run that is sampled on the way."""
    run_ = run(setup, start, periods)
    grid = CheckpointGrid(per_period, 1)
    again = Simulation(setup, start, run_.final, grid, None, None)
    again.go()
    return run_, again


@pytest.mark.quick(3)
@pytest.mark.parametrize(("engine", "periods"), CHOICES)
def test_sampling_does_not_change_the_run(case, engine, periods):
    system, start, settings = case
    setup = problem(*system, engine=engine, rtol=1e-8, **settings)
    for per_period in (7, 50, 200):
        run_, sampled = log(setup, start, periods, per_period)
        final = sampled._trajectory()
        assert same(run_.events, final.events)
        assert np.array_equal(run_.final.y, final.final.y)
        assert sampled.clock["samples_written"] == per_period * periods + 1


def test_samples_at_given_times_lie_on_the_closed_form():
    ball = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -2.0), initial={"x": 1.0},
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution=0.5)],
    )  # fmt: skip
    run = mi.simulate(ball, duration=4.0)  # impacts at 1, 2, 2.5, ...; rest from 3 on
    samples = run.samples(times=[0.0, 0.25, 0.25, 1.0, 1.75, 2.25, 3.5, 4.0])
    heights = [1.0, 0.9375, 0.9375, 0.0, 0.1875, 0.0625, 0.0, 0.0]
    assert samples["x"].to_numpy() == pytest.approx(heights, abs=1e-9)
    assert samples["v"].iloc[3] == pytest.approx(1.0)  # after the impact
    assert samples["t"].tolist() == [0.0, 0.25, 0.25, 1.0, 1.75, 2.25, 3.5, 4.0]
    grid = run.samples(per_period=40)
    again = run.samples(times=grid["t"])
    assert np.abs(grid[["x", "v"]] - again[["x", "v"]]).to_numpy().max() < 1e-13


@pytest.mark.quick(3)
@pytest.mark.parametrize(("engine", "periods"), CHOICES)
def test_a_coarse_grid_is_a_part_of_a_fine_one(case, engine, periods):
    system, start, settings = case
    run_ = run(problem(*system, engine=engine, **settings), start, periods)
    fine, coarse = run_.samples(48), run_.samples(12)
    assert np.array_equal(fine.y[::4], coarse.y)
    assert np.array_equal(fine.mode[::4], coarse.mode)
    assert np.array_equal(fine.y[-1], run_.final.y)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("engine", "periods"), CHOICES)
def test_the_tail_of_the_samples_is_the_samples_of_the_tail(case, engine, periods):
    system, start, settings = case
    run_ = run(problem(*system, engine=engine, **settings), start, periods)
    whole = run_.samples(40)
    times = whole.cycle + whole.time / run_.period
    for first in np.linspace(0.0, periods, 5 if engine == "interpreted" else 41):
        tail = run_.samples(40, first=first)
        keep = times >= first - 1e-12
        assert np.array_equal(tail.y, whole.y[keep])
        assert np.array_equal(tail.mode, whole.mode[keep])


def test_the_tail_may_begin_between_two_impacts_of_a_chatter():
    run_ = simulate(BALL, ball(0.5), [1.0, 0.0], 1.0)
    whole = run_.samples(1000)
    events = run_.events
    for cut in events.time[-8:]:
        tail = run_.samples(1000, first=np.nextafter(cut / TAU, 1.0))
        assert np.array_equal(tail.y, whole.y[-len(tail.y) :])


@pytest.mark.quick(2)
@pytest.mark.parametrize("e", [0.3, 0.8, 0.95])
def test_the_tail_may_begin_within_the_chatter_of_the_actuator(e):
    """The frame creeps with every impact: its position tells the tails apart."""
    drive = Sine(amplitude=0.38, omega=0.02)
    run_ = machine.simulate(machine.ZHAO.replace(e=e), drive, [0.0, 0.0, 0.45, 0.0], 0.3)
    whole = run_.samples(500)
    for cut in run_.events.time[run_.events.kind <= workspace.ACCUMULATION]:
        tail = run_.samples(500, first=np.nextafter(cut / run_.period, 1.0))
        assert np.array_equal(tail.y, whole.y[-len(tail.y) :])


@pytest.mark.parametrize("window", [(0.25, 0.75), (1.0, 2.0), (1.3, 1.3), (0.0, 7.5)])
def test_windows(window):
    run_ = simulate(STOP, stop(d=2.0), [1.0, 0.0], 7.5)
    samples = run_.samples(8, *window)
    assert samples.cycle + samples.time / TAU == pytest.approx(
        np.arange(np.ceil(window[0] * 8), np.floor(window[1] * 8) + 1) / 8.0
    )


@pytest.mark.parametrize(("beyond", "first"), [(1e-10, 4), (0.0, 3), (-1e-10, 3)])
def test_a_window_begins_with_the_sample_at_its_start(beyond, first):
    """0.3 is a rounding above three tenths; what is more than rounding counts."""
    samples = simulate(STOP, stop(d=2.0), [1.0, 0.0], 1.0).samples(10, first=0.3 + beyond)
    assert samples.time / TAU == pytest.approx(np.arange(first, 11) / 10.0 % 1.0)


@pytest.mark.parametrize("periods", [0.3, 0.7, 1.1, 2.9])
def test_the_last_sample_of_a_broken_period(periods):
    run_ = simulate(STOP, stop(d=2.0), [1.0, 0.0], periods)
    assert len(run_.samples(10).cycle) == round(10 * periods) + 1


def test_the_end_is_sampled_however_it_is_rounded():
    # 0.3 periods of 0.1 are 0.03, three tenths of 0.1 a rounding more.
    grid = simulate(STOP, stop(d=2.0), [1.0, 0.0], 0.3, period=0.1).samples(10)
    assert grid.time.tolist() == pytest.approx([0.0, 0.01, 0.02, 0.03])


def test_half_a_period_that_is_short_is_sampled_to_its_end():
    run_ = simulate(STOP, stop(d=2.0), [1.0, 0.0], 0.5, period=0.125, engine="interpreted")
    assert run_.samples(8).time.tolist() == [0.0, 0.015625, 0.03125, 0.046875, 0.0625]


@pytest.mark.parametrize("engine", ENGINES)
def test_samples_lie_on_the_closed_form(engine):
    """A harmonic oscillator without impacts, and a ball between two."""
    swing = simulate(STOP, stop(d=2.0), [1.0, 0.0], 2.0, engine=engine, rtol=1e-11).samples(37)
    assert swing.y[:, 0] == pytest.approx(np.cos(swing.cycle * TAU + swing.time), abs=1e-9)
    flight = simulate(BALL, ball(0.9), [0.0, 3.0], 0.9, engine=engine).samples(64)
    assert flight.y[:, 0] == pytest.approx(3.0 * flight.time - flight.time**2 / 2, abs=1e-10)


@pytest.mark.quick(2)
@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
def test_no_sample_lies_beyond_a_stopper(rtol):
    for e in (0.0, 0.3, 0.9, 1.0):
        for amplitude in (0.3, 0.7, 2.0):
            p = stop(c=0.1, amplitude=amplitude, omega=0.8, e=e)
            run_ = simulate(STOP, p, [0.2, 1.5], 20.0, period=TAU / 0.8, rtol=rtol)
            assert run_.samples(400).y[:, 0].max() <= 1.0 + 1e-9
    for e in (0.0, 0.4, 0.8):
        run_ = simulate(BALL, ball(e, 0.9, 1.0), [1.0, 0.0], 20.0, rtol=rtol)
        assert run_.samples(400).y[:, 0].min() >= -1e-9


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("direction", [-1, 0, 1])
def test_section_crossings(engine, direction):
    run_ = simulate(STOP, stop(d=2.0), [1.0, 0.0], 5.0, section=(0, 0.5, direction), engine=engine)
    events = run_.events[run_.events.kind == workspace.SECTION_CROSSING]
    times = events.cycle * TAU + events.time
    down, up = TAU / 6 + TAU * np.arange(5), 5 * TAU / 6 + TAU * np.arange(5)
    expected = {-1: down, 1: up, 0: np.sort(np.r_[down, up])}[direction]
    assert times == pytest.approx(expected, abs=1e-7)
    assert np.array_equal(np.sign(events.before[:, 1]), events.guard)
    assert events.before[:, 0] == pytest.approx(0.5, abs=1e-12)
