"""Mistakes in a system of one's own: each is one sentence before anything runs.

Whatever the engine, since what is tried here is the text of the functions.
"""

import functools
import math
import random
import types

import numpy as np
import pytest

import mems_impact as mi
from tests.analysis.systems import FREE, HELD, ball

helpers = types.ModuleType("helpers")
exec("def count(g):\n    global COUNT\n    COUNT = g\n    return g", vars(helpers))
helpers.g = helpers.count  # which no flow reads
CALLS = [0]
TOTAL = 0.0
HERE = r"\(test_validation\.py, line \d+\)"


def by_array(flow):
    return {"arrays": True, "flow": flow}


def writes(i):
    def flow(mode, t, y, p, dy):
        dy[0], dy[1] = y[1], -p.g
        dy[i] = 1.0

    return by_array(flow)


def half_written(mode, t, y, p, dy):
    dy[0] = y[1]


def reads_beyond(mode, t, y, p, dy):
    dy[0], dy[1] = y[2], -p.g


def writes_the_state(mode, t, y, p, dy):
    y[0] = 2.0
    dy[0], dy[1] = y[1], -p.g


def adds_to_nothing(mode, t, y, p, dy):
    dy[0] += y[1]
    dy[1] = -p.g


def writes_a_text(mode, t, y, p, dy):
    dy[0], dy[1] = y[1], "down"


def by_name_in_an_array(mode, t, y, p, dy):
    dy[0], dy[1] = y.v, -p.g


def misspelt_state(mode, t, y, p):
    return y.vel, -p.g


def misspelt_parameter(mode, t, y, p):
    return y.v, -p.gg


def helped(y):
    return y.speed


def through_a_helper(mode, t, y, p):
    return helped(y), -p.g


def forgotten_return(mode, t, y, p):
    if mode == HELD:
        return 0.0, 0.0
    y.v, -p.g  # noqa: B018


def counts(mode, t, y, p):
    CALLS[0] += 1
    return y.v, -p.g - 1e-3 * CALLS[0]


def changes_a_global(mode, t, y, p):
    global TOTAL
    TOTAL = y.v
    return y.v, -p.g


def g():
    changes_a_global(FREE, 0.0, None, None)


def reads_a_parameter_of_that_name(mode, t, y, p):
    return y.v, -p.g


def changes_a_global_through_a_module(mode, t, y, p):
    return y.v, -helpers.count(p.g)


def changes_a_global_within(mode, t, y, p):
    return y.v, -sum(helpers.count(p.g) for _ in range(1))


def changes_its_own(mode, t, y, p):
    total = 0.0

    def add():
        nonlocal total
        total += p.g

    add()
    return y.v, -total


def changes_a_closure():
    total = 0.0

    def flow(mode, t, y, p):
        nonlocal total
        total = y.v
        return y.v, -p.g

    return flow


def endless(mode, t, y, p):
    return endless(mode, t, y, p)


def unknown_name(mode, t, y, p):
    return y.v, -gravity  # noqa: F821


def divides(mode, t, y, p):
    return y.v, -p.g / y.v


def drifting(mode, t, y, p):
    return y.v, -p.g + 0.1 * math.cos(t)


