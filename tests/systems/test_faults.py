"""Mistakes that no short run meets: each ends its run in one sentence, on both engines.

Every system here is fine where it starts by itself, and wrong where the run is sent.
"""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.errors import FunctionError, InvalidParameter, RunError
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from tests.analysis.systems import FREE, HELD, ball

ENGINES = ["interpreted", pytest.param("compiled", marks=pytest.mark.slow)]
HERE = r"\(test_faults\.py, line \d+\)"
TABLE = np.array([9.81, 9.81])
FAR = 5.0  # above the start of the ball, where nothing goes unless it is told to


def beyond_dy(mode, t, y, p, dy):
    dy[0], dy[1] = y[1], -p.g
    if y[0] > FAR:
        dy[100_000] = 1.0


def next_to_dy(mode, t, y, p, dy):
    dy[0], dy[1] = y[1], -p.g
    if y[0] > FAR:
        dy[2] = 1.0


def beyond_y(mode, t, y, p, dy):
    dy[0], dy[1] = y[1], -p.g
    if y[0] > FAR:
        dy[1] = y[3]


def unwritten(mode, t, y, p, dy):
    dy[0] = y[1]
    if y[0] < FAR:
        dy[1] = -p.g


def beyond_a_table(mode, t, y, p):
    return y.v, -TABLE[int(y.x / FAR)] - TABLE[100 * int(y.x / FAR)]


def fails(mode, t, y, p):
    if y.x > FAR:
        raise RuntimeError("too high")
    return y.v, -p.g


def not_finite(mode, t, y, p):
    return y.v, -p.g if y.x < FAR else math.nan


def under_a_root(mode, t, y, p):
    return y.v, -p.g * math.sqrt(FAR - y.x)


LATE = [
    ({"arrays": True, "flow": beyond_dy}, rf"flow 'beyond_dy' {HERE} writes dy\[100000\], but it"),
    ({"arrays": True, "flow": next_to_dy}, rf"{HERE} writes dy\[2\], but it has 2 comp.*; go"),
    ({"arrays": True, "flow": beyond_y}, rf"flow 'beyond_y' {HERE} reads y\[3\], but it has 2"),
    ({"arrays": True, "flow": unwritten}, rf"'unwritten' {HERE} does not write dy\[1\]"),
    ({"flow": beyond_a_table}, rf"flow 'beyond_a_table' {HERE} raises IndexError.* at x = "),
    ({"flow": fails}, rf"flow 'fails' {HERE} raises RuntimeError: too high at x = "),
    ({"flow": not_finite}, rf"not finite: flow 'not_finite' {HERE} gives nan for v at x = "),
    ({"flow": under_a_root}, rf"not finite: flow 'under_a_root' {HERE} raises ValueError.* at x ="),
]  # fmt: skip


def run_far(system, engine, x=FAR + 2.0, **changes):
    options = mi.Options(engine=engine, method="dop853")
    return mi.simulate(system, duration=4.0, initial={"x": x}, options=options, **changes)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("changes", "sentence"), LATE)
def test_what_a_flow_does_wrong_far_away(changes, sentence, engine):
    system = ball(**changes)
    with pytest.raises(RunError, match=sentence) as caught:
        run_far(system, engine)
    assert len(str(caught.value).splitlines()) == 1
    assert caught.value.partial is not None


def to_nowhere(mode, t, y, p):
    return (5 if y.v < -FAR else FREE), (0.0, -p.e * y.v)


def to_no_number(mode, t, y, p):
    return FREE, (0.0, math.nan if y.v < -FAR else -p.e * y.v)


def into_nothing(mode, t, y, p, new):
    new[0], new[1] = 0.0, -p.e * y[1]
    if y[1] < -FAR:
        new[7] = 0.0
    return FREE


def no_rest(mode, t, y, p):
    return HELD, (math.nan, 0.0)


