"""Sequences of impacts beside other motions, across periods, in any units, within an instant."""

import math
from dataclasses import replace

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.errors import RunError
from mems_impact.hybrid import engine as engine_module
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import workspace
from tests.hybrid.systems import BALL, ENGINES, RESTING, STOP, ball, same, simulate, stop, times

both = pytest.mark.parametrize("engine", ENGINES)


def accumulation(e):
    return math.sqrt(2.0) * (1.0 + e) / (1.0 - e)


@pytest.mark.parametrize("e", [0.5, 0.9, 0.95, 0.99, 0.995, 0.999])
@pytest.mark.parametrize("rtol", [1e-9, 1e-13])
def test_the_end_of_a_sequence_whose_impacts_lose_little(e, rtol):
    """Flights that still have digits say where the sequence ends, however many are left."""
    expected = accumulation(e)
    options = {"rtol": rtol, "atol": rtol / 100, "max_events": 20_000}
    done = simulate(BALL, ball(e), [1.0, 0.0], expected + 1.0, period=1.0, **options)
    (end,) = times(done, workspace.ACCUMULATION)
    assert abs(end - expected) < 1e-12 / (1.0 - e) * expected
    assert done.final.mode == RESTING


def test_the_end_of_a_sequence_at_every_restitution():
    """A ball on a floor: to 1e-10 of the time."""
    for e in np.linspace(0.05, 0.95, 46).tolist():
        done = simulate(BALL, ball(e), [1.0, 0.0], 20.0, rtol=1e-13, atol=1e-15)
        assert times(done, workspace.ACCUMULATION)[0] == pytest.approx(
            accumulation(e), rel=1e-10
        ), e
        assert (done.final.mode, *done.final.y) == (RESTING, 0.0, 0.0), e


@pytest.mark.parametrize("height", [1e-12, 1e-14])
def test_three_impacts_make_a_sequence(height):
    """However weak they are: a run that is taken up between two of them knows no less."""
    done = simulate(BALL, ball(0.5), [height, 0.0], 1.0)
    assert len(times(done, workspace.TRANSITION)) == 3
    ends = times(done, workspace.ACCUMULATION)
    assert ends == pytest.approx([math.sqrt(height) * accumulation(0.5)], rel=1e-3)


def test_the_end_of_a_sequence_of_a_spring_pressed_to_a_stop():
    """From -1.5 at rest the stop at -1 is reached when cos t = 1/1.5, with the speed u.

    Position counts from the middle of the spring: its error of rtol changes the speed of an impact
    by rtol over it, which is 1e-5 in the last flights, and the end by 2/(1 - e) as much.
    """
    rtol = 1e-13
    first = math.acos(1.0 / 1.5)
    u = 1.5 * math.sin(first)
    for e in np.linspace(0.05, 0.95, 46).tolist():
        p = stop(e=e, d=-1.0)
        done = simulate(STOP, p, [-1.5, 0.0], 20.0, rtol=rtol, atol=0.01 * rtol)
        expected = first + math.fsum(2.0 * math.atan(u * e**n) for n in range(1, 3000))
        allowed = 3.0 * rtol / 2e-5 / (1.0 - e)
        assert abs(times(done, workspace.ACCUMULATION)[0] - expected) < allowed, e
        assert (done.final.mode, *done.final.y) == (RESTING, -1.0, 0.0), e


@pytest.mark.parametrize("period", [0.1, 0.37, 1.0, 50.0])
def test_a_sequence_continues_across_the_starts_of_periods(period):
    """What the loop remembers of the last impact moves with the time base."""
    expected = accumulation(0.8)
    done = simulate(BALL, ball(0.8), [1.0, 0.0], 14.0 / period, period=period)
    assert times(done, workspace.ACCUMULATION) == pytest.approx([expected], abs=1e-10)
    whole = simulate(BALL, ball(0.8), [1.0, 0.0], 14.0, period=1000.0)
    assert len(done.events[done.events.kind <= 1]) == len(whole.events[whole.events.kind <= 1])


