"""Several parts on one system: their modes multiply, and what one does the others feel."""

from __future__ import annotations

import itertools
import math
import pickle

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.hybrid.definition import in_modes

PLAIN = mi.Options(engine="interpreted", method="dop853")
STOP = mi.Stopper("stop", "x", "v", upper=1.0, restitution="e")
GROUND = mi.Friction("ground", "v", mu="mu_d", static="mu_s")


def pushed(mode, t, y, p):
    return y.v, y.load, p.rate


def block(parts, **changes):
    values = {"rate": -0.5, "e": 0.6, "mu_s": 0.3, "mu_d": 0.2, **changes.pop("parameters", {})}
    return mi.System(
        states=("x", "v", "load"), flow=pushed, parameters=values, parts=parts, time_scale=1.0,
        **changes,
    )  # fmt: skip


@pytest.mark.parametrize("parts", [[STOP, GROUND], [GROUND, STOP]], ids=["stop first", "last"])
def test_pressed_against_a_stop_it_leaves_when_the_load_pulls_harder_than_friction(parts):
    # It rests on the stop under a load that falls from 1: at 0.3 friction bears it alone, so that
    # the stop lets go, and at -0.3 it breaks away.
    start = mi.State(x=1.0, load=1.0)
    run = mi.simulate(block(parts), duration=4.0, initial=start, options=PLAIN)
    assert run.events["event"].tolist() == ["stop lets go", "ground slips"]
    assert run.events["t"].tolist() == pytest.approx([1.4, 2.6], rel=1e-9)
    assert (run.events["x"] == 1.0).all()
    gone = 4.0 - 2.6
    assert run.final.v == pytest.approx(-0.1 * gone - 0.25 * gone**2, rel=1e-9)


@pytest.mark.parametrize("parts", [[STOP, GROUND], [GROUND, STOP]], ids=["stop first", "last"])
def test_stuck_at_a_stop_it_breaks_away_against_it_and_stays(parts):
    start = mi.State(x=1.0, load=0.0)
    rising = block(parts, parameters={"rate": 0.5})
    run = mi.simulate(rising, duration=2.0, initial=start, options=PLAIN)
    assert run.final.x == 1.0
    assert run.final.v == 0.0
    assert run.final.mode in ("held-stuck", "stuck-held")
    assert run.events["t"].iloc[0] == pytest.approx(0.6, rel=1e-9)


def test_an_impact_of_a_sliding_body_loses_what_restitution_and_friction_take():
    start = mi.State(x=0.0, v=2.0)
    calm = block([STOP, GROUND], parameters={"rate": 0.0})
    run = mi.simulate(calm, duration=20.0, initial=start, options=PLAIN)
    assert run.events["event"].tolist() == ["stop", "ground slip end"]
    speed = math.sqrt(4.0 - 2.0 * 0.2)
    (hit,) = run.impacts.to_dict("records")
    assert hit["v before"] == pytest.approx(speed, rel=1e-9)
    assert hit["v after"] == pytest.approx(-0.6 * speed, rel=1e-9)
    assert run.final.x == pytest.approx(1.0 - (0.6 * speed) ** 2 / 0.4, rel=1e-8)
    assert run.final.mode == "free-stuck"


def test_a_body_stuck_on_a_belt_is_carried_into_the_stop_again_and_again():
    belt = mi.Friction("belt", "v", mu="mu_d", static="mu_s", surface=1.0)
    carried = block([STOP, belt], parameters={"rate": 0.0})
    run = mi.simulate(carried, duration=40.0, initial={"v": 1.0}, options=PLAIN)
    # It strikes at 1, comes back at -0.6, is braked to 0 and taken along by 0.2, never to stick
    # before it strikes at 0.6, and so on: flights of 2 u/0.2 that shrink by e, until it rests.
    first = run.impacts["t"].iloc[0]
    assert first == pytest.approx(1.0, rel=1e-12)
    assert np.diff(run.impacts["t"])[:6] == pytest.approx(10.0 * 0.6 ** np.arange(1, 7), rel=1e-8)
    assert run.final == mi.State(x=1.0, v=0.0, load=0.0, mode="held-backward")
    rest = run.events.query("event == 'chatter ends'")["t"]
    assert rest.tolist() == pytest.approx([1.0 + 10.0 * 0.6 / 0.4], rel=1e-8)