FLOWS = [
    (writes(3), rf"flow 'flow' {HERE} writes dy\[3\], but it has 2 components; go from 0 to 1"),
    (writes(5), r"writes dy\[5\], but it has 2"),
    (writes(2), r"writes dy\[2\], but it has 2"),
    (by_array(half_written), r"does not write dy\[1\] in mode free; write every component, 0\.0"),
    (by_array(lambda mode, t, y, p, dy: None), rf"flow a lambda {HERE} does not write dy\[0\]"),
    (by_array(reads_beyond), r"reads y\[2\], but it has 2"),
    (by_array(writes_the_state), r"writes y\[0\]|writes into y"),
    (by_array(adds_to_nothing), r"reads dy\[0\] before it is written"),
    (by_array(writes_a_text), r"gives 'down' \(a str\) for v; let it be a number"),
    (by_array(by_name_in_an_array), r"reads \.v of an array; write y\[0\]"),
    ({"flow": misspelt_state}, rf"'misspelt_state' {HERE} reads y\.vel, but .* there are x, v"),
    ({"flow": lambda mode, t, y, p: (y["v"], 0.0)}, r"str; a state is read as y\.NAME"),
    ({"flow": misspelt_parameter}, r"reads p\.gg, but there is no such parameter; did you mean g"),
    ({"flow": through_a_helper}, rf"flow 'through_a_helper' {HERE} reads y\.speed"),
    ({"flow": lambda mode, t, y, p: (y.v, -p.g, 0.0)}, "returns 3 numbers for 2 states"),
    ({"flow": lambda mode, t, y, p: [y.v, -p.g]}, "returns a list .* return a tuple of 2"),
    ({"flow": lambda mode, t, y, p: np.array([y.v, -p.g])}, r"\(a ndarray\).* return a tuple"),
    ({"flow": lambda mode, t, y, p: -p.g}, r"returns the one number -9\.81"),
    ({"flow": lambda mode, t, y, p: None}, "returns nothing in mode free"),
    ({"flow": forgotten_return}, "'forgotten_return' .* returns nothing in mode free"),
    ({"flow": lambda mode, t, y, p: (y.v, None)}, "gives nothing for v"),
    ({"flow": lambda mode, t, y, p: (y.v, math.nan)}, "gives nan for v at x = 1, v = 0, t = 0"),
    ({"flow": lambda mode, t, y, p: (y.v, (-p.g) ** 0.5)}, "gives .*j.* for v at x = 1"),
    ({"flow": lambda mode, t, y, p: (y.v, math.sqrt(-p.g))}, "raises ValueError.* treat this case"),
    ({"flow": divides}, "raises ZeroDivisionError.* treat this case separately"),
    ({"flow": lambda mode, t, y, p: (y.v, random.random())}, "two results for the same mode"),
    ({"flow": counts}, "two results .* no random numbers, no counters"),
    ({"flow": changes_a_global}, "changes TOTAL, a variable outside"),
    ({"flow": changes_a_closure()}, "changes total, a variable outside"),
    ({"flow": changes_a_global_through_a_module}, "changes COUNT, a variable outside"),
    ({"flow": changes_a_global_within}, "changes COUNT, a variable outside"),
    ({"flow": endless}, "has unbounded recursion"),
    ({"flow": unknown_name}, "raises NameError: name 'gravity' is not defined"),
    ({"flow": drifting, "period": 2.0}, r"differs a period later .*; give the period of the forc"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "sentence"), FLOWS)
def test_a_flow_is_tried(changes, sentence):
    refused(changes, sentence, mi.FunctionError)


def test_a_state_and_a_parameter_may_be_called_self():
    system = mi.System(
        states=("self",), flow=lambda mode, t, y, p: (-p.self * y.self,), parameters={"self": 2.0}
    )
    start = mi.State(self=1.0).replace(self=2.0)
    run = mi.simulate(system.changed(self=1.0), initial=start, duration=1.0, options=INTERPRETED)
    assert run.final.self == pytest.approx(2.0 * math.exp(-1.0), rel=1e-7)


@pytest.mark.parametrize("flow", [reads_a_parameter_of_that_name, changes_its_own])
def test_a_global_of_the_name_of_an_attribute_refuses_nothing(flow):
    """Functions g, of this module and of one that it knows, change globals; p.g is neither."""
    ball(flow=flow)


def refused(changes, sentence, kind):
    with pytest.raises(kind, match=sentence) as caught:
        ball(**changes)
    assert len(str(caught.value).splitlines()) == 1