def floor(*, transition=None, rest=None, arrays=False):
    own = ball(arrays=arrays).definition.guards[0]
    change, lie = transition or own.transition, rest or own.rest
    guard = mi.Impact("floor", own.margin, change, rest=lie, modes=(FREE,))
    return {"guards": [guard], "arrays": arrays}


LATER = [
    (floor(transition=to_nowhere), "returned the mode 5; there are 2"),
    (floor(transition=to_no_number), "'floor' left a state that is not finite"),
    (floor(rest=no_rest), "'floor' left a state that is not finite"),
    (floor(transition=into_nothing, arrays=True),
     rf"transition of 'floor', 'into_nothing', {HERE} writes new\[7\], but it has 2"),
]  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("changes", "sentence"), LATER)
def test_what_a_transition_does_wrong_far_away(changes, sentence, engine):
    system = ball(**changes)
    with pytest.raises(RunError, match=sentence):
        run_far(system, engine)


def kicked_too_little(mode, t, y, p):
    return FREE, (y.x, y.v + (1e-3 if y.v < -FAR else 50.0))


@pytest.mark.parametrize("engine", ENGINES)
def test_a_guard_that_continues_falling_is_reported_as_what_it_is(engine):
    kicked = mi.Guard("kick", lambda mode, t, y, p: y.x, kicked_too_little, condition=True)
    system = ball(guards=[kicked], modes=("free", "held"))
    with pytest.raises(RunError, match="the transition of 'kick' reverse the rate of its margin"):
        mi.simulate(system, duration=4.0, initial={"x": FAR + 2.0},
                    options=mi.Options(engine=engine, method="dop853", max_events=200))  # fmt: skip


def written(mode, t, y, p, dy):
    dy[0], dy[1] = y[1], -p[0]


def writes_far(mode, t, y, p, dy):
    dy[0], dy[1], dy[300_000] = y[1], -p[0], 1.0


def writes_nothing(mode, t, y, p, dy):
    pass


def reads_four(mode, t, y, p, dy):
    dy[0], dy[1] = y[1], -p[3]


def open_margin(mode, t, y, p, g, r):
    g[0], r[0] = 1.0 + y[0], y[1]


def second_margin(mode, t, y, p, g, r):
    g[0], r[0], g[1] = 1.0 + y[0], y[1], 1.0


def stay(mode, code, t, y, p):
    return mode


def write_far(mode, code, t, y, p):
    y[300_000] = 0.0
    return mode


ARRAYS = [
    ((writes_far, open_margin, stay), rf"flow 'writes_far' {HERE} writes dy\[300000\], but"),
    ((writes_nothing, open_margin, stay), "right-hand side is not finite"),
    ((reads_four, open_margin, stay), rf"flow 'reads_four' {HERE} reads p\[3\], but it has 2"),
    ((written, second_margin, stay), rf"margins 'second_margin' {HERE} writes g\[1\], but it"),
    ((written, open_margin, write_far), rf"transition 'write_far' {HERE} writes y\[300000\], but"),
]  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("functions", "sentence"), ARRAYS)
def test_an_automaton_over_arrays_cannot_crash_the_process(functions, sentence, engine):
    flow, margins, transition = functions
    automaton = Automaton(
        states=("x", "v"), modes=("free",), guards=(Guard(name="end", order=0),),
        flow=flow, margins=margins, transition=transition,
    )  # fmt: skip
    options = mi.Options(engine=engine, method="dop853")
    problem = Problem(automaton=automaton, parameters=[9.81, 0.5], period=1.0, options=options)
    with pytest.raises(RunError, match=sentence):
        run(problem, HybridState(0, 0.0, 0, np.array([1.0, 0.0])), 3.0)


@pytest.mark.parametrize("options", [None, {"method": "bdf"}, "bdf"])
def test_options_are_options(options):
    with pytest.raises(InvalidParameter, match=r"options = .*must be Options"):
        mi.simulate(ball(), duration=1.0, options=options)


