"""Events that fire together, at the start, in quick succession or for ever; and failures."""

import itertools
import math

import numpy as np
import pytest

from mems_impact.errors import RunError
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import workspace
from tests.hybrid.systems import (
    BALL,
    ENGINES,
    RESTING,
    STOP,
    TAU,
    ball,
    same,
    simulate,
    stop,
    times,
)

pytestmark = pytest.mark.usefixtures("each_method")

# Three guards that fire at y = 1. Which of them stands in which slot is in p; each one switches
# itself off in `fired`, and writes its digit to `log`.


def _three_flow(mode, t, y, p, dy):
    dy[0] = 1.0
    dy[1] = 0.0
    dy[2] = 0.0


def _three_margins(mode, t, y, p, g, r):
    for slot in range(3):
        who = int(p[slot])
        if not (int(y[1]) >> who) & 1:
            g[slot] = (who + 1) * (1.0 - y[0] * y[0])
            r[slot] = -2.0 * (who + 1) * y[0]


def _three_transition(mode, code, t, y, p):
    who = int(p[code])
    y[1] += float(1 << who)
    y[2] = 10.0 * y[2] + who + 1
    return mode


def three(slots):
    return Automaton(
        states=("y", "fired", "log"),
        modes=("only",),
        guards=tuple(Guard(name=f"guard {who}", order=(2, 0, 1)[who]) for who in slots),
        flow=_three_flow,
        margins=_three_margins,
        transition=_three_transition,
    )


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("slots", list(itertools.permutations(range(3))))
def test_the_result_does_not_depend_on_the_order_in_which_guards_are_listed(slots, engine):
    run_ = simulate(three(slots), slots, [0.0, 0.0, 0.0], 2.0, period=1.0, engine=engine)
    assert run_.final.y == pytest.approx([2.0, 7.0, 231.0], abs=1e-12)
    assert [int(slots[i]) for i in run_.events.guard] == [1, 2, 0]
    assert np.ptp(run_.events.time) == 0.0
    assert run_.events.time[0] + run_.events.cycle[0] == pytest.approx(1.0, abs=1e-12)


# A guard whose transition leads to a mode in which another guard has fired already, and back.


def _endless_flow(mode, t, y, p, dy):
    dy[0] = 1.0


def _endless_margins(mode, t, y, p, g, r):
    g[0], r[0] = p[0] - y[0], -1.0


def _endless_transition(mode, code, t, y, p):
    return 1 - mode if p[1] == 0.0 else mode


ENDLESS = Automaton(
    states=("y",),
    modes=("this", "that"),
    guards=(Guard(name="limit", order=0, condition=True),),
    flow=_endless_flow,
    margins=_endless_margins,
    transition=_endless_transition,
)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
def test_transitions_that_undo_each_other_end_in_an_error(engine):
    with pytest.raises(RunError, match="transitions in one instant") as caught:
        simulate(ENDLESS, (2.5, 0.0), [0.0], 9.0, period=1.0, engine=engine)
    error = caught.value
    assert (error.cycle, error.mode) == (2, "this")
    assert error.phase_time == pytest.approx(0.5)
    assert error.state == {"y": pytest.approx(2.5)}
    assert len(error.partial.events) <= 4
    assert error.partial.final.y == pytest.approx([2.5])


@pytest.mark.parametrize("engine", ENGINES)
def test_a_transition_that_changes_nothing_happens_once(engine):
    run_ = simulate(ENDLESS, (2.5, 1.0), [0.0], 9.0, period=1.0, engine=engine)
    assert times(run_) == pytest.approx([2.5])
    assert run_.final.y == pytest.approx([9.0])


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("x", [0.0, -1e-300, -1e-15, -1e-10])
def test_start_on_the_floor(x, engine):
    falling = simulate(BALL, ball(0.5), [x, -1.0], 0.1, engine=engine)
    assert falling.events.time[0] == 0.0
    assert falling.events.after[0].tolist() == [0.0, 0.5]
    assert len(falling.events) == 1
    rising = simulate(BALL, ball(0.5), [x, 1.0], 0.5, engine=engine)
    assert times(rising, workspace.TRANSITION)[0] == pytest.approx(2.0, abs=1e-8)
    resting = simulate(BALL, ball(0.5), [0.0, 0.0], 3.0, mode=RESTING, engine=engine)
    assert len(resting.events) == 0


def test_start_on_the_floor_at_rest_in_the_wrong_mode():
    """The pressing contact is found by the impact that it makes."""
    run_ = simulate(BALL, ball(0.5), [0.0, 0.0], 1.0)
    assert run_.final.mode == RESTING
    assert np.abs(run_.final.y).max() < 1e-12


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("flight", [1e-3, 1e-4, 1e-5, 1e-6])
def test_quick_impacts_are_all_seen(flight, engine):
    """An elastic ball that hops with a flight of given length, forever."""
    n = 200 if engine == "compiled" else 50
    p = ball(1.0)
    run_ = simulate(
        BALL, p, [0.0, flight / 2], (n + 0.5) * flight / TAU, engine=engine, rtol=1e-11, atol=1e-20
    )
    hits = times(run_, workspace.TRANSITION)
    assert hits == pytest.approx(flight * np.arange(1, n + 1), rel=1e-6)


