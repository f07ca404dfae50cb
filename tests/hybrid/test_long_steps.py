"""Long steps of systems that move slowly beside their time scale: nothing is missed within them."""

from __future__ import annotations

import math

import pytest

import mems_impact as mi

METHODS = ("adams", "bdf", "dop853", "auto")


def options(method):
    return mi.Options(method=method)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("mu", [1e-6, 1e-3])
def test_a_slow_slide_ends_at_its_time_in_few_steps(method, mu):
    box = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, 0.0), parameters={"mu": 0.3},
        initial={"v": 10.0}, parts=[mi.Friction("ground", "v", mu="mu", normal=9.8)],
    )  # fmt: skip
    run = mi.simulate(box.changed(mu=mu), duration=20.0 / (9.8 * mu), options=options(method))
    assert run.events["t"].tolist() == pytest.approx([10.0 / (9.8 * mu)], rel=1e-12)
    assert run.final.x == pytest.approx(50.0 / (9.8 * mu), rel=1e-9)
    assert run.trajectory.steps < 2000


def dip(mode, t, y, p):
    """Margin that falls below zero for 0.11 units of x only, at `p.at`."""
    return 1.0 - 1.5 * math.exp(-(((y.x - p.at) / 0.06) ** 2))


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("at", [77.7, 1234.5, 60000.25])
def test_a_short_dip_of_a_margin_is_found(method, at):
    road = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (1.0,), parameters={"at": 1.0},
        guards=[mi.Guard("dip", dip)],
    )  # fmt: skip
    run = mi.simulate(road.changed(at=at), duration=at + 50.0, options=options(method))
    entry = at - 0.06 * math.sqrt(math.log(1.5))
    assert run.events["t"].tolist() == pytest.approx([entry], rel=1e-9)


@pytest.mark.quick(7)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("at", [77.7, 1234.5, 60000.25])
def test_a_narrow_change_of_the_flow_is_found(method, at):
    def flow(mode, t, y, p):
        return 1.0, 0.3 * math.exp(-(((y.x - p.at) / 0.2) ** 2))

    road = mi.System(states=("x", "v"), flow=flow, parameters={"at": 1.0})
    run = mi.simulate(road.changed(at=at), duration=at + 500.0, options=options(method))
    assert run.final.v == pytest.approx(0.06 * math.sqrt(math.pi), rel=1e-7)
    assert run.trajectory.steps < 2000


@pytest.mark.parametrize("method", METHODS)
def test_all_closest_approaches_are_recorded(method):
    def gap(mode, t, y, p):
        return 1.5 - math.sin(y.x)

    floor = mi.Impact("floor", gap, lambda mode, t, y, p: (mode, (y.x,)))
    road = mi.System(states=("x",), flow=lambda mode, t, y, p: (1.0,), guards=[floor])
    run = mi.simulate(road, duration=1000.0, options=options(method))
    approaches = run.trajectory.events.time[run.trajectory.events.kind == 3]
    assert len(approaches) == round((1000.0 - math.pi / 2) // (2.0 * math.pi)) + 1


def test_a_system_with_a_period_keeps_its_longest_step():
    box = mi.System(states=("x",), flow=lambda mode, t, y, p: (1.0,), period=1.0)
    assert mi.simulate(box, periods=100).trajectory.steps >= 1600


@pytest.mark.slow
def test_more_samples_than_memory_holds_are_refused():
    system = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (-p.k * y.x,), parameters={"k": 1.0}
    )
    run = mi.simulate(system, duration=1e4)
    with pytest.raises(mi.InvalidParameter, match=r"number of samples = 100000001: .*fewer per"):
        run.samples(per_period=10_000)
    assert len(run.samples(per_period=100, first=10.0, last=11.0)) == 101
    sweep = mi.sweep(system, "k", [1.0, 2.0], transient=0.0, duration=1e6)
    assert all("number of samples" in reason for reason in sweep.table["status"])
