"""Sweeps of what nothing forces: cycles over a parameter, by their maxima or on a section."""

import math

import numpy as np
import pytest

import mems_impact as mi
from tests.analysis.oscillators import belt

PLAIN = mi.Options(method="dop853", rtol=1e-11, atol=1e-13, engine="interpreted")
DROPS = [0.4, 0.5]


def dropped(**arguments):
    """Sweep the friction drop of the block on the belt, over two or three cycles a value."""
    system = belt(v=0.3, Fs=1.0)
    spans = {"transient": 8.0, "duration": 12.0, "options": PLAIN}
    return mi.sweep(system, "Fd", [1.0 - drop for drop in DROPS], **spans, **arguments).table


def test_maxima_of_each_state():
    """It slips round a circle of the radius hypot(D, v) about x = Fd, and sticks at its top v."""
    table = dropped()
    assert list(table.columns) == [
        "Fd", "direction", "number", "x", "v", "impacts per time", "impacts per time error",
        "status",
    ]  # fmt: skip
    for drop in DROPS:
        rows = table[np.isclose(table["Fd"], 1.0 - drop)]
        assert rows["number"].tolist() == list(range(len(rows)))
        assert rows["x"].dropna().to_numpy() == pytest.approx(
            1.0 - drop + math.hypot(drop, 0.3), abs=1e-9
        )
        assert rows["v"].dropna().to_numpy() == pytest.approx(0.3, abs=1e-9)
        assert rows["x"].count() >= 1
        assert rows["v"].count() >= 1
    assert table.attrs["units"]["x"] == "m"


def spinning(mode, t, y, p):
    r2 = y.x * y.x + y.y * y.y
    return p.a * y.x - y.y - y.x * r2, y.x + p.a * y.y - y.y * r2


def rotor(**more):
    """Hopf's normal form: cycles of the radius sqrt(a), once round in 2 pi."""
    return mi.System(
        states=("x", "y"), flow=spinning, parameters={"a": 1.0}, initial={"x": 0.4}, **more
    )


@pytest.mark.slow
def test_a_section_and_both_ways():
    sweep = mi.sweep(
        rotor(section=("x", 0.0)), "a", [0.5, 1.0], direction="both", section=-1,
        transient=40.0, duration=13.0, initial=mi.State(x=0.4), options=PLAIN,
    )  # fmt: skip
    table = sweep.table
    assert table["y"].to_numpy() == pytest.approx(np.sqrt(table["a"]), abs=1e-9)
    assert len(table) == 8  # two rounds a value
    summary = sweep.statistics
    assert summary["a"].tolist() == [0.5, 1.0, 1.0, 0.5]
    assert summary["crossings"].tolist() == [2, 2, 2, 2]
    assert not summary["impacting"].any()


def test_what_is_at_rest_has_one_maximum():
    system = rotor()
    table = mi.sweep(
        system, "a", [0.5, 1.0], transient=30.0, duration=13.0, initial=mi.State(x=0.4),
        options=PLAIN,
    ).table  # fmt: skip
    for a, rows in table.groupby("a"):
        assert rows["x"].to_numpy() == pytest.approx(math.sqrt(a), abs=1e-9)
        assert rows["y"].to_numpy() == pytest.approx(math.sqrt(a), abs=1e-9)
    at_rest = mi.sweep(
        system, "a", [-1.0], transient=5.0, duration=2.0, initial=mi.State(x=0.0, y=0.0),
        options=PLAIN,
    ).table  # fmt: skip
    assert at_rest[["number", "x", "y"]].to_numpy().tolist() == [[0.0, 0.0, 0.0]]


def fall(mode, t, y, p):
    return y.v, -p.g


def height(mode, t, y, p):
    return y.x


def bounce(mode, t, y, p):
    return mode, (0.0, -y.v)


def test_jumps_are_maxima_and_impacts_are_counted_per_time():
    """A ball that loses nothing bounces at sqrt(2 g h) for ever, every 2 sqrt(2 h / g)."""
    ball = mi.System(
        states=("x", "v"),
        flow=fall,
        parameters={"g": 2.0},
        guards=[mi.Impact("floor", height, bounce)],
        initial={"x": 1.0},
    )
    table = mi.sweep(ball, "g", [2.0], transient=0.5, duration=10.0, options=PLAIN).table
    assert table["x"].dropna().to_numpy() == pytest.approx(1.0, abs=1e-9)
    assert table["v"].dropna().to_numpy() == pytest.approx(2.0, abs=1e-9)
    assert table["v"].count() == 5
    assert set(table["impacts per time"]) == {0.5}


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ({}, "duration: the system is autonomous: give the times"),
        ({"duration": 1.0}, "transient: the system is autonomous"),
        ({"transient": 1.0, "periods": 3}, "periods = 3: the system has no forcing period"),
        ({"transient": -1.0, "duration": 1.0}, "transient = -1: must be a finite number >= 0"),
        ({"transient": 0.0, "duration": 0.0}, "duration = 0: must be a finite number > 0"),
    ],
)
def test_spans_have_to_be_said(arguments, told):
    with pytest.raises(mi.InvalidParameter, match=told):
        mi.sweep(rotor(), "a", [1.0], **arguments)


def test_of_forced_systems_periods_are_said():
    zhao, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
    with pytest.raises(mi.InvalidParameter, match=r"duration = 3: .* give periods"):
        mi.sweep(zhao, drive, "amplitude", [0.2], duration=3.0)