@both
@pytest.mark.parametrize("e", [0.0, 1e-300, 1e-12, 1e-6])
def test_impacts_that_hardly_rebound_rest_at_once(e, engine):
    done = simulate(BALL, ball(e), [1.0, 0.0], 3.0, period=1.0, engine=engine)
    assert done.final.mode == RESTING
    assert done.final.y.tolist() == [0.0, 0.0]
    assert len(done.events) <= 4


@both
@pytest.mark.parametrize("method", ["adams", "bdf", "dop853"])
def test_impacts_that_hardly_rebound_rest_in_units_that_the_tolerances_do_not_fit(method, engine):
    """The first flight is lower than a step can see: each impact is late, and the next one too."""
    g, height = 9.81e6, 1e-6
    period = math.sqrt(2.0 * height / g)
    for e in np.logspace(-8, -2, 25 if engine == "compiled" else 7).tolist():
        done = simulate(
            BALL, ball(e, g), [height, 0.0], 4.0, period=period, rtol=1e-9, atol=1e-11,
            method=method, engine=engine, max_events=20,
        )  # fmt: skip
        assert (done.final.mode, *done.final.y) == (RESTING, 0.0, 0.0), e


# A ball that hops on a floor without a rule of its own for e = 0, beside a free pendulum, a
# falling stone, or another ball; p = (e of the first, e of the second).


