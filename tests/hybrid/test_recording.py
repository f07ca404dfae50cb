"""Guards that only record: margins may be negative, and are told once where they fall there."""

import math

import pytest

import mems_impact as mi

WAYS = [mi.Options(engine="interpreted"), mi.Options(engine="interpreted", method="dop853")]
LOW, HIGH = mi.modes("low", "high")


def ramp(*guards, **more):
    return mi.System(states=("s",), flow=lambda mode, t, y, p: (1.0,), guards=guards, **more)


def at(name, level, transition=None, **more):
    return mi.Guard(name, lambda mode, t, y, p: level - y.s, transition, **more)


def recorded_events(run):
    return list(zip(run.events["event"], run.events["t"].round(9), strict=True))


@pytest.mark.parametrize("options", WAYS, ids=["adams", "dop853"])
def test_one_that_starts_negative_waits_until_it_has_been_positive(options):
    wave = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -y.x),
        guards=[mi.Guard("falls", lambda mode, t, y, p: y.x)],
        initial={"x": -1.0},
        time_scale=100.0,
    )
    run = mi.simulate(wave, duration=13.0, options=options)
    assert run.events["t"].to_numpy() == pytest.approx([1.5 * math.pi, 3.5 * math.pi], abs=1e-7)


@pytest.mark.parametrize("options", WAYS, ids=["adams", "dop853"])
def test_another_event_does_not_tell_it_again(options):
    run = mi.simulate(ramp(at("a", 1.0), at("b", 2.0), at("c", 3.0)), duration=4.0, options=options)
    assert recorded_events(run) == [("a", 1.0), ("b", 2.0), ("c", 3.0)]


@pytest.mark.parametrize("first", [True, False])
def test_a_transition_in_the_same_instant_does_not_tell_it_again(first):
    change = at("change", 1.0, lambda mode, t, y, p: (HIGH, y), modes=(LOW,))
    guards = [at("seen", 1.0), change] if first else [change, at("seen", 1.0)]
    run = mi.simulate(ramp(*guards), duration=2.0, options=WAYS[1])
    assert recorded_events(run) == [(guard.name, 1.0) for guard in guards]


@pytest.mark.parametrize(("back", "count"), [(-3.0, 4), (0.5, 1)])
def test_a_jump_takes_it_through_zero_or_leaves_it_below(back, count):
    # The saw-tooth begins anew at `back` once it is at 1; what is told lies at 0.25.
    again = at("again", 1.0, lambda mode, t, y, p: (mode, (p.back,)))
    run = mi.simulate(ramp(again, at("seen", 0.25), parameters={"back": back}), duration=15.0,
                      options=WAYS[1])  # fmt: skip
    assert run.events["event"].tolist().count("seen") == count


def test_a_jump_over_it_is_reported_where_it_happens():
    over = at("over", 1.0, lambda mode, t, y, p: (HIGH, (5.0,)), modes=(LOW,))
    run = mi.simulate(ramp(at("seen", 3.0), over), duration=2.0, options=WAYS[1])
    assert recorded_events(run) == [("over", 1.0), ("seen", 1.0)]


def test_one_that_a_mode_begins_to_watch_below_zero_has_not_fallen():
    change = at("change", 1.0, lambda mode, t, y, p: (HIGH, y), modes=(LOW,))
    run = mi.simulate(ramp(at("seen", 0.5, modes=(HIGH,)), change), duration=2.0, options=WAYS[1])
    assert recorded_events(run) == [("change", 1.0)]


def test_two_falls_within_a_step_that_begins_and_ends_below():
    def margin(mode, t, y, p):
        return -(y.s - 1.0) * (y.s - 1.02) * (y.s - 2.0) * (y.s - 2.02)

    run = mi.simulate(
        ramp(mi.Guard("seen", margin), time_scale=50.0), duration=3.0, options=WAYS[1]
    )
    assert run.events["t"].to_numpy() == pytest.approx([1.02, 2.02], abs=1e-8)


@pytest.mark.parametrize("options", WAYS, ids=["adams", "dop853"])
def test_a_zero_that_two_guards_share_is_reported_at_its_time(options):
    # CVODE, led back into a step, took the other one's zero at its end for a root on the way.
    valley = mi.System(
        states=("y", "s"),
        flow=lambda mode, t, y, p: (2.0 * (y.s - 5.0), 1.0),
        guards=[
            mi.Guard("down", lambda mode, t, y, p: y.y),
            mi.Guard("up", lambda mode, t, y, p: -y.y),
        ],
        initial={"y": 25.0 - 0.25e-6},
        time_scale=1000.0,
    )
    run = mi.simulate(valley, duration=10.0, options=options)
    assert run.events["event"].tolist() == ["down", "up"]
    assert run.events["s"].to_numpy() == pytest.approx(run.events["t"].to_numpy(), abs=1e-9)


@pytest.mark.quick(1)
@pytest.mark.parametrize("options", WAYS, ids=["adams", "dop853"])
@pytest.mark.parametrize(("e", "falls", "rises"), [(0.5, 1, 0), (0.8, 2, 1)])
def test_every_flight_of_a_ball_has_its_apex(e, falls, rises, options):
    flying, lying = mi.modes("flying", "lying")
    ball = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -9.81) if mode == flying else (0.0, 0.0),
        parameters={"e": e},
        guards=[
            mi.Impact("floor", lambda mode, t, y, p: y.x,
                      lambda mode, t, y, p: (flying, (0.0, -p.e * y.v)),
                      rest=lambda mode, t, y, p: (lying, (0.0, 0.0)), modes=(flying,)),
            mi.Guard("apex", lambda mode, t, y, p: y.v),
            mi.Guard("half down", lambda mode, t, y, p: y.x - 0.5),
            mi.Guard("half up", lambda mode, t, y, p: 0.5 - y.x),
        ],
        initial={"x": 1.0},
    )  # fmt: skip
    run = mi.simulate(ball, duration=5.0, options=options)
    hits = run.impacts["t"].to_numpy()
    apex = run.events.loc[run.events["event"] == "apex", "t"].to_numpy()
    assert apex == pytest.approx([0.0, *(0.5 * (hits[1:] + hits[:-1]))], abs=1e-9)
    counts = run.events["event"].value_counts()
    assert (counts["half down"], counts["half up"]) == (falls, rises)
