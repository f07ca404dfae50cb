"""When a guard fires: falls through zero, jumps over it, conditions of a mode, flat zeros."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mems_impact as mi

WAYS = [mi.Options(engine="interpreted", method=method) for method in ("adams", "dop853")]
ways = pytest.mark.parametrize("options", WAYS, ids=["adams", "dop853"])
DOWN, UP = mi.modes("down", "up")


def log(run):
    return list(zip(run.events["event"], run.events["t"].round(9), strict=True))


def to(mode_after):
    return lambda mode, t, y, p: (mode_after, y)


def saw(**floor):
    """x falls at the slope 1 to -1, and rises; "floor" has the margin x in the mode that rises."""
    return mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (-1.0 if mode == DOWN else 1.0,),
        modes=(DOWN, UP),
        guards=[
            mi.Guard("turns", lambda mode, t, y, p: y.x + 1.0, to(UP), modes=(DOWN,)),
            mi.Guard("floor", lambda mode, t, y, p: y.x, to(DOWN), modes=(UP,), **floor),
        ],
    )


@ways
def test_a_margin_that_rises_does_not_fire(options):
    run = mi.simulate(saw(), duration=5.0, options=options)
    assert log(run) == [("turns", 1.0)]
    assert run.final.x == pytest.approx(3.0, abs=1e-9)


def test_a_run_that_continues_waits_as_the_one_before():
    half = mi.simulate(saw(), duration=1.5, options=WAYS[1])
    assert log(mi.simulate(saw(), duration=2.0, initial=half.final, options=WAYS[1])) == []
    fresh = mi.State(x=half.final.x, mode="up")
    again = mi.simulate(saw(), duration=0.3, initial=fresh, options=WAYS[1])
    assert log(again) == [("floor", 0.0)]
    samples = mi.simulate(saw(), duration=3.0, options=WAYS[1]).samples(per_period=8, first=2.5)
    assert set(samples["mode"]) == {"up"}


@ways
def test_samples_from_an_instant_know_its_events(options):
    """At 0 the margin is zero: its guard has fired in the first mode, and waits in the second."""

    def fire(mode, t, y, p):
        return mode, ((y.x,) if mode == DOWN else (1.0,))

    guards = [
        mi.Guard("zero", lambda mode, t, y, p: -t, fire),
        mi.Guard("begin", lambda mode, t, y, p: -1.0, to(UP), modes=(DOWN,), condition=True),
    ]
    decay = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (-y.x,), guards=guards, initial={"x": 0.1}
    )
    run = mi.simulate(decay, duration=1.0, options=options)
    assert log(run) == [("zero", 0.0), ("begin", 0.0)]
    for samples in (run.samples(1), run.samples(1, first=0.0)):
        assert samples["x"].to_numpy() == pytest.approx([0.1, 0.1 * math.exp(-1.0)])


@ways
@pytest.mark.parametrize("share", [0.25, 1.0 / 3.0, 0.5, 1.0])
def test_an_event_at_the_end_of_a_run_takes_place_once(options, share):
    """Runs of one length after another, as one run: x' = 1 counts when it passes 0.7 and 1.4."""
    passing = [
        mi.Guard(
            f"{place}",
            lambda mode, t, y, p, place=place: place - y.x,
            lambda mode, t, y, p: (mode, (y.x, y.count + 1.0)),
        )
        for place in (0.7, 1.4)
    ]
    system = mi.System(states=("x", "count"), flow=lambda mode, t, y, p: (1.0, 0.0), guards=passing)
    state, start = None, 0.0
    for _ in range(round(2.1 / (0.7 * share))):
        run = mi.simulate(system, duration=0.7 * share, initial=state, start=start, options=options)
        state, start = run.final, run.end
    assert state.count == 2.0