def test_impacts_without_rebound_and_without_loss():
    dead = simulate(BALL, ball(0.0), [1.0, 0.0], 1.0)
    assert (dead.events.kind.tolist(), dead.final.mode) == ([workspace.TRANSITION], RESTING)
    elastic = simulate(BALL, ball(1.0), [1.0, 0.0], 100.0, rtol=1e-12, atol=1e-14)
    hits = times(elastic, workspace.TRANSITION)
    assert hits == pytest.approx(math.sqrt(2.0) * np.arange(1, 2 * hits.size, 2), abs=1e-8)
    assert 0.5 * elastic.final.y[1] ** 2 + elastic.final.y[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_body_pushed_against_its_stop_for_ever(e):
    """The force never lets go: at most a chatter sequence, then rest (for ever hops if e = 1)."""
    p = stop(c=0.0 if e == 1.0 else 0.1, k=0.1, amplitude=0.0, e=e, d=-1.0)
    run_ = simulate(STOP, p, [-1.5, 0.0], 20.0)
    assert run_.final.mode == (RESTING if e < 1.0 else 0)
    assert run_.samples(50).y[:, 0].max() <= -1.0 + 1e-9


@pytest.mark.parametrize("engine", ENGINES)
def test_event_budget(engine):
    with pytest.raises(RunError, match="more than max_events = 20 events") as caught:
        simulate(BALL, ball(0.99), [1.0, 0.0], 90.0, period=100.0, max_events=20, engine=engine)
    error = caught.value
    assert len(error.partial.events) == 21
    assert (error.cycle, error.mode) == (0, "flying")
    assert error.phase_time == error.partial.events.time[-1]
    assert list(error.state.values()) == error.partial.events.after[-1].tolist()
    # The same number of events spread over several periods is within the budget.
    simulate(BALL, ball(0.99), [1.0, 0.0], 10.0, period=9.0, max_events=20, engine=engine)


@pytest.mark.parametrize("engine", ENGINES)
def test_step_budget(engine):
    with pytest.raises(RunError, match="more than max_steps = 30 steps") as caught:
        simulate(STOP, stop(d=2.0), [1.0, 0.0], 9.0, max_steps=30, engine=engine)
    error = caught.value
    t = error.phase_time
    assert 0.0 < t < TAU
    assert list(error.state.values()) == pytest.approx([math.cos(t), -math.sin(t)], abs=1e-8)
    assert error.partial.final.time == t


# y' = 1 until t = p[0], then what p[1] says.


def _broken_flow(mode, t, y, p, dy):
    dy[0] = 1.0 if t < p[0] else p[1]


def _broken_margins(mode, t, y, p, g, r):
    g[0], r[0] = p[2] - y[0], -1.0


BROKEN = Automaton(
    states=("y",),
    modes=("only",),
    guards=(Guard(name="limit", order=0),),
    flow=_broken_flow,
    margins=_broken_margins,
    transition=_endless_transition,
)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("when", [0.0, 1.3])
def test_a_flow_that_is_not_finite(when, value, engine, capfd):
    with pytest.raises(RunError, match="right-hand side is not finite") as caught:
        simulate(BROKEN, (when, value, 9.0), [0.0], 5.0, period=1.0, engine=engine)
    error = caught.value
    elapsed = error.cycle + error.phase_time
    assert 0.0 <= elapsed <= when
    assert when - elapsed <= 1.0 / 16.0  # one step
    assert error.state["y"] == pytest.approx(elapsed, abs=1e-9)
    assert error.mode == "only"
    assert error.partial.final.y.tolist() == [error.state["y"]]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("engine", ENGINES)
def test_a_margin_that_is_not_a_number(engine, capfd):
    """Nothing would ever be found by it."""
    with pytest.raises(RunError, match="guard"):
        simulate(BROKEN, (9.0, 0.0, math.nan), [0.0], 5.0, period=1.0, engine=engine)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("engine", ENGINES)
def test_runs_are_silent(engine, capfd):
    simulate(BALL, ball(0.5, 0.9, 1.0), [1.0, 0.0], 3.0, engine=engine).samples(20)
    simulate(STOP, stop(amplitude=0.5, square=1.0), [0.0, 0.0], 2.0, engine=engine).samples(20)
    assert capfd.readouterr() == ("", "")


def test_events_can_be_consumed_as_they_come():
    setup = stop(c=0.1, amplitude=0.7, omega=0.8)
    kept = simulate(STOP, setup, [0.2, 1.5], 1500.0, period=TAU / 0.8)
    from tests.hybrid.systems import at, problem, run

    chunks = []
    lean = run(
        problem(STOP, setup, period=TAU / 0.8), at([0.2, 1.5]), 1500.0, consume=chunks.append
    )
    assert len(lean.events) == 0
    assert sum(len(chunk) for chunk in chunks) == len(kept.events) > workspace.ROOM
    assert same(chunks[-1], kept.events[-len(chunks[-1]) :])
    assert np.array_equal(lean.final.y, kept.final.y)
