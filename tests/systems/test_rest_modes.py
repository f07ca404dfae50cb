"""Modes of rest that a user writes, without constraints: a start lies where the stop is now."""

import math

import pytest

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")
FREE, HELD = mi.modes("free", "held")
WALLS = [1.0, 1.2, 1.4]


def pushed(mode, t, y, p):
    force = p.F + 0.3 * math.cos(t) - 0.1 * y.v - y.x
    return (y.v, force) if mode == FREE else (0.0, 0.0)


def gap(mode, t, y, p):
    return p.wall - y.x


def rebound(mode, t, y, p):
    return FREE, (p.wall, -0.5 * y.v)


def rest(mode, t, y, p):
    return HELD, (p.wall, 0.0)


def pressed(mode, t, y, p):
    return p.F + 0.3 * math.cos(t) - y.x


def release(mode, t, y, p):
    return FREE, (y.x, 0.0)


def body(*guards, **more):
    guards = guards or (mi.Impact("wall", gap, rebound, rest=rest, modes=(FREE,)),)
    return mi.System(
        states=("x", "v"), flow=pushed, period=2.0 * math.pi, parameters={"wall": 1.0, "F": 2.0},
        guards=[*guards, mi.Guard("release", pressed, release, modes=(HELD,))], **more,
    )  # fmt: skip


def swept(system, values=WALLS, parameter="wall"):
    given = {"direction": "up", "transient": 20, "periods": 1, "options": PLAIN}
    return mi.sweep(system, parameter, values, **given).table


@pytest.mark.quick(1)
@pytest.mark.parametrize("typical", [None, {"x": 1e-3, "v": 20.0}], ids=["plain", "typical"])
def test_a_sweep_carries_a_resting_body_along_with_its_stop(typical):
    table = swept(body(typical=typical))
    assert table["x"].tolist() == pytest.approx(WALLS)


@pytest.mark.slow
def test_a_stop_that_only_a_transition_describes():
    caught = mi.Guard("caught", gap, rest, modes=(FREE,))
    assert swept(body(caught))["x"].iloc[-1] == pytest.approx(1.4)


def test_functions_that_write_into_arrays():
    def flow(mode, t, y, p, dy):
        dy[0] = y[1] if mode == 0 else 0.0
        dy[1] = 2.0 - 0.1 * y[1] - y[0] if mode == 0 else 0.0

    def margin(mode, t, y, p):
        return p.wall - y[0]

    def stop(mode, t, y, p, new):
        new[0], new[1] = p.wall, 0.0
        return 1

    system = mi.System(
        states=2, flow=flow, parameters={"wall": 1.0}, modes=("free", "held"), time_scale=1.0,
        guards=[mi.Guard("caught", margin, stop, modes=(FREE,))],
    )  # fmt: skip
    run = mi.simulate(
        system.changed(wall=1.5), duration=1.0, options=PLAIN,
        initial=mi.State(u0=1.0, mode="held"),
    )  # fmt: skip
    assert run.final["u0"] == 1.5


def test_of_two_stops_the_nearer_one():
    def other_gap(mode, t, y, p):
        return y.x + 3.0 * p.wall

    def other_rest(mode, t, y, p):
        return HELD, (-3.0 * p.wall, 0.0)

    system = body(
        mi.Impact("wall", gap, rebound, rest=rest, modes=(FREE,)),
        mi.Impact("other", other_gap, rebound, rest=other_rest, modes=(FREE,)),
    )
    for start, end in ((1.0, 1.2), (-3.0, -3.6)):
        run = mi.simulate(
            system.changed(wall=1.2), periods=0.5, initial=mi.State(x=start, mode=HELD),
            options=PLAIN,
        )  # fmt: skip
        assert run.final.x == pytest.approx(end)


def test_a_body_that_sticks_to_a_belt():
    slides, sticks = mi.modes("slides", "sticks")

    def flow(mode, t, y, p):
        return (y.v, 0.0) if mode == sticks else (y.v, -math.copysign(0.3, y.v - p.belt))

    def slip(mode, t, y, p):
        return p.belt - y.v

    def stick(mode, t, y, p):
        return sticks, (y.x, p.belt)

    system = mi.System(
        states=("x", "v"), flow=flow, parameters={"belt": 0.2}, cyclic=("x",), time_scale=1.0,
        guards=[mi.Guard("stick", slip, stick, modes=(slides,))], modes=(slides, sticks),
    )  # fmt: skip
    run = mi.simulate(
        system.changed(belt=0.5), duration=1.0, initial=mi.State(v=0.2, mode=sticks), options=PLAIN
    )
    assert run.final.v == 0.5


def test_a_body_that_rests_on_another_body():
    alone, both = mi.modes("alone", "both")

    def flow(mode, t, y, p):
        pull = -y.z + p.F
        return (y.w, 0.5 * pull, y.w, 0.5 * pull) if mode == both else (y.v, -1.0, y.w, pull)

    def height(mode, t, y, p):
        return y.x - y.z - p.size

    def land(mode, t, y, p):
        speed = 0.5 * (y.v + y.w)
        return both, (y.z + p.size, speed, y.z, speed)

    system = mi.System(
        states=("x", "v", "z", "w"), flow=flow, parameters={"F": 0.1, "size": 0.3},
        modes=(alone, both), guards=[mi.Guard("land", height, land, modes=(alone,))],
        time_scale=1.0,
    )  # fmt: skip
    run = mi.simulate(
        system.changed(size=0.4), duration=1.0, options=PLAIN,
        initial=mi.State(x=0.4, v=0.3, z=0.1, w=0.3, mode=both),
    )  # fmt: skip
    assert run.final.x - run.final.z == pytest.approx(0.4)


def test_other_modes_start_where_they_are_reported():
    heats, cools = mi.modes("heats", "cools")

    def flow(mode, t, y, p):
        return (2.0 - y.T if mode == heats else -y.T), 0.0

    def hot(mode, t, y, p):
        return p.high - y.T

    def cold(mode, t, y, p):
        return y.T - 0.5

    def off(mode, t, y, p):
        return cools, (p.high, p.level)

    def on(mode, t, y, p):
        return heats, (y.T, p.level)

    system = mi.System(
        states=("T", "level"), flow=flow, parameters={"high": 1.0, "level": 3.0}, time_scale=1.0,
        guards=[
            mi.Guard("hot", hot, off, modes=(heats,)), mi.Guard("cold", cold, on, modes=(cools,)),
        ],
    )  # fmt: skip
    for mode in (heats, cools):
        start = mi.State(T=0.8, level=1.0, mode=mode)
        run = mi.simulate(system, duration=0.01, initial=start, options=PLAIN)
        assert run.samples(2)[["T", "level"]].iloc[0].tolist() == [0.8, 1.0]


def test_basins_start_on_the_stop():
    system = body(initial=mi.State(x=1.0, mode=HELD)).changed(wall=1.3)
    recurrence = mi.RecurrenceOptions(transient=3, periods=2, exponents="none")
    found = mi.basins(system, x=("v", [0.0]), recurrence=recurrence, workers=1, options=PLAIN)
    assert found.attractors["x mean"].tolist() == pytest.approx([1.3])