def test_a_motion_rests_at_a_virtual_equilibrium_whose_guard_waits():
    """From x = -0.5 the mode "up" tends to -1, below the margin of its guard."""
    system = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (-1.0 if mode == DOWN else -(y.x + 1.0),),
        modes=(DOWN, UP),
        guards=[
            mi.Guard("turns", lambda mode, t, y, p: y.x + 0.5, to(UP), modes=(DOWN,)),
            mi.Guard("floor", lambda mode, t, y, p: y.x, to(DOWN), modes=(UP,)),
        ],
    )
    run = mi.simulate(system, duration=30.0, options=WAYS[1])
    assert log(run) == [("turns", 0.5)]
    assert (run.final.x, run.final.mode) == (pytest.approx(-1.0, abs=1e-9), "up")
    (rest,) = mi.find_equilibria(system, box={"x": (-2.0, 2.0)})
    assert not rest.admissible
    assert rest.violated_guards == ("floor",)


@pytest.mark.parametrize(
    "engine", ["compiled", pytest.param("interpreted", marks=pytest.mark.slow(all=True))]
)
def test_a_recurrence_continues_after_an_event_without_its_repetition(engine):
    """z changes its sign when x passes 0.7: 1 tends to -1, and a repetition would lead back."""
    passing = mi.Guard(
        "passing", lambda mode, t, y, p: 0.7 - y.x, lambda mode, t, y, p: (mode, (y.x, -y.z))
    )
    system = mi.System(
        states=("x", "z"),
        flow=lambda mode, t, y, p: (1.0 if y.x < 2.0 else 3.0 - y.x, y.z - y.z**3),
        guards=[passing],
        initial={"z": 1.0},
    )
    options = mi.Options(engine=engine, method="dop853")
    after = mi.simulate(system, duration=0.7, options=options).final
    found = mi.edge_state(system, after, {"x": 3.0, "z": -1.0}, returns=1, options=options)
    assert [state.z for state in found.attractors] == pytest.approx([-1.0, 1.0])


def wave(**parameters):
    """x rises to 1 and falls to 0 in turn; y rises by 2 while x falls, when "brake" waits."""
    return mi.System(
        states=("x", "y"),
        parameters=parameters,
        flow=lambda mode, t, y, p: (-1.0, 2.0) if mode == DOWN else (1.0, 0.0),
        modes=(DOWN, UP),
        guards=[
            mi.Guard("top", lambda mode, t, y, p: 1.0 - y.x, to(DOWN), modes=(UP,)),
            mi.Guard("bottom", lambda mode, t, y, p: y.x,
                     lambda mode, t, y, p: (UP, (0.0, 0.0)), modes=(DOWN,)),
            mi.Guard("brake", lambda mode, t, y, p: y.y - 0.7, to(UP), modes=(DOWN,)),
        ],
        observables=[mi.Observable("place", lambda y, p: y.x)],
        initial=mi.State(x=0.0, mode="up"),
    )  # fmt: skip


@pytest.mark.slow
def test_a_sweep_continues_as_a_run(tmp_path):
    """Each value begins while "brake" waits or not; in chunks or not, and again from a store."""
    length, values = 3.2, np.linspace(0.0, 1.0, 6)
    ends = 1.0 - abs(1.0 - length * np.arange(7) % 2.0)
    for store in (None, tmp_path):
        swept = mi.sweep(wave(q=0.0), "q", values, transient=0.0, duration=length, store=store)
        gains = swept.statistics["place"].to_numpy()
        assert gains == pytest.approx(np.diff(ends) / length, abs=1e-9)


@pytest.mark.slow
def test_the_state_of_an_orbit_begins_a_run_along_it():
    """A motion between two slopes of a spring; at the start of a period "far" waits."""
    soft, stiff = mi.modes("soft", "stiff")
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (
            y.v, -(1.1 if mode == soft else 3.7) * y.x - 0.25 * y.v + 0.6 * math.cos(0.8 * t)),
        period=2.5 * math.pi,
        modes=(soft, stiff),
        guards=[
            mi.Guard("near", lambda mode, t, y, p: 0.3 - y.x, to(stiff), modes=(soft,)),
            mi.Guard("low", lambda mode, t, y, p: y.x + 0.2, to(soft), modes=(stiff,)),
            mi.Guard("far", lambda mode, t, y, p: y.x - 1.0, to(soft), modes=(stiff,)),
        ],
    )  # fmt: skip
    run = mi.simulate(system, periods=40, options=WAYS[1])
    orbit = mi.find_orbit(run)
    assert orbit.state.mode == "stiff"
    assert orbit.state.x < 1.0
    for state in (orbit.state, run.final):
        along = mi.simulate(system, initial=state, periods=2, options=WAYS[1])
        assert along.events["event"].tolist() == ["low", "near"] * 2
    fresh = mi.State(x=run.final.x, v=run.final.v, mode="stiff")
    assert mi.simulate(system, initial=fresh, periods=1).events["event"].iloc[0] == "far"