def test_a_stuck_body_that_is_struck_slides():
    struck = mi.System(
        states=("x", "v", "z", "w"),
        flow=lambda mode, t, y, p: (y.v, 0.0, y.w, 0.0),
        masses={"v": 1.0, "w": 3.0},
        initial={"x": -1.0, "v": 2.0},
        parts=[
            mi.Stopper("collision", "x", "v", upper=0.0, restitution=0.5, against=("z", "w")),
            mi.Friction("ground", "w", mu=0.75),
        ],
    )  # fmt: skip
    run = mi.simulate(struck, duration=5.0, options=PLAIN)
    assert run.events["mode after"].tolist() == ["free-forward", "free-stuck"]
    speed = 2.0 * 1.5 / 4.0  # by momentum and restitution
    assert run.impacts["w after"].iloc[0] == pytest.approx(speed, rel=1e-12)
    assert run.events["t"].tolist() == pytest.approx([0.5, 0.5 + speed / 0.25], rel=1e-9)


def test_two_frictions_on_two_bodies_break_away_one_after_the_other():
    pulled = mi.System(
        states=("x", "v", "z", "w", "load"),
        flow=lambda mode, t, y, p: (
            y.v, y.load - 10.0 * (y.x - y.z), y.w, 10.0 * (y.x - y.z), 0.01,
        ),
        time_scale=1.0,
        parts=[mi.Friction("first", "v", mu=0.2), mi.Friction("second", "w", mu=0.3)],
    )  # fmt: skip
    run = mi.simulate(pulled, duration=60.0, options=PLAIN)
    events = run.events
    assert events["event"].iloc[0] == "first slips"
    assert events["t"].iloc[0] == pytest.approx(20.0, rel=1e-9)
    second = events.query("event == 'second slips'").iloc[0]
    assert 10.0 * (second["x"] - second["z"]) == pytest.approx(0.3, rel=1e-8)
    assert second["z"] == 0.0
    assert run.system.modes[4] == "forward-forward"


def test_a_block_on_a_plate_that_is_dragged_over_the_ground():
    # Both stick to what is below them; the force on the plate rises by 0.1 t.
    dragged = mi.System(
        states=("v", "w", "load"),
        flow=lambda mode, t, y, p: (0.0, y.load / p.M, 0.1),
        parameters={"m": 1.0, "M": 3.0},
        masses={"v": "m", "w": "M"},
        time_scale=1.0,
        parts=[
            mi.Friction("top", "v", mu=0.2, surface="w"),
            mi.Friction("ground", "w", mu=0.5),
        ],
    )
    run = mi.simulate(dragged, duration=15.0, options=PLAIN)
    # Together from 0.5 on, with (load - 0.5)/4; the block slips where that is 0.2.
    assert run.events["event"].tolist() == ["ground slips", "top slips"]
    assert run.events["t"].tolist() == pytest.approx([5.0, 13.0], rel=1e-9)
    assert run.events["v"].iloc[1] == run.events["w"].iloc[1]
    assert run.events["v"].iloc[1] == pytest.approx(0.1 / 4.0 * 8.0**2 / 2.0, rel=1e-9)
    assert run.final.v - run.events["v"].iloc[1] == pytest.approx(0.4, rel=1e-9)
    gain = (1.3 - 0.5 - 0.2) / 3.0 * 2.0 + 0.1 / 3.0 * 2.0
    assert run.final.w - run.events["w"].iloc[1] == pytest.approx(gain, rel=1e-9)
    assert run.final.mode == "backward-forward"