def _side_by_side(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = 0.0 if mode in (1, 3) else -1.0
    dy[2] = y[3]
    dy[3] = 0.0 if mode in (2, 3) else -y[2] * p[2] - p[3]


def _two_floors(mode, t, y, p, g, r):
    if mode in (0, 2):
        g[0], r[0] = y[0], y[1]
    if mode in (0, 1):
        g[1], r[1] = y[2] + p[4], y[3]


def _two_rebounds(mode, code, t, y, p):
    body = code % 2
    y[2 * body] = 0.0 if body == 0 else -p[4]
    if code < 2:
        y[2 * body + 1] = -p[body] * y[2 * body + 1]
        return mode
    y[2 * body + 1] = 0.0
    return mode + 1 + body


PAIR = Automaton(
    states=("x", "u", "z", "w"),
    modes=("both move", "first rests", "second rests", "both rest"),
    guards=(
        Guard(name="first floor", order=0, impact=True),
        Guard(name="second floor", order=1, impact=True),
    ),
    flow=_side_by_side,
    margins=_two_floors,
    transition=_two_rebounds,
)


def test_an_impact_at_another_gap_some_periods_ago_does_not_prolong_a_sequence():
    """A ball strikes a ceiling, and then hops to rest on the floor."""
    margins, transition = BALL.margins, BALL.transition

    def gaps(mode, t, y, p, g, r):
        margins(mode, t, y, p, g, r)
        if mode == 0:
            g[2], r[2] = 1.0 - y[0], -y[1]

    def rebound(mode, code, t, y, p):
        if code == 2:
            y[0], y[1] = 1.0, -y[1]
            return mode
        return transition(mode, 2 if code == 3 else code, t, y, p)

    ceiling = Guard(name="ceiling", order=2, impact=True)
    guards = (*BALL.guards, ceiling)
    room = replace(BALL, guards=guards, margins=gaps, transition=rebound)
    done = simulate(
        room, ball(0.5), [0.5, math.sqrt(5.0)], 12.0,
        period=0.5, method="dop853", engine="interpreted",
    )  # fmt: skip
    assert done.events.guard[0] == 2
    # Up to the ceiling, which it leaves at the speed 2; down; and flights of 2 sqrt(6)/2^n.
    end = (math.sqrt(5.0) - 2.0) + (math.sqrt(6.0) - 2.0) + 2.0 * math.sqrt(6.0)
    assert times(done, workspace.ACCUMULATION) == pytest.approx([end], abs=1e-9)
    assert done.final.mode == RESTING


@pytest.mark.slow
@both
@pytest.mark.parametrize("e", [0.3, 0.9, 0.97])
def test_nothing_stands_still_while_a_sequence_ends(e, engine):
    """A pendulum far from its own floor swings on, to the tolerance."""
    p = (e, 0.0, 1.0, 0.0, 9.0)
    end = accumulation(e) + 0.5
    done = simulate(PAIR, p, [1.0, 0.0, 1.0, 0.0], end, period=1.0, engine=engine)
    assert done.final.mode == 1
    assert times(done, workspace.ACCUMULATION) == pytest.approx([accumulation(e)], abs=1e-9)
    assert done.final.y[2:] == pytest.approx([math.cos(end), -math.sin(end)], abs=1e-9 * end)


@pytest.mark.parametrize("lead", [1e-3, 1e-4, 1e-5, 1e-6, 1e-7])
def test_an_impact_elsewhere_is_not_lost_in_the_end_of_a_sequence(lead):
    """A stone that falls with the weight 1 strikes just before the ball comes to rest."""
    e = 0.8
    strikes = accumulation(e) - lead
    p = (e, 0.5, 0.0, 1.0, 0.0)
    done = simulate(PAIR, p, [1.0, 0.0, 0.5 * strikes**2, 0.0], strikes + 0.2, period=1.0)
    second = done.events[(done.events.guard == 1) & (done.events.kind == workspace.TRANSITION)]
    assert second.cycle[0] + second.time[0] == pytest.approx(strikes, abs=1e-9)
    assert second.before[0, 3] == pytest.approx(-strikes, abs=1e-8)
    assert done.final.mode == 1
    # The impact cuts a flight of the last ones in two: they are followed to smaller ones.
    assert times(done, workspace.ACCUMULATION) == pytest.approx([accumulation(e)], abs=3e-6)


# A ball hops on a floor; a stone falls past a mark at zero, or onto the heavy ball, which throws it
# back; p = (e of the ball, 1 where the stone meets the ball, factor of the stone's speed there).


def _ball_and_stone(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = 0.0 if mode % 2 == 1 else -1.0
    dy[2] = y[3]
    dy[3] = -1.0


def _floor_and_stone(mode, t, y, p, g, r):
    if mode % 2 == 0:
        g[0], r[0] = y[0], y[1]
    if mode < 2:
        g[1], r[1] = y[2] - p[1] * y[0], y[3] - p[1] * y[1]


def _hops_or_passes(mode, code, t, y, p):
    if code % 2 == 1:
        y[3] *= p[2]
        return mode + 2
    y[0] = 0.0
    y[1] *= -p[0] if code == 0 else 0.0
    return mode if code == 0 else mode + 1


@pytest.mark.slow
@both
@pytest.mark.parametrize("lead", [1e-5, 1e-6, 1e-7])
@pytest.mark.parametrize("meets", [True, False])
def test_what_happens_shortly_before_the_end_of_a_sequence_is_reported(meets, lead, engine):
    """Be it an impact on the very body that comes to rest, or a guard of no concern to it."""
    system = Automaton(
        states=("x", "u", "z", "w"),
        modes=("hops", "rests", "hops, stone passed", "rests, stone passed"),
        guards=(
            Guard(name="floor", order=0, impact=True),
            Guard(name="stone", order=1, impact=meets),
        ),
        flow=_ball_and_stone,
        margins=_floor_and_stone,
        transition=_hops_or_passes,
    )
    e = 0.8
    when = accumulation(e) - lead
    p = (e, 1.0, -1.0) if meets else (e, 0.0, 1.0)
    start = [1.0, 0.0, 0.5 * when**2, 0.0]
    done = simulate(system, p, start, when + 0.2, period=1.0, engine=engine)
    stone = done.events[(done.events.guard == 1) & (done.events.kind == workspace.TRANSITION)]
    assert stone.cycle + stone.time == pytest.approx([when], abs=1e-8)
    assert stone.before[:, 3] == pytest.approx([-when], abs=1e-8)
    assert times(done, workspace.ACCUMULATION) == pytest.approx([accumulation(e)], abs=3e-6)
    assert done.final.mode == 3


@pytest.mark.parametrize("method", ["adams", "dop853"])
@pytest.mark.parametrize("unit", [1e-9, 1e9])
def test_a_gap_may_be_measured_in_any_unit(unit, method):
    def scaled(mode, t, y, p, g, r):
        BALL.margins(mode, t, y, p, g, r)
        if mode != RESTING:
            g[0], r[0] = unit * g[0], unit * r[0]

    def impacts(automaton):
        options = {"period": 1.0, "method": method, "engine": "interpreted"}
        return simulate(automaton, ball(0.5), [1.0, 0.0], 6.0, **options).events

    plain, other = impacts(BALL), impacts(replace(BALL, margins=scaled))
    assert other.kind.tolist() == plain.kind.tolist()
    assert other.cycle + other.time == pytest.approx(plain.cycle + plain.time, abs=1e-11)


@both
def test_two_balls_come_to_rest_in_turns(engine):
    """Their impacts alternate; each has a sequence of its own."""
    p = (0.5, 0.7, 0.0, 1.0, 0.0)
    done = simulate(PAIR, p, [1.0, 0.0, 0.8, 0.0], 9.0, period=1.0, engine=engine)
    ends = [accumulation(0.5), math.sqrt(0.8) * accumulation(0.7)]
    assert times(done, workspace.ACCUMULATION) == pytest.approx(ends, abs=1e-9)
    assert done.final.mode == 3
    assert done.final.y.tolist() == [0.0, 0.0, 0.0, 0.0]


def test_two_equal_balls_come_to_rest_together():
    done = simulate(PAIR, (0.8, 0.8, 0.0, 1.0, 0.0), [1.0, 0.0, 1.0, 0.0], 14.0, period=1.0)
    assert times(done, workspace.ACCUMULATION) == pytest.approx(2 * [accumulation(0.8)], abs=3e-6)
    assert done.final.mode == 3


@pytest.mark.parametrize("second", [1.0, 1e-3, 1e-6, 3600.0])
@pytest.mark.parametrize("metre", [1.0, 1e-6, 1e3])
def test_a_sequence_is_the_same_in_any_units(second, metre):
    """The ball on a swinging floor: impacts, rest and release, time in `second`s."""
    p = ball(0.6, 0.9, 1.0)
    plain = simulate(BALL, p, [0.7, 0.0], 6.0, rtol=1e-11, atol=1e-13)
    weight = metre / second**2
    period = 2.0 * math.pi * second
    scaled = simulate(
        BALL, ball(0.6, 0.9 * weight, weight, 1.0 / second), [0.7 * metre, 0.0], 6.0,
        period=period, rtol=1e-11, atol=1e-13 * min(metre, metre / second),
    )  # fmt: skip
    assert scaled.final.mode == plain.final.mode
    assert scaled.final.y[0] / metre == pytest.approx(plain.final.y[0], abs=1e-8)
    for kind in (workspace.TRANSITION, workspace.ACCUMULATION):
        mine = times(scaled, kind) / second
        # How weak an impact is still counted by itself depends on the absolute tolerance.
        strong = min(len(mine), len(times(plain, kind)), 4)
        assert mine[:strong] == pytest.approx(times(plain, kind)[:strong], abs=1e-8)
    assert len(times(scaled, workspace.ACCUMULATION)) == len(times(plain, workspace.ACCUMULATION))


# A ball whose weight 1 + a t changes with time, over a floor at the height H; p = (e, a, H).


def _heavier_flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = -(1.0 + p[1] * y[2]) if mode == 0 else 0.0
    dy[2] = 1.0


def _high_floor(mode, t, y, p, g, r):
    if mode == 0:
        g[0], r[0] = y[0] - p[2], y[1]


def _off_the_high_floor(mode, code, t, y, p):
    y[0] = p[2]
    y[1] = -p[0] * y[1] if code == 0 else 0.0
    return code


HEAVIER = Automaton(
    states=("x", "v", "time"),
    modes=("flies", "rests"),
    guards=(Guard(name="floor", order=0, impact=True),),
    flow=_heavier_flow,
    margins=_high_floor,
    transition=_off_the_high_floor,
)


def accumulation_of_the_heavier(e, a, speed):
    """Return when it rests: flights in closed form, impact by impact, to the last one."""
    flights, t = [], 0.0
    while speed > 1e-20:
        half = 0.5 * (1.0 + a * t)
        # u = w/2 T + a/6 T^2, and it strikes at w/2 T + a/3 T^2.
        flight = 2.0 * speed / (half + math.sqrt(half * half + 2.0 / 3.0 * a * speed))
        speed = e * flight * (half + a / 3.0 * flight)
        flights.append(flight)
        t += flight
    return math.fsum(flights)


@pytest.mark.quick(8)
@both
@pytest.mark.parametrize(
    ("e", "a", "height", "error"),
    [
        # How the weight changes until the end: to first order, with the last flight's own share.
        (0.5, 1.0, 0.0, 5e-14),
        (0.8, -0.2, 0.0, 5e-13),
        (0.1, 1.0, 1e4, 1e-8),
        (0.5, 0.1, 1e4, 4e-8),
        (0.8, 0.1, 1e4, 5e-8),
        # So fast that the impacts go on: neither too few nor, with a gap of few digits, too many.
        (0.8, 1.0, 1e6, 6e-6),
        (0.8, 1000.0, 1e6, 6e-6),
        (0.95, 1000.0, 1e4, 2e-5),
    ],
)
def test_the_end_of_a_sequence_under_a_weight_that_changes(e, a, height, error, engine):
    """High above zero the gap has few digits, and flights are weak early."""
    speed = 0.5 * (1.0 - e)
    expected = accumulation_of_the_heavier(e, a, speed)
    done = simulate(
        HEAVIER, (e, a, height), [height, speed, 0.0], expected + 0.3,
        period=1.0, method="dop853", rtol=1e-13, atol=1e-15, engine=engine,
    )  # fmt: skip
    assert times(done, workspace.ACCUMULATION) == pytest.approx([expected], rel=0.0, abs=error)
    assert done.final.mode == RESTING


# A ball between a floor and a paddle that comes closer with every stroke, and is taken away when it
# is at p[0]; y = (x, v, height of the paddle).


def _under_a_paddle(mode, t, y, p, dy):
    dy[0], dy[1], dy[2] = (y[1], -1.0, 0.0) if mode == 0 else (0.0, 0.0, 0.0)


def _floor_and_paddle(mode, t, y, p, g, r):
    if mode == 0:
        g[0], r[0] = y[0], y[1]
        g[1], r[1] = y[2] - y[0], -y[1]


def _thrown_back(mode, code, t, y, p):
    if code == 1:
        y[1] = -y[1]
        y[2] = 0.5 * y[2] if y[2] > p[0] else 1000.0
        return 0
    y[0] = 0.0
    y[1] *= -0.9 if code == 0 else 0.0
    return 0 if code == 0 else 1


PADDLE = Automaton(
    states=("x", "v", "height"),
    modes=("flies", "rests"),
    guards=(Guard(name="floor", order=0, impact=True), Guard(name="paddle", order=1)),
    flow=_under_a_paddle,
    margins=_floor_and_paddle,
    transition=_thrown_back,
)


@both
@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_a_ball_that_is_thrown_back_makes_no_sequence(engine, method):
    """Its flights shrink, and its speeds, but it comes back far too soon for them."""
    done = simulate(
        PADDLE, (1e-7,), [0.0, 0.5, 1e-5], 0.3, period=1.0, atol=1e-3, method=method, engine=engine
    )
    struck = times(done, workspace.TRANSITION, 0)
    assert len(struck) == 8
    left, speed = 0.3 - struck[-1], 0.5 * 0.9**8
    assert done.final.mode == 0
    assert done.final.y[0] == pytest.approx(speed * left - 0.5 * left**2, rel=1e-4)


# Newton's cradle: n equal balls in a row, the first one fast; p = (e,). y = positions, speeds.
COUNT = 17


def _cradle_flow(mode, t, y, p, dy):
    for i in range(COUNT):
        dy[i] = y[COUNT + i]
        dy[COUNT + i] = 0.0


def _cradle_gaps(mode, t, y, p, g, r):
    for i in range(COUNT - 1):
        g[i] = y[i + 1] - y[i]
        r[i] = y[COUNT + i + 1] - y[COUNT + i]


def _cradle_blow(mode, code, t, y, p):
    i = code % (COUNT - 1)
    e = p[0] if code < COUNT - 1 else 0.0
    y[i + 1] = y[i]
    change = 0.5 * (1.0 + e) * (y[COUNT + i] - y[COUNT + i + 1])
    y[COUNT + i] -= change
    y[COUNT + i + 1] += change
    return mode


CRADLE = Automaton(
    states=tuple(f"{what}{i}" for what in "xv" for i in range(COUNT)),
    modes=("free",),
    guards=tuple(Guard(name=f"gap {i}", order=i, impact=True) for i in range(COUNT - 1)),
    flow=_cradle_flow,
    margins=_cradle_gaps,
    transition=_cradle_blow,
)


def cradle(e, engine="compiled", place=0.0, **options):
    start = np.zeros(2 * COUNT)
    start[:COUNT] = place
    start[COUNT] = 1.0
    return simulate(CRADLE, (e,), start, 1.0, period=1.0, engine=engine, **options)


@pytest.mark.slow
@both
@pytest.mark.parametrize("place", [0.0, 1.0])
@pytest.mark.parametrize(("e", "impacts"), [(1.0, 16), (0.9, 136)])
def test_a_cradle_takes_the_impacts_that_it_needs(e, impacts, place, engine):
    done = cradle(e, engine, place)
    assert len(done.events) == impacts
    assert np.all(done.events.time == 0.0)
    speeds = done.final.y[COUNT:]
    assert math.fsum(speeds) == pytest.approx(1.0, abs=1e-13)
    assert np.all(np.diff(speeds) >= -1e-14)


def test_a_cradle_that_collapses_ends_in_one_speed():
    """Infinitely many impacts in no time: followed until rounding alone is left of them."""
    done = cradle(0.5, max_events=100_000)
    assert len(done.events) > 1000
    speeds = done.final.y[COUNT:]
    assert math.fsum(speeds) == pytest.approx(1.0, abs=1e-12)
    assert np.all(np.diff(speeds) >= -1e-12)


def test_a_budget_that_a_collapse_spends_is_reported_with_its_instant():
    told = (
        "200 events, 201 of them in its last instant.*raise max_events: bodies that touch in a row"
    )
    with pytest.raises(RunError, match=told):
        cradle(0.5, max_events=200)


@pytest.mark.quick(1)
@both
def test_an_instant_may_hold_more_events_than_the_buffer(engine, monkeypatch):
    """Wherever the buffer is full, between transitions of an instant too, the run is the same."""
    whole = cradle(0.9, engine)
    monkeypatch.setattr(engine_module, "EVENT_ROWS", workspace.ROOM + 3)
    assert same(cradle(0.9, engine).events, whole.events)
    p = ball(0.6, 0.9, 1.0)
    small = simulate(BALL, p, [0.7, 0.0], 6.0, engine=engine)
    monkeypatch.undo()
    assert same(small.events, simulate(BALL, p, [0.7, 0.0], 6.0, engine=engine).events)


LIGHT, HEAVY, GROUNDED = mi.modes("light", "heavy", "resting")


def alternating(mode, t, y, p):
    if mode == LIGHT:
        return y.v, -p.light
    return (y.v, -p.heavy) if mode == HEAVY else (0.0, 0.0)


def above(mode, t, y, p):
    return y.x


def bounce_into_the_other(mode, t, y, p):
    return (HEAVY if mode == LIGHT else LIGHT), (0.0, -p.e * y.v)


def rest_for_good(mode, t, y, p):
    return GROUNDED, (0.0, 0.0)


@pytest.mark.parametrize(
    ("light", "heavy", "e"), [(1.0, 2.0, 0.5), (1.0, 10.0, 0.5), (1.0, 1.1, 0.9), (1.0, 3.0, 0.1)]
)
def test_flights_under_different_forces_take_turns(light, heavy, e):
    ball = mi.System(
        states=("x", "v"),
        flow=alternating,
        parameters={"light": light, "heavy": heavy, "e": e},
        guards=[
            mi.Impact(
                "floor", above, bounce_into_the_other, rest=rest_for_good, modes=(LIGHT, HEAVY)
            )
        ],
        initial={"x": 0.5},
    )
    options = mi.Options(method="dop853", engine="interpreted", rtol=1e-10, atol=1e-12)
    events = mi.simulate(ball, duration=30.0, options=options).events
    (end,) = events.query("event == 'chatter ends'")["t"]
    # Flights last 2 u/g; the speed u after an impact is e times that after the one before.
    first = math.sqrt(1.0 / light)
    speed = e * math.sqrt(light)
    assert abs(end - first - 2.0 * speed * (1.0 / heavy + e / light) / (1.0 - e * e)) < 1e-9


@pytest.mark.parametrize("modes", [("flying", "resting"), ("resting", "flying")])
def test_rest_is_that_of_the_guard_and_of_its_mode_whatever_their_numbers(modes):
    """A ball under a ceiling on a floor, at once; and after a fall, on a belt that moves on.

    The belt carries it at the speed 1 where it rests, and a flying ball not: so it is carried from
    the end of the sequence on, at sqrt(2) (1 + e)/(1 - e) after a fall from 1.
    """
    flying, resting = (modes.index(name) for name in ("flying", "resting"))

    def fall(mode, t, y, p):
        return (y.v, -1.0, 0.0) if mode == flying else (0.0, 0.0, 1.0)

    def bounce(mode, t, y, p):
        return flying, (0.0, -0.5 * y.v, y.z)

    system = mi.System(
        states=("x", "v", "z"),
        modes=modes,
        flow=fall,
        guards=[
            mi.Impact("ceiling", lambda mode, t, y, p: 9.0 - y.x, bounce, modes=(flying,)),
            mi.Impact(
                "floor",
                lambda mode, t, y, p: y.x,
                bounce,
                rest=lambda mode, t, y, p: (resting, (0.0, 0.0, y.z)),
                modes=(flying,),
            ),
        ],
    )
    options = mi.Options(engine="interpreted", method="dop853")
    for height, end in ((0.0, 0.0), (1.0, 3.0 * math.sqrt(2.0))):
        start = mi.State(x=height, v=0.0, mode="flying")
        run = mi.simulate(system, duration=8.0, initial=start, options=options)
        last = run.events.iloc[-1]
        assert (last["event"], run.final.mode) == ("chatter ends", "resting")
        assert last["t"] == pytest.approx(end, abs=1e-9)
        carried = run.final.z - (8.0 - end)
        # The flights that are left out, of 5e-11 of the height and less, are gone through in the
        # mode of rest: some 1e-5 of time, within which the belt moves already.
        assert abs(carried) < 1e-12 if height == 0.0 else 1e-6 < carried < 2e-5


# A rocking block that nothing shakes (docs/examples/rocking_block.py): x'' = x -+ 1 about either
# corner, and of the speed r is left at the change; p = (r,). A flight is as long as 2 artanh v.
RIGHT, LEFT, UPRIGHT = 0, 1, 2


def _rocks(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = 0.0 if mode == UPRIGHT else y[0] - (1.0 if mode == RIGHT else -1.0)


def _corner(mode, t, y, p, g, r):
    if mode != UPRIGHT:
        side = 1.0 if mode == RIGHT else -1.0
        g[0], r[0] = side * y[0], side * y[1]
        g[1], r[1] = side * y[1] + p[1], side * y[0] - 1.0


def _changes_corners(mode, code, t, y, p):
    if code == 1:
        return mode
    y[0] = 0.0
    if code == 0:
        y[1] *= p[0]
        return LEFT if mode == RIGHT else RIGHT
    y[1] = 0.0
    return UPRIGHT


BLOCK = Automaton(
    states=("x", "v"),
    modes=("right", "left", "upright"),
    guards=(Guard(name="base", order=0, impact=True), Guard(name="top", order=1)),
    flow=_rocks,
    margins=_corner,
    transition=_changes_corners,
)


def rocking(r, top=1e9, start=0.5, **options):
    """Return a run to rest, with the instants of its impacts, and those in closed form."""
    first = math.acosh(1.0 / (1.0 - start))
    speed, flights = (1.0 - start) * math.sinh(first), [first]
    while speed > 1e-20:
        speed *= r
        flights.append(2.0 * math.atanh(speed))
    expected = np.cumsum(flights)
    done = simulate(BLOCK, (r, top), [start, 0.0], expected[-1] + 1.0, period=1.0, **options)
    return done, np.array(times(done, workspace.TRANSITION, 0)), expected


@pytest.mark.quick(2)
@pytest.mark.parametrize("top", [1e9, 0.0], ids=["whole flights", "cut in two"])
@pytest.mark.parametrize(
    ("method", "rtol", "engine", "most"),
    [
        ("adams", 1e-6, "compiled", 2.0),
        ("adams", 1e-9, "compiled", 2.0),
        ("adams", 1e-9, "interpreted", 2.0),
        ("adams", 1e-12, "compiled", 8.0),
        ("bdf", 1e-6, "compiled", 10.0),
        ("bdf", 1e-9, "compiled", 15.0),
        ("bdf", 1e-9, "interpreted", 15.0),
        ("bdf", 1e-12, "compiled", 60.0),
    ],
)
def test_a_flight_is_good_to_the_tolerance_however_low_it_is(method, rtol, engine, most, top):
    """A rocking block comes down at the speed at which it rose, down to flights of 1e-12.

    In tolerances, and roundings of the time that tell the speed. An event at the top may cut
    the flight, of which the rest is then an arc of its own.
    """
    for r in (0.5, 0.8) if engine == "interpreted" else (0.5, 0.8, 0.95, 0.98):
        done, _, _ = rocking(r, top, method=method, rtol=rtol, atol=0.01 * rtol, engine=engine)
        struck = (done.events.kind == workspace.TRANSITION) & (done.events.guard == 0)
        down, up = abs(done.events.before[struck, 1]), abs(done.events.after[struck, 1])
        assert up[-1] < 1e-4
        assert (abs(down[1:] / up[:-1] - 1.0) < most * (rtol + 2.0**-50 / up[:-1])).all(), r


@pytest.mark.parametrize(
    ("method", "rtol", "restitutions"),
    [
        ("adams", 1e-6, [0.5, 0.8, 0.95, 0.98]),
        ("adams", 1e-9, [0.5, 0.8, 0.95, 0.98]),
        ("adams", 1e-12, [0.5, 0.8, 0.95, 0.98]),
        ("bdf", 1e-6, [0.5, 0.8, 0.95, 0.98]),
        ("bdf", 1e-9, [0.5, 0.8, 0.95]),
        ("bdf", 1e-12, [0.5, 0.8]),
        ("dop853", 1e-6, [0.5, 0.8, 0.95, 0.98]),
        ("dop853", 1e-12, [0.5, 0.8, 0.95, 0.98]),
    ],
)
def test_the_impacts_of_a_long_sequence_are_within_a_hundred_tolerances(method, rtol, restitutions):
    """Up to 581 impacts of a rocking block, and its rest, as parts of the time that has passed."""
    for r in restitutions:
        done, impacts, expected = rocking(r, method=method, rtol=rtol, atol=0.01 * rtol)
        (end,) = times(done, workspace.ACCUMULATION)
        assert impacts == pytest.approx(expected[: impacts.size], rel=100.0 * rtol, abs=0.0)
        assert end == pytest.approx(expected[-1], rel=100.0 * rtol, abs=0.0)
        assert (done.final.mode, *done.final.y) == (UPRIGHT, 0.0, 0.0)


@pytest.mark.parametrize("method", ["adams", "bdf"])
def test_a_sequence_may_be_taken_up_at_any_of_its_impacts(method):
    """How exactly a flight is integrated is told by its beginning, not by the one before it."""
    whole, impacts, _ = rocking(0.9, method=method)
    for k in (10, 40, impacts.size - 5):
        event = whole.events[k : k + 1]
        state, mode, phase = event.after[0], int(event.mode_after[0]), float(event.time[0])
        rest = simulate(
            BLOCK, (0.9, 1e9), state, 1.0, mode=mode, time=phase, period=1.0, method=method
        )
        again = rest.events.before[0]
        assert again.tolist() == whole.events.before[k + 1].tolist()