@ways
def test_a_condition_fires_at_once(options):
    # It leads back at -1, where "turns" is at zero and falls.
    with pytest.raises(mi.RunError, match="push against each other"):
        mi.simulate(saw(condition=True), duration=5.0, options=options)


@ways
@pytest.mark.parametrize(("k", "d"), [(1e3, 10.0), (50.0, 0.5), (1e4, 250.0)])
def test_a_contact_that_cannot_pull(k, d, options):
    """A ball on a spring and damper, which it leaves where the force vanishes: SciPy, by arcs."""
    free, on = mi.modes("free", "on")

    def flow(mode, t, y, p):
        return y.v, -9.81 - (k * y.x + d * y.v if mode == on else 0.0)

    ball = mi.System(
        states=("x", "v"), flow=flow, initial={"x": 1.0}, modes=(free, on),
        guards=[
            mi.Guard("touches", lambda mode, t, y, p: y.x, to(on), modes=(free,)),
            mi.Guard("leaves", lambda mode, t, y, p: -(k * y.x + d * y.v), to(free), modes=(on,)),
        ],
    )  # fmt: skip
    run = mi.simulate(ball, duration=1.6, options=options)
    t, y, pressed, times = 0.0, np.array([1.0, 0.0]), False, []
    while t < 1.6:

        def margin(t, y, pressed=pressed):
            return -(k * y[0] + d * y[1]) if pressed else y[0]

        def slope(t, y, pressed=pressed):
            return y[1], -9.81 - (k * y[0] + d * y[1] if pressed else 0.0)

        margin.terminal, margin.direction = True, -1
        arc = solve_ivp(slope, (t, 1.6), y, "DOP853", rtol=1e-12, atol=1e-14, events=margin,
                        max_step=0.02)  # fmt: skip
        t, y = arc.t[-1], arc.y[:, -1]
        if arc.status == 1:
            pressed = not pressed
            times.append(t)
    assert run.events["t"].to_numpy() == pytest.approx(times, abs=1e-7)
    assert run.final.x == pytest.approx(y[0], abs=1e-7)


@ways
@pytest.mark.parametrize("order", [None, 0])
def test_events_at_times_need_no_modes(options, order):
    """At t = 1, 2, 2, 3: k becomes 2, 5, 7, 9, as by triggers of SBML; x' = k."""

    def at(name, time, k, **more):
        return mi.Guard(
            name,
            lambda mode, t, y, p: time - y.s,
            lambda mode, t, y, p: (mode, (y.s, y.x, k)),
            **more,
        )

    chain = mi.System(
        states=("s", "x", "k"),
        flow=lambda mode, t, y, p: (1.0, y.k, 0.0),
        guards=[
            at("d", 3.0, 9.0),
            at("b", 2.0, 5.0),
            at("c", 2.0, 7.0, order=order),
            at("a", 1.0, 2.0),
        ],
    )
    run = mi.simulate(chain, duration=4.0, options=options)
    both = [("c", 2.0), ("b", 2.0)] if order == 0 else [("b", 2.0), ("c", 2.0)]
    assert log(run) == [("a", 1.0), *both, ("d", 3.0)]
    assert run.final.x == pytest.approx(2.0 + (5.0 if order == 0 else 7.0) + 9.0, abs=1e-9)


