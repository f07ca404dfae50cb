"""The millionth period is as exact as the first."""

import math

import numpy as np
import pytest

from mems_impact.hybrid import problem
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import loop, workspace
from tests.hybrid.systems import STOP, TAU, simulate, stop

PER_PERIOD = 1e-3


def _creep_flow(mode, t, y, p, dy):
    dy[0] = p[0] * (1.0 + math.cos(t)) / 6.283185307179586
    dy[1] = -y[1]


def _creep_margins(mode, t, y, p, g, r):
    pass


def _creep_transition(mode, code, t, y, p):
    return mode


CREEP = Automaton(
    states=("x1", "rest"),
    modes=("only",),
    guards=(Guard(name="never", order=0),),
    flow=_creep_flow,
    margins=_creep_margins,
    transition=_creep_transition,
    cyclic=(0,),
)


@pytest.mark.slow
@pytest.mark.parametrize(("engine", "periods"), [("compiled", 100_000), ("interpreted", 300)])
def test_a_cyclic_component_keeps_its_digits(engine, periods):
    run_ = simulate(CREEP, (PER_PERIOD,), [5.0, 0.0], periods, engine=engine, rtol=1e-11)
    advance = run_.final.y[0] - 5.0
    assert advance == pytest.approx(periods * PER_PERIOD, abs=1e-12 * periods)
    assert (run_.final.cycle, run_.final.time) == (periods, 0.0)


def test_the_integration_of_a_cyclic_component_does_not_depend_on_its_value():
    near, far = (simulate(CREEP, (PER_PERIOD,), [x, 0.0], 50.5) for x in (0.0, 2.0**40))
    assert near.steps == far.steps
    assert far.final.y[0] - 2.0**40 == pytest.approx(near.final.y[0], abs=2.0**-12)


def test_time_does_not_lose_digits():
    """Free oscillation, in phase after ten thousand periods; steps are those of the first ones."""
    n = 10_000
    run_ = simulate(STOP, stop(d=9.0), [1.0, 0.0], n, rtol=1e-12, atol=1e-14)
    rebases = run_.events[run_.events.kind == workspace.REBASE]
    assert len(rebases) > n / 2 / loop.REBASE_PERIODS
    assert rebases.time.max() < TAU
    assert run_.final.y == pytest.approx([1.0, 0.0], abs=1e-6)
    counts = np.diff(np.flatnonzero(run_.events.kind == workspace.APPROACH))
    assert counts.max() <= 2


def test_a_forced_motion_is_steady_for_ever():
    """With damping nothing accumulates: the state after 10,000 periods is that of the first."""
    omega = 0.8
    p = stop(c=0.1, amplitude=0.3, omega=omega, d=9.0)
    z = 0.3 / (1.0 - omega**2 + 0.1j * omega)
    start = [z.real, (1j * omega * z).real]
    run_ = simulate(STOP, p, start, 10_000, period=TAU / omega, rtol=1e-11)
    assert run_.final.y == pytest.approx(start, abs=1e-9)


def test_impact_times_do_not_lose_digits():
    p = stop(c=0.1, amplitude=0.7, omega=1.2)
    run_ = simulate(STOP, p, [0.0, 0.0], 20_000, period=TAU / 1.2)
    hits = run_.events[run_.events.kind == workspace.TRANSITION]
    assert np.ptp(hits.time[-2000:]) < 1e-8
    assert hits.cycle[-1] == 19_999


def test_calls_of_the_loop_take_a_tenth_of_a_second(monkeypatch):
    seconds_per_step, now = 1e-3, 0.0
    monkeypatch.setattr(problem, "thread_time", lambda: now)

    def loop(status, taken, steps):
        nonlocal now
        now += seconds_per_step * min(taken, steps)
        return status

    quota = problem.StepQuota(10)
    used = []
    for _ in range(6):
        used.append(quota.steps)
        assert quota.call(loop, workspace.PAUSED, 10_000) == workspace.PAUSED
    assert used == pytest.approx([10, 20, 40, 80, 100, 100], abs=1)
    quota.call(loop, workspace.BUFFER_FULL, 5)  # tells nothing about the time of 100 steps
    assert quota.steps == pytest.approx(100, abs=1)
    seconds_per_step = 1.0
    quota.call(loop, workspace.BUFFER_FULL, 5)
    assert quota.steps == 2
