"""Which method takes an arc: closed forms, no going to and fro, what a change may not change."""

import math
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mems_impact as mi
from mems_impact.errors import RunError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import run
from mems_impact.integrators.auto import stiffness
from tests.hybrid.systems import (
    BALL,
    COULOMB,
    SQUARE,
    STOP,
    TAU,
    at,
    ball,
    coulomb,
    problem,
    same,
    simulate,
    stop,
)

PLAIN = {"engine": "interpreted", "method": "auto"}


def system(flow, n):
    return Automaton(
        states=tuple(f"y{i}" for i in range(n)),
        modes=("only",),
        guards=(),
        flow=flow,
        margins=lambda mode, t, y, p, g, r: None,
        transition=lambda mode, code, t, y, p: mode,
    )


# A state that chases cos t at a rate.


def _chase(mode, t, y, p, dy):
    dy[0] = -p[0] * (y[0] - math.cos(t))


CHASE = system(_chase, 1)


def chased(rate, t):
    """The solution from 1."""
    share = rate / (1.0 + rate * rate)
    return share * (rate * math.cos(t) + math.sin(t)) + (1.0 - share * rate) * math.exp(-rate * t)


@pytest.mark.parametrize("rate", [1.0, 1e5, 1e9])
def test_a_chase_in_closed_form(rate):
    done = simulate(CHASE, (rate,), [1.0], 2.0, rtol=1e-9, atol=1e-11, **PLAIN)
    assert done.final.y[0] == pytest.approx(chased(rate, 4.0 * math.pi), abs=1e-7)
    assert done.events.handovers.guard.tolist() == ([-1] if rate > 1.0 else [])
    assert done.stiff == (rate > 1.0)
    assert done.implicit_arcs == (rate > 1.0)
    assert done.steps < 1500


def test_where_nothing_is_stiff_it_is_the_one_step_method():
    settings = {"period": TAU / 0.8, "engine": "interpreted"}
    auto, alone = (
        simulate(STOP, stop(0.1, 1.0, 0.7, 0.8), [0.2, 1.5], 4.0, method=method, **settings)
        for method in ("auto", "dop853")
    )
    assert len(auto.events) > 4
    assert same(auto.events, alone.events)
    assert np.array_equal(auto.final.y, alone.final.y)
    assert auto.implicit_arcs == 0


@pytest.mark.nightly  # compiles the loop
def test_both_forms_choose_alike():
    runs = [
        simulate(CHASE, (3e3,), [1.0], 3.0, rtol=1e-9, atol=1e-11, engine=engine, method="auto")
        for engine in ("compiled", "interpreted")
    ]
    assert [each.events.handovers.guard.tolist() for each in runs] == [[-1], [-1]]
    assert runs[0].final.y == pytest.approx(runs[1].final.y, abs=1e-8)


@pytest.mark.parametrize("rtol", [1e-4, 1e-11])
def test_at_no_rate_does_it_go_to_and_fro(rtol):
    """Where BDF is tried in vain, it is tried again after twice as long."""
    tried = 0
    for rate in (3.0, 12.0, 300.0):
        settings = {"rtol": rtol, "atol": 0.01 * rtol, "engine": "interpreted"}
        done = simulate(CHASE, (rate,), [1.0], 4.0, method="auto", **settings)
        told = done.events.handovers.guard.tolist()
        in_vain = [k for k in told if k > 0]
        tried += len(in_vain)
        assert in_vain == list(range(1, len(in_vain) + 1))
        # Before a trial so many windows of steps have passed.
        assert stiffness.WINDOW * (2 ** len(in_vain) - 1) <= done.steps
        assert len(told) <= 2 * len(in_vain) + 1
        assert (told[-1:] == [-1]) == (rate == 300.0)
    assert (tried > 0) == (rtol == 1e-11)


# Van der Pol's oscillator: slow and stiff, with jumps that are neither.