@ways
@pytest.mark.parametrize(("shift", "fires"), [(-3.0, True), (-0.5, False)])
@pytest.mark.parametrize("watched", [True, False])
def test_a_jump_over_a_margin_fires(options, shift, fires, watched):
    """x = 1 + s jumps at s = 1; the margin is x, positive before."""
    jumper = mi.System(
        states=("s", "x", "hits"),
        initial={"x": 1.0},
        flow=lambda mode, t, y, p: (1.0, 1.0, 0.0),
        modes=(DOWN, UP),
        guards=[
            mi.Guard("jump", lambda mode, t, y, p: 1.0 - y.s,
                     lambda mode, t, y, p: (UP, (y.s, y.x + shift, y.hits)), modes=(DOWN,)),
            mi.Guard("low", lambda mode, t, y, p: y.x,
                     lambda mode, t, y, p: (mode, (y.s, y.x, y.hits + 1.0)),
                     modes=None if watched else (UP,)),
        ],
    )  # fmt: skip
    run = mi.simulate(jumper, duration=4.0, options=options)
    assert log(run) == [("jump", 1.0), ("low", 1.0)][: 1 + fires]
    assert run.final.hits == fires


@ways
def test_a_fall_at_a_switching_time(options):
    """The margin jumps from 2 to -1 at 0.8 T, and back at T = 2."""

    def margin(mode, t, y, p):
        return 2.0 if t % 2.0 < 1.6 else -1.0

    count = mi.System(
        states=("n",), flow=lambda mode, t, y, p: (0.0,), period=2.0, switches=(1.6, 2.0),
        guards=[mi.Guard("falls", margin, lambda mode, t, y, p: (mode, (y.n + 1.0,)))],
    )  # fmt: skip
    run = mi.simulate(count, periods=3, options=options)
    falls = run.events.query("event == 'falls'")
    assert falls["t"].to_numpy() == pytest.approx([1.6, 3.6, 5.6])


@ways
@pytest.mark.parametrize("band", [0.0, 0.1])
def test_a_comparator_of_one_guard(options, band):
    """Without hysteresis it has no motion; with a band b it switches every b."""
    relay = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (-1.0 if mode == DOWN else 1.0,),
        modes=(DOWN, UP),
        initial={"x": 0.55},
        guards=[mi.Guard("switches",
                         lambda mode, t, y, p: y.x if mode == DOWN else p.band - y.x,
                         lambda mode, t, y, p: (UP if mode == DOWN else DOWN, y))],
        parameters={"band": band},
    )  # fmt: skip
    if band == 0.0:
        with pytest.raises(mi.RunError, match="push against each other at 'switches'"):
            mi.simulate(relay, duration=1.0, options=options)
    else:
        run = mi.simulate(relay, duration=1.0, options=options)
        assert run.events["t"].to_numpy() == pytest.approx(0.55 + band * np.arange(5), abs=1e-9)


# --- Orbits

# --- Flat zeros

FLYING, RESTING = mi.modes("flying", "resting")
FLAT = {
    "cube": lambda mode, t, y, p: (y.h / p.size) ** 3,
    "fifth power": lambda mode, t, y, p: (y.h / p.size) ** 5,
    "seventh power": lambda mode, t, y, p: (y.h / p.size) ** 7,
    "signed square": lambda mode, t, y, p: y.h * abs(y.h) / p.size**2,
    "cube of sinh": lambda mode, t, y, p: math.sinh(y.h / p.size) ** 3,
}


