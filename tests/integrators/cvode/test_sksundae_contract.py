"""What `integrators.cvode.interpreted` relies on, or works around, in scikit-sundae.

If one of these fails with a new scikit-sundae, look at the work-around that it names.
"""

import math

import numpy as np
import pytest
from sksundae.cvode import CVODE

TAU = 2.0 * math.pi


def swing(_t, y, dy):
    dy[0], dy[1] = y[1], -y[0]


def solver(levels=(0.0,), rhs=swing, direction=0, **options):
    def events(_t, y, out):
        out[:] = [y[0] - level for level in levels]

    events.terminal = [False] * len(levels)
    events.direction = [direction] * len(levels)
    options = {"method": "Adams", "rtol": 1e-9, "atol": 1e-11, **options}
    return CVODE(rhs, eventsfn=events, num_events=len(levels), **options), events


def advance(solver, events=1, **how):
    """Step until so many roots have been found; return the last result."""
    found = 0
    for _ in range(10_000):
        result = solver.step(1e3, method="onestep", **how)
        if result.status == 2:
            found += 1
            if found == events:
                return result
    raise AssertionError("no such root")


def test_the_event_log_is_kept_across_restarts():
    """Hence `InterpretedCvode.step` clears _i, _t and _y before every step."""
    cvode, events = solver()
    for restart in range(1, 4):
        cvode.init_step(0.0, [1.0, 0.0])
        result = advance(cvode)
        assert len(events._t) == len(events._i) == len(events._y) == restart
        assert len(result.t_events) == restart
    for log in (events._i, events._t, events._y):
        log.clear()
    cvode.init_step(0.0, [1.0, 0.0])
    result = advance(cvode)
    assert result.t_events == pytest.approx([TAU / 4])
    assert events._i_cnt.tolist() == [4]


def test_counters_stop_an_event_that_is_terminal_after_a_number():
    """Hence no event of ours is terminal."""
    cvode, events = solver()
    events.terminal = [2]
    cvode, events = CVODE(swing, method="Adams", eventsfn=events, num_events=1), events
    for _ in range(2):
        cvode.init_step(0.0, [1.0, 0.0])
        cvode.step(2.0)
    assert events._i_cnt.tolist() == [2]


def test_one_step_stops_at_a_root_and_says_which_and_how():
    cvode, _ = solver(levels=(0.0, 0.5, 5.0))
    cvode.init_step(0.0, [1.0, 0.0])
    result = advance(cvode)
    assert result.i_events[-1].tolist() == [0, -1, 0]
    assert float(np.ravel(result.t)[-1]) == pytest.approx(TAU / 6, abs=1e-7)
    assert advance(cvode).i_events[-1].tolist() == [-1, 0, 0]
    assert advance(cvode, 2).i_events[-1].tolist() == [0, 1, 0]


def test_directions_are_obeyed():
    cvode, _ = solver(direction=1)
    cvode.init_step(0.0, [1.0, 0.0])
    assert float(np.ravel(advance(cvode).t)[-1]) == pytest.approx(3 * TAU / 4, abs=1e-6)


def test_one_step_takes_one_step_whatever_the_end():
    times = []
    for horizon in (2.0, 50.0):
        cvode, _ = solver(levels=(9.0,), first_step=1e-6)
        cvode.init_step(0.0, [1.0, 0.0])
        steps = [cvode.step(horizon, method="onestep") for _ in range(9)]
        times.append([float(np.ravel(step.t)[-1]) for step in steps])
        assert all(step.status == 0 for step in steps)
    assert times[0] == times[1]


def test_a_dip_within_one_step_is_missed():
    """Hence the rate guards: no sign changes at the ends of the step."""
    missed = 0
    for phase in np.linspace(0.3, 3.0, 20):
        cvode, events = solver(levels=(1.0 - 1e-6,), rtol=1e-8)
        cvode.init_step(0.0, [math.cos(phase), math.sin(phase)])
        cvode.step(4.0)
        missed += len(events._t) == 0
    assert missed > 10


def test_an_event_at_the_stop_is_reported_as_the_stop():
    """Hence the look at all margins after every switch of the drive."""

    def ramp(_t, y, dy):
        dy[0], dy[1] = 1.0, 0.0

    cvode, events = solver(levels=(1.0,), rhs=ramp)
    cvode.init_step(0.0, [0.0, 0.0])
    for _ in range(1000):
        result = cvode.step(5.0, method="onestep", tstop=1.0)
        if result.status:
            break
    assert result.status == 1
    assert float(np.ravel(result.t)[-1]) == 1.0
    assert len(events._t) == 0


def test_a_failure_does_not_raise_but_prints(capfd):
    """Hence negative codes, and the redirection of standard output."""

    def stiff(_t, y, dy):
        dy[0], dy[1] = 1e12 * math.sin(1e9 * y[0]), 0.0

    cvode, _ = solver(levels=(9.0,), rhs=stiff, max_num_steps=2)
    cvode.init_step(0.0, [1.0, 0.0])
    result = cvode.step(1.0)
    assert not result.success
    assert result.status < 0
    assert "Error" in capfd.readouterr().out


def test_exceptions_in_callbacks_come_through():
    """Hence a right-hand side that is not finite can end a step."""

    def broken(_t, _y, _dy):
        raise KeyError("rhs")

    cvode, _ = solver(rhs=broken)
    cvode.init_step(0.0, [1.0, 0.0])
    with pytest.raises(KeyError, match="rhs"):
        cvode.step(1.0, method="onestep")


def test_a_step_may_go_back_within_the_last_one():
    cvode, _ = solver(levels=(9.0,), rtol=1e-10)
    cvode.init_step(0.0, [1.0, 0.0])
    before = after = 0.0
    for _ in range(30):
        before, after = after, float(np.ravel(cvode.step(9.0, method="onestep").t)[-1])
    for part in (0.9, 0.1, 0.5, 1.0):
        t = before + part * (after - before)
        assert cvode.step(t, method="normal").y[0] == pytest.approx(math.cos(t), abs=1e-8)
    assert float(np.ravel(cvode.step(9.0, method="onestep").t)[-1]) > after


def test_going_back_clears_the_roots_that_were_found():
    """Hence `InterpretedCvode.interpolate` shows CVODE constant root functions, and leads back."""
    cvode, events = solver()
    cvode.init_step(0.0, [1.0, 0.0])
    root = float(np.ravel(advance(cvode).t)[-1])
    cvode.step(root - 1e-3, method="normal")
    assert float(np.ravel(advance(cvode).t)[-1]) == pytest.approx(root, abs=1e-8)
    assert len(events._t) >= 2