def floor(kind=mi.Impact, **changes):
    """Return the ball's floor with something changed."""
    own = ball().definition.guards[0]
    made = {"margin": own.margin, "transition": own.transition, "rest": own.rest, **changes}
    if kind is mi.Guard:
        del made["rest"]
    return {"guards": [kind("floor", modes=(FREE,), **made)]}


def after(mode, x, v):
    return floor(transition=lambda _mode, t, y, p: (mode, (x, v(y))))


def into(transition):
    guards = ball(arrays=True).definition.guards
    own = mi.Impact("floor", guards[0].margin, transition, modes=(FREE,))
    return {"arrays": True, "guards": [own]}


def no_mode(mode, t, y, p, new):
    new[1] = -p.e * y[1]


def beyond_the_state(mode, t, y, p, new):
    new[2] = 0.0
    return mode


def upwards(y):
    return -0.5 * y.v


def onwards(y):
    return 0.5 * y.v


FUNCTIONS = [
    (floor(margin=lambda mode, t, y, p: None), rf"margin of 'floor', a lambda, {HERE} returns"),
    (floor(margin=lambda mode, t, y, p: (y.x, y.v)), "returns a tuple of 2 .* return one number"),
    (floor(margin=lambda mode, t, y, p: y.height), r"reads y\.height"),
    (floor(margin=lambda mode, t, y, p: math.log(-y.x)), "margin of 'floor'.* raises ValueError"),
    (floor(margin=lambda mode, t, y, p: y.x * random.random()), "two results"),
    (after(5, 0.0, upwards), r"returns mode 5; .* 0 \(free\), 1 \(held\), or give all .* modes="),
    (after(-1, 0.0, upwards), "returns mode -1"),
    (after(0.5, 0.0, upwards), r"returns mode 0\.5"),
    (after("free", 0.0, upwards), r"returns 'free' \(a str\); return one of the modes"),
    (floor(transition=lambda mode, t, y, p: (0.0, 0.0)), r"returns mode 0\.0"),
    (floor(transition=lambda mode, t, y, p: None), "returns nothing .* the new mode and"),
    (floor(transition=lambda mode, t, y, p: mode), "returns the one number"),
    (floor(transition=lambda mode, t, y, p: (mode, (0.0, 0.0, 0.0))), "returns 3 numbers for 2"),
    (floor(transition=lambda mode, t, y, p: (mode, [0.0, 0.0])), "returns a list"),
    (floor(transition=lambda mode, t, y, p: (mode, (0.0, "up"))), r"gives 'up' \(a str\) for v"),
    (floor(transition=lambda mode, t, y, p: (mode, (0.0, -p.f * y.v))), r"reads p\.f"),
    (after(FREE, 0.0, onwards), "leaves its margin at zero and falling.* reverse the rate"),
    (
        floor(mi.Guard, condition=True, transition=lambda mode, t, y, p: (mode, (0.0, y.v - 1.0))),
        "and falling",
    ),
    (floor(rest=lambda mode, t, y, p: (HELD, (0.0, 0.0, 0.0))), "rest of 'floor'.* returns 3"),
    (floor(rest=lambda mode, t, y, p: None), "rest of 'floor'.* returns nothing"),
    (into(no_mode), "transition of 'floor', 'no_mode', .* returns nothing; return one"),
    (into(beyond_the_state), r"writes new\[2\], but it has 2"),
    ({"observables": [mi.Observable("h", lambda y, p: y.height)]}, "observable of 'h'.* y.height"),
    ({"observables": [mi.Observable("h", lambda y, p: None)]}, "'h'.* returns nothing"),
    ({"observables": [mi.Observable("u", lambda mode, t, before, after, p: after.w,
                                    at=("floor",), reduce="sum")]}, "observable of 'u'.* y.w"),
    ({"period": lambda p: 1.0 / p.f}, r"period a lambda .* reads p\.f"),
    ({"switches": lambda p: p.f, "period": 1.0}, r"switches a lambda .* reads p\.f"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "sentence"), FUNCTIONS)
