"""Systems written as one writes equations, and the verbs on them."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest

import mems_impact as mi
from tests.analysis.systems import FREE, ball, oscillator

FALL = math.sqrt(2.0 / 9.81)
PLAIN = mi.Options(engine="interpreted", method="dop853")
ENGINES = [mi.Options(), mi.Options(method="dop853"), PLAIN]


@pytest.mark.quick(3)
@pytest.mark.parametrize("options", ENGINES, ids=["adams", "dop853", "interpreted"])
@pytest.mark.parametrize("arrays", [False, True], ids=["named", "arrays"])
def test_a_ball_comes_to_rest(options, arrays):
    run = mi.simulate(ball(arrays=arrays), duration=2.0, options=options)
    hits = run.impacts
    assert hits["t"].iloc[0] == pytest.approx(FALL, rel=1e-9)
    assert hits["t"].iloc[1] == pytest.approx(2.0 * FALL, rel=1e-9)
    ended = run.events.query("event == 'chatter ends'")["t"]
    assert ended.tolist() == pytest.approx([FALL * 1.5 / 0.5], abs=1e-10)
    assert run.final == mi.State(x=0.0, v=0.0, mode="held")
    assert hits.attrs["units"] == {"t": "s", "x before": "m", "x after": "m", "v before": "m/s",
                                   "v after": "m/s"}  # fmt: skip


def test_functions_with_keyword_only_arguments_are_compiled():
    def spring(x, soft=0.1, *, stiffness, cubic=0.5):
        return -(stiffness - soft) * x - cubic * x**3

    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, spring(y.x, stiffness=p.k)),
        parameters={"k": 2.0},
        initial={"x": 1.0},
    )
    runs = [mi.simulate(system, duration=3.0, options=each).final for each in (ENGINES[1], PLAIN)]
    assert runs[0].as_dict() == pytest.approx(runs[1].as_dict(), rel=1e-9)


def test_until_comes_after_what_else_happens_in_its_instant():
    """Whatever order a guard is given: a mark that is passed there is still recorded."""

    def height(mode, t, y, p):
        return y.x

    system = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (-1.0,),
        guards=[mi.Guard("mark", height, order=50)],
        initial={"x": 1.0},
    )
    run = mi.simulate(system, until=height, options=PLAIN)
    assert run.ended == "until"
    assert "mark" in run.events["event"].tolist()


@pytest.mark.slow
def test_no_forcing_no_periods_in_tables():
    run = mi.simulate(ball(), duration=0.5, options=PLAIN)
    assert list(run.events.columns) == ["t", "event", "mode before", "mode after", "x", "v"]
    assert list(run.samples(10).columns) == ["t", "x", "v", "mode"]
    with pytest.raises(mi.InvalidParameter, match="no forcing period: give the duration"):
        mi.simulate(ball(), 3)
    with pytest.raises(mi.InvalidParameter, match="give the duration"):
        mi.simulate(ball())
    with pytest.raises(mi.OrbitError, match="an equilibrium was reached"):
        mi.find_orbit(ball(), options=PLAIN)
    with pytest.raises(mi.InvalidParameter, match="the system is autonomous: give the times"):
        mi.sweep(ball(), "e", [0.5])


@pytest.mark.slow
@pytest.mark.parametrize("arrays", [False, True], ids=["named", "arrays"])
def test_until(arrays):
    if arrays:
        until, options = (lambda mode, t, y, p: y[1] + 1.0), PLAIN
    else:
        until, options = (lambda mode, t, y, p: y.v + 1.0), mi.Options(method="dop853")
    run = mi.simulate(ball(arrays=arrays), until=until, options=options)
    assert run.ended == "until"
    assert run.final.v == pytest.approx(-1.0, abs=1e-12)
    assert run.events["t"].tolist() == pytest.approx([1.0 / 9.81], rel=1e-9)
    assert run.events["event"].tolist() == ["until"]


def test_a_sequence_of_impacts_without_rest_ends_the_run():
    floor = mi.Impact(
        "floor", lambda mode, t, y, p: y.x, lambda mode, t, y, p: (mode, (0.0, -p.e * y.v))
    )
    lost = ball(flow=lambda mode, t, y, p: (y.v, -p.g), guards=[floor])
    with pytest.raises(
        mi.RunError, match=r"a chatter sequence has ended .* rest= of the Impact"
    ) as caught:
        mi.simulate(lost, duration=2.0, options=PLAIN)
    partial = caught.value.partial
    assert len(partial.impacts) > 15
    assert partial.final.time == 0.0
    assert partial.extent[1] == pytest.approx(FALL * 1.5 / 0.5, rel=1e-6)


def test_a_guard_may_only_record():
    half = mi.Guard("half way", lambda mode, t, y, p: y.x - 0.5)
    system = ball(guards=[*ball().definition.guards, half])
    run = mi.simulate(system, duration=0.4, options=PLAIN)
    assert run.events["event"].tolist() == ["half way"]
    assert run.events["t"].tolist() == pytest.approx([math.sqrt(1.0 / 9.81)], rel=1e-9)
    assert run.events["v"].iloc[0] == pytest.approx(-math.sqrt(9.81), rel=1e-9)


@pytest.mark.parametrize("exponent", range(2, 13, 2))
def test_a_graze_is_seen_without_a_rate(exponent):
    # Without drive and damping x turns where its energy says: 10^-k beyond the wall, or short.
    depth, options = 10.0**-exponent, mi.Options(method="dop853", rtol=1e-13, atol=1e-15)
    still = oscillator(A=0.0, zeta=0.0, e=1.0)

    def impacts(turn):
        start = {"x": 0.96, "v": math.sqrt((turn - 0.96) * (turn + 0.96))}
        return mi.simulate(still, 0.2, initial=start, options=options).impacts

    struck = impacts(1.0 + depth)
    assert len(struck) == 1
    assert len(impacts(1.0 - depth)) == 0
    speed = math.sqrt(depth * (2.0 + depth))
    assert struck["v before"].iloc[0] == pytest.approx(speed, abs=3e-13 / speed)


@pytest.mark.slow
def test_orbit_branch_curve():
    system = oscillator(A=0.5)
    orbit = mi.find_orbit(mi.simulate(system, 300), periods=2)
    assert (orbit.stable, len(orbit.impacts)) == (True, 2)
    orbit = mi.find_orbit(oscillator(A=0.6), transient=300)
    branch = mi.continue_solution(orbit, "A", stop=0.3)
    assert [s.label for s in branch.special_points] == ["PD", "G"]
    grazing = math.sqrt((1.0 - 0.8**2) ** 2 + (2.0 * 0.05 * 0.8) ** 2)
    assert branch.special_points[1].value == pytest.approx(grazing, abs=1e-10)
    assert branch.table.columns[0] == "A"
    assert {"x", "v", "speed", "energy"} <= set(branch.table.columns)
    struck = branch.table["impacts"] == 1
    assert np.allclose(branch.table["speed"][struck], branch.table["impact speed"][struck])
    assert np.abs(branch.table["energy"]).max() < 1e-9  # it comes back to its start

    curve = mi.continue_curve(branch.special_points[1], "zeta", stop=0.1)
    exact = np.sqrt((1.0 - 0.8**2) ** 2 + (2.0 * curve.table["zeta"] * 0.8) ** 2)
    assert np.abs(curve.table["A"] - exact).max() < 1e-9
    assert branch.special_points[1].type in mi.GrazingType


def test_a_sweep_looks_where_periods_begin():
    sweep = mi.sweep(oscillator(), "A", [0.3, 0.5], transient=100, periods=4, direction="both")
    table = sweep.table
    assert list(table.columns) == [
        "A", "direction", "period", "x", "v", "impacts per period", "impacts per period error",
        "speed", "speed error", "energy", "energy error", "status",
    ]  # fmt: skip
    assert len(table) == 2 * 2 * 4
    silent = table[table["A"] == 0.3]
    omega, zeta = 0.8, 0.05
    z = 0.3 / complex(1.0 - omega**2, 2.0 * zeta * omega)
    assert np.abs(silent["x"] - z.real).max() < 1e-6
    assert np.abs(silent["v"] + omega * z.imag).max() > 0.0
    summary = sweep.statistics
    assert summary["impacting"].tolist() == [False, True, True, False]
    assert summary["crossings"].tolist() == [4] * 4


def test_statistics_of_observables_and_modes():
    run = mi.simulate(oscillator(A=0.6), 300)
    told = run.statistics
    assert told["impacts per period"] == told["wall per period"] == 1.0
    assert told["speed"] == pytest.approx(run.impacts["speed"].iloc[-1], rel=1e-6)
    assert told["share free"] == 1.0
    assert abs(told["energy"]) < 1e-6
    assert run.verify().agrees


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"states": ("x", "x")}, "must be names that differ"),
        ({"parameters": {"g": math.nan}}, "g = nan: must be a finite number"),
        ({"parameters": {"1g": 1.0}}, "a Python name"),
        ({"flow": 3}, "flow = 3: must be a function"),
        ({"flow": lambda t, y: y}, "must be a function flow"),
        ({"section": ("z", 0.0)}, "section = 'z': must be one of x, v"),
        ({"initial": {"z": 0.0}}, "initial = 'z': must be components among x, v"),
        ({"guards": [3]}, "guards = 3: must be each a Guard"),
        ({"guards": [mi.Guard("a")]}, "margin of 'a' = None: must be a function"),
        ({"cyclic": ("z",)}, "cyclic = 'z': must be one of x, v"),
    ],
)
def test_mistakes_are_one_sentence(changes, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        ball(**changes)


def test_arguments_of_the_verbs():
    system = oscillator()
    with pytest.raises(mi.InvalidParameter, match="parameter = 'b': must be one of A, omega"):
        mi.sweep(system, "b", [1.0])
    with pytest.raises(mi.InvalidParameter, match="initial = 'y': must be components among x, v"):
        mi.simulate(system, 1, initial={"y": 0.0})
    with pytest.raises(mi.InvalidParameter, match="mode = 'lost': must be one of free, held"):
        mi.simulate(system, 1, initial=mi.State(x=0.0, mode="lost"))
    with pytest.raises(
        mi.InvalidParameter, match="system = 'oscillator': must be a System, or an Actuator"
    ):
        mi.simulate("oscillator", 1)
    with pytest.raises(TypeError, match=r"argument 'rtol': give options=Options\(rtol=…\)"):
        mi.simulate(system, 1, rtol=1e-6)
    with pytest.raises(TypeError, match=r"'y0'; its arguments are system, .*guess"):
        mi.find_orbit(system, y0=[1.0, 0.0])
    assert system.changed(A=0.7).parameters["A"] == 0.7
    assert system.parameters["A"] == 0.6
    assert FREE.name == "free"
    with pytest.raises(mi.InvalidParameter, match="parameter = 'B': must be one of"):
        system.changed(B=1.0)


def test_systems_and_results_are_pickled_with_their_functions():
    run = mi.simulate(oscillator(), 20)
    again = pickle.loads(pickle.dumps(run))
    assert again.final == run.final
    assert mi.simulate(again, 5).final == mi.simulate(run, 5).final


def test_an_initial_state_has_no_phase_without_forcing():
    with pytest.raises(mi.InvalidParameter, match="must be 0: the system has no forcing period"):
        mi.simulate(ball(), duration=1.0, initial=mi.State(x=1.0, time=1.0))


def test_a_run_that_ended_continues_without_what_ended_it():
    ended = mi.simulate(ball(), until=lambda mode, t, y, p: y.v + 1.0, options=PLAIN)
    assert ended.statistics["window last"] == pytest.approx(1.0 / 9.81, rel=1e-6)
    further = mi.simulate(ended, duration=0.1)
    assert further.ended == "time"
    assert further.final.v == pytest.approx(-1.0 - 0.981, rel=1e-9)


def test_statistics_count_in_time_where_nothing_forces():
    run = mi.simulate(ball(parameters={"g": 9.81, "e": 0.5}, time_scale=10.0), duration=1.0)
    told = mi.simulate(ball(time_scale=10.0), duration=1.0, window=(0.0, 1.0)).statistics
    assert told["impacts per time"] == pytest.approx(2.0)
    assert (told["window first"], told["window last"]) == pytest.approx((0.0, 1.0))
    assert repr(run).startswith("Run(time 0 to 1,")


def test_an_observable_that_fails_once_loses_nothing():
    failures = []

    def speed(mode, t, before, after, p):
        if failures:
            raise failures.pop()
        return -before.v

    system = ball(observables=[mi.Observable("u", speed, at=("floor",), reduce="max")])
    run = mi.simulate(system, duration=1.0, window=(0.0, 1.0), options=PLAIN)
    failures.append(ValueError)
    with pytest.raises(mi.FunctionError, match="observable u"):
        _ = run.statistics
    assert run.statistics["u"] == pytest.approx(math.sqrt(2.0 * 9.81), rel=1e-9)


def test_verbs_take_orbits():
    orbit = mi.find_orbit(oscillator(), transient=300)
    assert mi.simulate(orbit, 1).final.x == pytest.approx(orbit.state.x, abs=1e-7)
    branch = mi.continue_solution(orbit, "A", stop=0.59)
    with pytest.raises(mi.InvalidParameter, match="a Run or an Orbit"):
        mi.simulate(branch, 1)


def test_orders_that_are_given_are_kept():
    floor = ball().definition.guards[0]
    half = mi.Guard("half way", lambda mode, t, y, p: y.x - 0.5, order=0)
    system = ball(guards=[half, floor])
    assert [guard.order for guard in system.automaton.guards] == [0, 1]


@pytest.mark.parametrize(("t", "x", "v"), [(0.3, 0.2, 0.7), (2.0, -1.0, 0.4)])
def test_a_rate_by_differences_is_the_derivative_along_the_flow(t, x, v):
    """Of sin(x v) cos t, where x' = v and v' = -x."""
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -y.x),
        period=2.0 * math.pi,
        guards=[mi.Guard("g", lambda mode, t, y, p: 3.0 + math.sin(y.x * y.v) * math.cos(t))],
    )
    problem = system.problem(mi.Options())
    margins, rates = np.zeros(1), np.zeros(1)
    problem.automaton.margins(0, t, np.array([x, v]), problem.parameters, margins, rates)
    along = math.cos(x * v) * (v * v - x * x) * math.cos(t) - math.sin(x * v) * math.sin(t)
    assert rates[0] == pytest.approx(along, abs=1e-11)