@pytest.mark.parametrize("mu", [0.2, 0.3])
def test_bodies_that_break_away_in_the_same_instant(mu):
    alike = mi.System(
        states=("v", "w", "load"),
        flow=lambda mode, t, y, p: (y.load, -y.load, 1.0),
        time_scale=1.0,
        parts=[
            mi.Friction("one", "v", mu=mu, static=0.3), mi.Friction("two", "w", mu=mu, static=0.3)
        ],
    )  # fmt: skip
    run = mi.simulate(alike, duration=1.0, options=PLAIN)
    assert sorted(run.events["event"]) == ["one slips", "two slips"]
    assert run.events["t"].tolist() == pytest.approx([0.3, 0.3], rel=1e-12)
    assert run.final.mode == "forward-backward"
    assert run.final.v == -run.final.w
    assert run.final.v == pytest.approx((0.3 - mu) * 0.7 + 0.5 * 0.49, rel=1e-9)


def test_two_frictions_on_one_body_hold_with_both_limits():
    double = mi.System(
        states=("v", "load"), flow=lambda mode, t, y, p: (y.load, 0.1), time_scale=1.0,
        parts=[mi.Friction("top", "v", mu=0.3), mi.Friction("bottom", "v", mu=0.2)],
    )  # fmt: skip
    run = mi.simulate(double, duration=8.0, options=PLAIN)
    assert run.final.v == pytest.approx(0.05 * 9.0, rel=1e-8)  # from load 0.5 at t = 5
    turned = mi.simulate(double, duration=8.0, initial={"load": 0.45}, options=PLAIN)
    assert turned.final.mode == "forward-forward"


@pytest.mark.slow
def test_systems_of_parts_are_values():
    system = block([STOP, GROUND], parameters={"rate": 0.0})
    again = pickle.loads(pickle.dumps(system))
    assert again == system
    start = mi.State(x=0.0, v=2.0)
    plain = mi.simulate(again, duration=5.0, initial=start, options=PLAIN)
    assert plain.final == mi.simulate(system, duration=5.0, initial=start, options=PLAIN).final
    assert "free-stuck" in system.summary()["modes"]
    assert list(system.functions) == ["flow"]
    assert system.functions["flow"].endswith(":pushed")
    assert system != block([STOP], parameters={"rate": 0.0})
    assert system == block([STOP, GROUND], parameters={"rate": 0.0})