def test_other_functions_are_tried(changes, sentence):
    refused(changes, sentence, mi.FunctionError)


def turned(mode, t, y, p):
    return 2, y


def test_switch_transition_is_tried_at_a_switch():
    changes = {"period": 1.0, "switches": (0.2,), "switch_transition": turned}
    refused(changes, "switch_transition 'turned' .* returns mode 2", mi.FunctionError)


class Falling:
    def __call__(self, mode, t, y, p):
        return y.v, -p.g


GAP = ball().definition.guards[0].margin
ARGUMENTS = [
    ({"flow": Falling()}, "flow = .*: must be a function, written with def or lambda"),
    ({"flow": functools.partial(Falling(), 0)}, "must be a function, written with def or lambda"),
    ({"flow": math.sin}, "must be a function, written with def or lambda"),
    ({"flow": lambda mode, t, y: (y.v, 0.0)}, r"must be a function flow\(mode, t, y, p\)"),
    (floor(margin=lambda y: y.x), r"margin of 'floor' = .* takes 1 arguments.*\(mode, t, y, p\)"),
    (floor(margin=max), "margin of 'floor' = .* must be a function"),
    (floor(transition=lambda mode, t, y, p, new: mode), "transition of 'floor'.* takes 5"),
    (floor(rest=lambda y: y), "rest of 'floor'.* takes 1"),
    ({"switch_transition": lambda y: y}, "switch_transition = .* takes 1"),
    ({"guards": mi.Guard("g", GAP)}, "guards = .*: must be a list of Guard and Impact"),
    ({"guards": [mi.Guard("", GAP)]}, "name of a guard = '': must be a text"),
    ({"guards": [mi.Guard("g", GAP), mi.Guard("g", GAP)]}, "guards = .* unique names"),
    ({"guards": [mi.Guard("g", GAP, modes=(7,))]}, "modes of 'g' = 7: must be one of the 1 modes"),
    ({"guards": [mi.Guard("g", GAP, modes=())]}, r"modes of 'g' = \(\): must be a tuple of modes"),
    ({"guards": [mi.Guard("g", GAP, modes=FREE)]}, "modes of 'g' = 0: must be a tuple of modes"),
    ({"guards": [mi.Guard("g", GAP, modes="free")]}, "modes of 'g' = 'free'"),
    ({"guards": [mi.Guard("g", GAP, modes=(0, 0))]}, r"modes of 'g' = \(0, 0\)"),
    ({"guards": [mi.Guard("g", GAP, order="first")]}, "order of 'g' = 'first'"),
    ({"guards": [mi.Guard("g", GAP, rest=Falling())]}, "rest of 'g' = "),
    ({"modes": ()}, r"modes = \(\): must be the modes of the system"),
    ({"modes": "free"}, "modes = 'free': must be the modes of the system"),
    ({"modes": ("free", "free")}, "modes = .* unique names"),
    ({"modes": (HELD, FREE)}, "modes = .* in the order of their numbers"),
    ({"modes": ("flying", "lying")}, "modes of 'floor' = 'free': must be called flying"),
    ({"states": "xv"}, "states = 'xv': must be a list of names"),
    ({"states": 0}, r'states = 0: must be a list of names such as \["x"\], or their number'),
    ({"states": ()}, r"states = \(\): must be one or more"),
    ({"states": (1, 2)}, "states = 1: must be each a name"),
    ({"states": ("x", "x")}, "must be names that differ"),
    ({"parameters": [9.81]}, "parameters = .*numbers by name"),
    ({"initial": [1.0, 0.0]}, "initial = .* must be a State, or numbers by name"),
    ({"initial": {"x": -1.0}}, "initial: lies beyond the guard 'floor', whose margin is -1"),
    ({"units": ["m"]}, "units = .* must be units by name"),
    ({"units": {"z": "m"}}, "units = 'z': must be names among x, v, g, e, time"),
    ({"units": {"x": 1}}, "unit of x = 1: must be a text"),
    ({"section": "x"}, r"section = 'x': must be a state and its value: \('x', 0\.0\)"),
    ({"section": ("x", "0")}, "section = .* a state and its value"),
    ({"switches": "ab"}, "switches = 'ab': must be times"),
    ({"switches": 0.5}, "switches = 0.5: must be times"),
    ({"states": ("x", "mode")}, "states = 'mode': must be names other than period, time, t, mode"),
    ({"period": "1"}, "period = '1': must be a finite number"),
    ({"period": 0.0}, "period = 0: must be finite and above 0"),
    ({"period": lambda p: None}, "period = None: must be a finite number"),
    ({"time_scale": lambda p: None}, "time_scale = None: must be a finite number"),
    ({"time_scale": [1.0]}, "time_scale = .* must be a finite number"),
    ({"cyclic": "x"}, "cyclic = 'x': must be a list of names among x, v"),
    ({"observables": mi.Observable("h", lambda y, p: y.x)}, "observables = .* a list"),
    ({"observables": ["h"]}, "observables = 'h': must be each an Observable"),
    ({"observables": [mi.Observable("x", lambda y, p: y.x)]}, "observables = 'x': must be unique"),
    ({"observables": [mi.Observable("u", Falling(), at=("wall",), reduce="sum")]},
     "at of 'u' = 'wall': must be one of floor"),
    ({"observables": [mi.Observable("u", Falling(), at="floor", reduce="sum")]}, "at of 'u' = 'f"),
    ({"observables": [mi.Observable("h", lambda y: y.x)]}, r"function of 'h' = .* a function"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "sentence"), ARGUMENTS)