def test_a_run_of_more_periods_than_can_be_counted():
    plain = mi.System(states=("x",), flow=lambda mode, t, y, p: (0.0,), period=1.0)
    with pytest.raises(InvalidParameter, match=r"periods = 1e\+30: must be above 0 and up to"):
        mi.simulate(plain, periods=1e30)


@pytest.mark.parametrize(
    ("until", "sentence"),
    [
        (lambda mode, t, y, p: y.w, r"margin of 'until', a lambda, .* reads y\.w"),
        (lambda mode, t, y, p: None, "returns nothing .* return one number"),
    ],
)
def test_what_ends_a_run_is_tried(until, sentence):
    with pytest.raises(FunctionError, match=sentence):
        mi.simulate(ball(), until=until)
    with pytest.raises(InvalidParameter, match=r"until = .* takes 1 arguments"):
        mi.simulate(ball(), until=lambda y: y.x)


KNOWN = {"g": 9.81}
KNOWN_LIST = [9.81]


def of_a_dict(mode, t, y, p):
    return y.v, -KNOWN["g"]


def of_a_list(mode, t, y, p):
    return y.v, -KNOWN_LIST[0]


def closing_over(numbers):
    def flow(mode, t, y, p):
        return y.v, -numbers[0]

    return flow


def of_an_assignment_expression(mode, t, y, p):
    return (y.v, -p.g) if (x := y.x) < FAR else (x, 0.0)


def of_texts(mode, t, y, p):
    return y.v, -p.g * float(len(f"{3}"))


def of_an_array(mode, t, y, p):
    return y.v, -float(np.array([p.g, y.x]).max())


def sometimes_nothing(mode, t, y, p):
    if y.x < FAR:
        return y.v, -p.g


def sometimes_more(mode, t, y, p):
    return (y.v, -p.g) if y.x < FAR else (y.v, -p.g, 0.0)


def misspelt_far_away(mode, t, y, p):
    return y.v, -p.g if y.x < FAR else y.vel


UNCOMPILED = [
    (of_a_dict, "cannot be compiled by numba: it reads KNOWN, of type dict; write it over numbers"),
    (of_a_list, "cannot be compiled by numba: it reads KNOWN_LIST, of type list; write it"),
    (closing_over([9.81]), "cannot be compiled by numba: it reads numbers, of type list; write"),
    (of_an_assignment_expression, "by numba: the type of a value cannot be determined; write it"),
    (of_texts, "cannot be compiled by numba: "),
    (of_an_array, "it creates a list, an array or a string at run time"),
    (sometimes_nothing, "returns nothing on some path"),
    (sometimes_more, "cannot be compiled by numba: "),
    (misspelt_far_away, "cannot be compiled by numba: .*'vel'"),
]


@pytest.mark.slow
@pytest.mark.parametrize(("flow", "sentence"), UNCOMPILED)
def test_what_numba_cannot_compile_is_one_sentence(flow, sentence):
    system = ball(flow=flow)
    with pytest.raises(FunctionError, match=sentence) as caught:
        run_far(system, "compiled")
    error = caught.value
    assert len(str(error).splitlines()) == 1
    assert error.__cause__ is not None  # numba's own
    begins = flow.__code__.co_firstlineno
    assert error.file == __file__
    assert begins <= error.line <= begins + 3


INTERPRETED = [
    (sometimes_nothing, "'sometimes_nothing' .* returns nothing in mode free"),
    (sometimes_more, "'sometimes_more' .* returns 3 numbers for 2 states"),
    (misspelt_far_away, r"'misspelt_far_away' .* reads y\.vel"),
]


@pytest.mark.parametrize(("flow", "sentence"), INTERPRETED)
def test_the_same_interpreted(flow, sentence):
    with pytest.raises(RunError, match=sentence):
        run_far(ball(flow=flow), "interpreted")
