"""The millionth period is as exact as the first."""

import math
import signal
from dataclasses import replace

import numpy as np
import pytest

from mems_impact.errors import Interrupted
from mems_impact.hybrid import engine as engine_module
from mems_impact.hybrid import simulation
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import loop, workspace
from mems_impact.integrators import interface
from tests.hybrid import systems
from tests.hybrid.systems import ENGINES, STOP, TAU, at, simulate, stop

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


@pytest.mark.slow
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


@pytest.mark.nightly
def test_a_forced_motion_is_steady_for_ever():
    """With damping nothing accumulates: the state after 10,000 periods is that of the first."""
    omega = 0.8
    p = stop(c=0.1, amplitude=0.3, omega=omega, d=9.0)
    z = 0.3 / (1.0 - omega**2 + 0.1j * omega)
    start = [z.real, (1j * omega * z).real]
    run_ = simulate(STOP, p, start, 10_000, period=TAU / omega, rtol=1e-11)
    assert run_.final.y == pytest.approx(start, abs=1e-9)


@pytest.mark.nightly
def test_impact_times_do_not_lose_digits():
    p = stop(c=0.1, amplitude=0.7, omega=1.2)
    run_ = simulate(STOP, p, [0.0, 0.0], 20_000, period=TAU / 1.2)
    hits = run_.events[run_.events.kind == workspace.TRANSITION]
    assert np.ptp(hits.time[-2000:]) < 1e-8
    assert hits.cycle[-1] == 19_999


def test_calls_of_the_loop_take_a_tenth_of_a_second(monkeypatch):
    seconds_per_step, waiting_per_step, now, worked = 1e-3, 0.0, 0.0, 0.0
    monkeypatch.setattr(engine_module, "monotonic", lambda: now)
    monkeypatch.setattr(engine_module, "thread_time", lambda: worked)

    def loop(status, taken, steps):
        nonlocal now, worked
        worked += seconds_per_step * min(taken, steps)
        now += (seconds_per_step + waiting_per_step) * min(taken, steps)
        return status

    quota = engine_module.StepQuota(10)
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
    seconds_per_step, waiting_per_step = 1e-6, 0.05  # a flow that waits
    for _ in range(20):
        quota.call(loop, workspace.PAUSED, 10_000)
    assert quota.steps == pytest.approx(10, abs=1)


def _jump_flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = math.cos(t) - 0.3 * y[1] - y[0] + (0.5 if y[0] > 0.1 else -0.5)


JUMP = Automaton(
    states=("x", "v"),
    modes=("only",),
    guards=(),
    flow=_jump_flow,
    margins=_creep_margins,
    transition=_creep_transition,
)


def test_calls_that_end_at_a_collapsed_step_let_no_later_one_take_more_steps(monkeypatch):
    monkeypatch.setattr(engine_module, "thread_time", lambda: 0.0)
    monkeypatch.setattr(engine_module, "monotonic", lambda: 0.0)
    quota, collapses = engine_module.StepQuota(100), []
    monkeypatch.setattr(
        simulation,
        "create_engine",
        lambda of: replace(engine_module.create_engine(of), quota=quota),
    )
    setup = replace(
        systems.problem(JUMP, (), method="dop853"),
        discontinuity_check=lambda *collapse: bool(collapses.append(collapse)),
    )
    trajectory = simulation.run(setup, at([0.2, 0.0]), 50.0)
    assert len(collapses) >= 4
    assert quota.steps <= 2 * trajectory.steps


@pytest.mark.parametrize("engine", ENGINES)
def test_chunks_of_events_do_not_depend_on_the_speed_of_the_machine(monkeypatch, engine):
    """The rounding errors of statistics depend on them."""
    monkeypatch.setattr(engine_module, "CALL_SECONDS", math.inf)
    lengths = []
    for steps in (1, 1_000_000):

        def bound(of, steps=steps):
            return replace(engine_module.create_engine(of), quota=engine_module.StepQuota(steps))

        monkeypatch.setattr(simulation, "create_engine", bound)
        chunks = []
        setup = systems.problem(STOP, stop(amplitude=0.3, c=0.1), engine=engine)
        simulation.run(setup, at([0.2, 1.5]), 30.0, consume=chunks.append)
        lengths.append([len(chunk) for chunk in chunks])
    assert lengths[0] == lengths[1]
    assert sum(lengths[0]) > 20


@pytest.fixture
def python_hears_ctrl_c():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.nightly
def test_ctrl_c_within_interpreted_code_leaves_a_state_of_the_run(monkeypatch):
    calls, last, read_state = 0, 0, interface.state

    def state(*arguments):
        nonlocal calls
        calls += 1
        if calls == last:
            raise KeyboardInterrupt  # the time is that of the end of the step, the state is not yet
        read_state(*arguments)

    monkeypatch.setattr(interface, "state", state)
    setup = systems.problem(STOP, stop(amplitude=0.3, c=0.1), engine="interpreted")
    whole = simulation.run(setup, at([0.2, 1.5]), 3.0)
    for number in range(1, calls, 5):
        calls, last = 0, number
        with pytest.raises(Interrupted) as caught:
            simulation.run(setup, at([0.2, 1.5]), 3.0)
        last, reached = 0, caught.value.partial
        elapsed = reached.final.cycle + reached.final.time / setup.period
        rest = simulation.run(setup, reached.final, 3.0 - elapsed)
        assert rest.final.y == pytest.approx(whole.final.y, abs=1e-6)
        assert np.concatenate(
            [systems.times(part, workspace.TRANSITION) for part in (reached, rest)]
        ) == pytest.approx(systems.times(whole, workspace.TRANSITION), abs=1e-6)


@pytest.mark.usefixtures("python_hears_ctrl_c")
@pytest.mark.nightly
def test_ctrl_c_while_events_are_handed_over_repeats_none():
    handed_over = []

    def consume(events):
        handed_over.append(len(events))
        if len(handed_over) == 1:
            signal.raise_signal(signal.SIGINT)
        handed_over.append("complete")

    with pytest.raises(Interrupted):
        simulation.run(systems.problem(STOP, stop()), at([0.2, 1.5]), 1e6, consume=consume)
    assert handed_over[0] > 0
    assert handed_over[1] == "complete"
    assert sum(each for each in handed_over[2:] if each != "complete") == 0