def test_arguments_are_looked_at(changes, sentence):
    refused(changes, sentence, mi.InvalidParameter)


@pytest.mark.parametrize(
    "flow",
    [
        lambda mode, t, y, p: (y.v, math.sin(p.w * t)),  # nothing at all where it starts
        lambda mode, t, y, p: (y.v, -p.w * (y.x - 1.0) - 0.3 + 0.3 * math.cos(p.w * t)),
    ],
)
def test_what_is_rounding_depends_on_no_time(flow):
    mi.System(
        states=("x", "v"),
        flow=flow,
        parameters={"w": 3.0},
        period=lambda p: 2.0 * math.pi / p.w,
        initial={"x": 1.0},
    )


@pytest.mark.parametrize("count", [3, 9])
def test_the_states_that_a_tuple_is_for_are_named_unless_they_are_many(count):
    names = tuple(f"x{i}" for i in range(count))
    with pytest.raises(mi.FunctionError) as caught:
        mi.System(states=names, flow=lambda mode, t, y, p: (0.0,))
    shown = ", ".join(names[:8]) + (", …" if count > 8 else "")
    assert f"return a tuple of {count}, for {shown}, on every path" in str(caught.value)


# What the short run never comes to, a run does: a mode that is entered after a long while.

EARLY, LATE = mi.modes("early", "late")


def off_the_circle(mode, t, y, p):
    return y.x


def swinging(mode, t, y, p):
    return y.v, -y.x, 1.0


def late_swing(constraint, flow=swinging, length=50.0, **more):
    """An oscillator with a clock, which is in another mode from s = 50 on."""
    return mi.System(
        states=("x", "v", "s"),
        modes=("early", "late"),
        flow=flow,
        parameters={"length": length},
        constraints={LATE: constraint} if constraint else None,
        guards=[
            mi.Guard(
                "begins",
                lambda mode, t, y, p: p.length - y.s,
                lambda mode, t, y, p: (LATE, (y.x, y.v, y.s)),
                modes=(EARLY,),
            ),
        ],
        initial={"x": 1.0},
        **more,
    )