@pytest.mark.parametrize(
    ("margin", "h", "g", "e", "size", "method", "engine"),
    [
        (FLAT["cube"], 2.0, 1.6, 0.5, 3.0, "dop853", "interpreted"),
        (FLAT["seventh power"], 0.02, 9.8, 0.85, 1.0, "adams", "compiled"),
        (FLAT["fifth power"], 0.4, 9.8, 0.55, 1.0, "bdf", "compiled"),
        *(
            pytest.param(FLAT[margin], *case, method, "compiled", marks=pytest.mark.slow)
            for margin, case in (
                ("cube", (50.0, 9.8, 0.8, 1.0)),
                ("cube", (3e-6, 9.81, 0.7, 1e-6)),
                ("fifth power", (50.0, 9.8, 0.8, 1.0)),
                ("fifth power", (0.4, 9.8, 0.55, 1.0)),
                ("seventh power", (0.02, 9.8, 0.85, 1.0)),
                ("signed square", (0.7, 9.8, 0.93, 0.4)),
                ("signed square", (0.02, 9.8, 0.85, 1.0)),
                ("cube of sinh", (0.7, 1.6, 0.35, 1.3)),
            )
            for method in ("adams", "dop853")
        ),
    ],
)
def test_a_flat_margin_has_the_events_of_its_sign(margin, h, g, e, size, method, engine):
    options = mi.Options(method=method, engine=engine)

    def fall(guards, duration):
        ball = mi.System(
            states=("h", "v"),
            flow=lambda mode, t, y, p: (y.v, -p.g) if mode == FLYING else (0.0, 0.0),
            modes=(FLYING, RESTING),
            initial={"h": h},
            parameters={"g": g, "e": e, "size": size},
            guards=guards,
        )
        return mi.simulate(ball, duration=duration, options=options).events

    first = math.sqrt(2.0 * h / g)
    seen = fall([mi.Guard("ground", margin)], 1.5 * first)
    assert seen["t"].to_numpy() == pytest.approx([first], rel=1e-7)
    impact = mi.Impact(
        "ground",
        margin,
        lambda mode, t, y, p: (FLYING, (0.0, -p.e * y.v)),
        rest=lambda mode, t, y, p: (RESTING, (0.0, 0.0)),
        modes=(FLYING,),
    )
    end = first * (1.0 + e) / (1.0 - e)
    events = fall([impact], 1.2 * end)
    assert events["event"].iloc[-1] == "chatter ends"
    assert events["t"].iloc[-1] == pytest.approx(end, rel=1e-8)


@ways
def test_a_flat_zero_of_time_fires_once(options):
    """Zeros of (t - 5)^2 sin(pi t) and, at t = 3, of 1 - (4 - t)^6, in few evaluations."""
    calls = []

    def crossing(name, sign, function):
        def margin(mode, t, y, p):
            calls.append(name)
            return sign * function(t)

        return mi.Guard(name, margin)

    def flat(t):
        return (t - 5.0) ** 2 * math.sin(math.pi * t)

    def steep(t):
        return 1.0 - (4.0 - t) ** 6 if t < 4.0 else 1.0

    def times(*guards):
        system = mi.System(states=("x",), flow=lambda mode, t, y, p: (1.0,), guards=guards)
        return mi.simulate(system, duration=9.5, options=options).events["t"].to_numpy()

    falls, rises = crossing("falls", 1.0, flat), crossing("rises", -1.0, flat)
    assert times(falls) == pytest.approx([1.0, 3.0, 5.0, 7.0, 9.0], abs=1e-12)
    assert times(falls, rises, crossing("steep", -1.0, steep)) == pytest.approx(
        [0.0, 1.0, 2.0, 3.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0], abs=1e-12
    )
    assert len(calls) < 30_000


def bouncer(margin, force, initial, **parameters):
    """A ball over the floor at 0.37, where the bounces leave the position as it is."""
    return mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, force(t)) if mode == FLYING else (0.0, 0.0),
        modes=(FLYING, RESTING),
        initial=initial,
        parameters=parameters,
        guards=[
            mi.Impact(
                "floor",
                margin,
                lambda mode, t, y, p: (FLYING, (y.x, -p.e * y.v)),
                rest=lambda mode, t, y, p: (RESTING, (y.x, 0.0)),
                modes=(FLYING,),
            )
        ],
    )