def test_own_guards_find_the_modes_of_parts_by_name():
    kick = mi.Guard("kick", lambda mode, t, y, p: 1.0 if mode.ground != 0 else 0.5 - y.load,
                    lambda mode, t, y, p: (mode, (y.x, -1.0, y.load)))  # fmt: skip
    strong = block([GROUND], parameters={"rate": 0.5, "mu_s": 1.0}, guards=[kick])
    run = mi.simulate(strong, duration=1.1, options=PLAIN)
    assert run.events["event"].tolist() == ["kick"]
    assert run.final.mode == "backward"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"parts": [3]}, "parts = 3: must be each a part"),
        ({"parts": [STOP, STOP]}, "must be unique names"),
        ({"parts": [mi.Friction("a b", "v", mu=1.0)]}, "must be a Python name"),
        ({"parts": [mi.Friction("g", "z", mu=1.0)]}, "velocity of 'g' = 'z': must be one of x, v"),
        ({"parts": [mi.Friction("g", "v", mu="nu")]}, "mu of 'g' = 'nu': must be a number, a func"),
        ({"parts": [mi.Friction("g", "v", mu=math.nan)]}, "mu of 'g' = nan: must be a number"),
        ({"parts": [STOP], "masses": {"z": 1.0}}, "masses = 'z': must be velocities among"),
        ({"parts": [STOP], "modes": ("a",)}, "modes = .*: must be omitted if parts are given"),
        ({"parts": [STOP], "guards": [mi.Guard("a", lambda mode, t, y, p: 1.0, modes=(0,))]},
         "modes of 'a' = .*: must be None"),
    ],
)  # fmt: skip
def test_mistakes_are_one_sentence(changes, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        block(**changes)


def test_a_mass_of_zero_and_a_line_of_the_users_that_fails_where_a_run_starts():
    with pytest.raises(mi.InvalidParameter, match="mass of v = 0: must be > 0"):
        block([GROUND], masses={"v": 0.0})

    def failing(mode, t, y, p):
        return y.v, y.load / (y.x - 1.0), p.rate

    changes = {"time_scale": 1.0, "parameters": {"rate": 0.0, "mu_s": 0.3, "mu_d": 0.2}}
    system = mi.System(states=("x", "v", "load"), flow=failing, parts=[GROUND], **changes)
    with pytest.raises(mi.FunctionError, match=r"test_assembly\.py, line \d+.*float division"):
        mi.simulate(system, duration=1.0, initial=mi.State(x=1.0), options=PLAIN)


def test_mistakes_of_one_part():
    with pytest.raises(
        mi.InvalidParameter, match=r"upper, lower of 's' = .*: must be one of the two, or both"
    ):
        mi.Stopper("s", "x", "v", restitution=1.0)


@pytest.mark.parametrize(
    ("flow", "sentence"),
    [
        (lambda mode, t, y, p: (y.w, -y.x, 99.0), "returns 3 numbers for 2 states"),
        (lambda mode, t, y, p: (y.w, -p.K * y.x), r"reads p\.K, but there is no such parameter"),
        (lambda mode, t, y, p: y.w, "returns the one number 0"),
        (lambda mode, t, y, p: [y.w, -y.x], "returns a list"),
        (lambda mode, t, y, p: (y.w, -y.x * mode.walls), "walls"),
    ],
)
def test_a_mistake_in_a_flow_with_parts_is_reported_where_it_was_made(flow, sentence):
    with pytest.raises(mi.FunctionError, match=sentence) as caught:
        mi.System(
            states=("x", "w"),
            flow=flow,
            parameters={"k": 1.0},
            parts=[mi.Stopper("wall", "x", "w", upper=1.0, restitution=0.7)],
        )
    assert "test_assembly.py" in str(caught.value)


@pytest.mark.slow
@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("exchanged", [False, True])
def test_a_block_that_comes_to_rest_on_a_plate_leaves_it_where_the_ground_holds_it(
    turned, exchanged
):
    # On a plate that the ground holds against a push; and on one that lies on a stop.
    on, surface = ("w", "v") if exchanged else ("v", "w")
    rub = mi.Friction("rub", on, mu=0.2, surface=surface)
    holds = [
        (mi.Friction("ground", "w", mu=0.3, static=1.0), 0.5),
        (mi.Stopper("floor", "z", "w", lower=0.0, restitution=0.5), -1.0),
    ]
    for part, push in holds:
        plate = mi.System(
            states=("x", "v", "z", "w"),
            flow=lambda mode, t, y, p: (y.v, -y.x - 0.05 * y.v, y.w, p.push),
            masses={"v": 1.0, "w": 1.0},
            parameters={"push": push},
            initial={"x": 1.0171},
            time_scale=1.0,
            parts=[rub, part] if turned else [part, rub],
        )
        for start in (1.0171, 1.77):
            run = mi.simulate(plate, duration=20.0, initial=mi.State(x=start), options=PLAIN)
            assert run.events["event"].tolist() == ["rub slip end"] * len(run.events)
            assert (run.final.v, run.final.z, run.final.w) == (0.0, 0.0, 0.0)
            assert set(run.final.mode.split("-")) <= {"stuck", "held"}


def loaded(parts):
    return mi.System(
        states=("v", "w", "load"), flow=lambda mode, t, y, p: (y.load, 0.0, 0.1), time_scale=1.0,
        masses={"v": 1.0, "w": 1.0}, parts=parts,
    )  # fmt: skip


@pytest.mark.quick(1)
@pytest.mark.parametrize("turned", [False, True])
def test_two_frictions_hold_one_body_up_to_the_sum_of_their_static_limits(turned):
    parts = [
        mi.Friction("top", "v", mu=0.1, static=0.4), mi.Friction("bottom", "v", mu=0.2, static=0.5)
    ]  # fmt: skip
    run = mi.simulate(loaded(parts[::-1] if turned else parts), duration=11.0, options=PLAIN)
    assert run.events["t"].tolist() == pytest.approx([9.0], rel=1e-9)
    assert run.final.mode == "forward-forward"
    assert run.final.v == pytest.approx(0.6 * 2.0 + 0.05 * 2.0**2, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("exchanged", [False, True])
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_a_ring_of_frictions_holds_what_some_forces_within_their_limits_hold(order, exchanged):
    # The ground holds v with 0.3 and w with 0.2, and w can give v no more than 0.4, or what the
    # ground gives it; so 0.5 in all, where no force of the three is determined.
    between = ("w", "v") if exchanged else ("v", "w")
    ring = [
        mi.Friction("one", "v", mu=0.15, static=0.3),
        mi.Friction("two", "w", mu=0.05, static=0.2),
        mi.Friction("rub", between[0], mu=0.3, static=0.4, surface=between[1]),
    ]
    run = mi.simulate(loaded([ring[i] for i in order]), duration=7.0, options=PLAIN)
    assert run.events["t"].iloc[0] == pytest.approx(5.0, rel=1e-9)
    assert (run.events["t"] < 5.1).all()
    # Both move on together, since 0.4 drags the second one along.
    assert run.final.v == run.final.w
    assert run.final.v == pytest.approx((0.3 * 2.0 + 0.05 * 2.0**2) / 2.0, rel=1e-9)


@pytest.mark.quick(1)
@pytest.mark.parametrize("turned", [False, True])
def test_two_bodies_in_touch_hold_with_the_friction_of_both(turned):
    row = [
        mi.Friction("one", "v", mu=0.1, static=0.3),
        mi.Friction("two", "w", mu=0.1, static=0.2),
        mi.Stopper("touch", "x", "v", upper=0.0, restitution=0.0, against=("z", "w")),
    ]
    pushed = mi.System(
        states=("x", "v", "z", "w", "load"),
        flow=lambda mode, t, y, p: (y.v, y.load, y.w, 0.0, 0.1),
        time_scale=1.0, masses={"v": 1.0, "w": 1.0}, parts=row[::-1] if turned else row,
    )  # fmt: skip
    run = mi.simulate(pushed, duration=7.0, options=PLAIN)
    # The first one reaches its own limit at 0.3; the other one takes the rest up to 0.5.
    assert run.events["t"].iloc[:2].tolist() == pytest.approx([3.0, 5.0], rel=1e-9)
    assert run.events["w"].iloc[0] == 0.0
    assert run.final.v == run.final.w
    assert run.final.v == pytest.approx((0.3 * 2.0 + 0.05 * 2.0**2) / 2.0, rel=1e-9)


@pytest.mark.quick(1)
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_a_block_sticks_to_all_that_it_comes_to_rest_on_at_once(order):
    # It slides on the ground and along a body that lies on a stop, of which its friction can take
    # all; whichever of the two is told first to stick, both do.
    parts = [
        mi.Friction("ground", "v", mu=0.4, static=0.45),
        mi.Friction("rub", "v", mu=0.3, surface="w"),
        mi.Stopper("stop", "z", "w", lower=0.0, restitution=0.0),
    ]
    block = mi.System(
        states=("v", "z", "w", "load"),
        flow=lambda mode, t, y, p: (y.load, y.w, -0.1, 0.1),
        masses={"v": 1.0, "w": 1.0}, initial={"v": -1.0}, time_scale=1.0,
        parts=[parts[i] for i in order],
    )  # fmt: skip
    run = mi.simulate(block, duration=6.0, options=PLAIN)
    assert sorted(run.events["mode after"].iloc[0].split("-")) == ["free", "stuck", "stuck"]
    # It drags the body along, from the ground with 0.45 and the 0.1 that presses it.
    slips = run.events[run.events["event"] == "ground slips"]
    assert slips["t"].tolist() == pytest.approx([5.5], rel=1e-8)
    assert run.final.v == pytest.approx(0.5 * (0.05 * 0.5 + 0.05 * 0.5**2), rel=1e-7)


def pushed_unequally(mode, t, y, p):
    return y.v1, y.v2, 0.8 * y.load / 2.0, 0.7 * y.load, 1.0


@pytest.mark.quick(1)
@pytest.mark.parametrize("order", [(0, 1, 2), (1, 0, 2), (2, 1, 0)])
@pytest.mark.parametrize("turned", [False, True])
def test_frictions_that_bear_a_load_together_break_away_together_in_any_order(order, turned):
    # Two bodies on the ground, one on the other, under 0.8 and 0.7 times a load that rises from
    # 0.5. At 1 the ground bears no more than 0.6 + 0.9, and both slide; what rubs between them has
    # not reached its limit. Slid on the other one too, the second body could have stayed.
    one, other = ("v1", "v2") if turned else ("v2", "v1")
    parts = [
        mi.Friction("first", "v1", mu=0.3, static=0.6),
        mi.Friction("second", "v2", mu=0.5, static=0.9),
        mi.Friction("between", one, mu=0.1, static=0.3, surface=other),
    ]
    pair = mi.System(
        states=("x1", "x2", "v1", "v2", "load"),
        flow=pushed_unequally,
        parts=[parts[k] for k in order],
        masses={"v1": 2.0, "v2": 1.0},
        time_scale=1.0,
    )
    run = mi.simulate(pair, duration=1.5, initial={"load": 0.5}, options=PLAIN)
    assert run.events["t"].tolist() == pytest.approx([0.5], rel=1e-9)
    assert run.final.v1 == run.final.v2 == pytest.approx((0.7 + 0.75) / 3.0, rel=1e-9)


BARS = [("v1", 0.0), ("v2", 0.0), ("v1", "v2"), ("v3", "v1"), ("v2", "v3")]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_around_a_ring_at_rest_not_all_that_slides_does_so_in_one_direction(seed):
    # The relative speeds around a ring add up to zero: of those of contacts at rest, none can
    # begin to be positive where the others are none or positive.
    rng = np.random.default_rng(seed)
    chosen = [BARS[k] for k in rng.permutation(len(BARS))]
    parts = [
        mi.Friction(f"rub{k}", on, mu=0.1, static=float(rng.choice([0.1, 0.2])), surface=of)
        for k, (on, of) in enumerate(chosen)
    ]
    bodies = ("v1", "v2", "v3")
    loads = rng.choice([0.0, 0.1, 0.2, 0.3, -0.2], size=3).tolist()

    def still(mode, t, y, p):
        return loads[0], loads[1], loads[2]

    rings = mi.System(
        states=bodies, flow=still, parts=parts, masses=dict.fromkeys(bodies, 1.0), time_scale=1.0
    )
    run = mi.simulate(rings, duration=1e-3, options=PLAIN)
    signs = {"stuck": 0, "forward": 1, "backward": -1}
    sliding = zip(chosen, run.final.mode.split("-"), strict=True)
    speeds = {0.0: 0.0, **{body: getattr(run.final, body) for body in bodies}}
    for (on, of), mode in sliding:
        assert np.sign(round(speeds[on] - speeds[of], 12)) == signs[mode]


def test_the_condition_of_one_part_of_many_is_one_comparison():
    count = 2**12
    for stride in (1, 4, 2**11):
        held = tuple(mode for mode in range(count) if mode // stride % 2 == 1)
        condition = in_modes(held, count)
        assert "or" not in condition
        assert [mode for mode in range(count) if eval(condition)] == list(held)
    for some in ((0, 1, 4), (5,), (1, 3), tuple(range(6)), None):
        condition = in_modes(some, 6)
        chosen = [mode for mode in range(6) if eval(condition)]
        assert chosen == list(range(6) if some is None else some)