INTERPRETED = mi.Options(engine="interpreted", method="dop853")


def test_a_constraint_that_is_wrong_where_a_run_comes_at_last():
    system = late_swing(off_the_circle)
    mi.simulate(system, duration=40.0, options=INTERPRETED)
    for _ in range(2):  # it is told until it is mended
        with pytest.raises(mi.FunctionError, match="constraint 'off_the_circle'") as caught:
            mi.simulate(system, duration=60.0, options=INTERPRETED)
        assert isinstance(caught.value.partial, mi.Run)
        assert caught.value.partial.final.s == pytest.approx(60.0, rel=1e-12)
        assert f"is {math.cos(50.0):.6g} at" in str(caught.value)
        assert "s = 50, t = 50" in str(caught.value)


def test_a_run_that_begins_where_the_short_one_did_not():
    start = mi.State(x=0.6, v=0.8, s=0.0, mode="late")
    with pytest.raises(mi.FunctionError, match=r"changes at the rate 0\.8 at x = 0"):
        mi.simulate(late_swing(off_the_circle), duration=1.0, initial=start, options=INTERPRETED)


def test_what_is_kept_of_a_run_does_not_matter_to_its_constraints():
    with pytest.raises(mi.FunctionError, match="mode late"):
        mi.simulate(
            late_swing(off_the_circle), duration=60.0, keep="statistics", options=INTERPRETED
        )


def test_a_sweep_continues_past_constraints_that_are_wrong_for_some_of_its_values():
    system = late_swing(off_the_circle, period=2.0 * math.pi)
    table = mi.sweep(
        system, "length", [50.0, 90.0], transient=1, periods=9, options=INTERPRETED, workers=1
    ).table
    status = table.groupby("length")["status"].first()
    assert "off_the_circle" in status[50.0]
    assert status[90.0] == "ok"


def test_a_time_that_enters_where_a_run_comes_at_last():
    def driven_late(mode, t, y, p):
        return y.v, -y.x + (0.1 * math.cos(t) if mode == LATE else 0.0), 1.0

    swing = late_swing(None, driven_late)
    mi.simulate(swing, duration=60.0, options=INTERPRETED)
    with pytest.raises(mi.FunctionError, match="depends on time, and the system has no period"):
        mi.find_orbit(swing, options=INTERPRETED)


BAD_NAMES = [
    "x\0y",
    "\ud800",
    "a\nb",
    "a\x1bb",
    "\u202eb",
    "=1+1",
    "-1",
    "+cmd",
    "@sum",
    "\uffff",
    "$\\frac$",
]


@pytest.mark.parametrize("name", BAD_NAMES)
def test_a_name_that_no_file_can_hold_is_refused(name):
    """In HTML, XML, CSV and figures; a spreadsheet evaluates what begins like a formula."""
    own = ball().definition.guards[0]
    observable = mi.Observable(name, lambda y, p: y.x)
    for changes in (
        {"name": name},
        {"guards": [mi.Impact(name, own.margin, own.transition, modes=(FREE,), rest=own.rest)]},
        {"modes": ("free", name)},
        {"units": {"x": name}},
        {"observables": [observable]},
        {"parameters": {name: 1.0}},
        {"states": ("x", name)},
    ):
        with pytest.raises(mi.InvalidParameter) as caught:
            ball(**changes)
        assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "name", ["x */ int injected; /*", '"; <b>&amp;', "Kugel/Stoß µ", "a ??/", "x_{", "\\frac"]
)
def test_other_names_are_taken(name):
    assert ball(name=name).name == name


def test_the_message_of_an_exception_is_one_printable_line():
    def flow(mode, t, y, p):
        raise ValueError("\ud800 \0\n\x1b[31m")

    with pytest.raises(mi.FunctionError, match="raises ValueError") as caught:
        ball(flow=flow)
    assert str(caught.value).isprintable()