@pytest.mark.slow(all=True)
@pytest.mark.parametrize(
    "margin",
    [
        lambda mode, t, y, p: y.x - 0.37 - math.sin(y.x - 0.37),
        lambda mode, t, y, p: y.x - 0.37 - math.tanh(y.x - 0.37),
        lambda mode, t, y, p: math.copysign(math.exp(-0.01 / (y.x - 0.37) ** 2), y.x - 0.37),
    ],
    ids=["h - sin h", "h - tanh h", "flat to all orders"],
)
@pytest.mark.parametrize("e", [0.35, 0.9])
@ways
def test_a_zero_that_rounding_hides_is_refused(margin, e, options):
    ball = bouncer(margin, lambda t: -2.3, {"x": 1.6}, e=e)
    with pytest.raises(mi.RunError, match="hide the zero of the margin of 'floor'"):
        mi.simulate(
            ball, duration=1.1 * math.sqrt(2.46 / 2.3) * (1.0 + e) / (1.0 - e), options=options
        )


def test_chatter_at_a_flat_zero_under_a_varying_force():
    """The same ball with its gap as the margin, whose chatter is located by rates."""
    ends = []
    for power in (1, 3):
        ball = bouncer(
            lambda mode, t, y, p, power=power: (y.x - 0.37) ** power,
            lambda t: -2.3 - 1.9 * math.sin(1.3 * t),
            {"x": 1.1},
            e=0.6,
        )
        events = mi.simulate(ball, duration=8.0, options=WAYS[1]).events
        ends.append(events.query("event == 'chatter ends'")["t"].iloc[0])
    assert ends[1] == pytest.approx(ends[0], abs=3e-9)


# --- Friction


def test_a_slip_that_reverses_is_not_called_sticking():
    """A block on a spring turns at 1.01 - 0.08 n; it sticks within the friction 0.04 only."""
    block = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -y.x), initial={"x": 1.01},
        parts=[mi.Friction("ground", "v", mu=0.04)],
    )  # fmt: skip
    events = mi.simulate(block, duration=60.0, options=WAYS[1]).events
    assert set(events["event"]) == {"ground slip end"}
    assert (events["mode after"] == "stuck").to_numpy().nonzero()[0].tolist() == [len(events) - 1]


@pytest.mark.parametrize(
    ("count", "rise", "message"),
    [
        (2, 0.0, "the modes 'a' and 'b' push against each other at 'to b' and 'to a'"),
        (2, 1e-7, "the modes 'a' and 'b' push against each other at 'to b' and 'to a'"),
        (2, 1e-5, "one period held more than max_events = 100 events"),
        (3, 0.0, "the same state comes back after"),
    ],
)
def test_two_modes_that_push_against_each_other_are_named(count, rise, message):
    """Modes in a ring, each with a guard that lifts x by `rise` where x falls through zero."""
    modes = mi.modes(*"abc"[:count])

    def guard(mode, following):
        def transition(mode, t, y, p):
            return following, (rise,)

        return mi.Guard(
            f"to {following.name}", lambda mode, t, y, p: y.x, transition, modes=(mode,)
        )

    ring = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (-1.0,),
        modes=modes,
        guards=[guard(modes[k], modes[(k + 1) % count]) for k in range(count)],
        initial={"x": 1.0},
    )
    options = mi.Options(engine="interpreted", method="dop853", max_events=100)
    with pytest.raises(mi.RunError, match=message):
        mi.simulate(ring, duration=2.0, options=options)


@ways
@pytest.mark.parametrize("before", [1e-3, 1e-9, 1e-12])
def test_an_event_shortly_before_a_switch_has_its_own_time(options, before):
    """x grows by 1 in a period, and a switch adds 10 where half of it is over."""
    system = mi.System(
        states=("x",),
        flow=lambda mode, t, y, p: (1.0,),
        guards=[mi.Guard("mark", lambda mode, t, y, p: 0.5 - before - y.x)],
        switches=(0.5,),
        switch_transition=lambda mode, t, y, p: (mode, (y.x + 10.0,)),
        period=1.0,
    )
    events = mi.simulate(system, periods=0.7, options=options).events
    assert len(events) == 2
    assert events["event"].iloc[0] == "mark"
    assert events["t"].tolist() == pytest.approx([0.5 - before, 0.5], rel=0.0, abs=1e-14)