def _relaxing(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = p[0] * (1.0 - y[0] * y[0]) * y[1] - y[0]


def counted(method, **settings):
    """Run an oscillator of mu = 1000 over a swing; with evaluations of the flow."""
    calls = [0]

    def flow(mode, t, y, p, dy):
        calls[0] += 1
        _relaxing(mode, t, y, p, dy)

    setup = problem(system(flow, 2), (1000.0,), period=16_000.0, method=method,
                    engine="interpreted", rtol=1e-9, atol=1e-11, **settings)  # fmt: skip
    return (lambda: run(setup, at([2.0, 0.0]), 1700.0 / 16_000.0)), calls


def test_an_oscillator_that_is_stiff_by_turns_takes_both_methods():
    auto, calls = counted("auto")
    done = auto()
    assert done.events.handovers.guard.tolist() == [-1, 0, -1, 0, -1]
    jumps = done.events.handovers.time[[1, 3]]
    assert np.diff(jumps) == pytest.approx([807.0], abs=2.0)
    exact = solve_ivp(
        lambda t, y: [y[1], 1000.0 * (1.0 - y[0] * y[0]) * y[1] - y[0]],
        (0.0, 1700.0), [2.0, 0.0], method="LSODA", rtol=1e-11, atol=1e-12,
    ).y[:, -1]  # fmt: skip
    assert done.final.y == pytest.approx(exact, abs=1e-6)
    # A step of BDF has a linear system to solve, beside its evaluations.
    bdf, by_bdf = counted("bdf")
    assert done.steps < 0.6 * bdf().steps
    assert calls[0] < 1.5 * by_bdf[0]
    # The one-step method alone has not come to a hundredth of the way by as many.
    explicit, _ = counted("dop853", max_steps=calls[0] // 12)
    with pytest.raises(RunError, match="max_steps") as caught, pytest.warns(mi.StiffnessWarning):
        explicit()
    assert caught.value.phase_time < 30.0


def test_an_estimate_of_the_spectral_radius_does_not_hang_on_units():
    """Of x'' = -1e8 x, whose states differ by four orders, and of a decay beside it."""

    def flow(mode, t, y, p, dy):
        dy[0], dy[1], dy[2] = y[1], -1e8 * y[0], -p[0] * y[2]

    for decay, expected in ((1.0, 1e4), (1e6, 1e6)):
        engine = _engine(flow, 3, (decay,))
        engine.rows[stiffness.STATE][:3] = [1e-4, 1.0, 1e-8]
        engine.directed = 0
        assert stiffness.spectral_radius(engine, 0.0) == pytest.approx(expected, rel=0.3)


def _engine(flow, n, p):
    from mems_impact.integrators.auto.interpreted import InterpretedAuto
    from mems_impact.integrators.interface import Equations
    from mems_impact.integrators.options import Options

    automaton = system(flow, n)
    equations = Equations(flow=flow, margins=automaton.margins, transition=automaton.transition,
                          n=n, m=0, parameters=p, approaches=[])  # fmt: skip
    return InterpretedAuto(equations, Options(**PLAIN), 1.0)


# Handing over all the time, at every event and in between, must not be seen in any of them.


@pytest.fixture
def restless(monkeypatch):
    """Make both methods hand over after a few steps; that rebounds never pause it."""
    monkeypatch.setattr(stiffness, "straight", lambda engine, t: True)
    for name, value in {
        "WINDOW": 2,
        "CHECK_INTERVAL": 1,
        "IMPLICIT_WINDOW": 4,
        "ENTER_LIMIT": -1.0,
        "MAX_DOUBLINGS": 1,
    }.items():
        monkeypatch.setattr(stiffness, name, value)
    for name in ("LONG_STEP_RATIO", "MAX_STEP_GROWTH", "LEAVE_LIMIT"):
        monkeypatch.setattr(stiffness, name, math.inf)


CASES = {
    "impacts": (STOP, stop(0.1, 1.0, 0.7, 0.8), [0.2, 1.5], 0, {"period": TAU / 0.8,
                "section": (0, 0.0, 0)}),
    "rest": (BALL, ball(0.4, 0.9, 1.0), [0.3, 0.0], 0, {"section": (1, 0.01, 0)}),
    "friction": (COULOMB, coulomb(0.3, 1.0, 0.3), [0.5, 0.0], 0, {"period": TAU / 0.3,
                 "section": (0, 0.1, 0)}),
    "switches": (STOP, stop(0.1, 1.0, 0.7, 0.8, 1.0), [0.2, 1.5], 0, {"period": TAU / 0.8,
                 "switches": SQUARE}),
}  # fmt: skip


@pytest.fixture(params=CASES)
def case(request):
    automaton, p, y, mode, settings = CASES[request.param]
    tight = {"rtol": 1e-11, "atol": 1e-13, "engine": "interpreted", **settings}
    return automaton, p, at(y, mode), tight


@pytest.mark.usefixtures("restless")
def test_handing_over_all_the_time_changes_no_event(case):
    automaton, p, start, settings = case
    auto = run(problem(automaton, p, method="auto", **settings), start, 2.0)
    alone = run(problem(automaton, p, method="dop853", **settings), start, 2.0)
    assert len(auto.events.handovers) > 10
    assert 0 < auto.implicit_arcs < auto.arcs
    seen = auto.events[auto.events.kind != workspace.HANDOVER]
    assert np.array_equal(seen.kind, alone.events.kind)
    assert np.array_equal(seen.guard, alone.events.guard)
    assert seen.time == pytest.approx(alone.events.time, abs=1e-8)
    assert seen.after == pytest.approx(alone.events.after, abs=1e-7)
    assert auto.final.y == pytest.approx(alone.final.y, abs=1e-7)


@pytest.mark.quick(2)
@pytest.mark.usefixtures("restless")
def test_a_run_is_sampled_and_taken_up_with_what_was_learnt_before(case):
    automaton, p, start, settings = case
    setup = problem(automaton, p, method="auto", **settings)
    whole = run(setup, start, 2.0)
    assert any(whole.final.remembered)
    grid = whole.samples(60)
    late = whole.samples(60, 1.3, 1.9)
    inside = np.isin(60 * grid.cycle + np.rint(60 * grid.time / setup.period),
                     60 * late.cycle + np.rint(60 * late.time / setup.period))  # fmt: skip
    assert len(late.y) > 30
    assert np.array_equal(grid.y[inside][:-1], late.y[:-1])  # time at the end is rounded twice
    begins = np.flatnonzero(whole.events.starts_arc)
    i = begins[len(begins) // 2]
    event = whole.events[i : i + 1]
    known = whole.events[:i].remembered(())
    middle = at(event.after[0], int(event.mode_after[0]), float(event.time[0]), int(event.cycle[0]))
    again = run(setup, middle.__class__(**{**vars(middle), "remembered": known}),
                2.0 - middle.cycle - middle.time / setup.period)  # fmt: skip
    assert again.final.y == pytest.approx(whole.final.y, abs=1e-9)


# As users see it.


def charging(mode, t, y, p):
    return y.v, -y.x - 0.1 * y.v + 0.1 * y.q, (math.cos(t) - y.q) / p.rc


CIRCUIT = mi.System(
    states=("x", "v", "q"),
    flow=charging,
    period=TAU,
    parameters={"rc": 1e-3},
    guards=[mi.Impact("wall", lambda mode, t, y, p: 0.4 - y.x,
                      lambda mode, t, y, p: (mode, (0.4, -0.8 * y.v, y.q)))],
    initial={"x": 0.3, "v": 1.0},
)  # fmt: skip
AUTO = mi.Options(method="auto", engine="interpreted", rtol=1e-8, atol=1e-10)


def test_what_was_chosen_stands_in_the_run_and_is_kept(tmp_path):
    done = mi.simulate(CIRCUIT, periods=3, options=AUTO)
    assert len(done.impacts) == 2
    assert done.arcs["dop853"] == 1
    assert done.arcs["bdf"] == done.trajectory.arcs - 1
    assert done.handovers[["period", "mode", "method"]].values.tolist() == [[0, "free", "bdf"]]
    assert done.summary()["method"] == "auto, rtol 1e-08"
    assert done.summary()["arcs"] == f"1 arcs by dop853, {done.arcs['bdf']} arcs by bdf"
    assert f"{done.arcs['bdf']} arcs by bdf" in repr(done)
    done.save(tmp_path / "run.zip")
    for same_again in (
        mi.load(tmp_path / "run.zip", system=CIRCUIT),
        pickle.loads(pickle.dumps(done)),
    ):
        assert same_again == done
        assert same_again.arcs == done.arcs
        assert same_again.handovers.equals(done.handovers)
        assert same_again.samples(20, 1.5, 2.5).equals(done.samples(20, 1.5, 2.5))


def test_statistics_alone_see_the_same_run():
    kept, gathered = (
        mi.simulate(CIRCUIT, periods=3, options=AUTO, keep=keep, window=(1.0, 2.5))
        for keep in ("events", "statistics")
    )
    assert kept.statistics.equals(gathered.statistics)
    assert kept.arcs == gathered.arcs
    with pytest.raises(mi.InvalidParameter, match="handovers"):
        _ = gathered.handovers


def test_a_method_without_choice_has_its_name():
    done = mi.simulate(CIRCUIT.changed(rc=1.0), periods=1, options=mi.Options(engine="interpreted"))
    assert done.arcs == {"adams": done.trajectory.arcs}
    assert len(done.handovers) == 0
